"""The whole model in one C++ header: rigid arm, losses, named laws, offsets, net and memory; no
heap, no library.

The first part is the feed-forward header's; `model_torque` adds what a simulator's file has no
words for. Its `State` holds what joints remember and is the caller's, one for each arm.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array
from ident.errors import InputError
from ident.export.controllers import write_cpp
from ident.export.identified import IdentifiedArm
from ident.laws.carried import NamedLaw
from ident.laws.motion import Losses
from ident.model.hybrid import HybridModel
from ident.model.joint_nets import DIRECTION_SCALES, LOAD_ROUNDING, JointNets
from ident.model.memory import RANGES, TIMES, TURNING, own_inputs
from ident.model.nearness import FAR

FILE = "learned_torque.hpp"
# Lines of the header that are longer than one here may be.
WITHIN = (
    "inline double within(double x, double low, double high) "
    "{ return x < low ? low : (x > high ? high : x); }"
)
ABOUT_NET = (
    "// Net of a joint by its speed, acceleration and load; beyond its training it says what it "
    "says at the edge,"
)
SIGNATURE = (
    "inline Vector model_torque(const Vector& q, const Vector& dq, const Vector& ddq, double dt, "
    "State& state)"
)


def has_learned(model: HybridModel) -> bool:
    """Whether a model says more than bodies and plain losses, in what this header can say."""
    dense = model.net is not None and not isinstance(model.net.network, JointNets)
    further = bool(model.named) or model.net is not None or bool(model.loss.offset.any())
    return further and not dense and not model.carried


def write_learned(model: HybridModel) -> str:
    """The header's text.

    Args:
        model: The fitted model; its net, if any, is one a joint.
    """
    loss = model.loss
    width = np.maximum(loss.transition_speed, 1e-6)
    losses = Losses(loss.motor_inertia, loss.viscous, loss.coulomb, width, np.zeros(model.arm.n))
    first = write_cpp(IdentifiedArm.with_losses(model.arm, losses))
    head, _, tail = first.rpartition("}  // namespace")
    parts = [_state(model), _laws(model), _net(model), _memory(model), _whole(model)]
    return head + "\n".join(parts) + "\n}  // namespace" + tail


def _numbers(values: Array) -> str:
    return ", ".join(repr(float(value)) for value in np.asarray(values).ravel())


def _table(name: str, values: Array, kind: str = "double") -> str:
    flat = np.asarray(values).ravel()
    text = ", ".join(str(int(value)) for value in flat) if kind == "int" else _numbers(flat)
    return f"static const {kind} {name}[{max(len(flat), 1)}] = {{{text or '0'}}};"


def _state(model: HybridModel) -> str:
    return f"""
// What joints remember: zero-initialised before a motion, one for each arm.
struct State {{
  bool started;
  double last[kJoints], stops[kJoints][{len(RANGES)}], means[kJoints][{len(TIMES)}][4];
}};
"""


def _law(law: NamedLaw) -> str:
    """The torque of one law as C++, by speed v, load L, direction s and angle a.

    Raises:
        InputError: A law whose C++ nobody has written.
    """
    c = [repr(float(value)) for value, _, _ in law.figures]
    shape = law.shape
    if law.effect == "stribeck_friction":
        knee = shape["stribeck_velocity_rad_s"]
        power = shape["exponent"]
        return f"{c[0]} * s * std::exp(-std::pow(std::fabs(v) / {knee!r}, {power!r}))"
    if law.effect == "nonlinear_viscous_friction":
        power = shape["exponent"]
        knee = shape.get("knee_rad_s", 0.0)
        if knee:
            bend = f"std::pow(v * v + {knee * knee!r}, {0.5 * power - 0.5!r})"
            return f"{c[0]} * s * std::fabs(v) * {bend}"
        return f"{c[0]} * s * std::pow(std::fabs(v), {power!r})"
    if law.effect == "load_dependent_friction":
        both = f"{c[0]} * (0.75 * s * std::fabs(L) + 0.25 * s * s * L)"
        both += f" + {c[1]} * (0.75 * s * std::fabs(L) - 0.25 * s * s * L)"
        if shape["terms"] == 4:
            both += f" + {c[2]} * s * L * L / {shape['load_Nm']!r} + {c[3]} * v * std::fabs(L)"
        return both
    if law.effect == "asymmetric_friction":
        return f"0.5 * {c[0]} * s * s + 0.5 * {c[1]} * std::fabs(v)"
    if law.effect == "position_dependent_friction":
        order = shape["order"]
        return f"{c[0]} * s * std::cos({order!r} * a) + {c[1]} * s * std::sin({order!r} * a)"
    remedy = "choose formats without it, or write its torque in `_law` of ident/export/learned.py"
    raise InputError("the format cpp", f"has no words for the law {law.effect}", remedy)


def _laws(model: HybridModel) -> str:
    lines = []
    for j in range(model.arm.n):
        terms = [repr(float(model.loss.offset[j]))]
        terms += [_law(law) for law in model.named if law.joint == j]
        lines.append(f"    case {j}: return {' + '.join(terms)};")
    body = "\n".join(lines)
    return f"""
