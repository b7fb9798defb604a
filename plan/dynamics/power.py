"""Torque, its derivatives, power and energy of trajectories, thousands at a time.

All of the joints that a task moves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Literal, get_args

import numpy as np

from ident.arrays import Array, Float, Int
from ident.compiled import compiled
from ident.laws.carried import JointStates, NamedLaw, named_torque, states_of
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.robot.chain import Chain
from plan.dynamics.compiled_nets import CompiledNet, read_residual
from plan.dynamics.rigid import joint_rows, rnea
from plan.spline import Splines

Metric = Literal["signed", "positive", "absolute", "copper"]
METRICS: tuple[Metric, ...] = get_args(Metric)
# Gauss-Legendre points a section: exact for smooth power to far below a per cent.
POINTS = 8
# Kinks that are bent less than this share of their middle are not counted as bent.
BENT = 0.01
# Step of the central difference by position [rad]: the error of either kind is then some 1e-9 of
# the torque.
STEP = 1e-5
# The same for friction laws, in their states' own units: these are smooth on scales that are
# thousands of times it.
LAW_STEP = 1e-6
# What a friction law's torque depends on.
LAW_STATES = ("q", "dq", "slip", "load")
# By how much the modulus of power is bent, as a share of the most, for each metric that has one.
KINKS: dict[Metric, float] = {"absolute": 1.0, "positive": 0.5, "signed": 0.0}

Slopes = tuple[Float[Array, "T n n"], Float[Array, "T n n"], Float[Array, "T n n"]]
"""Derivatives of the torque by the joints' q, dq and ddq; state, then the torque's joint."""


@compiled(fastmath=True, nogil=True, error_model="numpy")
def _torque_states(chain, losses, q, dq, ddq):  # type: ignore[no-untyped-def]
    """Rigid torque with losses, and rigid torque alone."""
    inertia, viscous, coulomb, offset, width = losses
    tau = np.empty(q.shape)
    rigid = np.empty(q.shape)
    work = np.empty((q.shape[1], 18))
    for t in range(q.shape[0]):
        rnea(chain, q[t], dq[t], ddq[t], work, rigid[t])
        for j in range(q.shape[1]):
            speed = dq[t, j]
            slip = np.tanh(speed / width[j]) if width[j] > 0.0 else np.sign(speed)
            tau[t, j] = (
                rigid[t, j]
                + inertia[j] * ddq[t, j]
                + viscous[j] * speed
                + coulomb[j] * slip
                + offset[j]
            )
    return tau, rigid


@dataclass(frozen=True, eq=False)
class ChainTorque:
    """Rigid body, losses and perhaps named laws and a net, compiled: eq. 1 of the paper."""

    chain: Chain  # the arm as arrays
    losses: LossParameters  # losses of its joints
    net: CompiledNet | None = None  # residual net of the chain's joints; None without
    named: tuple[NamedLaw, ...] = ()  # friction laws of the chain's joints that a diagnosis named

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.chain.masses)

    @cached_property
    def joints(self) -> Array:
        """The chain as loops read it, see `joint_rows`."""
        return joint_rows(self.chain)

    def torque(
        self, q: Float[Array, "B T n"], dq: Float[Array, "B T n"], ddq: Float[Array, "B T n"]
    ) -> Float[Array, "B T n"]:
        """Joint torque [N m]."""
        flat_q, flat_dq, flat_ddq = (self._flat(values) for values in (q, dq, ddq))
        losses = _values_of(self.losses)
        tau, rigid = _torque_states(self.joints, losses, flat_q, flat_dq, flat_ddq)
        if self.named:
            width = self.losses.transition_speed
            tau += named_torque(self.named, flat_q, flat_dq, rigid, width)
        if self.net is not None:
            tau += self.net.torque(flat_q, flat_dq, flat_ddq, rigid)
        return tau.reshape(np.shape(q))

    def _flat(self, values: Float[Array, "B T n"]) -> Float[Array, "BT n"]:
        """The states of all trajectories below one another."""
        return np.ascontiguousarray(values, dtype=float).reshape(-1, self.n)


@cache
def section_nodes(points: int = POINTS) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
    """Local times of a section and their weights: Gauss-Legendre inside, both ends weigh nothing.

    The ends are where acceleration, and mostly torque, peaks: a cubic's acceleration is linear in
    each section.
    """
    abscissae, weights = np.polynomial.legendre.leggauss(points)
    times = np.concatenate([[0.0], (abscissae + 1) / 2, [1.0]])
    return times, np.concatenate([[0.0], weights / 2, [0.0]])


def power_integral(
    tau: Float[Array, "B T n"],
    dq: Float[Array, "B T n"],
    weights: Float[Array, "B T"],
    metric: Metric,
) -> Float[Array, " B"]:
    """Energy by one metric, summed over the joints [J]; N² m² s for copper.

    signed: ∫ τ dq dt, the paper's eq. 8, which credits negative work; positive: braking is lost,
    not credited; absolute: braking costs as much as driving; copper: ∫ τ² dt, what heats the
    motors.

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
    """Energy of the first of a batch of motions [J] by every metric, see `power_integral`.

    Args:
        tau: Joint torques (B, T, n) [N m].
        dq: Joint speeds (B, T, n) [rad/s].
        weights: Of each state in the integral over time (B, T) [s].

    Returns:
        By metric's name, one entry for each of `METRICS`.
    """
    energies: dict[Metric, float] = {}
    for metric in METRICS:
        energies[metric] = float(power_integral(tau, dq, weights, metric)[0])
    return energies


