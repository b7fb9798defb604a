"""What a task has to keep: its arm's limits, its maker's and its own, inside what is known of the
arm.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.arrays import Array, Bool
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
            slides = bool(arm.sliding_joints[j])
            low = as_given(arm.lower[j], slides, 0)
            high = as_given(arm.upper[j], slides, 0)
            what = f"[limits] leave {joint} no room within the robot's own, {low} to {high}"
            raise InputError(task.source, what, "correct lower_deg or upper_deg")
        if reserve is not None and not usable[j] > 0.0:
            given = f"{joint} may use {torque[j]:g} N m"
            what = f"{given}, and the model's torque is known to {reserve[j]:.2g} N m only"
            raise InputError(task.source, what, "raise limits.torque_Nm, or give --no-reserve")
    speed = known.speed if task.speed is None else task.speed
    acceleration = task.acceleration
    jerk = task.jerk
    if makers is not None and task.makers:
        # The maker's are of all the arm's joints, held ones last.
        if task.speed is None and makers.speed is not None:
            speed = np.minimum(speed, makers.speed[: task.n])
        if makers.binding or advised:
            acceleration = _first_given(acceleration, makers.acceleration, task.n)
            jerk = _first_given(jerk, makers.jerk, task.n)
    return Limits(lower, upper, speed, usable, task.clearance, acceleration, jerk, reserve)


def _first_given(asked: Array | None, published: Array | None, n: int) -> Array | None:
    """What the task asks for, else the maker's of the first n joints."""
    if asked is not None or published is None:
        return asked
    return published[:n]


def with_known_positions(arm: ArmModel, task: Task) -> tuple[ArmModel, tuple[str, ...]]:
    """The arm with a whole turn either way for joints whose limits leave no room, and what is to be
    said of it.

    Raises:
        InputError: A joint that slides has none, and the task gives none.
    """
    unknown = ~has_room(arm.lower, arm.upper)
    if not unknown.any():
        return arm, ()
    names = _names_where(arm, unknown)
    if np.any(unknown & arm.sliding_joints) and (task.lower is None or task.upper is None):
        what = f"the URDF gives {' and '.join(names)} no limits of position (no room between them)"
        remedy = "give limits.lower_deg and upper_deg, of joints that slide in metres"
        raise InputError(task.source, what, remedy)
    lower = np.where(unknown, -TURN, arm.lower)
    upper = np.where(unknown, TURN, arm.upper)
    if task.lower is not None:
        lower = np.where(unknown, task.lower, lower)
    if task.upper is not None:
        upper = np.where(unknown, task.upper, upper)
    joints = ", ".join(names)
    what = f"limits of position of {joints} are unknown (no room between them in the URDF)"
    note = f"{what}: a turn either way is taken"
    return arm.with_position_limits(lower, upper), (note,)


def _names_where(arm: ArmModel, chosen: Bool[Array, " n"]) -> list[str]:
    """Names of some joints."""
    return [name for name, taken in zip(arm.joint_names, chosen, strict=True) if taken]


def say_unknown(arm: ArmModel, limits: Limits) -> tuple[str, ...]:
    """Which limits of torque and speed nobody gives, in words."""
    notes = []
    for name, values in (("torque", limits.torque), ("speed", limits.speed)):
        missing = _names_where(arm, np.isinf(values))
        if missing:
            what = f"limits of {name} of {', '.join(missing)} are unknown ({NOT_GIVEN})"
            notes.append(f"{what}: none is kept")
    return tuple(notes)


def require_known_rates(task: Task, arm: ArmModel, limits: Limits, objective: str) -> None:
    """Raises InputError where a joint's speed has no limit: a time task has no end, and no search a
    scale.
    """
    missing = _names_where(arm, np.isinf(limits.speed))
    if missing:
        what = f"nobody says how fast {', '.join(missing)} may be ({NOT_GIVEN})"
        raise InputError(task.source, what, "give limits.speed_deg_s")
    endless = _names_where(arm, np.isinf(limits.torque))
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
        what = "no model says where it was fitted"
        raise InputError("--stay-inside", what, "give --model, or fit it again")
    if options.beyond:
        return ""
    if trained is not None:
        return TRAINING
    if makers is None or not task.makers or task.acceleration is not None:
        return ""
    return ADVICE if _advises(makers) else ""


def _advises(makers: MakersLimits) -> bool:
    """Whether the maker advises an acceleration, and no more than that."""
    return not makers.binding and makers.acceleration is not None


def say_beyond(trained: TrainingRange | None, makers: MakersLimits | None) -> str:
    """What leaving the known means, in words."""
    said = []
    if trained is not None:
        speed, acceleration = np.maximum(trained.high[1:3], -trained.low[1:3]).max(axis=1)
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
    both_ways = np.minimum(-ours.low[1:3], ours.high[1:3])
    speed, acceleration = np.maximum(both_ways, LEAST_RATE)
    if limits.acceleration is not None:
        acceleration = np.minimum(limits.acceleration, acceleration)
    return replace(limits, speed=np.minimum(limits.speed, speed), acceleration=acceleration)


def within_known(problem: PlanningProblem) -> PlanningProblem:
    """The problem kept within the positions of its model's training.

    These are widened to what the task itself names, which a note tells. Where the training doesn't
    bind, or is not known, it is the problem itself.
    """
    trained = problem.trained
    if problem.known != TRAINING or trained is None:
        return problem
    ours = trained.first(problem.n)
    limits = problem.limits
    passed = [via.target for via in problem.way.vias if not via.of_tool]
    ends = np.stack([problem.start, problem.goal, *passed])
    low = np.minimum(ours.low[0], ends.min(axis=0))
    high = np.maximum(ours.high[0], ends.max(axis=0))
    lower = np.maximum(limits.lower, low)
    upper = np.minimum(limits.upper, high)
    widened = (low < ours.low[0]) | (high > ours.high[0])
    notes = problem.notes
    if widened.any():
        joints = ", ".join(_names_where(problem.scene.arm, widened))
        what = "the task begins, passes or ends beyond the model's training"
        notes = (*notes, f"{what}: positions of {joints} reach as far as it does")
    return replace(problem, limits=replace(limits, lower=lower, upper=upper), notes=notes)
