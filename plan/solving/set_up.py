"""From a scene file and a model to planning problems, one for each goal, with the checks that the input needs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.model.hybrid import HybridModel, TrainingRange
from ident.model.loss import LossParameters
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel
from plan.command_options import TaskOptions
from plan.dynamics.power import METRICS, ChainTorque, Metric, torque_of_model
from plan.geometry.clearance_proof import why_refused
from plan.geometry.pairs import read_disabled
from plan.geometry.scene import Scene
from plan.geometry.tool import hang
from plan.initial.inverse_kinematics import PoseSolver, reach_pose
from plan.initial.starts import from_vias, positions_along, straight
from plan.problem.makers_limits import MakersLimits, find_makers_limits, say_limits
from plan.problem.problem import ADVICE, FREE, OBJECTIVES, TRAINING, Free, Limits, PlanningProblem
from plan.problem.rule_values import TURNING
from plan.problem.rules import Pose, ViaPoint
from plan.problem.scene_keys import as_given
from plan.problem.task_file import Task

Choice = TypeVar("Choice", bound=str)
DEFAULTS = TaskOptions()
# What a plan without a fitted model leaves out.
# Positions from which a place that has to be passed is tried before it counts as out of reach.
PLACES_TRIED = 40
# Positions along a straight line at which it is looked for what stands in its way; and how much deeper than it may
# be off the line a link has to be in something for no dodging to help [m].
LOOKED_AT, DEEPER = 60, 0.02
# What a joint that turns may do where its URDF does not say [rad].
TURN = 2.0 * np.pi
# A joint that the training left standing may move with this [rad/s, rad/s²]: a limit has to lie above nought.
LEAST_RATE = 1e-6
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
    known = _known(task, trained, makers, options)
    limits = _limits(task, arm, makers, doubt, advised=known == ADVICE)
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
        duration = 2.0 * max(_need(limits, np.abs(task.goal - task.start)).values()) or 1.0
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


def shortest_duration(problem: PlanningProblem) -> float:
    """No motion from rest to rest is shorter than this by the limits of each joint's speed, acceleration, jerk [s]."""
    needs = list(_need(problem.limits, np.abs(problem.goal - problem.start)).values())
    if problem.way.speed is not None and problem.rules is not None:
        needs.append(problem.rules.length / problem.way.speed)
    return max(needs)


def _known(task: Task, trained: TrainingRange | None, makers: MakersLimits | None, options: TaskOptions) -> str:
    """What a motion stays inside of: the model's training, else the maker's advice; nothing where neither is known.

    Raises:
        InputError: It is to stay inside of what is not known, or to leave it, too.
    """
    if options.inside and options.beyond:
        raise InputError("--beyond", "--stay-inside is given, too", "give one of them")
    if options.inside and trained is None:
        raise InputError("--stay-inside", "no model says where it was fitted", "give --model, or fit it again")
    if options.beyond:
        return ""
    if trained is not None:
        return TRAINING
    advised = task.makers and makers is not None and not makers.binding and makers.acceleration is not None
    return ADVICE if advised and task.acceleration is None else ""


def say_beyond(trained: TrainingRange | None, makers: MakersLimits | None) -> str:
    """What leaving the known means, in words."""
    said = []
    if trained is not None:
        speed, acceleration = (float(np.maximum(trained.high[k], -trained.low[k]).max()) for k in (1, 2))
        said.append(f"the model saw no more than {speed:.3g} rad/s and {acceleration:.3g} rad/s2")
        said.append("torque and energy beyond that are guesses, and no interval holds there")
    elif makers is not None and makers.acceleration is not None and not makers.binding:
        said.append(f"the maker advises {float(makers.acceleration.max()):.3g} rad/s2")
        said.append("the controller may stop the arm beyond that")
    else:
        said.append("nothing is known of this arm that could be left")
    return f"beyond what is known, as asked: {'; '.join(said)}"