// Named laws and constant torque of a joint, by its speed v, load L, direction s and angle a.
inline double laws(std::size_t joint, double v, double L, double s, double a) {{
  (void)v; (void)L; (void)s; (void)a;
  switch (joint) {{
{body}
  }}
  return 0.0;
}}
"""


def _net(model: HybridModel) -> str:
    if model.net is None:
        return "inline double net(std::size_t, double, double, double) { return 0.0; }"
    net = model.net
    network = net.network
    assert isinstance(network, JointNets)
    assert net.bounds is not None
    first, last = (weights.astype(float) for weights in network.weights)
    bias, offset = (biases.astype(float) for biases in network.biases)
    weights = first / net.input_std[:, :, None]
    biases = bias[:, 0] - np.einsum("jf,jfh->jh", net.input_mean, weights)
    scale = net.output_std
    hidden = first.shape[2]
    silent = [int(not last[j].any() and not offset[j].any()) for j in range(net.n)]
    near, far = DIRECTION_SCALES
    tables = [
        _table("kFirst", weights.transpose(0, 2, 1)),
        _table("kBias", biases),
        _table("kLast", last[:, :, 0] * scale[:, None]),
        _table("kOffset", offset[:, 0, 0] * scale),
        _table("kSilent", np.array(silent), "int"),
        _table("kLow", net.bounds.low),
        _table("kHigh", net.bounds.high),
        _table("kLeast", net.bounds.torques[0]),
        _table("kMost", net.bounds.torques[1]),
    ]
    return (
        "\n".join(tables)
        + f"""
{WITHIN}

{ABOUT_NET}
// and never more than it said there.
inline double net(std::size_t j, double v, double a, double load) {{
  if (kSilent[j]) return 0.0;
  v = within(v, kLow[j], kHigh[j]);
  a = within(a, kLow[kJoints + j], kHigh[kJoints + j]);
  load = within(load, kLow[2 * kJoints + j], kHigh[2 * kJoints + j]);
  const double near = std::tanh(v / {near!r});
  const double x[6] = {{v, a, near, std::tanh(v / {far!r}), load,
                       std::sqrt(load * load + {LOAD_ROUNDING**2!r}) * near}};
  double out = kOffset[j];
  for (int h = 0; h < {hidden}; ++h) {{
    const double* w = kFirst + (j * {hidden} + h) * 6;
    double z = kBias[j * {hidden} + h];
    for (int f = 0; f < 6; ++f) z += w[f] * x[f];
    out += kLast[j * {hidden} + h] * z / (1.0 + std::exp(-within(z, -80.0, 80.0)));
  }}
  return within(out, kLeast[j], kMost[j]);
}}
"""
    )


def _memory(model: HybridModel) -> str:
    trees = () if model.memory is None else model.memory.trees
    grown = [tree for tree in trees if tree is not None]
    if not grown:
        return """
inline bool remembers(std::size_t) { return false; }
inline double memory(std::size_t, const double*, double) { return 0.0; }
inline double nearest(const Vector&) { return 0.0; }
"""
    assert model.memory is not None
    nearness = model.memory.nearness
    # Where no share falls, no pose is asked for.
    poses = nearness.poses if nearness.steepness.any() else nearness.poses[:0]
    count, depth = grown[0].inputs.shape
    place = [-1 if tree is None else grown.index(tree) for tree in trees]
    tables = [
        _table("kPlace", np.array(place), "int"),
        _table("kInputs", np.array([tree.inputs for tree in grown]), "int"),
        _table("kThresholds", np.array([tree.thresholds for tree in grown])),
        _table("kLeaves", np.array([tree.leaves for tree in grown])),
        _table("kPoses", poses),
        _table("kSteepness", nearness.steepness),
    ]
    return (
        "\n".join(tables)
        + f"""
