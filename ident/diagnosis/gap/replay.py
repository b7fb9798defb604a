"""Replay of the motion: the recorded torques drive the model over short windows.

The position error is measured. A replay starts from the measured state. The recording obeys the
model but for the residual torque r, so the deviation e = q_replayed − q obeys, to first order,

    M(q) ë + D(q, dq) ė + K(q, dq, ddq) e = r,   e(0) = ė(0) = 0

with M the mass matrix and rotors, D and K the derivatives of the modelled torque by velocity and
position. All windows are integrated at once by Newmark's rule of constant mean acceleration. With
an exact model only noise deviates; a missing torque of 1 N m on 1 kg m² moves the joint by 31 mrad
in a quarter of a second.

A joint that stands still or reverses within a window is led along its recorded motion there, for
dry friction at rest is not a function of the state. Controllers are not modelled.

Source: multiple shooting after Bock 1984; Newmark 1959 (β = 1/4, γ = 1/2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.diagnosis.gap.residuals import RunResidual
from ident.diagnosis.gap.settings import USUAL_REPLAY, ReplaySettings
from ident.records import JsonRecord
from ident.regression.baseline import Baseline


@dataclass(frozen=True, eq=False)
class Replay:
    """Deviation of the replayed from the recorded motion."""

    window: float  # length of a window [s]
    windows: Int[Array, " n"]  # number of windows in which each joint moved freely
    # Root mean square deviation at the end of a window [rad], without the effects and with them.
    before: Float[Array, " n"]
    after: Float[Array, " n"]

    def to_dict(self, joints: Sequence[str]) -> JsonRecord:
        """Its record, for the joints that moved freely.

        Args:
            joints: Names of the arm's joints.

        Returns:
            `window_s`, `windows` (number by joint name), and `position_rms_rad` with `before` and
            `after` the effects, by joint name.
        """
        there = [(j, name) for j, name in enumerate(joints) if self.windows[j]]
        return {
            "window_s": self.window,
            "windows": {name: int(self.windows[j]) for j, name in there},
            "position_rms_rad": {
                "before": {name: float(self.before[j]) for j, name in there},
                "after": {name: float(self.after[j]) for j, name in there},
            },
        }


def replay(
    series: Sequence[RunResidual], baseline: Baseline, settings: ReplaySettings = USUAL_REPLAY
) -> Replay:
    """Replays the session with models that were not fitted to the window's fold.

    Args:
        series: Residuals of all runs.
        baseline: The tuned model, for masses and derivatives.
        settings: Length and number of the windows.
    """
    window = settings.window_s
    n = len(baseline.nominal.joint_names)
    squares = np.zeros((2, n))
    windows = np.zeros(n, dtype=int)
    count = sum(len(_starts(item, window)) for item in series)
    every = max(1, math.ceil(count / settings.most_windows))
    for item in series:
        starts = _starts(item, window)[::every]
        rows = starts[:, None] + np.arange(_samples(item, window) + 1)
        # Free are joints that move one way throughout a window.
        heading = np.sign(item.speed[rows])
        one_way = (heading == heading[:, :1]).all(axis=1)
        free = item.valid[rows].all(axis=1) & one_way
        any_free = free.any(axis=1)
        rows = rows[any_free]
        free = free[any_free]
        if len(rows) == 0:
            continue
        force = np.stack([item.unseen_before[rows], item.unseen_after[rows]], axis=-1)
        departure = integrate(*_dynamics(item, baseline, rows), force, free, item.step)
        squares += np.sum(departure**2, axis=0).T
        windows += free.sum(axis=0)
    rms = np.sqrt(squares / np.maximum(windows, 1))
    return Replay(window, windows, rms[0], rms[1])


def _starts(item: RunResidual, window: float) -> Int[Array, " w"]:
    """First samples of a run's windows, which follow each other."""
    return np.arange(0, len(item.before) - _samples(item, window), _samples(item, window))


def _samples(item: RunResidual, window: float) -> int:
    """Number of steps of a window, at least one."""
    return max(1, round(window / item.step))


def _dynamics(
    item: RunResidual, baseline: Baseline, rows: Int[Array, "w k"]
) -> tuple[Float[Array, "w k n n"], Float[Array, "w k n n"], Float[Array, "w k n n"]]:
    """Mass matrix, damping and stiffness along the recorded motion."""
    motion = item.run.motion
    sample = rows.ravel() * motion.lowpass.factor
    stiffness, damping, mass = item.run.arm.derivatives(
        motion.q[sample],
        motion.dq[sample],
        motion.ddq[sample],
    )
    shape = (*rows.shape, motion.n, motion.n)
    mass = mass + np.diag(baseline.loss.motor_inertia)
    damping = damping + np.diag(baseline.loss.viscous)
    return mass.reshape(shape), damping.reshape(shape), stiffness.reshape(shape)


def integrate(
    mass: Float[Array, "w k n n"],
    damping: Float[Array, "w k n n"],
    stiffness: Float[Array, "w k n n"],
    force: Float[Array, "w k n m"],
    free: Bool[Array, "w n"],
    step: float,
) -> Float[Array, "w n m"]:
    """Deviation at the end of each window; joints that are not free stay at zero.

    Args:
        mass: Mass matrices along the k samples of each window [kg m²].
        damping, stiffness: Torque by velocity and by position there [N m s/rad, N m/rad].
        force: Residual torque of m models [N m].
        free: Joints that may deviate in each window.
        step: Time between samples [s].
    """
    both = free[:, None, :, None] & free[:, None, None, :]
    led: Array = np.eye(free.shape[1]) * ~free[:, None, :]
    mass = np.where(both, mass, 0.0)
    damping = np.where(both, damping, 0.0)
    stiffness = np.where(both, stiffness, 0.0)
    force = np.where(free[:, None, :, None], force, 0.0)
    deviation = np.zeros(force[:, 0].shape)
    speed = np.zeros(force[:, 0].shape)
    acceleration = np.linalg.solve(mass[:, 0] + led, force[:, 0])
    for k in range(1, force.shape[1]):
        reached = deviation + step * speed + step**2 / 4 * acceleration
        gained = speed + step / 2 * acceleration
        damped = step / 2 * damping[:, k]
        sprung = step**2 / 4 * stiffness[:, k]
        left = mass[:, k] + led + damped + sprung
        braking = damping[:, k] @ gained
        pull = force[:, k] - braking - stiffness[:, k] @ reached
        acceleration = np.linalg.solve(left, pull)
        deviation = reached + step**2 / 4 * acceleration
        speed = gained + step / 2 * acceleration
    return deviation
