"""From a scene file and a model to planning problems, one for each goal, with the checks that the input needs."""

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
from plan.problem.problem import ADVICE, FREE, OBJECTIVES, TRAINING, Free, PlanningProblem
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
NO_FRICTION = "without --model torque and energy are the rigid arm's: friction and motor inertia are missing"


def set_up(task: Task, model: HybridModel | None = None, options: TaskOptions = DEFAULTS) -> PlanningProblem:
    """The problem of a task, started from the straight line; a goal that is a pose is still to be reached.

    Args:
        task: What to do.
        model: Fitted model; the rigid arm without losses if None.
        options: How it is taken. Where it names no variables, a planner that can may insert via points.

    Raises:
        RobotError: A link has no collision geometry, and nothing stands in.
        InputError: The task does not fit the robot or the model.
        InputError: No such objective, metric or choice of variables.
    """
    objective = _one_of("--objective", options.objective, OBJECTIVES)
    metric: Metric = _one_of("--metric", options.metric, METRICS)
    free: Free | None = None if options.variables is None else _one_of("--variables", options.variables, FREE)
    if objective == "time" and free == "vias":
        raise InputError("--variables", "time can't fall while the time stamps are fixed", "use times or both")
    robot = ArmModel.load(task.robot)
    if model is not None:
        model.require_robot(robot, task.source)
    not_the_arms = frozenset(robot.locked_joints)
    robot = robot.locked(list(task.held), list(task.held.values()))
    hung, payload, carried = hang(robot, task.attached, task.payload, task.payload_link)
    robot = robot if payload is None else robot.with_payload(payload)
    arm, unknown = with_known_positions(_moving_arm(task, robot), task)
    trained, makers = None if model is None else model.trained, find_makers_limits(robot)
    doubt = None if trained is None or not options.reserve else trained.torque_half_width[: task.n]
    known = name_known(task, trained, makers, options)
    limits = task_limits(task, arm, makers, doubt, advised=known == ADVICE)
    unknown += say_unknown(arm, limits)
    leaving = (say_beyond(trained, makers),) if options.beyond else ()
    kept = (f"speed and acceleration stay inside {known} (--beyond: not)",) if known else ()
    if known == TRAINING and trained is not None:
        limits = stay_inside(limits, trained)
    require_known_rates(task, arm, limits, objective)
    duration, longest = task.duration, _longest(task, objective)
    if duration is None and objective == "energy" and longest is None:
        remedy = "add it, or at_most_s or standby_W; only --objective time does without"
        raise InputError(task.source, "task.duration_s is missing", remedy)
    if duration is None:  # one that the limits allow; of a pose the way is unknown
        duration = 2.0 * max(least_durations(limits, np.abs(task.goal - task.start)).values()) or 1.0
        duration = duration if longest is None else min(duration, longest)
    disabled = None if task.srdf is None else read_disabled(task.srdf, robot)
    said = say_limits(makers, task.makers, limits.acceleration is not None, limits.jerk is not None)
    return PlanningProblem(
        scene=Scene.build(arm, task.obstacles, stand_in=options.shapes, carried=hung, disabled=disabled),
        model=_torque(model, payload, arm, task),
        limits=limits,
        start=task.start,
        goal=task.goal,
        vias=straight(task.start, task.goal, task.via_points),
        durations=np.full(task.via_points + 1, duration / (task.via_points + 1)),
        objective=objective,
        metric=metric,
        free=free or ("vias" if objective == "energy" else "both"),
        radius=task.reach,
        grows=free is None,
        trained=trained,
        way=task.way,
        carried=carried,
        not_the_arms=not_the_arms,
        notes=(*leaving, *kept, *unknown, *said, *(() if model is not None else (NO_FRICTION,))),
        known=known,
        longest=longest,
        standby=task.standby,
    )


def _longest(task: Task, objective: str) -> float | None:
    """The longest duration of least energy; None where it is fixed, or time is the objective.

    Raises:
        InputError: Time is the objective, and something is said of energy.
    """
    if objective == "time":
        given = ("at_most_s", task.longest is not None), ("standby_W", task.standby > 0.0)
        for key, is_given in given:
            if is_given:
                raise InputError(task.source, f"task.{key} says nothing of least time", "drop it, or --objective time")
        return None
    if task.duration is not None and task.standby > 0.0:
        remedy = "give at_most_s in place of duration_s, or drop it"
        raise InputError(task.source, "task.standby_W says nothing where the duration is fixed", remedy)
    if task.duration is not None:
        return None
    return task.longest if task.longest is not None else np.inf if task.standby > 0.0 else None


