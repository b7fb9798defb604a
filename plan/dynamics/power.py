"""Torque, its derivatives, power and energy of trajectories, thousands at a time, of the joints that a task moves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal, get_args

import numpy as np

from ident.arrays import Array, Float, Int
from ident.compiled import compiled
from ident.laws.carried import NamedLaw, named_torque, states_of
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.robot.chain import Chain
from plan.dynamics.compiled_nets import CompiledNet, read_residual
from plan.dynamics.rigid import rnea
from plan.spline import Splines

Metric = Literal["signed", "positive", "absolute", "copper"]
METRICS: tuple[Metric, ...] = get_args(Metric)
# Gauss-Legendre points a section: exact for smooth power to far below a per cent.
POINTS = 8


@compiled(fastmath=True, nogil=True)
def _torque_states(chain, losses, q, dq, ddq):  # type: ignore[no-untyped-def]
    """Rigid torque with losses, and rigid torque alone."""
    bm, cm, fc, offset, width = losses
    tau, rigid = np.empty(q.shape), np.empty(q.shape)
    work = np.empty((q.shape[1], 18))
    for t in range(q.shape[0]):
        rnea(chain, q[t], dq[t], ddq[t], work, rigid[t])
        for j in range(q.shape[1]):
            v = dq[t, j]
            slip = np.tanh(v / width[j]) if width[j] > 0.0 else np.sign(v)
            tau[t, j] = rigid[t, j] + bm[j] * ddq[t, j] + cm[j] * v + fc[j] * slip + offset[j]
    return tau, rigid


@dataclass(frozen=True, eq=False)
class ChainTorque:
    """Rigid body, losses and perhaps named laws and a net, compiled: eq. 1 of the paper for a planner's appetite."""

    chain: Chain  # the arm as arrays
    losses: LossParameters  # losses of its joints
    net: CompiledNet | None = None  # residual net of the chain's joints; None without
    named: tuple[NamedLaw, ...] = ()  # friction laws of the chain's joints that a diagnosis named

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.chain.masses)

    def torque(
        self, q: Float[Array, "B T n"], dq: Float[Array, "B T n"], ddq: Float[Array, "B T n"]
    ) -> Float[Array, "B T n"]:
        """Joint torque [N m]."""
        flat_q, flat_dq, flat_ddq = (
            np.ascontiguousarray(values, dtype=float).reshape(-1, self.n) for values in (q, dq, ddq)
        )
        tau, rigid = _torque_states(self.chain, _parts(self.losses), flat_q, flat_dq, flat_ddq)
        if self.named:
            tau += named_torque(self.named, flat_q, flat_dq, rigid, self.losses.transition_speed)
        if self.net is not None:
            tau += self.net.torque(flat_q, flat_dq, flat_ddq, rigid)
        return tau.reshape(np.shape(q))


@cache
def section_nodes(points: int = POINTS) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
    """Local times of a section and their weights: Gauss-Legendre inside, and both ends with weight zero.

    The ends are where acceleration, and mostly torque, peaks: a cubic's acceleration is linear in each section.
    """
    x, w = np.polynomial.legendre.leggauss(points)
    return np.concatenate([[0.0], (x + 1) / 2, [1.0]]), np.concatenate([[0.0], w / 2, [0.0]])


def power_integral(
    tau: Float[Array, "B T n"], dq: Float[Array, "B T n"], weights: Float[Array, "B T"], metric: Metric
) -> Float[Array, " B"]:
    """Energy by one metric, summed over the joints [J]; N² m² s for copper.

    signed: ∫ τ dq dt, the paper's eq. 8, which credits negative work; positive: braking is lost, not credited;
    absolute: braking costs as much as driving; copper: ∫ τ² dt, what heats the motors.

    Args:
        tau, dq: Torque [N m] and speed [rad/s] at the nodes.
        weights: Quadrature weights [s].
        metric: Which.
    """
    rate = tau * tau if metric == "copper" else tau * dq
    if metric == "absolute":
        rate = np.abs(rate)
    elif metric == "positive":
        rate = np.maximum(rate, 0.0)
    return np.einsum("btn,bt->b", rate, weights)


def power_integrals(tau: Array, dq: Array, weights: Array) -> dict[Metric, float]:
    """Energy of the first of a batch of motions by every metric, see `power_integral`."""
    return {metric: float(power_integral(tau, dq, weights, metric)[0]) for metric in METRICS}


