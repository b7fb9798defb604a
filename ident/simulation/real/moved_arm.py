"""A real arm as it moved: smoothed states, its rigid torque, and what an ordinary model leaves of
the recorded torque.

Smoothing, rigid body and refit are this module's own: neither the diagnosis nor the simulated arm
is asked.

A gear that twists, or has play, moves the link behind a motor that moves as recorded. With the
twist θ between motor and link, M θ'' + D θ' + K z(θ) = τ, where τ is what the bodies would ask of
the motor if the gear were rigid, M the inertia that the joint moves, z(θ) = θ or what of it lies
beyond the play.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import pinocchio as pin
from scipy.signal import butter, sosfiltfilt

from ident.arrays import Array, Bool, Float
from ident.compiled import compiled
from ident.simulation.real.sources import Source

# Of the zero-phase filters for states and for what is compared [Hz]; of the rows that are compared
# [Hz].
STATE_CUTOFF = 10.0
BAND = 8.0
ROW_RATE = 25.0
FASTEST_GRID = 250.0  # [Hz]
STILL = 0.005  # [rad/s]
# How often the refit's joints are weighted anew by what they leave.
REWEIGHTINGS = 3
# An effect that acts for a while acts where it is more than this share of its largest.
ACTS = 0.1
# Share of the rows in which a joint has to move for an effect to be planted at it.
LEAST_MOVING = 0.15
# Width of the sign of a speed [rad/s].
TURNING = 0.01
View = Literal["refit", "loss", "no_offset"]
# Share of an oscillation's phase that a step of the integration may take; fastest and slowest step
# [s].
PHASE = 0.25
STEPS = (5e-5, 1e-3)


def model_of(urdf: str) -> pin.Model:
    """Pinocchio's model of a URDF's text."""
    return pin.buildModelFromXML(urdf)


def rigid_torque(
    model: pin.Model, q: Float[Array, "N n"], v: Float[Array, "N n"], a: Float[Array, "N n"]
) -> Float[Array, "N n"]:
    """Torque that the bodies ask for [N m]."""
    data = model.createData()
    states = zip(q, v, a, strict=True)
    return np.array([pin.rnea(model, data, *state) for state in states])


@dataclass(frozen=True, eq=False)
class MovedArm:
    """All runs of a session, one after the other in N rows of n joints."""

    source: Source  # where they come from
    t: Float[Array, " N"]  # session clock [s]
    runs: tuple[slice, ...]  # rows of each run
    q: Float[Array, "N n"]  # smoothed motion
    v: Float[Array, "N n"]
    a: Float[Array, "N n"]
    tau: Float[Array, "N n"]  # recorded torque [N m]
    given: tuple[slice, ...]  # rows of each piece that a session gets, none over two runs

    @classmethod
    def of(cls, source: Source, given: Sequence[slice] = ()) -> MovedArm:
        """Smooths the recordings of a source.

        Args:
            source: All that was recorded.
            given: Rows that a session gets of it, counted over all runs; all if none is named. An
                effect is worked out over all rows, so that what remembers comes to them as it
                would have; whether it shows is asked of these alone.
        """
        ends = np.cumsum([0, *(len(run.time) for run in source.runs)])
        pairs = itertools.pairwise(ends)
        runs = tuple(slice(int(start), int(end)) for start, end in pairs)
        # positions, speeds and accelerations of each run, at its sample times
        states: list[Array] = []
        for run in source.runs:
            grid = _grid(run.time)
            interval = grid[1] - grid[0]
            recorded = _at(grid, run.time, np.unwrap(run.position, axis=0))
            q = _filtered(recorded, interval, STATE_CUTOFF)
            v = np.gradient(q, interval, axis=0)
            a = _filtered(np.gradient(v, interval, axis=0), interval, STATE_CUTOFF)
            states.append(np.array([_at(run.time, grid, channel) for channel in (q, v, a)]))
        q, v, a = np.concatenate(states, axis=1)
        t = np.concatenate([run.time for run in source.runs])
        tau = np.concatenate([run.effort for run in source.runs])
        return cls(source, t, runs, q, v, a, tau, tuple(given) or runs)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.q.shape[1]

    @cached_property
    def model(self) -> pin.Model:
        """The arm of the recordings' URDF."""
        return model_of(self.source.urdf)

    @cached_property
    def rigid(self) -> Float[Array, "N n"]:
        """Torque of the URDF's bodies [N m]."""
        return rigid_torque(self.model, self.q, self.v, self.a)

    @cached_property
    def steps(self) -> Float[Array, " N"]:
        """Time since the row before; infinite at the start of a run: what remembers begins anew
        [s].
        """
        dt = np.diff(self.t, prepend=-np.inf)
        dt[[run.start for run in self.runs]] = np.inf
        return dt

    @cached_property
    def load(self) -> Float[Array, "N n"]:
        """Torque that went through the gears: what was recorded less the refit's friction,
        low-passed [N m].
        """
        dry = self.coulomb * np.tanh(self.v / TURNING)
        friction = dry + self.viscous * self.v
        return self.over_runs(self.tau - friction, lambda t, x: _low_passed(t, x, BAND))

    @cached_property
    def peak(self) -> Float[Array, " n"]:
        """Torque that a joint hardly exceeds [N m]."""
        return np.quantile(np.abs(self.tau), 0.99, axis=0)

    def over_runs(self, x: Array, change: Callable[[Array, Array], Array]) -> Array:
        """A channel, changed run by run.

        Args:
            x: The channel (N, …).
            change: Of a run's times [s] and its rows, to as many rows.
        """
        return np.concatenate([change(self.t[run], x[run]) for run in self.runs])

    def plus(self, torque: Float[Array, "N n"]) -> MovedArm:
        """A copy with a torque added to the recorded one [N m]."""
        return replace(self, tau=self.tau + torque)

    # What an ordinary model leaves: link inertias, rotor, viscous and Coulomb friction, offset,
    # over the arm.

    @cached_property
    def _grids(self) -> list[Float[Array, " m"]]:
        clocks = [self.t[run] for run in self.runs]
        return [np.arange(clock[0], clock[-1], 1.0 / ROW_RATE) for clock in clocks]

    def rows(self, x: Float[Array, "N k"]) -> Float[Array, "M k"]:
        """A channel in the band and at the rows that are compared."""
        grids = zip(self.runs, self._grids, strict=True)
        rows = [_low_passed(self.t[run], x[run], BAND, grid) for run, grid in grids]
        return np.concatenate(rows)

    @cached_property
    def moving(self) -> Bool[Array, "M n"]:
        """Where each joint moves, at the M rows of the refit."""
        return np.abs(self.rows(self.v)) > STILL

    @cached_property
    def _asked(self) -> Bool[Array, " M"]:
        """Rows that are compared of which a session gets what they are made of."""
        instants = np.concatenate(self._grids)
        asked = np.zeros(len(instants), dtype=bool)
        for rows in self.given:
            begun = instants >= self.t[rows.start]
            not_over = instants <= self.t[rows.stop - 1]
            asked |= begun & not_over
        return asked

    @cached_property
    def _columns(self) -> Float[Array, "M n p"]:
        """Bodies (10 n), then rotor, viscous, Coulomb, offset of each joint."""
        q = self.rows(self.q)
        v = self.rows(self.v)
        a = self.rows(self.a)
        data = self.model.createData()
        states = zip(q, v, a, strict=True)
        bodies = [pin.computeJointTorqueRegressor(self.model, data, *state) for state in states]
        # of one joint Pinocchio drops an axis
        stacked = np.array(bodies).reshape(len(q), self.n, -1)
        sign = self.rows(np.tanh(self.v / TURNING))
        constant = np.ones_like(q)
        losses = [x[:, :, None] * np.eye(self.n) for x in (a, v, sign, constant)]
        return np.concatenate([stacked, *losses], axis=2) * self.moving[:, :, None]

    @cached_property
    def _fit(self) -> tuple[Float[Array, " p"], Float[Array, " n"]]:
        """Coefficients of the recorded torque, each joint weighted by what it leaves, and that [N
        m].
        """
        tau = self.rows(self.tau) * self.moving
        noise = np.ones(self.n)
        for _ in range(REWEIGHTINGS):
            width = self._columns.shape[2]
            weighted = (self._columns / noise[:, None]).reshape(-1, width)
            solution = np.linalg.lstsq(weighted, (tau / noise).ravel(), rcond=1e-9)[0]
            noise = self._rms(tau - self._columns @ solution)
        return solution, noise

    def _rms(self, x: Float[Array, "M n"]) -> Float[Array, " n"]:
        return _rms_where(self.moving, x)

    @cached_property
    def noise(self) -> Float[Array, " n"]:
        """What the refit leaves of the recorded torque, in the band; infinite where a joint hardly
        moves [N m].
        """
        return np.where(self.moving.mean(axis=0) > LEAST_MOVING, self._fit[1], np.inf)

    @cached_property
    def coulomb(self) -> Float[Array, " n"]:
        """Dry friction of each joint as refitted, 0.5 % of its peak torque at the least [N m]."""
        coulomb = self._fit[0][12 * self.n : 13 * self.n]
        return np.maximum(coulomb, 0.005 * self.peak)

    @cached_property
    def viscous(self) -> Float[Array, " n"]:
        """Viscous friction of each joint as refitted [N m s/rad].

        At the least what makes a tenth of the dry friction at a speed that 95 % of the samples are
        below.
        """
        fastest = np.quantile(np.abs(self.v), 0.95, axis=0) + 1e-6
        viscous = self._fit[0][11 * self.n : 12 * self.n]
        return np.maximum(viscous, 0.1 * self.coulomb / fastest)

    @cached_property
    def _bases(self) -> dict[View, Array]:
        """Orthonormal bases of what a refit explains: all; no bodies, as the URDF tells them; no
        offset.
        """
        n = self.n
        scale = 1.0 / self.noise  # a joint that hardly moves has no say
        width = self._columns.shape[2]
        whole = (self._columns * scale[:, None]).reshape(-1, width)
        kinds: dict[View, Array] = {
            "refit": whole,
            "loss": whole[:, 10 * n :],
            "no_offset": whole[:, : 13 * n],
        }
        bases: dict[View, Array] = {}
        for name, columns in kinds.items():
            scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
            values, vectors = np.linalg.eigh(scaled.T @ scaled)
            strong = values > 1e-10 * values[-1]
            of_strong = vectors[:, strong] / np.sqrt(values[strong])
            bases[name] = scaled @ of_strong
        return bases

    def visible(
        self, torque: Float[Array, "N n"], view: View, local: bool = False
    ) -> Float[Array, " n"]:
        """What a refit leaves of a torque at each joint; of a local one, while it acts.

        In units of what the same refit leaves of the recording as it is: where the URDF is held
        fixed, that holds the URDF's own errors, among which a small body more is none.
        """
        scaled = self.rows(torque) * self.moving / self.noise
        left = self._left(scaled, view)
        if local:
            size = np.abs(scaled)
            acts = np.any(size > ACTS * size.max(), axis=1)
            left = left[acts & self._asked]
            rms = np.sqrt(np.mean(left**2, axis=0))
            return np.asarray(rms / self._own[view])
        asked = self.moving & self._asked[:, None]
        return np.asarray(_rms_where(asked, left) / self._own[view])

    def _left(self, y: Float[Array, "M n"], view: View) -> Float[Array, "M n"]:
        basis = self._bases[view]
        return y - (basis @ (basis.T @ y.ravel())).reshape(y.shape)

    @cached_property
    def _own(self) -> dict[View, Float[Array, " n"]]:
        """What each refit leaves of the recorded torque, in units of the noise; one at the
        least.
        """
        torques: dict[View, Array] = {
            "refit": self.tau,
            "loss": self.tau - self.rigid,
            "no_offset": self.tau,
        }
        left = {}
        for view, torque in torques.items():
            scaled = self.rows(torque) * self.moving / self.noise
            left[view] = np.maximum(self._rms(self._left(scaled, view)), 1.0)
        return left


