"""An arm in CasADi: Newton-Euler, link placements, named laws, the net and the spline as symbols.

The `pin` wheel has no `pinocchio.casadi`; the recursion over the chain's arrays is short and equals Pinocchio's to
rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ident.arrays import Array
from ident.laws.carried import JointStates, NamedLaw
from ident.model.residual_net import DIRECTION_SCALES, LOAD_ROUNDING
from plan.dynamics.chain import Chain
from plan.dynamics.compiled_nets import CompiledDenseNet, CompiledJointNets, ResidualTerm
from plan.errors import MethodError

# Added to a squared speed that a root is drawn from in symbols [rad²/s²].
ROUNDING = 1e-12

Symbol = Any  # casadi.SX or casadi.MX; CasADi has no common type for them


def rotation(chain: Chain, i: int, q: Symbol) -> Symbol:
    """Axes of joint frame i in its parent's."""
    first, sine, cosine = (ca.DM(np.array(part)) for part in chain.rotations[i])
    if chain.sliding[i]:
        return ca.SX(first)
    return first + ca.sin(q) * sine + (1 - ca.cos(q)) * cosine


def lever(chain: Chain, i: int, q: Symbol) -> Symbol:
    """Origin of joint frame i in its parent's axes [m]."""
    offset = ca.DM(np.array(chain.offsets[i]))
    if not chain.sliding[i]:
        return ca.SX(offset)
    return offset + ca.DM(chain.rotations[i, 0] @ chain.axes[i]) * q


def inverse_dynamics(chain: Chain, q: Symbol, dq: Symbol, ddq: Symbol) -> Symbol:
    """Torque of the rigid chain [N m], column of n. Source: paper, eq. 2."""
    omega, alpha, acc = ca.SX.zeros(3), ca.SX.zeros(3), ca.SX(-ca.DM(np.array(chain.gravity)))
    frames, forces, moments, levers = [], [], [], []
    for i in range(chain.n):
        r, p, e = rotation(chain, i, q[i]), lever(chain, i, q[i]), ca.DM(np.array(chain.axes[i]))
        acc = r.T @ (acc + ca.cross(alpha, p) + ca.cross(omega, ca.cross(omega, p)))
        omega, alpha = r.T @ omega, r.T @ alpha
        if chain.sliding[i]:
            acc = acc + e * ddq[i] + 2 * ca.cross(omega, e) * dq[i]
        else:
            alpha = alpha + e * ddq[i] + ca.cross(omega, e) * dq[i]
            omega = omega + e * dq[i]
        c, inertia = ca.DM(np.array(chain.centres[i])), ca.DM(np.array(chain.inertias[i]))
        force = chain.masses[i] * (acc + ca.cross(alpha, c) + ca.cross(omega, ca.cross(omega, c)))
        moment = inertia @ alpha + ca.cross(omega, inertia @ omega) + ca.cross(c, force)
        frames.append(r)
        levers.append(p)
        forces.append(force)
        moments.append(moment)
    tau = [ca.SX(0)] * chain.n
    for i in reversed(range(chain.n)):
        axis = ca.DM(np.array(chain.axes[i]))
        tau[i] = ca.dot(axis, forces[i] if chain.sliding[i] else moments[i])
        if i > 0:
            force = frames[i] @ forces[i]
            forces[i - 1] += force
            moments[i - 1] += frames[i] @ moments[i] + ca.cross(levers[i], force)
    return ca.vertcat(*tau)


def placements(chain: Chain, q: Symbol) -> list[tuple[Symbol, Symbol]]:
    """Rotation and origin of the world and of every joint frame, n + 1 pairs."""
    found = [(ca.SX.eye(3), ca.SX.zeros(3))]
    for i in range(chain.n):
        r, p = found[-1]
        found.append((r @ rotation(chain, i, q[i]), p + r @ lever(chain, i, q[i])))
    return found


def residual_torque(net: ResidualTerm, q: Symbol, dq: Symbol, ddq: Symbol, rigid: Symbol) -> Symbol:
    """The net's torque for all nodes at once: matrices of n rows and one column a node.

    Raises:
        MethodError: The net is of a kind that is not known here.
    """
    if isinstance(net, CompiledDenseNet):
        return _dense(net, ca.vertcat(q, dq, ddq))
    if isinstance(net, CompiledJointNets):
        return ca.vertcat(*(_joint(net, j, dq[j, :], ddq[j, :], rigid[j, :]) for j in range(q.shape[0])))
    raise MethodError("--method reference", f"a net of kind {type(net).__name__} has no symbols", "use --method cma")


@dataclass(frozen=True, eq=False)
class SmoothStates(JointStates):
    """A joint's states as symbols, their moduli rounded.

    Attributes:
        width: Over which the direction turns [rad/s].
    """

    width: Symbol = 0.0

    @property
    def speed(self) -> Symbol:
        return ca.sqrt(self.dq * self.dq + self.width * self.width + ROUNDING)

    @property
    def burden(self) -> Symbol:
        return ca.sqrt(self.load * self.load + LOAD_ROUNDING**2)


