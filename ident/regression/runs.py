"""The runs of a session as the effects see them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import RunContext, SessionContext
from ident.motion.motion import Motion
from ident.regression.baseline import Baseline
from ident.regression.dwells import rested, resting, static_level
from ident.robot.arm import ArmModel


def build_session(
    baseline: Baseline, motions: Sequence[Motion], common_clock: bool
) -> SessionContext:
    """What the effects know of the runs: modelled torques only, never the measured one.

    Args:
        baseline: The tuned model.
        motions: All runs, in their order.
        common_clock: Whether the clock continues from run to run.
    """
    nominal = baseline.nominal
    runs = []
    for motion in motions:
        carrying = baseline.arm.with_payload(motion.payload)
        runs.append(_run_of(baseline, motion, carrying))
    return SessionContext(
        runs=tuple(runs),
        common_clock=common_clock,
        joint_names=nominal.joint_names,
        gear_ratios=nominal.gear_ratios,
        rated_torque=nominal.effort_limit,
        tuned=baseline.arm.inertial_parameters - nominal.inertial_parameters,
    )


def _run_of(baseline: Baseline, motion: Motion, arm: ArmModel) -> RunContext:
    """A run as the effects see it, with the arm that carries its payload."""
    rigid = arm.inverse_dynamics(motion.q, motion.dq, motion.ddq)
    slip = baseline.sliding.direction(motion)
    friction = baseline.loss.viscous * motion.dq + baseline.loss.coulomb * slip
    run = RunContext(
        motion=motion,
        arm=arm,
        rigid=rigid,
        link=rigid,
        rotor=np.asarray(baseline.loss.motor_inertia * motion.ddq),
        friction=np.asarray(friction),
        direction=slip,
        temperature=motion.temperature,
        position_command=motion.position_command,
    )
    return rested(run)


def noisier_run(baseline: Baseline, run: RunContext) -> RunContext:
    """A run as seen with one more draw of the encoder noise in its states; the arm as it
    carries.
    """
    return _run_of(baseline, run.motion.noisier, run.arm)


def leftover_torque(session: SessionContext) -> Sequence[Float[Array, "t n"]]:
    """What the tuned model leaves of each run's torque, filtered; NaN at a run's ends, which
    filters blur [N m].

    Of a joint at rest it is what goes beyond its static friction: mostly zero. Near a stop or a
    turn, where friction may have either sign, it is what goes beyond twice as much, and NaN where
    nothing does: nobody knows.

    Returns:
        For each run, at its t filtered samples.
    """
    torques = []
    held = static_level(session)
    for run in session.runs:
        motion = run.motion
        left = motion.tau_filtered - motion.filtered(run.total)
        rests = resting(motion)[motion.coarse]
        friction = np.where(rests, held, 2.0 * held)
        beyond = left - np.clip(left, -friction, friction)
        of_rest_and_turns = np.where(rests | (beyond != 0.0), beyond, np.nan)
        torque = np.where(motion.settled, left, of_rest_and_turns)
        for j, reach in enumerate(motion.blurred.tolist()):
            torque[:reach, j] = np.nan
            torque[len(torque) - reach :, j] = np.nan
        torques.append(torque)
    return torques
