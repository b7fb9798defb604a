"""From a scene file and a model to planning problems, with the checks that the input needs.

There is one problem for each goal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from ident.arrays import Array
from ident.errors import InputError
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel
from plan.command_options import TaskOptions
from plan.dynamics.power import METRICS, ChainTorque, Metric, torque_of_model
from plan.geometry.clearance_proof import why_refused
from plan.geometry.pairs import read_disabled
from plan.geometry.scene import Scene
from plan.geometry.tool import hang
from plan.initial.inverse_kinematics import reach_pose
from plan.initial.vias import from_vias, straight
from plan.problem.makers_limits import find_makers_limits, say_limits
from plan.problem.problem import (
    ADVICE,
    FREE,
    OBJECTIVES,
    TRAINING,
    Free,
    Limits,
    PlanningProblem,
)
from plan.problem.rules import Pose
from plan.problem.task_file import Task
from plan.solving.obstruction import least_durations
from plan.solving.task_limits import (
    name_known,
    require_known_rates,
    say_beyond,
    say_unknown,
    stay_inside,
    task_limits,
    with_known_positions,
    within_known,
)

Choice = TypeVar("Choice", bound=str)
DEFAULTS = TaskOptions()
# What a plan without a fitted model leaves out.
MISSING = "friction and motor inertia are missing"
NO_FRICTION = f"without --model torque and energy are the rigid arm's: {MISSING}"
# Where a guess of the duration begins, as a multiple of the shortest by the limits; and where the
# goal is the start, as for a pose that is still to be reached [s].
LONGER = 2.0
GUESSED = 1.0


def set_up(
    task: Task,
    model: HybridModel | None = None,
    options: TaskOptions = DEFAULTS,
) -> PlanningProblem:
    """The problem of a task, started from the straight line.

    A goal that is a pose is still to be reached.

    Args:
        task: What to do.
        model: Fitted model; the rigid arm without losses if None.
        options: How it is taken. Where it names no variables, a planner that can may insert via
            points.

    Raises:
        RobotError: A link has no collision geometry, and nothing stands in.
        InputError: The task does not fit the robot or the model.
        InputError: No such objective, metric or choice of variables.
    """
    objective = _one_of("--objective", options.objective, OBJECTIVES)
    metric: Metric = _one_of("--metric", options.metric, METRICS)
    free: Free | None = None
    if options.variables is not None:
        free = _one_of("--variables", options.variables, FREE)
    if objective == "time" and free == "vias":
        what = "time can't fall while the time stamps are fixed"
        raise InputError("--variables", what, "use times or both")
    robot = ArmModel.load(task.robot)
    if model is not None:
        model.require_robot(robot, task.source)
    not_the_arms = frozenset(robot.locked_joints)
    robot = robot.locked(list(task.held), list(task.held.values()))
    hung, payload, carried = hang(robot, task.attached, task.payload, task.payload_link)
    if payload is not None:
        robot = robot.with_payload(payload)
    arm, unknown = with_known_positions(_moving_arm(task, robot), task)
    makers = find_makers_limits(robot)
    trained = None if model is None else model.trained
    doubt = None
    if trained is not None and options.reserve:
        doubt = trained.torque_half_width[: task.n]
    known = name_known(task, trained, makers, options)
    limits = task_limits(task, arm, makers, doubt, advised=known == ADVICE)
    unknown += say_unknown(arm, limits)
    notes: list[str] = []
    if options.beyond:
        notes.append(say_beyond(trained, makers))
    if known:
        notes.append(f"speed and acceleration stay inside {known} (--beyond: not)")
    notes.extend(unknown)
    if known == TRAINING and trained is not None:
        limits = stay_inside(limits, trained)
    has_acceleration = limits.acceleration is not None
    has_jerk = limits.jerk is not None
    notes.extend(say_limits(makers, task.makers, has_acceleration, has_jerk))
    if model is None:
        notes.append(NO_FRICTION)
    require_known_rates(task, arm, limits, objective)
    longest = _longest(task, objective)
    duration = _first_duration(task, objective, limits, longest)
    disabled = None if task.srdf is None else read_disabled(task.srdf, robot)
    scene = Scene.build(
        arm,
        task.obstacles,
        stand_in=options.shapes,
        carried=hung,
        disabled=disabled,
    )
    sections = task.via_points + 1
    default: Free = "vias" if objective == "energy" else "both"
    return PlanningProblem(
        scene=scene,
        model=_torque(model, payload, arm, task),
        limits=limits,
        start=task.start,
        goal=task.goal,
        vias=straight(task.start, task.goal, task.via_points),
        durations=np.full(sections, duration / sections),
        objective=objective,
        metric=metric,
        free=free or default,
        radius=task.reach,
        grows=free is None,
        trained=trained,
        way=task.way,
        carried=carried,
        not_the_arms=not_the_arms,
        notes=tuple(notes),
        known=known,
        longest=longest,
        standby=task.standby,
    )


def _first_duration(task: Task, objective: str, limits: Limits, longest: float | None) -> float:
    """The task's duration; where it names none, one that the limits allow [s].

    Raises:
        InputError: Least energy is asked for, and nothing says how long it may take.
    """
    if task.duration is not None:
        return task.duration
    if objective == "energy" and longest is None:
        remedy = "add it, or at_most_s or standby_W; only --objective time does without"
        raise InputError(task.source, "task.duration_s is missing", remedy)
    shortest = max(least_durations(limits, np.abs(task.goal - task.start)).values())
    duration = LONGER * shortest or GUESSED
    return duration if longest is None else min(duration, longest)


def _longest(task: Task, objective: str) -> float | None:
    """The longest duration of least energy; None where it is fixed, or time is the objective.

    Raises:
        InputError: Time is the objective, and something is said of energy.
    """
    has_standby = task.standby > 0.0
    if objective == "time":
        given = {"at_most_s": task.longest is not None, "standby_W": has_standby}
        for key, is_given in given.items():
            if is_given:
                what = f"task.{key} says nothing of least time"
                raise InputError(task.source, what, "drop it, or --objective time")
        return None
    if task.duration is not None:
        if has_standby:
            what = "task.standby_W says nothing where the duration is fixed"
            raise InputError(task.source, what, "give at_most_s in place of duration_s, or drop it")
        return None
    if task.longest is None and has_standby:
        return np.inf
    return task.longest


def reach_goals(problem: PlanningProblem, task: Task) -> tuple[PlanningProblem, ...]:
    """The task once for every goal, nearest first.

    Goals are joint positions that are given, or that bring its frame to a pose.

    Raises:
        InputError: No such frame, or the arm can't bring it to any of the poses.
    """
    if task.pose is None:
        goals = _allowed_goals(problem, task)
    else:
        goals = reach_any(problem, task, (task.pose, *task.other_poses), "task.goal_pose")
    reached = []
    for q in goals:
        vias = straight(problem.start, q, problem.via_count)
        reached.append(within_known(replace(problem, goal=q, vias=vias)))
    return tuple(reached)


def _allowed_goals(problem: PlanningProblem, task: Task) -> list[Array]:
    """The task's goals at which a motion may end; its first goal where none is."""
    limits = problem.limits
    goals = []
    for q in (task.goal, *task.others):
        is_inside = np.all(q >= limits.lower) and np.all(q <= limits.upper)
        if is_inside and why_refused(problem.scene, q, limits.clearance) is None:
            goals.append(q)
    return goals or [task.goal]


