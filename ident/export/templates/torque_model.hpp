// Feed-forward torque of the robot called @NAME@, as it was identified. C++11, no library.
//
//   std::array<double, @N@> tau = @SPACE@::torque(q, dq, ddq);   // [N m], joints in the order of @SPACE@::joints()
//
// Rigid body, rotor inertia, viscous friction, and dry friction that turns round over a speed.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace @SPACE@ {

constexpr std::size_t kJoints = @N@;
using Vector = std::array<double, kJoints>;

struct Vec3 {
  double x, y, z;
};

inline Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator*(double s, Vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3 cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

struct Mat3 {
  double m[9];
};

inline Vec3 mul(const Mat3& r, Vec3 a) {
  const double* m = r.m;
  return {m[0] * a.x + m[1] * a.y + m[2] * a.z, m[3] * a.x + m[4] * a.y + m[5] * a.z,
          m[6] * a.x + m[7] * a.y + m[8] * a.z};
}
inline Vec3 mul_transposed(const Mat3& r, Vec3 a) {
  const double* m = r.m;
  return {m[0] * a.x + m[3] * a.y + m[6] * a.z, m[1] * a.x + m[4] * a.y + m[7] * a.z,
          m[2] * a.x + m[5] * a.y + m[8] * a.z};
}
inline Mat3 product(const Mat3& a, const Mat3& b) {
  Mat3 c{};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k) c.m[3 * i + j] += a.m[3 * i + k] * b.m[3 * k + j];
  return c;
}
inline Mat3 about(Vec3 u, double angle) {
  const double c = std::cos(angle), s = std::sin(angle), v = 1.0 - c;
  return {{c + u.x * u.x * v, u.x * u.y * v - u.z * s, u.x * u.z * v + u.y * s, u.y * u.x * v + u.z * s,
           c + u.y * u.y * v, u.y * u.z * v - u.x * s, u.z * u.x * v - u.y * s, u.z * u.y * v + u.x * s,
           c + u.z * u.z * v}};
}

struct Link {
  Mat3 rotation;   // of the joint in the one before
  Vec3 offset;     // [m]
  Vec3 axis;
  bool slides;
  double mass;     // [kg]
  Vec3 first;      // mass times centre [kg m]
  Mat3 inertia;    // about the joint's frame [kg m2]
  double rotor;    // [kg m2]
  double viscous;  // [N m s/rad]
  double coulomb;  // [N m]
  double turning;  // speed over which dry friction turns round [rad/s]
};

inline const std::array<Link, kJoints>& links() {
  static const std::array<Link, kJoints> table = {{
@LINKS@
  }};
  return table;
}

inline const std::array<const char*, kJoints>& joints() {
  static const std::array<const char*, kJoints> names = {{@JOINTS@}};
  return names;
}

inline Vector torque(const Vector& q, const Vector& dq, const Vector& ddq) {
  const std::array<Link, kJoints>& table = links();
  std::array<Mat3, kJoints> turns{};
  std::array<Vec3, kJoints> levers{}, forces{}, moments{};
  Vec3 omega{0, 0, 0}, alpha{0, 0, 0}, acc{@UP@};  // standing still in gravity is being pushed upwards
  for (std::size_t i = 0; i < kJoints; ++i) {
    const Link& link = table[i];
    turns[i] = product(link.rotation, about(link.axis, link.slides ? 0.0 : q[i]));
    levers[i] = link.slides ? link.offset + mul(turns[i], q[i] * link.axis) : link.offset;
    acc = acc + cross(alpha, levers[i]) + cross(omega, cross(omega, levers[i]));
    omega = mul_transposed(turns[i], omega);
    alpha = mul_transposed(turns[i], alpha);
    acc = mul_transposed(turns[i], acc);
    const Vec3 speed = dq[i] * link.axis;
    if (link.slides) {
      acc = acc + 2.0 * cross(omega, speed) + ddq[i] * link.axis;
    } else {
      alpha = alpha + cross(omega, speed) + ddq[i] * link.axis;
      omega = omega + speed;
    }
    forces[i] = link.mass * acc + cross(alpha, link.first) + cross(omega, cross(omega, link.first));
    moments[i] = mul(link.inertia, alpha) + cross(omega, mul(link.inertia, omega)) + cross(link.first, acc);
  }
  Vector tau{};
  Vec3 force{0, 0, 0}, moment{0, 0, 0};
  for (std::size_t k = kJoints; k-- > 0;) {
    const Link& link = table[k];
    force = force + forces[k];
    moment = moment + moments[k];
    tau[k] = dot(link.slides ? force : moment, link.axis) + link.rotor * ddq[k] + link.viscous * dq[k] +
             link.coulomb * std::tanh(dq[k] / link.turning);
    force = mul(turns[k], force);
    moment = mul(turns[k], moment) + cross(levers[k], force);
  }
  return tau;
}

}  // namespace @SPACE@