def _rms_where(mask: Bool[Array, "M n"], x: Float[Array, "M n"]) -> Float[Array, " n"]:
    count = np.maximum(mask.sum(axis=0), 1.0)
    return np.sqrt(np.sum(x**2 * mask, axis=0) / count) + 1e-9


def _grid(t: Float[Array, " T"]) -> Float[Array, " K"]:
    rate = min(1.0 / float(np.median(np.diff(t))), FASTEST_GRID)
    duration = t[-1] - t[0]
    return np.linspace(t[0], t[-1], max(int(rate * duration), 16))


def _filtered(x: Float[Array, "K n"], interval: float, cutoff: float) -> Float[Array, "K n"]:
    share = min(2.0 * cutoff * interval, 0.8)
    return sosfiltfilt(butter(2, share, output="sos"), x, axis=0)


def _at(t: Array, knots: Array, x: Array) -> Array:
    return np.column_stack([np.interp(t, knots, column) for column in x.T])


def _low_passed(t: Array, x: Array, cutoff: float, where: Array | None = None) -> Array:
    grid = _grid(t)
    even = _filtered(_at(grid, t, x), grid[1] - grid[0], cutoff)
    return _at(t if where is None else where, grid, even)


States = tuple[Array, Array, Array]


def twist_of(
    arm: MovedArm, j: int, stiffness: float, ratio: float, gap: float = 0.0
) -> tuple[States, float]:
    """Twist of a springy gear with play of full width `gap` [rad], its first two derivatives, and
    its damping [N m s/rad], a share `ratio` of the critical one.

    Raises:
        ValueError: The URDF's links behind the joint have no inertia about it.
    """
    # What the joint moves [kg m^2], every tenth sample and between.
    sampled = np.arange(0, len(arm.q), 10)
    data = arm.model.createData()
    inertias = []
    for k in sampled:
        of_joints = pin.crba(arm.model, data, arm.q[k])
        inertias.append(of_joints[j, j])
    inertia = np.interp(np.arange(len(arm.q)), sampled, inertias)
    if inertia.min() <= 0.0:
        raise ValueError(f"{arm.source.joints[j]} moves no inertia")
    damping = 2.0 * ratio * float(np.sqrt(stiffness * np.median(inertia)))
    slowest = np.sqrt(inertia.min() / stiffness)
    step = float(np.clip(PHASE * slowest, *STEPS))
    states = np.zeros((3, len(arm.q)))
    gear = np.array([stiffness, damping, 0.5 * gap, step])
    _follow(np.ascontiguousarray(arm.rigid[:, j]), inertia, arm.steps, gear, states)
    return (states[0], states[1], states[2]), damping