def reach_goals(problem: PlanningProblem, task: Task) -> tuple[PlanningProblem, ...]:
    """The task once for every goal: joint positions that are given, or that bring its frame to a pose, nearest first.

    Raises:
        InputError: No such frame, or the arm can't bring it to any of the poses.
    """
    if task.pose is None:
        low, high, clear = problem.limits.lower, problem.limits.upper, problem.limits.clearance
        inside = [q for q in (task.goal, *task.others) if np.all(q >= low) and np.all(q <= high)]
        goals = [q for q in inside if why_refused(problem.scene, q, clear) is None] or [task.goal]
    else:
        goals = reach_any(problem, task, (task.pose, *task.other_poses), "task.goal_pose")
    reached = [replace(problem, goal=q, vias=straight(problem.start, q, problem.via_count)) for q in goals]
    return tuple(within_known(task_of_goal) for task_of_goal in reached)


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
    arm, limits = problem.scene.arm, problem.limits
    named, frames = pose.frame or arm.links[-1], dict.fromkeys(str(one.name) for one in arm.model.frames)
    if named not in frames:
        names = ", ".join(one for one in frames if one != "universe")
        return InputError(task.source, f"{key}: the robot has no frame {named!r}", f"use one of: {names}")
    ways, outside, (place, turn) = reach_pose(arm, pose, named, problem.start, limits.lower, limits.upper)
    refused = [why_refused(problem.scene, q, limits.clearance) for q in ways]
    goals = [q for q, why in zip(ways, refused, strict=True) if why is None]
    if goals:
        return goals
    comes = f"{key}: {named} comes there in"
    if refused and refused[0] is not None:
        what = f"{comes} {len(refused)} ways, in all of them something is in the way (in the nearest {refused[0][0]})"
        return InputError(task.source, what, "move the pose or the obstacle")
    if outside:
        what = f"{comes} {outside} ways, all of them out of the position limits"
        return InputError(task.source, what, "move the pose, or widen [limits]")
    short = f"{1000 * place:.0f} mm" + ("" if pose.rotation is None else f" and {np.degrees(turn):.0f} deg")
    what = f"{key}: the {arm.n} joints that move can't bring {named} there; they come within {short}"
    remedies = ["move the pose", *["leave its rotation out"] * (pose.rotation is not None)]
    return InputError(task.source, what, ", or ".join([*remedies, *["let more joints move"] * bool(arm.locked_joints)]))


def from_taught(problem: PlanningProblem, vias: Array, times: Array | None) -> PlanningProblem:
    """The problem started from taught via points, at their time stamps if these are given; the whole duration kept."""
    begun = from_vias(problem, vias, "taught", len(vias))
    return begun if times is None else replace(begun, durations=np.diff([0.0, *times, problem.durations.sum()]))


def _one_of(option: str, value: str, known: tuple[Choice, ...]) -> Choice:
    """The value, if it is known.

    Raises:
        InputError: It is not.
    """
    for one in known:
        if one == value:
            return one
    raise InputError(option, f"{value!r} is unknown", f"use one of: {', '.join(map(str, known))}")


def _moving_arm(task: Task, robot: ArmModel) -> ArmModel:
    """The arm of the joints that move, the others held where the task says.

    Raises:
        InputError: More angles than joints, or held ones out of their limits.
    """
    if len(task.goal) != task.n or not 1 <= task.n <= robot.n:
        what = f"task.start_deg has {task.n} angles, {robot.name} has {robot.n} joints: {', '.join(robot.joint_names)}"
        raise InputError(task.source, what, "give as many or fewer")
    rest, held = robot.n - task.n, robot.neutral[task.n :] if task.wrist is None else task.wrist
    if len(held) != rest:
        what = f"task.wrist_deg has {len(held)} angles, {rest} joints stand still"
        raise InputError(task.source, what, f"give {rest}")
    if np.any(held < robot.lower[task.n :]) or np.any(held > robot.upper[task.n :]):
        raise InputError(task.source, "task.wrist_deg is out of the limits", "stay within the robot's limits")
    return robot.locked(robot.joint_names[task.n :], list(held)) if rest else robot


def _torque(model: HybridModel | None, payload: Payload | None, arm: ArmModel, task: Task) -> ChainTorque:
    """Torque of the joints that move, a payload in the last link's frame; the model's others held as the arm's are."""
    if model is None:
        return ChainTorque(arm.chain, LossParameters.zero(arm.n))
    known, remedy = model.joint_names, "fit a model of all joints (--links 6)"
    if payload is not None and len(known) < model.robot.n:
        what = f"[payload] hangs on the last link, the model knows {len(known)} of {model.robot.n} joints"
        raise InputError(task.source, what, remedy)
    if len(known) < task.n:
        raise InputError(task.source, f"the task moves {task.n} joints, the model knows {len(known)}", remedy)
    loaded = model if payload is None else replace(model, arm=model.arm.with_payload(payload))
    return torque_of_model(loaded, task.n, [arm.locked_joints[name] for name in known[task.n :]])