def reach_any(problem: PlanningProblem, task: Task, poses: Sequence[Pose], key: str) -> list[Array]:
    """Joint positions that bring a frame to any of some poses; none of no pose.

    Args:
        problem: The task, its goal not yet known.
        task: What the file says.
        poses: The poses.
        key: What they are called in messages.

    Raises:
        InputError: There is none.
    """
    goals: list[Array] = []
    faults = []
    for pose in poses:
        reached = _reach(problem, task, pose, key)
        if isinstance(reached, InputError):
            faults.append(reached)
        else:
            goals.extend(reached)
    if faults and not goals:
        raise faults[0]
    return goals


def _reach(problem: PlanningProblem, task: Task, pose: Pose, key: str) -> list[Array] | InputError:
    """Joint positions that bring a frame to its pose, or why there are none."""
    arm = problem.scene.arm
    limits = problem.limits
    named = pose.frame or arm.links[-1]
    frames = [str(frame.name) for frame in arm.model.frames]
    if named not in frames:
        names = ", ".join(name for name in dict.fromkeys(frames) if name != "universe")
        return InputError(
            task.source,
            f"{key}: the robot has no frame {named!r}",
            f"use one of: {names}",
        )
    ways, outside, (place, turn) = reach_pose(
        arm,
        pose,
        named,
        problem.start,
        limits.lower,
        limits.upper,
    )
    refused = [why_refused(problem.scene, q, limits.clearance) for q in ways]
    goals = [q for q, why in zip(ways, refused, strict=True) if why is None]
    if goals:
        return goals
    comes = f"{key}: {named} comes there in"
    if refused and refused[0] is not None:
        nearest = f"in the nearest {refused[0][0]}"
        what = f"{comes} {len(refused)} ways, in all of them something is in the way ({nearest})"
        return InputError(task.source, what, "move the pose or the obstacle")
    if outside:
        what = f"{comes} {outside} ways, all of them out of the position limits"
        return InputError(task.source, what, "move the pose, or widen [limits]")
    short = f"{1000 * place:.0f} mm"
    remedies = ["move the pose"]
    if pose.rotation is not None:
        short += f" and {np.degrees(turn):.0f} deg"
        remedies.append("leave its rotation out")
    if arm.locked_joints:
        remedies.append("let more joints move")
    what = f"{key}: the {arm.n} joints that move can't bring {named} there"
    what += f"; they come within {short}"
    return InputError(task.source, what, ", or ".join(remedies))


