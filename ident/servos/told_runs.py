"""Goals, measured positions, and where the reported figures put a servo: the curves of a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Float
from ident.robot.arm import ArmModel
from ident.servos.goal_runs import GoalRun
from ident.servos.servo_fit import COLUMNS, ServoJoint


@dataclass(frozen=True, eq=False)
class ToldRun:
    """One run through its filter, at t samples of n joints [rad]."""

    name: str  # of the run
    time: Float[np.ndarray, " t"]  # from its start [s]
    position: Float[np.ndarray, "t n"]  # measured
    goal: Float[np.ndarray, "t n"]  # as it was given
    told: Float[
        np.ndarray, "t n"
    ]  # by the figures; no number near reversals and rest, where they say nothing


def told_runs(
    runs: Sequence[GoalRun], arm: ArmModel | None, joints: Sequence[ServoJoint]
) -> tuple[ToldRun, ...]:
    """What the figures say of every run.

    Args:
        runs, joints: The runs, and what was found of each joint.
        arm: What the joints carry; nobody knows if None.
    """
    return tuple(_told_run(run, arm, joints) for run in runs)


def _told_run(run: GoalRun, arm: ArmModel | None, joints: Sequence[ServoJoint]) -> ToldRun:
    motion = run.motion
    time = motion.time[motion.coarse]
    goals = []
    told = []
    for j, joint in enumerate(joints):
        goals.append(motion.filtered(run.goal_at(j, 0.0)))
        told.append(_told_joint(run, arm, joint, j))
    return ToldRun(
        name=motion.name,
        time=np.asarray(time - time[0]),
        position=np.asarray(motion.tau_filtered),
        goal=np.stack(goals, axis=1),
        told=np.where(motion.settled, np.stack(told, axis=1), np.nan),
    )


def _told_joint(
    run: GoalRun, arm: ArmModel | None, joint: ServoJoint, index: int
) -> Float[np.ndarray, " t"]:
    """The delayed goal less all that holds the joint back [rad]."""
    motion = run.motion
    figures = {name: value for name, (value, _, _) in joint.figures.items()}
    speed = motion.dq[:, index]
    gravity = np.zeros(len(speed))
    if arm is not None:
        gravity = arm.gravity(motion.q)[:, index]
    acceleration = motion.ddq[:, index]
    constant = np.ones(len(speed))
    columns = (acceleration, speed, np.sign(speed), constant, gravity)
    behind = np.zeros(len(speed))
    for name, column in zip(COLUMNS, columns, strict=True):
        behind += figures.get(name, 0.0) * column
    delay = figures.get("delay_s", 0.0)
    return np.asarray(motion.filtered(run.goal_at(index, delay) - behind))