def energy(model: ChainTorque, splines: Splines, metric: Metric, points: int = POINTS) -> Float[Array, " B"]:
    """Energy of each trajectory by one metric [J]; peaks, for which a section's ends count, are not looked at.

    Args:
        model: Torque model.
        splines: Trajectories.
        metric: How power is counted, see `power_integral`.
        points: Gauss-Legendre points a section.
    """
    s, w = (nodes[1:-1] for nodes in section_nodes(points))
    q, dq, ddq = splines.states(s)
    tau = model.torque(q, dq, ddq)
    weights = (splines.durations[:, :, None] * w).reshape(len(q), -1)
    return power_integral(tau, dq, weights, metric)


def torque_of_model(model: HybridModel, moving: int, held: Sequence[float]) -> ChainTorque:
    """Torque of a fitted model for the first joints, the others held.

    Args:
        model: The fitted model, of as many joints as move or more.
        moving: Number of joints that move.
        held: Positions of the robot's other joints [rad].
    """
    fixed = np.asarray(held, dtype=float)[: len(model.joint_names) - moving]
    arm = model.arm.locked(model.arm.joint_names[moving:], list(fixed)) if len(fixed) else model.arm
    net = None if model.net is None else read_residual(model.net)
    net = net if net is None or len(fixed) == 0 else net.frozen(fixed)
    named = tuple(law for law in model.named if law.joint < moving)  # of joints that stand still there is no friction
    return ChainTorque(arm.chain, LossParameters(*(part[:moving] for part in _parts(model.loss))), net, named)


def _parts(loss: LossParameters) -> tuple[Array, ...]:
    """Motor inertia, viscous and Coulomb friction, offset and transition speed of all joints."""
    return loss.motor_inertia, loss.viscous, loss.coulomb, loss.offset, loss.transition_speed


# Kinks that are bent less than this share of their middle are not counted as bent.
BENT = 0.01
# Step of the central difference by position [rad]: the error of either kind is then some 1e-9 of the torque.
STEP = 1e-5
# The same for friction laws, in their states' own units: these are smooth on scales that are thousands of times it.
LAW_STEP = 1e-6


Slopes = tuple[Float[Array, "T n n"], Float[Array, "T n n"], Float[Array, "T n n"]]
"""Derivatives of the torque by the joints' q, dq and ddq; first index the state, second the torque's joint."""


@compiled(fastmath=True, nogil=True)
def _rigid_partials(chain, q, dq, ddq, step):  # type: ignore[no-untyped-def]
    """Rigid torque and its partials: exact by acceleration (linear) and speed (quadratic), central by position."""
    count, n = q.shape
    tau = np.empty((count, n))
    by_q, by_v, by_a = np.empty((count, n, n)), np.empty((count, n, n)), np.empty((count, n, n))
    work, low, high, x = np.empty((n, 18)), np.empty(n), np.empty(n), np.empty(n)
    for t in range(count):
        rnea(chain, q[t], dq[t], ddq[t], work, tau[t])
        for j in range(n):
            x[:] = ddq[t]
            x[j] += 1.0
            rnea(chain, q[t], dq[t], x, work, high)
            for i in range(n):
                by_a[t, i, j] = high[i] - tau[t, i]
            x[:] = dq[t]
            x[j] += 1.0
            rnea(chain, q[t], x, ddq[t], work, high)
            x[j] -= 2.0
            rnea(chain, q[t], x, ddq[t], work, low)
            for i in range(n):
                by_v[t, i, j] = 0.5 * (high[i] - low[i])
            x[:] = q[t]
            x[j] += step
            rnea(chain, x, dq[t], ddq[t], work, high)
            x[j] -= 2.0 * step
            rnea(chain, x, dq[t], ddq[t], work, low)
            for i in range(n):
                by_q[t, i, j] = (high[i] - low[i]) / (2.0 * step)
    return tau, by_q, by_v, by_a


def rounded(model: ChainTorque, width: float) -> ChainTorque:
    """The same model with the sign of its friction rounded by a width, beyond what the model itself does [rad/s]."""
    losses = model.losses
    return replace(model, losses=replace(losses, transition_speed=losses.transition_speed + width))


def without_friction(model: ChainTorque) -> ChainTorque:
    """The same model without dry friction, offsets, named laws and net: at rest it tells gravity alone."""
    zero = np.zeros(model.n)
    return replace(model, net=None, named=(), losses=replace(model.losses, coulomb=zero, offset=zero))


