"""What the diagnosis will see of a motion that is yet to be recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.diagnosis.regression.baseline import Baseline, fit_baseline
from ident.diagnosis.regression.runs import build_session
from ident.effects.base import SessionContext
from ident.motion.filter import FOR_DIAGNOSIS
from ident.motion.motion import Lowpass, Motion
from ident.robot.arm import ArmModel
from ident.trajectories.limits import MotionLimits
from ident.trajectories.reference import TICK_S, ReferenceMotion
from plan.experiment.run_set import random_runs

# Of the ticks of a reference, one in this many is looked at: 125 Hz.
THINNING = 8
PAUSE_S = 5.0
# What a smoother leaves of the doubt about q, dq and ddq at a modern encoder [rad, rad/s, rad/s²].
STATE_DOUBT = (1e-5, 1e-3, 0.1)
# Noise where none is known, as a share of the rated torque: that of a good drive and of what models leave.
NOISE_SHARE = 0.005
# A typical gear's friction: Coulomb as a share of the rated torque, viscous as much again at this speed [rad/s],
# rotor inertia as a share of rated torque at 100 rad/s².
COULOMB_SHARE, VISCOUS_SPEED, ROTOR_RATE = 0.06, 1.2, 150.0


@dataclass(frozen=True, eq=False)
class Eye:
    """What the diagnosis will know when it looks at a motion that is yet to be recorded.

    Attributes:
        arm: The arm.
        baseline: Tuned on an imagined healthy recording.
        noise: Standard deviation of each joint's torque noise [N m].
    """

    arm: ArmModel
    baseline: Baseline
    noise: Float[Array, " n"]

    @classmethod
    def of(cls, arm: ArmModel, noise: Float[Array, " n"] | None = None) -> Eye:
        """The eye for an arm; noise of half a per cent of the rated torque if none is known."""
        limits = MotionLimits(arm)
        rng = np.random.default_rng(0)
        runs = [as_recorded(run, arm, 0.0) for run in random_runs(arm, 3, 6.0, rng)]
        healthy = [_with_torque(run, arm, limits.torque, rng) for run in runs]
        sigma = NOISE_SHARE * limits.torque if noise is None else noise
        return cls(arm, fit_baseline(healthy, arm), freeze(np.array(sigma)))

    def session(self, runs: Sequence[ReferenceMotion]) -> SessionContext:
        """Runs as the effects will see them, on one clock."""
        motions, clock = [], 0.0
        for run in runs:
            motions.append(as_recorded(run, self.arm, clock))
            clock = float(motions[-1].time[-1]) + PAUSE_S
        return build_session(self.baseline, motions, common_clock=True)


def as_recorded(run: ReferenceMotion, arm: ArmModel, start: float) -> Motion:
    """A reference as if the arm had followed it exactly, without torque."""
    q, dq, ddq = (freeze(values[::THINNING]) for values in (run.q, run.dq, run.ddq))
    rate = 1.0 / (THINNING * TICK_S)
    return Motion(
        name=run.name,
        joints=arm.joint_names,
        time=freeze(start + np.arange(len(q)) / rate),
        q=q,
        dq=dq,
        ddq=ddq,
        tau=freeze(np.zeros_like(q)),
        lowpass=Lowpass.design(rate, settings=FOR_DIAGNOSIS),
        std=freeze(np.outer(STATE_DOUBT, np.ones(arm.n))),
    )


def _with_torque(run: Motion, arm: ArmModel, rated: Float[Array, " n"], rng: np.random.Generator) -> Motion:
    """The same run with the torque of an arm as its URDF says, with typical friction and noise."""
    coulomb = COULOMB_SHARE * rated
    tau = arm.inverse_dynamics(run.q, run.dq, run.ddq) + rated / ROTOR_RATE * run.ddq
    tau += coulomb * (np.tanh(run.dq / 2e-3) + run.dq / VISCOUS_SPEED)
    tau += NOISE_SHARE * rated * rng.standard_normal(tau.shape)
    return replace(run, tau=freeze(tau))
