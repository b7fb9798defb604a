"""The joint torque regressor of a chain: τ = Y(q, dq, ddq) π, for whole batches of states.

Pinocchio computes it for one state at a time; recordings have 10⁵ and more. Here every number of the recursion is a
row of all states, so that NumPy goes through memory in order and nothing needs to be compiled. π holds ten numbers a
link in Pinocchio's order: mass, first moments (m c), and the inertia about the joint frame's origin as xx, xy, yy, xz,
yz, zz.

The force and moment of link i act on joint j ≤ i through the joint's axis and lever, both seen from link i:

    τ_j = z · moment + (z × p) · force,  p from joint j's origin to link i's.

Source: Featherstone, Rigid Body Dynamics Algorithms (2008), section 5.3 (recursive Newton-Euler), linear in π
as in Khalil and Dombre, Modeling, Identification and Control of Robots (2002), section 12.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float

Vector = tuple[Array, Array, Array]
# States that are worked on together: their rows stay in the processor's cache.
CHUNK = 2048


@dataclass(frozen=True, eq=False)
class _Axis:
    """A joint's screw seen from the link at hand: for a turning joint axis z and lever z × p, for a sliding one z."""

    moment: Vector | None
    force: Vector


@dataclass(frozen=True, eq=False)
class _Body:
    """Motion of a link in its own axes: angular velocity and acceleration, classical acceleration less gravity."""

    omega: Vector
    alpha: Vector
    acc: Vector


def compute_regressor(
    rotations: Float[Array, "n 3 3"],
    offsets: Float[Array, "n 3"],
    axes: Float[Array, "n 3"],
    sliding: Array,
    gravity: Float[Array, " 3"],
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    ddq: Float[Array, "T n"],
) -> Float[Array, "T n 10n"]:
    """Torque regressor of a chain.

    Args:
        rotations: Axes of each joint frame in its parent's, at zero.
        offsets: Origin of each joint frame in its parent's [m].
        axes: Joint axes in the joint frames, unit length.
        sliding: Whether each joint is prismatic.
        gravity: Gravity in the base frame [m/s²].
        q, dq, ddq: Joint states [rad, rad/s, rad/s²].

    Returns:
        Y with τ = Y π [N m per unit of π].
    """
    samples, n = np.shape(q)
    out = np.zeros((samples, n, 10 * n))
    joints = [_Joint(rotations[i], offsets[i], np.asarray(axes[i], dtype=float), bool(sliding[i])) for i in range(n)]
    for start in range(0, samples, CHUNK):
        part = slice(start, min(start + CHUNK, samples))
        states = [np.ascontiguousarray(np.asarray(values[part], dtype=float).T) for values in (q, dq, ddq)]
        out[part] = _chunk(joints, np.asarray(gravity, dtype=float), *states)
    return out


def _chunk(
    joints: Sequence[_Joint], gravity: Array, q: Float[Array, "n T"], dq: Float[Array, "n T"], ddq: Float[Array, "n T"]
) -> Float[Array, "T n 10n"]:
    n, samples = q.shape
    rows = np.zeros((n, 10 * n, samples))
    zero = np.zeros(samples)
    body = _Body((zero, zero, zero), (zero, zero, zero), _constant(-gravity, zero))
    acting: list[_Axis] = []
    for i, joint in enumerate(joints):
        turn, lever = joint.place(q[i])
        body = joint.move(body, turn, lever, dq[i], ddq[i])
        acting = [_carry(axis, turn, lever) for axis in acting]
        acting.append(joint.axis_of_its_own(zero))
        inertial = _inertial_columns(body)
        for j, axis in enumerate(acting):
            _fill(rows[j, 10 * i : 10 * i + 10], body, axis, inertial)
    return np.ascontiguousarray(rows.transpose(2, 0, 1))