def differentiate_torque(
    model: ChainTorque, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]
) -> tuple[Float[Array, "T n"], Slopes]:
    """Torque of a compiled model [N m] and its partial derivatives at T states.

    Args:
        model: Rigid body, losses and perhaps a net; a friction that jumps has no slope here, see `rounded`.
        q, dq, ddq: States.
    """
    states = [np.ascontiguousarray(part, dtype=float) for part in (q, dq, ddq)]
    rigid, by_q, by_v, by_a = _rigid_partials(model.chain, *states, STEP)
    tau, losses, joints = rigid.copy(), model.losses, np.arange(model.n)
    # Sign of the speed, rounded by tanh(v / width), and its slope; where the width is zero, that is not seen.
    width = np.where(losses.transition_speed > 0.0, losses.transition_speed, np.inf)
    slip = np.where(width < np.inf, np.tanh(states[1] / width), np.sign(states[1]))
    slope = np.where(width < np.inf, (1.0 - slip**2) / width, 0.0)
    by_state = by_q, by_v, by_a
    # By what the load of each law's joint changes, before anything else is added to it.
    by_state_of_load = [[part[:, law.joint].copy() for part in by_state] for law in model.named]
    if model.net is not None:
        tau += model.net.add_slopes(states, rigid, by_state)
    for law, slopes_of_load in zip(model.named, by_state_of_load, strict=True):
        j, at, found = law.joint, states_of(law.joint, states[0], states[1], rigid, slip), {}
        for name in ("q", "dq", "slip", "load"):  # moduli have corners: there this is the mean of both sides
            ends = (replace(at, **{name: getattr(at, name) + step}) for step in (LAW_STEP, -LAW_STEP))
            up, down = map(law.torque, ends)
            found[name] = (up - down) / (2.0 * LAW_STEP)
        tau[:, j] += law.torque(at)
        for part, rows in zip(by_state, slopes_of_load, strict=True):
            part[:, j] += found["load"][:, None] * rows
        by_q[:, j, j] += found["q"]
        by_v[:, j, j] += found["dq"] + slope[:, j] * found["slip"]
    tau += losses.motor_inertia * states[2] + losses.viscous * states[1] + losses.coulomb * slip + losses.offset
    by_a[:, joints, joints] += losses.motor_inertia
    by_v[:, joints, joints] += losses.viscous + losses.coulomb * slope
    return tau, by_state


def find_kinks(
    model: ChainTorque, dq: Float[Array, "T n"], found: tuple[Array, Slopes], metric: Metric, width: float
) -> Iterator[tuple[Int[Array, " k"], list[Float[Array, "k n"]]]]:
    """Second derivative of what is integrated where power or speed of a joint passes zero.

    The modulus of power, √(p² + δ²), is bent there by δ²/√(p² + δ²)³ along p's own slope, and friction's share of it,
    v tanh(v/w), by 2/w (1 - tanh²)(1 - v/w tanh) along v. A joint that coasts, or stands for a while, stays at such a
    kink, where the slope alone points to where the cost rises at once.

    Args:
        model: As it was differentiated, its friction rounded.
        dq: Speeds.
        found: Its torque and derivatives.
        metric: How energy is counted.
        width: Rounding δ of the modulus of power [W].

    Yields:
        States, and slopes there by position, speed and acceleration, whose squares are the second derivative.
    """
    share_of_kink = {"absolute": 1.0, "positive": 0.5, "signed": 0.0}
    if metric not in share_of_kink:
        return
    (tau, slopes), kink, one = found, share_of_kink[metric], np.eye(model.n)
    power = tau * dq
    root = np.sqrt(power**2 + width**2)
    sharp = kink * (width / root) ** 3
    nodes, joints = np.nonzero(sharp > BENT)
    by = [part[nodes, joints] * dq[nodes, joints, None] for part in slopes]
    by[1] += one[joints] * tau[nodes, joints, None]
    yield nodes, [part * np.sqrt(sharp[nodes, joints, None] / width) for part in by]
    losses = model.losses
    share, slip = dq / losses.transition_speed, np.tanh(dq / losses.transition_speed)
    sharp = np.maximum((1.0 - kink + kink * power / root) * (1.0 - slip**2) * (1.0 - share * slip), 0.0)
    nodes, joints = np.nonzero(sharp > BENT)
    bent = np.sqrt(2.0 * sharp * losses.coulomb / losses.transition_speed)[nodes, joints, None] * one[joints]
    yield nodes, [0.0 * bent, bent, 0.0 * bent]