def within_known(problem: PlanningProblem) -> PlanningProblem:
    """The same within the positions of its model's training, widened to what the task itself names; that is told."""
    trained = problem.trained
    if problem.known != TRAINING or trained is None:
        return problem
    ours, limits = trained.first(problem.n), problem.limits
    passed = [via.target for via in problem.way.vias if not via.of_tool]
    ends = np.stack([problem.start, problem.goal, *passed])
    low, high = np.minimum(ours.low[0], ends.min(axis=0)), np.maximum(ours.high[0], ends.max(axis=0))
    lower, upper = np.maximum(limits.lower, low), np.minimum(limits.upper, high)
    names = problem.scene.arm.joint_names
    wide = [name for name, a, b in zip(names, low < ours.low[0], high > ours.high[0], strict=True) if a or b]
    said = problem.notes
    if wide:
        joints = ", ".join(wide)
        what = "the task begins, passes or ends beyond the model's training"
        said = (*said, f"{what}: positions of {joints} reach as far as it does")
    return replace(problem, limits=replace(limits, lower=lower, upper=upper), notes=said)


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
        found = [_reach(problem, task, pose) for pose in (task.pose, *task.other_poses)]
        goals = [q for one in found if not isinstance(one, InputError) for q in one]
        if not goals:
            raise next(one for one in found if isinstance(one, InputError))
    reached = [replace(problem, goal=q, vias=straight(problem.start, q, problem.via_count)) for q in goals]
    return tuple(within_known(task_of_goal) for task_of_goal in reached)


def _reach(problem: PlanningProblem, task: Task, pose: Pose) -> list[Array] | InputError:
    """Joint positions that bring a frame to its pose, or why there are none."""
    arm, limits = problem.scene.arm, problem.limits
    named, frames = pose.frame or arm.links[-1], dict.fromkeys(str(one.name) for one in arm.model.frames)
    if named not in frames:
        names = ", ".join(one for one in frames if one != "universe")
        return InputError(task.source, f"task.goal_pose: the robot has no frame {named!r}", f"use one of: {names}")
    ways, outside, (place, turn) = reach_pose(arm, pose, named, problem.start, limits.lower, limits.upper)
    refused = [why_refused(problem.scene, q, limits.clearance) for q in ways]
    goals = [q for q, why in zip(ways, refused, strict=True) if why is None]
    if goals:
        return goals
    comes = f"task.goal_pose: {named} comes there in"
    if refused and refused[0] is not None:
        what = f"{comes} {len(refused)} ways, in all of them something is in the way (in the nearest {refused[0][0]})"
        return InputError(task.source, what, "move the pose or the obstacle")
    if outside:
        what = f"{comes} {outside} ways, all of them out of the position limits"
        return InputError(task.source, what, "move the pose, or widen [limits]")
    short = f"{1000 * place:.0f} mm" + ("" if pose.rotation is None else f" and {np.degrees(turn):.0f} deg")
    what = f"task.goal_pose: the {arm.n} joints that move can't bring {named} there; they come within {short}"
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


def _bad_end(problem: PlanningProblem) -> tuple[str, str, str] | None:
    """The end of the task at which no motion may begin or end: which, why, and the remedy; None if both are allowed."""
    limits, arm = problem.limits, problem.scene.arm
    for name, q in zip(("start", "goal"), problem.ends, strict=True):
        outside = np.flatnonzero((q < limits.lower) | (q > limits.upper))
        if len(outside):
            j = int(outside[0])
            slides = bool(arm.sliding_joints[j])
            low, high = (as_given(one[j], slides, 0) for one in (limits.lower, limits.upper))
            what = f"{as_given(q[j], slides)} of {arm.joint_names[j]} is out of its limits"
            return name, what, f"stay within {low} to {high}"
        refused = why_refused(problem.scene, q, limits.clearance)
        if refused is not None:
            return name, *refused
    return None


