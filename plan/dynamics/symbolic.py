"""Torque of an arm in CasADi's symbols: Newton-Euler, losses, named laws and nets of joints.

Written apart from the compiled torque and its derivatives, so that either can be checked against the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ident.laws.carried import JointStates
from ident.model.residual_net import DIRECTION_SCALES, LOAD_ROUNDING
from ident.robot.chain import Chain
from plan.dynamics.compiled_nets import CompiledJointNets
from plan.dynamics.power import ChainTorque
from plan.errors import MethodError

Symbol = Any  # casadi.SX or DM
# Added to a squared speed that a root is drawn from [rad²/s²]; rounding of the modulus of a load [N m].
ROUNDING, BURDEN = 1e-12, 0.02


@dataclass(frozen=True, eq=False)
class SmoothStates(JointStates):
    """A joint's states as symbols, their moduli rounded over a width [rad/s]."""

    width: Symbol = 0.0

    @property
    def speed(self) -> Symbol:
        return ca.sqrt(self.dq * self.dq + self.width * self.width + ROUNDING)

    @property
    def burden(self) -> Symbol:
        return ca.sqrt(self.load * self.load + BURDEN**2)


def rigid_torque(chain: Chain, q: Symbol, dq: Symbol, ddq: Symbol) -> list[Symbol]:
    """Torque of each joint of the rigid chain [N m], by recursive Newton-Euler from columns of n. Source: eq. 2."""
    parts = np.asarray(chain.axes), np.asarray(chain.offsets), np.asarray(chain.centres), np.asarray(chain.inertias)
    axes, offsets, centres, inertias = ([ca.DM(one) for one in part] for part in parts)
    omega, alpha = ca.SX.zeros(3), ca.SX.zeros(3)
    acc: Symbol = -ca.DM(np.asarray(chain.gravity))
    moved = []
    for i, (axis, centre, inertia) in enumerate(zip(axes, centres, inertias, strict=True)):
        placed, sine, cosine = (ca.DM(part) for part in np.asarray(chain.rotations[i]))
        slides = bool(chain.sliding[i])
        turn: Symbol = placed if slides else placed + ca.sin(q[i]) * sine + (1.0 - ca.cos(q[i])) * cosine
        lever: Symbol = offsets[i] + placed @ axis * q[i] if slides else offsets[i]
        acc = turn.T @ (acc + ca.cross(alpha, lever) + ca.cross(omega, ca.cross(omega, lever)))
        omega, alpha = turn.T @ omega, turn.T @ alpha
        if slides:
            acc += axis * ddq[i] + 2.0 * ca.cross(omega, axis) * dq[i]
        else:
            alpha += axis * ddq[i] + ca.cross(omega, axis) * dq[i]
            omega += axis * dq[i]
        force = chain.masses[i] * (acc + ca.cross(alpha, centre) + ca.cross(omega, ca.cross(omega, centre)))
        moment = inertia @ alpha + ca.cross(omega, inertia @ omega) + ca.cross(centre, force)
        moved.append((turn, lever, force, moment, axis, slides))
    tau, force, moment = [], ca.SX.zeros(3), ca.SX.zeros(3)
    for turn, lever, own_force, own_moment, axis, slides in reversed(moved):
        force, moment = own_force + force, own_moment + moment
        tau.append(ca.dot(axis, force if slides else moment))
        force = turn @ force
        moment = turn @ moment + ca.cross(lever, force)
    return tau[::-1]


def torque(model: ChainTorque, q: Symbol, dq: Symbol, ddq: Symbol, rounding: Symbol) -> list[Symbol]:
    """Torque of each joint [N m], the sign of the speed rounded over a width [rad/s]. Source: eq. 1.

    Raises:
        MethodError: The net is of another kind than the default.
    """
    if not (model.net is None or isinstance(model.net, CompiledJointNets)):
        raise MethodError("--method reference", "this model's net has no symbols", "use --method sqp")
    rigid, loss, found = rigid_torque(model.chain, q, dq, ddq), model.losses, []
    for j, load in enumerate(rigid):
        width = ca.sqrt(rounding**2 + loss.transition_speed[j] ** 2)
        slip = ca.tanh(dq[j] / width)
        tau = load + loss.motor_inertia[j] * ddq[j] + loss.viscous[j] * dq[j] + loss.coulomb[j] * slip + loss.offset[j]
        at = SmoothStates(q[j], dq[j], load, slip, ca, width)
        for law in (law for law in model.named if law.joint == j):
            columns = law.kind.columns(at, law.shape)
            tau += sum(value * column for (value, _, _), column in zip(law.figures, columns, strict=True))
        found.append(tau if model.net is None else tau + _net_torque(model.net, j, dq[j], ddq[j], load))
    return found


def _net_torque(net: CompiledJointNets, j: int, dq: Symbol, ddq: Symbol, load: Symbol) -> Symbol:
    """A joint's net, see `CompiledJointNets`."""
    if net.bounds is not None:
        edges = zip((dq, ddq, load), net.bounds.low[:, j], net.bounds.high[:, j], strict=True)
        dq, ddq, load = (ca.fmin(ca.fmax(part, float(low)), float(high)) for part, low, high in edges)
    near, far = (ca.tanh(dq / scale) for scale in DIRECTION_SCALES)
    x = ca.vertcat(dq, ddq, near, far, load, ca.sqrt(load * load + LOAD_ROUNDING**2) * near)
    *layers, (last, offset) = net.joints[j]
    for weight, bias in layers:
        x = ca.sparsify(ca.DM(np.array(weight.T))) @ x + ca.DM(np.array(bias))
        x = 0.5 * x * (1.0 + ca.tanh(0.5 * x))
    return ca.dot(ca.DM(np.array(last[:, 0])), x) + float(offset[0])
