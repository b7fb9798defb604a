"""Torque with its exact derivatives by position, speed and acceleration: what gradient planners ask for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from ident.arrays import Array, Float
from ident.laws.carried import NamedLaw, states_of
from ident.model.residual_net import DIRECTION_SCALES, LOAD_ROUNDING
from plan.dynamics.compiled_nets import CompiledDenseNet, CompiledJointNets, ResidualTerm
from plan.dynamics.named_friction import law_slopes
from plan.dynamics.newton_euler import _rnea
from plan.dynamics.power import ChainTorque

# Step of the central difference by position [rad]: the error of either kind is then some 1e-9 of the torque.
STEP = 1e-5


@dataclass(frozen=True, eq=False)
class TorqueDerivatives:
    """Torque at T states and its partial derivatives; first index the state, second the torque's joint.

    Attributes:
        tau: Torque [N m].
        by_position, by_speed, by_acceleration: Derivatives by the joints' q, dq and ddq.
    """

    tau: Float[Array, "T n"]
    by_position: Float[Array, "T n n"]
    by_speed: Float[Array, "T n n"]
    by_acceleration: Float[Array, "T n n"]


@njit(cache=True, fastmath=True, nogil=True)
def _rigid_partials(rot, off, axes, sliding, mass, com, inertia, gravity, q, dq, ddq, step):  # type: ignore[no-untyped-def]
    """Rigid torque and its partials: exact by acceleration (linear) and speed (quadratic), central by position."""
    count, n = q.shape
    tau = np.empty((count, n))
    by_q, by_v, by_a = np.empty((count, n, n)), np.empty((count, n, n)), np.empty((count, n, n))
    work, low, high, x = np.empty((n, 18)), np.empty(n), np.empty(n), np.empty(n)
    for t in range(count):
        _rnea(rot, off, axes, sliding, mass, com, inertia, gravity, q[t], dq[t], ddq[t], work, tau[t])
        for j in range(n):
            x[:] = ddq[t]
            x[j] += 1.0
            _rnea(rot, off, axes, sliding, mass, com, inertia, gravity, q[t], dq[t], x, work, high)
            for i in range(n):
                by_a[t, i, j] = high[i] - tau[t, i]
            x[:] = dq[t]
            x[j] += 1.0
            _rnea(rot, off, axes, sliding, mass, com, inertia, gravity, q[t], x, ddq[t], work, high)
            x[j] -= 2.0
            _rnea(rot, off, axes, sliding, mass, com, inertia, gravity, q[t], x, ddq[t], work, low)
            for i in range(n):
                by_v[t, i, j] = 0.5 * (high[i] - low[i])
            x[:] = q[t]
            x[j] += step
            _rnea(rot, off, axes, sliding, mass, com, inertia, gravity, x, dq[t], ddq[t], work, high)
            x[j] -= 2.0 * step
            _rnea(rot, off, axes, sliding, mass, com, inertia, gravity, x, dq[t], ddq[t], work, low)
            for i in range(n):
                by_q[t, i, j] = (high[i] - low[i]) / (2.0 * step)
    return tau, by_q, by_v, by_a


def rounded(model: ChainTorque, width: float) -> ChainTorque:
    """The same model with the sign of its friction rounded by a width, beyond what the model itself does [rad/s]."""
    losses = model.losses
    return replace(model, losses=replace(losses, transition_speed=losses.transition_speed + width))


def differentiate_torque(
    model: ChainTorque, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]
) -> TorqueDerivatives:
    """Torque of a compiled model and its partial derivatives at T states.

    Args:
        model: Rigid body, losses and perhaps a net; a friction that jumps has no slope here, see `rounded`.
        q, dq, ddq: States.
    """
    states = [np.ascontiguousarray(part, dtype=float) for part in (q, dq, ddq)]
    rigid, by_q, by_v, by_a = _rigid_partials(*model.chain.dynamics, *states, STEP)  # type: ignore[call-arg]
    tau, losses, joints = rigid.copy(), model.losses, np.arange(model.n)
    slip, slope = _rounded_sign(states[1], losses.transition_speed)
    load = [_rows(part, model.named) for part in (by_q, by_v, by_a)]
    if model.net is not None:
        _add_net(model.net, states, rigid, (tau, by_q, by_v, by_a))
    for law, *slopes_of_load in zip(model.named, *load, strict=True):
        j, at = law.joint, states_of(law.joint, states[0], states[1], rigid, slip)
        tau[:, j] += law.torque(at)
        by_own, by_rate, by_load = law_slopes(law, at, slope[:, j])
        for part, rows in zip((by_q, by_v, by_a), slopes_of_load, strict=True):
            part[:, j] += by_load[:, None] * rows
        by_q[:, j, j] += by_own
        by_v[:, j, j] += by_rate
    tau += losses.motor_inertia * states[2] + losses.viscous * states[1] + losses.coulomb * slip + losses.offset
    by_a[:, joints, joints] += losses.motor_inertia
    by_v[:, joints, joints] += losses.viscous + losses.coulomb * slope
    return TorqueDerivatives(tau, by_q, by_v, by_a)


def _rows(part: Float[Array, "T n n"], named: tuple[NamedLaw, ...]) -> list[Float[Array, "T n"]]:
    """What the rigid torque of each law's joint changes by, before anything else is added to it."""
    return [part[:, law.joint].copy() for law in named]