def require_valid_ends(problem: PlanningProblem, task: Task, inside: bool = False) -> None:
    """Raises InputError unless start and goal keep the limits, their distance from all obstacles, and if asked stay
    inside the training."""
    if inside:
        require_inside(problem, task.source)
    bad, limits = _bad_end(problem), problem.limits
    if bad is not None:
        key = task.keys[bad[0] == "goal"]
        raise InputError(task.source, f"task.{key}: {bad[1]}", bad[2])
    cones = [] if problem.rules is None else problem.rules.rows(problem.ends, np.zeros_like(problem.ends))
    for number, row in enumerate((row for row in cones if row.name == "cone"), start=1):
        if row.value.max() > row.limit:
            key = task.keys[int(row.value.argmax())]
            what = f"task.{key}: the tool's axis breaks tool.cone {number}"
            raise InputError(task.source, what, "move that position, or change the cone")
    for number, via in enumerate(problem.way.vias, start=1):
        if not via.of_tool and np.any((via.target < limits.lower) | (via.target > limits.upper)):
            raise InputError(task.source, f"pass {number}.deg is out of the joints' limits", "move that via point")
        missed = _out_of_reach(problem, via)
        if missed:
            raise InputError(task.source, f"pass {number}.{missed}", "move that via point")


def _out_of_reach(problem: PlanningProblem, via: ViaPoint) -> str:
    """Why no motion can pass a via point, whatever its way, in words; nothing where one may."""
    arm, limits, scene = problem.scene.arm, problem.limits, problem.scene
    if not via.of_tool:
        # No pair can come farther apart than its levers let it while each joint is off by what is allowed.
        gained = scene.levers.sum(axis=1) * via.within
        apart = scene.distances(via.target) + gained if len(scene.pairs) else np.ones(1)
        worst = int(np.argmin(apart))
        return f"deg: {scene.pair_name(worst)} collide there" if apart[worst] <= 0.0 else ""
    rules = problem.rules
    assert rules is not None
    rng, solver = np.random.default_rng(0), PoseSolver(arm, rules.frame)  # fixed: a property of the task
    low, high = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    nearest = np.inf
    for begin in (problem.start, problem.goal, *rng.uniform(low, high, (PLACES_TRIED, problem.n))):
        nearest = min(nearest, solver.descend(Pose(None, via.target), begin)[1][0])
        if nearest <= via.within:
            return ""
    return f"xyz_m is out of reach: {rules.frame} comes within {1000.0 * nearest:.0f} mm of it"


def require_inside(problem: PlanningProblem, source: Path) -> None:
    """Raises InputError where start or goal themselves lie beyond the training."""
    known = problem.trained
    assert known is not None
    for name, q in (("start", problem.start), ("goal", problem.goal)):
        outside = np.flatnonzero((q < known.low[0, : problem.n]) | (q > known.high[0, : problem.n]))
        if len(outside):
            j = int(outside[0])
            arm, seen = problem.scene.arm, (q, known.low[0], known.high[0])
            here, low, high = (as_given(one[j], bool(arm.sliding_joints[j])) for one in seen)
            raise InputError(
                source,
                f"the {name}'s {arm.joint_names[j]}, {here}, lies beyond the model's training ({low} to {high})",
                "move it, fit a model to recordings from there, or leave out --stay-inside",
            )