inline bool remembers(std::size_t j) {{ return kPlace[j] >= 0; }}

// Square of the distance to the nearest pose that was seen.
inline double nearest(const Vector& q) {{
  double least = {FAR if len(poses) else 0.0!r};
  for (int k = 0; k < {len(poses)}; ++k) {{
    double square = 0.0;
    for (std::size_t i = 0; i < kJoints; ++i) {{
      const double off = q[i] - kPoses[k * kJoints + i];
      square += off * off;
    }}
    if (square < least) least = square;
  }}
  return least;
}}

// Memory of a joint by its inputs; it counts less the farther off the nearest pose is.
inline double memory(std::size_t j, const double* x, double square) {{
  double out = 0.0;
  for (int k = 0; k < {count}; ++k) {{
    const int tree = kPlace[j] * {count} + k;
    int leaf = 0;
    for (int d = 0; d < {depth}; ++d) {{
      const int at = tree * {depth} + d;
      leaf = 2 * leaf + (x[kInputs[at]] > kThresholds[at] ? 1 : 0);
    }}
    out += kLeaves[tree * {1 << depth} + leaf];
  }}
  return out / (1.0 + square * kSteepness[j]);
}}
"""
    )


def _whole(model: HybridModel) -> str:
    near, far = DIRECTION_SCALES
    inputs = own_inputs()
    return f"""
{_table("kRanges", np.array(RANGES))}
{_table("kTimes", np.array(TIMES))}

// Torque of the whole model [N m]; dt is the time since the last call [s].
{SIGNATURE} {{
  Vector tau = torque(q, dq, ddq);
  double load[kJoints];
  const std::array<Link, kJoints>& table = links();
  for (std::size_t j = 0; j < kJoints; ++j) {{
    const double s = std::tanh(dq[j] / table[j].turning);
    load[j] = tau[j] - table[j].rotor * ddq[j] - table[j].viscous * dq[j] - table[j].coulomb * s;
    tau[j] += laws(j, dq[j], load[j], s, q[j]);
  }}
  const double square = nearest(q);
  for (std::size_t j = 0; j < kJoints; ++j) {{
    const double now[4] = {{std::tanh(dq[j] / {TURNING!r}), std::fabs(dq[j]), load[j], q[j]}};
    for (int r = 0; r < {len(RANGES)}; ++r) {{
      double z = state.started ? state.stops[j][r] + q[j] - state.last[j] : 0.0;
      z = z < -kRanges[r] ? -kRanges[r] : (z > kRanges[r] ? kRanges[r] : z);
      state.stops[j][r] = z;
    }}
    for (int t = 0; t < {len(TIMES)}; ++t)
      for (int c = 0; c < 4; ++c) {{
        double& mean = state.means[j][t][c];
        mean = state.started ? mean + dt / (kTimes[t] + dt) * (now[c] - mean) : now[c];
      }}
    state.last[j] = q[j];
    if (!remembers(j)) {{
      tau[j] += net(j, dq[j], ddq[j], load[j]);
      continue;
    }}
    const double near = std::tanh(dq[j] / {near!r});
    double x[{inputs} + 4 * kJoints] = {{dq[j], ddq[j], near, std::tanh(dq[j] / {far!r}), load[j],
                                  std::sqrt(load[j] * load[j] + {LOAD_ROUNDING**2!r}) * near}};
    int f = 6;
    for (int r = 0; r < {len(RANGES)}; ++r) x[f++] = state.stops[j][r] / kRanges[r];
    for (int t = 0; t < {len(TIMES)}; ++t) {{
      x[f++] = state.means[j][t][0];
      x[f++] = state.means[j][t][1];
      x[f++] = state.means[j][t][2] - load[j];
      x[f++] = q[j] - state.means[j][t][3];
    }}
    for (std::size_t i = 0; i < kJoints; ++i) x[f++] = q[i];
    for (std::size_t i = 0; i < kJoints; ++i) x[f++] = dq[i];
    for (std::size_t i = 0; i < kJoints; ++i) x[f++] = ddq[i];
    for (std::size_t i = 0; i < kJoints; ++i) x[f++] = load[i];
    tau[j] += memory(j, x, square);
  }}
  state.started = true;
  return tau;
}}
"""
