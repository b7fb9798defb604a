"""What a task has to keep: its arm's limits, its maker's and its own, inside what is known of the
arm.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.arrays import Array
from ident.errors import InputError
from ident.model.training_range import TrainingRange
from ident.robot.arm import ArmModel
from ident.robot.limits import has_room
from plan.command_options import TaskOptions
from plan.problem.makers_limits import MakersLimits
from plan.problem.problem import ADVICE, TRAINING, Limits, PlanningProblem
from plan.problem.scene_keys import as_given
from plan.problem.task_file import Task

# What a joint that turns may do where its URDF does not say [rad].
TURN = 2.0 * np.pi
# A joint that the training left standing may move with this [rad/s, rad/s²]: a limit has to lie
# above nought.
LEAST_RATE = 1e-6
# How a URDF says that a limit of speed or torque is unknown: see `ident.robot.limits`.
NOT_GIVEN = "0, 1 or a giant in the URDF"


def task_limits(
    task: Task,
    arm: ArmModel,
    makers: MakersLimits | None,
    reserve: Array | None,
    advised: bool = False,
) -> Limits:
    """The robot's limits within those of the task; where the task gives none, its maker's of speed,
    acceleration, jerk.

    Advice of the maker counts only where it is asked for.

    Raises:
        InputError: They leave nothing.
    """
    lower = arm.lower if task.lower is None else np.maximum(arm.lower, task.lower)
    upper = arm.upper if task.upper is None else np.minimum(arm.upper, task.upper)
    known = arm.known_limits
    torque = known.effort if task.torque is None else task.torque
    usable = torque if reserve is None else torque - reserve
    for j, joint in enumerate(arm.joint_names):
        if lower[j] >= upper[j]:
            low, high = (
                as_given(one[j], bool(arm.sliding_joints[j]), 0) for one in (arm.lower, arm.upper)
            )
            what = f"[limits] leave {joint} no room within the robot's own, {low} to {high}"
            raise InputError(task.source, what, "correct lower_deg or upper_deg")
        if reserve is not None and not usable[j] > 0.0:
            what = f"{joint} may use {torque[j]:g} N m, and the model's torque is known to {reserve[j]:.2g} N m only"
            raise InputError(task.source, what, "raise limits.torque_Nm, or give --no-reserve")
    asked = makers if task.makers else None
    speed = known.speed if task.speed is None else task.speed
    if (
        task.speed is None and asked is not None and asked.speed is not None
    ):  # of all the arm's joints, held ones last
        speed = np.minimum(speed, asked.speed[: task.n])
    bound = asked if asked is not None and (asked.binding or advised) else None
    published = (None, None) if bound is None else (bound.acceleration, bound.jerk)
    acceleration, jerk = (
        own if own is not None or theirs is None else theirs[: task.n]
        for own, theirs in zip((task.acceleration, task.jerk), published, strict=True)
    )
    return Limits(lower, upper, speed, usable, task.clearance, acceleration, jerk, reserve)


def with_known_positions(arm: ArmModel, task: Task) -> tuple[ArmModel, tuple[str, ...]]:
    """The arm with a whole turn either way for joints whose limits leave no room, and what is to be
    said of it.

    Raises:
        InputError: A joint that slides has none, and the task gives none.
    """
    unknown = ~has_room(arm.lower, arm.upper)
    if not unknown.any():
        return arm, ()
    names = [name for name, missing in zip(arm.joint_names, unknown, strict=True) if missing]
    if np.any(unknown & arm.sliding_joints) and (task.lower is None or task.upper is None):
        what = f"the URDF gives {' and '.join(names)} no limits of position (no room between them)"
        raise InputError(
            task.source, what, "give limits.lower_deg and upper_deg, of joints that slide in metres"
        )
    lower, upper = np.where(unknown, -TURN, arm.lower), np.where(unknown, TURN, arm.upper)
    if task.lower is not None:
        lower = np.where(unknown, task.lower, lower)
    if task.upper is not None:
        upper = np.where(unknown, task.upper, upper)
    what = (
        f"limits of position of {', '.join(names)} are unknown (no room between them in the URDF)"
    )
    said = f"{what}: a turn either way is taken"
    return arm.with_position_limits(lower, upper), (said,)


def say_unknown(arm: ArmModel, limits: Limits) -> tuple[str, ...]:
    """Which limits of torque and speed nobody gives, in words."""
    said = []
    for name, values in (("torque", limits.torque), ("speed", limits.speed)):
        missing = [
            joint for joint, value in zip(arm.joint_names, values, strict=True) if np.isinf(value)
        ]
        if missing:
            what = f"limits of {name} of {', '.join(missing)} are unknown ({NOT_GIVEN})"
            said.append(f"{what}: none is kept")
    return tuple(said)


def require_known_rates(task: Task, arm: ArmModel, limits: Limits, objective: str) -> None:
    """Raises InputError where a joint's speed has no limit: a time task has no end, and no search a
    scale.
    """
    missing = [
        name for name, speed in zip(arm.joint_names, limits.speed, strict=True) if np.isinf(speed)
    ]
    if missing:
        what = f"nobody says how fast {', '.join(missing)} may be ({NOT_GIVEN})"
        raise InputError(task.source, what, "give limits.speed_deg_s")
    endless = [
        name
        for name, torque in zip(arm.joint_names, limits.torque, strict=True)
        if np.isinf(torque)
    ]
    if objective == "time" and endless and limits.acceleration is None:
        strength = f"nobody says how strong {', '.join(endless)} may be ({NOT_GIVEN})"
        what = f"{strength}, nor how fast speed may change"
        raise InputError(task.source, what, "give limits.torque_Nm or acceleration_deg_s2")


def name_known(
    task: Task, trained: TrainingRange | None, makers: MakersLimits | None, options: TaskOptions
) -> str:
    """What a motion stays inside of: the model's training, else the maker's advice; nothing where
    neither is known.

    Raises:
        InputError: It is to stay inside of what is not known, or to leave it, too.
    """
    if options.inside and options.beyond:
        raise InputError("--beyond", "--stay-inside is given, too", "give one of them")
    if options.inside and trained is None:
        raise InputError(
            "--stay-inside", "no model says where it was fitted", "give --model, or fit it again"
        )
    if options.beyond:
        return ""
    if trained is not None:
        return TRAINING
    advised = (
        task.makers
        and makers is not None
        and not makers.binding
        and makers.acceleration is not None
    )
    return ADVICE if advised and task.acceleration is None else ""


def say_beyond(trained: TrainingRange | None, makers: MakersLimits | None) -> str:
    """What leaving the known means, in words."""
    said = []
    if trained is not None:
        speed, acceleration = (
            float(np.maximum(trained.high[k], -trained.low[k]).max()) for k in (1, 2)
        )
        said.append(f"the model saw no more than {speed:.3g} rad/s and {acceleration:.3g} rad/s2")
        said.append("torque and energy beyond that are guesses, and no interval holds there")
    elif makers is not None and makers.acceleration is not None and not makers.binding:
        said.append(f"the maker advises {float(makers.acceleration.max()):.3g} rad/s2")
        said.append("the controller may stop the arm beyond that")
    else:
        said.append("nothing is known of this arm that could be left")
    return f"beyond what is known, as asked: {'; '.join(said)}"


def stay_inside(limits: Limits, known: TrainingRange) -> Limits:
    """Limits of speed and acceleration that let nothing pass which the training did not see;
    positions stay.
    """
    ours = known.first(len(limits.lower))
    speed, acceleration = (
        np.maximum(np.minimum(-ours.low[k], ours.high[k]), LEAST_RATE) for k in (1, 2)
    )
    most = np.inf if limits.acceleration is None else limits.acceleration
    return replace(
        limits, speed=np.minimum(limits.speed, speed), acceleration=np.minimum(most, acceleration)
    )


def within_known(problem: PlanningProblem) -> PlanningProblem:
    """The same within the positions of its model's training, widened to what the task itself names;
    that is told.
    """
    trained = problem.trained
    if problem.known != TRAINING or trained is None:
        return problem
    ours, limits = trained.first(problem.n), problem.limits
    passed = [via.target for via in problem.way.vias if not via.of_tool]
    ends = np.stack([problem.start, problem.goal, *passed])
    low, high = (
        np.minimum(ours.low[0], ends.min(axis=0)),
        np.maximum(ours.high[0], ends.max(axis=0)),
    )
    lower, upper = np.maximum(limits.lower, low), np.minimum(limits.upper, high)
    names = problem.scene.arm.joint_names
    wide = [
        name
        for name, a, b in zip(names, low < ours.low[0], high > ours.high[0], strict=True)
        if a or b
    ]
    said = problem.notes
    if wide:
        joints = ", ".join(wide)
        what = "the task begins, passes or ends beyond the model's training"
        said = (*said, f"{what}: positions of {joints} reach as far as it does")
    return replace(problem, limits=replace(limits, lower=lower, upper=upper), notes=said)