def find_obstruction(problem: PlanningProblem) -> str:
    """Why no search could help: the reason in words, or nothing."""
    duration, limits, ends, rules = float(problem.durations.sum()), problem.limits, problem.ends, problem.rules
    if not duration > 0.0:
        return "the duration is zero"
    bad = _bad_end(problem)
    if bad is not None:
        return f"the {bad[0]} is not allowed: {bad[1]}"
    needs = {
        f"at the {name} limits it takes": need
        for name, need in _need(limits, np.abs(problem.goal - problem.start)).items()
    }
    bound = max(needs, key=lambda name: needs[name])
    if problem.way.speed is not None and rules is not None and needs[bound] <= duration:
        bound = f"at {problem.way.speed:g} m/s the tool takes"
        needs[bound] = rules.length / problem.way.speed
    if problem.objective == "energy" and duration < needs[bound]:
        leave = f" ({problem.known}; --beyond leaves it)" if problem.known else ""
        return f"{duration:g} s is too short: {bound} {needs[bound]:.3f} s at least{leave}"
    blocked = _line_blocked(problem)
    if blocked:
        return blocked
    still = np.zeros_like(ends)[None]
    holding = np.abs(problem.model.torque(ends[None], still, still)[0])
    share = holding / limits.torque
    if share.max() > 1.0:
        end, joint = np.unravel_index(int(np.argmax(share)), share.shape)
        needed = f"that takes {holding[end, joint]:.3g} N m, and it may use {limits.torque[joint]:.3g} N m"
        return f"joint {joint + 1} can't hold the arm at the {('start', 'goal')[end]}: {needed}"
    return ""


def _line_blocked(problem: PlanningProblem) -> str:
    """What a straight line of the tool leads through, where the line leaves the joints no choice; else nothing."""
    rules, scene = problem.rules, problem.scene
    if rules is None or problem.way.straight is None or not len(scene.pairs) or problem.n not in (3, TURNING):
        return ""
    line = positions_along(problem, rules, LOOKED_AT)
    gaps = scene.gaps(line, 1.0)
    place, pair = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
    if gaps[place, pair] > 0.0:
        return ""
    depth = -float(scene.distances(line[place])[pair])
    if depth <= problem.way.straight + DEEPER:
        return ""
    share = 100.0 * (place + 1) / (LOOKED_AT + 1)
    through = f"{scene.pair_name(int(pair))} collide, {1000.0 * depth:.0f} mm deep"
    return f"the straight line of the tool is blocked {share:.0f} % along: {through}"


def _need(limits: Limits, way: Array) -> dict[str, float]:
    """No motion of each joint's way from rest to rest is shorter by each kind of limit, whatever its path [s].

    Half of a way d needs √(d / a) at an acceleration a; and a speed that is a parabola of curvature j, as high as it
    can be over a time T, covers j T³ / 12.
    """
    found = {"speed": float(np.max(way / limits.speed))}
    if limits.acceleration is not None:
        found["acceleration"] = float(np.max(2.0 * np.sqrt(way / limits.acceleration)))
    if limits.jerk is not None:
        found["jerk"] = float(np.max(np.cbrt(12.0 * way / limits.jerk)))
    return found


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


def _limits(
    task: Task, arm: ArmModel, makers: MakersLimits | None, reserve: Array | None, advised: bool = False
) -> Limits:
    """The robot's limits within those of the task; where the task gives none, its maker's of speed, acceleration, jerk.

    Advice of the maker counts only where it is asked for.

    Raises:
        InputError: They leave nothing.
    """
    lower = arm.lower if task.lower is None else np.maximum(arm.lower, task.lower)
    upper = arm.upper if task.upper is None else np.minimum(arm.upper, task.upper)
    torque = _where_known(arm.effort_limit) if task.torque is None else task.torque
    usable = torque if reserve is None else torque - reserve
    for j, joint in enumerate(arm.joint_names):
        if lower[j] >= upper[j]:
            low, high = (as_given(one[j], bool(arm.sliding_joints[j]), 0) for one in (arm.lower, arm.upper))
            what = f"[limits] leave {joint} no room within the robot's own, {low} to {high}"
            raise InputError(task.source, what, "correct lower_deg or upper_deg")
        if reserve is not None and not usable[j] > 0.0:
            what = f"{joint} may use {torque[j]:g} N m, and the model's torque is known to {reserve[j]:.2g} N m only"
            raise InputError(task.source, what, "raise limits.torque_Nm, or give --no-reserve")
    asked = makers if task.makers else None
    speed = _where_known(arm.velocity_limit) if task.speed is None else task.speed
    if task.speed is None and asked is not None and asked.speed is not None:  # of all the arm's joints, held ones last
        speed = np.minimum(speed, asked.speed[: task.n])
    bound = asked if asked is not None and (asked.binding or advised) else None
    published = (None, None) if bound is None else (bound.acceleration, bound.jerk)
    acceleration, jerk = (
        own if own is not None or theirs is None else theirs[: task.n]
        for own, theirs in zip((task.acceleration, task.jerk), published, strict=True)
    )
    return Limits(lower, upper, speed, usable, task.clearance, acceleration, jerk, reserve)