def _rounded_sign(v: Float[Array, "T n"], width: Float[Array, " n"]) -> tuple[Float[Array, "T n"], Float[Array, "T n"]]:
    """tanh(v / width) and its slope; the sign and zero where the width is zero."""
    safe = np.where(width > 0.0, width, 1.0)
    rounded = np.tanh(v / safe)
    return np.where(width > 0.0, rounded, np.sign(v)), np.where(width > 0.0, (1.0 - rounded**2) / safe, 0.0)


def _add_net(net: ResidualTerm, states: list[Array], rigid: Array, sums: tuple[Array, Array, Array, Array]) -> None:
    """Adds a net's torque and derivatives; a joint's own net sees its load, so the chain rule goes through that."""
    tau, by_q, by_v, by_a = sums
    if isinstance(net, CompiledJointNets):
        value, slopes = joint_net_slopes(net, states[1], states[2], rigid)
        load, joints = 1.0 + slopes[2][:, :, None], np.arange(rigid.shape[1])
        for part in (by_q, by_v, by_a):
            part *= load
        by_v[:, joints, joints] += slopes[0]
        by_a[:, joints, joints] += slopes[1]
        tau += value
        return
    assert isinstance(net, CompiledDenseNet)
    value, jacobian = dense_net_jacobian(net, np.concatenate(states, axis=1))
    tau += value
    for part, block in zip((by_q, by_v, by_a), np.split(jacobian, 3, axis=2), strict=True):
        part += block


def joint_net_slopes(
    net: CompiledJointNets, dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"]
) -> tuple[Float[Array, "T n"], Float[Array, "3 T n"]]:
    """Each joint's residual torque and its slopes by its own speed, acceleration and load, in double precision."""
    value, slopes = np.empty(dq.shape), np.empty((3, *dq.shape))
    for j in range(dq.shape[1]):
        given = dq[:, j], ddq[:, j], rigid[:, j]
        v, a, load = net.clip(j, *given)
        near, far = (np.tanh(v / scale) for scale in DIRECTION_SCALES)
        rounded, one, zero = np.hypot(load, LOAD_ROUNDING), np.ones_like(v), np.zeros_like(v)
        steep, flat = (1.0 - near**2) / DIRECTION_SCALES[0], (1.0 - far**2) / DIRECTION_SCALES[1]
        x = np.stack([v, a, near, far, load, rounded * near], axis=1)
        by_v = np.stack([one, zero, steep, flat, zero, rounded * steep], axis=1)
        by_a = np.stack([zero, one, zero, zero, zero, zero], axis=1)
        by_load = np.stack([zero, zero, zero, zero, one, near * load / rounded], axis=1)
        tangents = np.stack([by_v, by_a, by_load])
        layers = net.side_by_side(j)
        for weight, bias in layers[:-1]:
            x, tangents = x @ weight + bias, tangents @ weight
            gate = 0.5 * (1.0 + np.tanh(0.5 * x))
            tangents *= gate * (1.0 + x * (1.0 - gate))
            x = x * gate
        weight, bias = layers[-1]
        value[:, j] = (x @ weight + bias)[:, 0]
        # Beyond the training's edge the net stays as it is.
        inside = [part == clipped for part, clipped in zip(given, (v, a, load), strict=True)]
        slopes[:, :, j] = (tangents @ weight)[:, :, 0] * np.stack(inside)
    return value, slopes


def dense_net_jacobian(
    net: CompiledDenseNet, x: Float[Array, "T i"]
) -> tuple[Float[Array, "T n"], Float[Array, "T n i"]]:
    """Torques of the fully connected net and their derivatives by its inputs, in double precision."""
    slopes = []
    for weight, bias in zip(net.weights[:-1], net.biases[:-1], strict=True):
        x = np.tanh(x @ weight.T + bias)
        slopes.append(1.0 - x * x)
    value = x @ net.weights[-1].T + net.biases[-1]
    jacobian = np.repeat(net.weights[-1][None], len(x), axis=0)
    for weight, slope in zip(net.weights[-2::-1], slopes[::-1], strict=True):
        jacobian = (jacobian * slope[:, None, :]) @ weight
    return value, jacobian