def from_taught(problem: PlanningProblem, vias: Array, times: Array | None) -> PlanningProblem:
    """The problem started from taught via points, the whole duration kept.

    At their time stamps, if these are given.

    Args:
        problem: The task.
        vias: Via points (V, n) [rad].
        times: One a via point, from the start on [s]; None deals the duration out by way.
    """
    begun = from_vias(problem, vias, "taught", len(vias))
    if times is None:
        return begun
    stamps = [0.0, *times, problem.durations.sum()]
    return replace(begun, durations=np.diff(stamps))


def _one_of(option: str, value: str, known: tuple[Choice, ...]) -> Choice:
    """The value, if it is known.

    Raises:
        InputError: It is not.
    """
    for choice in known:
        if choice == value:
            return choice
    raise InputError(option, f"{value!r} is unknown", f"use one of: {', '.join(map(str, known))}")


def _moving_arm(task: Task, robot: ArmModel) -> ArmModel:
    """The arm of the joints that move, the others held where the task says.

    Raises:
        InputError: More angles than joints, or held ones out of their limits.
    """
    if len(task.goal) != task.n or not 1 <= task.n <= robot.n:
        joints = f"{robot.n} joints: {', '.join(robot.joint_names)}"
        what = f"task.start_deg has {task.n} angles, {robot.name} has {joints}"
        raise InputError(task.source, what, "give as many or fewer")
    rest = robot.n - task.n
    held = robot.neutral[task.n :] if task.wrist is None else task.wrist
    if len(held) != rest:
        what = f"task.wrist_deg has {len(held)} angles, {rest} joints stand still"
        raise InputError(task.source, what, f"give {rest}")
    if np.any(held < robot.lower[task.n :]) or np.any(held > robot.upper[task.n :]):
        what = "task.wrist_deg is out of the limits"
        raise InputError(task.source, what, "stay within the robot's limits")
    if rest == 0:
        return robot
    return robot.locked(robot.joint_names[task.n :], list(held))


def _torque(
    model: HybridModel | None,
    payload: Payload | None,
    arm: ArmModel,
    task: Task,
) -> ChainTorque:
    """Torque of the joints that move, a payload in the last link's frame.

    The model's other joints are held as the arm's are.
    """
    if model is None:
        return ChainTorque(arm.chain, LossParameters.zero(arm.n))
    known = model.joint_names
    remedy = "fit a model of all joints (--links 6)"
    if payload is not None and len(known) < model.robot.n:
        joints = f"{len(known)} of {model.robot.n} joints"
        what = f"[payload] hangs on the last link, the model knows {joints}"
        raise InputError(task.source, what, remedy)
    if len(known) < task.n:
        what = f"the task moves {task.n} joints, the model knows {len(known)}"
        raise InputError(task.source, what, remedy)
    if payload is not None:
        model = replace(model, arm=model.arm.with_payload(payload))
    held = [arm.locked_joints[name] for name in known[task.n :]]
    return torque_of_model(model, task.n, held)