@dataclass(frozen=True, eq=False)
class _Joint:
    """One joint of the chain."""

    rotation: Float[Array, "3 3"]
    offset: Float[Array, " 3"]
    axis: Float[Array, " 3"]
    slides: bool

    def place(self, q: Float[Array, " T"]) -> tuple[list[Vector], Vector]:
        """Rows of the link's axes in its parent's, and its origin there."""
        if self.slides:
            turn = [_constant(row, np.zeros_like(q)) for row in self.rotation]
            along = self.rotation @ self.axis
            x, y, z = (self.offset[k] + along[k] * q for k in range(3))
            return turn, (x, y, z)
        s, c = np.sin(q), np.cos(q)
        x, y, z = self.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        outer = np.outer(self.axis, self.axis)
        # Rodrigues: outer + cos (1 − outer) + sin cross, in the parent's axes.
        fixed, even, odd = (self.rotation @ part for part in (outer, np.eye(3) - outer, cross))
        turn = []
        for k in range(3):
            a, b, d = (fixed[k, m] + even[k, m] * c + odd[k, m] * s for m in range(3))
            turn.append((a, b, d))
        return turn, _constant(self.offset, np.zeros_like(q))

    def move(self, parent: _Body, turn: list[Vector], lever: Vector, dq: Array, ddq: Array) -> _Body:
        """Motion of the link from its parent's."""
        swing = _cross(parent.omega, lever)
        acc = _add(parent.acc, _cross(parent.alpha, lever), _cross(parent.omega, swing))
        omega, alpha, acc = (_into(turn, values) for values in (parent.omega, parent.alpha, acc))
        axis = self.axis
        if self.slides:
            rate = _scaled(axis, dq)
            coriolis = _cross(omega, rate)
            return _Body(omega, alpha, _add(acc, _scaled(axis, ddq), coriolis, coriolis))
        rate = _scaled(axis, dq)
        alpha = _add(alpha, _scaled(axis, ddq), _cross(omega, rate))
        return _Body(_add(omega, rate), alpha, acc)

    def axis_of_its_own(self, zero: Array) -> _Axis:
        """The joint's screw seen from its own link."""
        axis = _constant(self.axis, zero)
        return _Axis(None, axis) if self.slides else _Axis(axis, (zero, zero, zero))


def _carry(axis: _Axis, turn: list[Vector], lever: Vector) -> _Axis:
    """A screw seen from the next link: moments of forces grow by the lever."""
    if axis.moment is None:
        return _Axis(None, _into(turn, axis.force))
    force = _add(axis.force, _cross(axis.moment, lever))
    return _Axis(_into(turn, axis.moment), _into(turn, force))


def _inertial_columns(body: _Body) -> tuple[Vector, ...]:
    """d(moment)/dI of I α + ω × I ω for xx, xy, yy, xz, yz, zz."""
    (wx, wy, wz), (ax, ay, az) = body.omega, body.alpha
    xy, xz, yz = wx * wy, wx * wz, wy * wz
    xx, yy, zz = wx * wx, wy * wy, wz * wz
    return (
        (ax, xz, -xy),
        (ay - xz, ax + yz, xx - yy),
        (-yz, ay, xy),
        (az + xy, zz - xx, ax - yz),
        (yy - zz, az - xy, ay + xz),
        (yz, -xz, az),
    )


def _fill(out: Float[Array, "10 T"], body: _Body, axis: _Axis, inertial: tuple[Vector, ...]) -> None:
    """Torque of a screw by each of a link's ten numbers: force = m a + (α× + ω×ω×) m c, moment = m c × a + I-terms."""
    f, a = axis.force, body.acc
    out[0] = _dot(f, a)
    # f · (α × c + ω × (ω × c)) = c · (f × α + ω (ω · f) − f (ω · ω))
    (wx, wy, wz), turned = body.omega, _cross(f, body.alpha)
    along, square = _dot(body.omega, f), _dot(body.omega, body.omega)
    for k, w in enumerate((wx, wy, wz)):
        out[1 + k] = turned[k] + w * along - f[k] * square
    if axis.moment is None:
        return
    # z · (c × a) = c · (a × z)
    for k, value in enumerate(_cross(a, axis.moment)):
        out[1 + k] += value
    for k, column in enumerate(inertial):
        out[4 + k] = _dot(axis.moment, column)


def _constant(values: Float[Array, " 3"], zero: Array) -> Vector:
    return zero + values[0], zero + values[1], zero + values[2]


def _scaled(values: Float[Array, " 3"], by: Array) -> Vector:
    return values[0] * by, values[1] * by, values[2] * by


def _dot(a: Vector, b: Vector) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _add(first: Vector, *others: Vector) -> Vector:
    x, y, z = first
    for other in others:
        x, y, z = x + other[0], y + other[1], z + other[2]
    return x, y, z


def _into(turn: list[Vector], values: Vector) -> Vector:
    """A vector of the parent's axes in the link's: Rᵀ v."""
    (r0, r1, r2), (x, y, z) = turn, values
    return (
        r0[0] * x + r1[0] * y + r2[0] * z,
        r0[1] * x + r1[1] * y + r2[1] * z,
        r0[2] * x + r1[2] * y + r2[2] * z,
    )