def energy(
    model: ChainTorque, splines: Splines, metric: Metric, points: int = POINTS
) -> Float[Array, " B"]:
    """Energy of each trajectory by one metric [J].

    Peaks, for which a section's ends count, are not looked at.

    Args:
        model: Torque model.
        splines: Trajectories.
        metric: How power is counted, see `power_integral`.
        points: Gauss-Legendre points a section.
    """
    times, shares = section_nodes(points)
    q, dq, ddq = splines.states(times[1:-1])
    tau = model.torque(q, dq, ddq)
    weights = (splines.durations[:, :, None] * shares[1:-1]).reshape(len(q), -1)
    return power_integral(tau, dq, weights, metric)


def torque_of_model(model: HybridModel, moving: int, held: Sequence[float]) -> ChainTorque:
    """Torque of a fitted model for the first joints, the others held.

    Args:
        model: The fitted model, of as many joints as move or more.
        moving: Number of joints that move.
        held: Positions of the robot's other joints [rad].
    """
    fixed = np.asarray(held, dtype=float)[: len(model.joint_names) - moving]
    arm = model.arm
    if len(fixed):
        arm = arm.locked(arm.joint_names[moving:], list(fixed))
    net = None
    if model.net is not None:
        net = read_residual(model.net)
        if len(fixed):
            net = net.frozen(fixed)
    losses = LossParameters(*(values[:moving] for values in _values_of(model.loss)))
    # Of joints that stand still there is no friction.
    named = tuple(law for law in model.named if law.joint < moving)
    return ChainTorque(arm.chain, losses, net, named)


def _values_of(loss: LossParameters) -> tuple[Array, ...]:
    """Motor inertia, viscous and Coulomb friction, offset and transition speed of all joints."""
    return (loss.motor_inertia, loss.viscous, loss.coulomb, loss.offset, loss.transition_speed)


@compiled(fastmath=True, nogil=True, error_model="numpy")
def _rigid_partials(chain, q, dq, ddq, step):  # type: ignore[no-untyped-def]
    """Rigid torque and its partials.

    Exact by acceleration (linear) and speed (quadratic), central by position.
    """
    count, n = q.shape
    tau = np.empty((count, n))
    by_q = np.empty((count, n, n))
    by_v = np.empty((count, n, n))
    by_a = np.empty((count, n, n))
    work = np.empty((n, 18))
    low = np.empty(n)
    high = np.empty(n)
    x = np.empty(n)
    for t in range(count):
        rnea(chain, q[t], dq[t], ddq[t], work, tau[t])
        for j in range(n):
            for i in range(n):
                x[i] = ddq[t, i]
            x[j] += 1.0
            rnea(chain, q[t], dq[t], x, work, high)
            for i in range(n):
                by_a[t, i, j] = high[i] - tau[t, i]
            for i in range(n):
                x[i] = dq[t, i]
            x[j] += 1.0
            rnea(chain, q[t], x, ddq[t], work, high)
            x[j] -= 2.0
            rnea(chain, q[t], x, ddq[t], work, low)
            for i in range(n):
                by_v[t, i, j] = 0.5 * (high[i] - low[i])
            for i in range(n):
                x[i] = q[t, i]
            x[j] += step
            rnea(chain, x, dq[t], ddq[t], work, high)
            x[j] -= 2.0 * step
            rnea(chain, x, dq[t], ddq[t], work, low)
            for i in range(n):
                by_q[t, i, j] = (high[i] - low[i]) / (2.0 * step)
    return tau, by_q, by_v, by_a


def rounded(model: ChainTorque, width: float) -> ChainTorque:
    """A copy of a model with the sign of its friction rounded by a further width [rad/s].

    That comes on top of what the model itself rounds.
    """
    losses = model.losses
    wider = replace(losses, transition_speed=losses.transition_speed + width)
    return replace(model, losses=wider)


def without_friction(model: ChainTorque) -> ChainTorque:
    """A copy of a model without dry friction, offsets, named laws and net.

    At rest it tells gravity alone; viscous friction and rotors stay.
    """
    zero = np.zeros(model.n)
    losses = replace(model.losses, coulomb=zero, offset=zero)
    return replace(model, net=None, named=(), losses=losses)