def _where_known(limit: Float[Array, " n"]) -> Float[Array, " n"]:
    """A URDF's limits, those of nought as endless: files that leave a limit out, or do not know it, have a nought."""
    return np.where(limit > 0.0, limit, np.inf)


def with_known_positions(arm: ArmModel, task: Task) -> tuple[ArmModel, tuple[str, ...]]:
    """The arm with a whole turn either way for joints whose limits are both nought, and what is to be said of it.

    Raises:
        InputError: A joint that slides has none, and the task gives none.
    """
    unknown = (arm.lower == 0.0) & (arm.upper == 0.0)
    if not unknown.any():
        return arm, ()
    names = [name for name, missing in zip(arm.joint_names, unknown, strict=True) if missing]
    if np.any(unknown & arm.sliding_joints) and (task.lower is None or task.upper is None):
        what = f"the URDF gives {' and '.join(names)} no limits of position (0 to 0)"
        raise InputError(task.source, what, "give limits.lower_deg and upper_deg, of joints that slide in metres")
    lower, upper = np.where(unknown, -TURN, arm.lower), np.where(unknown, TURN, arm.upper)
    if task.lower is not None:
        lower = np.where(unknown, task.lower, lower)
    if task.upper is not None:
        upper = np.where(unknown, task.upper, upper)
    said = f"limits of position of {', '.join(names)} are unknown (0 to 0 in the URDF): a turn either way is taken"
    return arm.with_position_limits(lower, upper), (said,)


def say_unknown(arm: ArmModel, limits: Limits) -> tuple[str, ...]:
    """Which limits of torque and speed nobody gives, in words."""
    said = []
    for name, values in (("torque", limits.torque), ("speed", limits.speed)):
        missing = [joint for joint, value in zip(arm.joint_names, values, strict=True) if np.isinf(value)]
        if missing:
            what = f"limits of {name} of {', '.join(missing)} are unknown (0 in the URDF)"
            said.append(f"{what}: none is kept")
    return tuple(said)


def require_known_rates(task: Task, arm: ArmModel, limits: Limits, objective: str) -> None:
    """Raises InputError where a joint's speed has no limit: a time task has no end, and no search a scale."""
    missing = [name for name, speed in zip(arm.joint_names, limits.speed, strict=True) if np.isinf(speed)]
    if missing:
        what = f"nobody says how fast {', '.join(missing)} may be (0 in the URDF)"
        raise InputError(task.source, what, "give limits.speed_deg_s")
    endless = [name for name, torque in zip(arm.joint_names, limits.torque, strict=True) if np.isinf(torque)]
    if objective == "time" and endless and limits.acceleration is None:
        what = f"nobody says how strong {', '.join(endless)} may be (0 in the URDF), nor how fast speed may change"
        raise InputError(task.source, what, "give limits.torque_Nm or acceleration_deg_s2")


def stay_inside(limits: Limits, known: TrainingRange) -> Limits:
    """Limits of speed and acceleration that let nothing pass which the training did not see; positions stay."""
    ours = known.first(len(limits.lower))
    speed, acceleration = (np.maximum(np.minimum(-ours.low[k], ours.high[k]), LEAST_RATE) for k in (1, 2))
    most = np.inf if limits.acceleration is None else limits.acceleration
    return replace(limits, speed=np.minimum(limits.speed, speed), acceleration=np.minimum(most, acceleration))