@compiled()
def _follow(torque: Array, mass: Array, dt: Array, gear: Array, out: Array) -> None:
    """Semi-implicit Euler between the samples, torque and inertia linear between them."""
    stiffness, damping, half, step = gear
    x = v = 0.0
    for k in range(len(torque)):
        if not np.isfinite(dt[k]):
            x = torque[k] / stiffness + np.sign(torque[k]) * half
            v = 0.0
            bend = torque[k]
        else:
            count = max(int(np.ceil(dt[k] / step)), 1)
            h = dt[k] / count
            for i in range(count):
                share = (i + 1) / count
                load = torque[k - 1] + share * (torque[k] - torque[k - 1])
                m = mass[k - 1] + share * (mass[k] - mass[k - 1])
                bend = stiffness * (np.sign(x) * max(abs(x) - half, 0.0))
                touching = 1.0 if abs(x) >= half else 0.05
                # The damping is taken at the step's end: no step is too long for it.
                v = (v + h * (load - bend) / m) / (1.0 + h * touching * damping / m)
                x += h * v
        bend = stiffness * (np.sign(x) * max(abs(x) - half, 0.0))
        out[0, k] = x
        out[1, k] = v
        damped = damping if abs(x) >= half else 0.05 * damping
        out[2, k] = (torque[k] - bend - damped * v) / mass[k]