def differentiate_torque(
    model: ChainTorque,
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    ddq: Float[Array, "T n"],
) -> tuple[Float[Array, "T n"], Slopes]:
    """Torque of a compiled model [N m] and its partial derivatives at T states.

    Args:
        model: Rigid body, losses and perhaps a net; a friction that jumps has no slope here, see
            `rounded`.
        q, dq, ddq: States.
    """
    states = [np.ascontiguousarray(values, dtype=float) for values in (q, dq, ddq)]
    rigid, *derivatives = _rigid_partials(model.joints, *states, STEP)
    by_q, by_v, by_a = derivatives
    by_state = (by_q, by_v, by_a)
    losses = model.losses
    slip, slip_slope = _slip(losses, states[1])
    # By what the load of each law's joint changes, before anything else is added to it.
    load_slopes = [_of_joint(by_state, law.joint) for law in model.named]
    tau = rigid.copy()
    if model.net is not None:
        tau += model.net.add_slopes(states, rigid, by_state)
    for law, by_state_of_load in zip(model.named, load_slopes, strict=True):
        j = law.joint
        law_states = states_of(j, states[0], states[1], rigid, slip)
        slopes = _law_slopes(law, law_states)
        tau[:, j] += law.torque(law_states)
        for derivative, of_load in zip(by_state, by_state_of_load, strict=True):
            derivative[:, j] += slopes["load"][:, None] * of_load
        by_q[:, j, j] += slopes["q"]
        by_v[:, j, j] += slopes["dq"] + slip_slope[:, j] * slopes["slip"]
    friction = losses.motor_inertia * states[2] + losses.viscous * states[1]
    friction = friction + losses.coulomb * slip + losses.offset
    tau += friction
    joints = np.arange(model.n)
    by_a[:, joints, joints] += losses.motor_inertia
    by_v[:, joints, joints] += losses.viscous + losses.coulomb * slip_slope
    return tau, by_state


def _of_joint(slopes: Slopes, joint: int) -> list[Float[Array, "T n"]]:
    """Copies of the derivatives of one joint's torque."""
    return [derivative[:, joint].copy() for derivative in slopes]


def _slip(
    losses: LossParameters, dq: Float[Array, "T n"]
) -> tuple[Float[Array, "T n"], Float[Array, "T n"]]:
    """Sign of the speed, rounded by tanh(v / width), and its slope [s/rad].

    Where the width is zero, the slope is not seen.
    """
    width = np.where(losses.transition_speed > 0.0, losses.transition_speed, np.inf)
    is_rounded = width < np.inf
    slip = np.where(is_rounded, np.tanh(dq / width), np.sign(dq))
    slope = np.where(is_rounded, (1.0 - slip**2) / width, 0.0)
    return slip, slope


def _law_slopes(law: NamedLaw, states: JointStates) -> dict[str, Float[Array, " T"]]:
    """Derivatives of a friction law's torque by each of its states, by central differences.

    Moduli have corners: there this is the mean of both sides.
    """
    slopes = {}
    for name in LAW_STATES:
        middle = getattr(states, name)
        above = law.torque(replace(states, **{name: middle + LAW_STEP}))
        below = law.torque(replace(states, **{name: middle - LAW_STEP}))
        slopes[name] = (above - below) / (2.0 * LAW_STEP)
    return slopes


def find_kinks(
    model: ChainTorque,
    dq: Float[Array, "T n"],
    differentiated: tuple[Array, Slopes],
    metric: Metric,
    width: float,
) -> Iterator[tuple[Int[Array, " k"], list[Float[Array, "k n"]]]]:
    """Second derivative of what is integrated where power or speed of a joint passes zero.

    The modulus of power, √(p² + δ²), is bent there by δ²/√(p² + δ²)³ along p's own slope, and
    friction's share of it, v tanh(v/w), by 2/w (1 - tanh²)(1 - v/w tanh) along v. A joint that
    coasts, or stands for a while, stays at such a kink, where the slope alone points to where the
    cost rises at once.

    Args:
        model: As it was differentiated, its friction rounded.
        dq: Speeds.
        differentiated: Its torque and derivatives.
        metric: How energy is counted.
        width: Rounding δ of the modulus of power [W].

    Yields:
        States, and slopes there by position, speed and acceleration, whose squares are the second
        derivative.
    """
    if metric not in KINKS:
        return
    kink = KINKS[metric]
    tau, slopes = differentiated
    unit = np.eye(model.n)
    power = tau * dq
    root = np.sqrt(power**2 + width**2)
    bend = kink * (width / root) ** 3
    nodes, joints = np.nonzero(bend > BENT)
    speed = dq[nodes, joints, None]
    by_state = [derivative[nodes, joints] * speed for derivative in slopes]
    by_state[1] += unit[joints] * tau[nodes, joints, None]
    scale = np.sqrt(bend[nodes, joints, None] / width)
    yield nodes, [derivative * scale for derivative in by_state]

    losses = model.losses
    share = dq / losses.transition_speed
    slip = np.tanh(share)
    driving = 1.0 - kink + kink * power / root
    bend = np.maximum(driving * (1.0 - slip**2) * (1.0 - share * slip), 0.0)
    nodes, joints = np.nonzero(bend > BENT)
    size = np.sqrt(2.0 * bend * losses.coulomb / losses.transition_speed)
    by_speed = size[nodes, joints, None] * unit[joints]
    nothing = 0.0 * by_speed
    yield nodes, [nothing, by_speed, nothing]