def law_symbols(law: NamedLaw, q: Symbol, dq: Symbol, load: Symbol, slip: Symbol, width: Symbol) -> Symbol:
    """A law's torque in CasADi's symbols, moduli rounded: smooth everywhere.

    Args:
        law: Fitted.
        q, dq, load: States of its joint, a row of nodes.
        slip: Its direction.
        width: Over which the direction turns [rad/s].
    """
    at = SmoothStates(q, dq, load, slip, ca, width)
    columns = law.kind.columns(at, law.shape)
    return sum(value * column for (value, _, _), column in zip(law.figures, columns, strict=True))


def _dense(net: CompiledDenseNet, x: Symbol) -> Symbol:
    for layer, (weight, bias) in enumerate(zip(net.weights, net.biases, strict=True)):
        x = _affine(weight, bias, x)
        if layer < len(net.weights) - 1:
            x = ca.tanh(x)
    return x


def _joint(net: CompiledJointNets, j: int, v: Symbol, a: Symbol, load: Symbol) -> Symbol:
    if net.bounds is not None:
        edges = zip((v, a, load), net.bounds.low[:, j], net.bounds.high[:, j], strict=True)
        v, a, load = (ca.fmin(ca.fmax(part, float(low)), float(high)) for part, low, high in edges)
    near, far = (ca.tanh(v / scale) for scale in DIRECTION_SCALES)
    x = ca.vertcat(v, a, near, far, load, ca.sqrt(load * load + LOAD_ROUNDING**2) * near)
    layers = net.side_by_side(j)
    for number, (weight, bias) in enumerate(layers):
        x = _affine(weight.T, bias, x)
        if number < len(layers) - 1:
            x = 0.5 * x * (1 + ca.tanh(0.5 * x))  # SiLU, in the form that never overflows
    return x


def _affine(weight: Array, bias: Array, x: Symbol) -> Symbol:
    return ca.sparsify(ca.DM(np.array(weight))) @ x + ca.repmat(ca.DM(np.array(bias)), 1, x.shape[1])


def knot_slopes(points: list[Symbol], h: list[Symbol]) -> list[Symbol]:
    """Velocities at the knots of a clamped cubic spline, by one tridiagonal elimination."""
    last = len(points) - 1
    upper: list[Symbol] = [ca.SX(0)] * (last + 1)
    slopes = [ca.SX.zeros(points[0].shape) for _ in points]
    for i in range(1, last):
        h0, h1 = h[i - 1], h[i]
        pivot = 2 * (h0 + h1) - h1 * upper[i - 1]
        upper[i] = h0 / pivot
        rise = 3 * (h1 * (points[i] - points[i - 1]) / h0 + h0 * (points[i + 1] - points[i]) / h1)
        slopes[i] = (rise - h1 * slopes[i - 1]) / pivot
    for i in range(last - 2, 0, -1):
        slopes[i] = slopes[i] - upper[i] * slopes[i + 1]
    return slopes


def section_state(
    q0: Symbol, q1: Symbol, v0: Symbol, v1: Symbol, h: Symbol, s: Symbol
) -> tuple[Symbol, Symbol, Symbol]:
    """Position, velocity and acceleration at local time s of one section."""
    a, b, d = v0 * h, v1 * h, q1 - q0
    c2, c3 = 3 * d - 2 * a - b, a + b - 2 * d
    q = q0 + s * (a + s * (c2 + s * c3))
    return q, (a + s * (2 * c2 + 3 * s * c3)) / h, (2 * c2 + 6 * s * c3) / h**2


def spline_function(n: int, vias: int, s: Array) -> Any:
    """CasADi function from (z, start, goal) to positions, velocities and accelerations at the nodes, each n × K.

    z holds the via angles, via by via, and then the section durations.
    """
    z, start, goal = ca.SX.sym("z", vias * n + vias + 1), ca.SX.sym("start", n), ca.SX.sym("goal", n)
    points, h = split(z, start, goal, n, vias)
    slopes = knot_slopes(points, h)
    states = [
        section_state(points[k], points[k + 1], slopes[k], slopes[k + 1], h[k], float(x))
        for k in range(vias + 1)
        for x in s
    ]
    return ca.Function("states", [z, start, goal], [ca.horzcat(*parts) for parts in zip(*states, strict=True)])


def split(z: Symbol, start: Symbol, goal: Symbol, n: int, vias: int) -> tuple[list[Symbol], list[Symbol]]:
    """Knots and section durations held in z."""
    points = [start, *(z[i * n : (i + 1) * n] for i in range(vias)), goal]
    return points, [z[vias * n + k] for k in range(vias + 1)]
