"""What no search could help: ends that are not allowed, places out of reach, too little time,
blocked lines.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ident.arrays import Array
from ident.errors import InputError
from plan.geometry.clearance_proof import why_refused
from plan.initial.inverse_kinematics import PoseSolver
from plan.initial.line_pace import positions_along
from plan.problem.problem import Limits, PlanningProblem
from plan.problem.rule_values import TURNING
from plan.problem.rules import Pose, ViaPoint
from plan.problem.scene_keys import as_given
from plan.problem.task_file import Task

# Positions from which a place that has to be passed is tried before it counts as out of reach.
PLACES_TRIED = 40
# Positions along a straight line at which it is looked for what stands in its way; and how much
# deeper than it may be off the line a link has to be in something for no dodging to help [m].
LOOKED_AT, DEEPER = 60, 0.02


def require_valid_ends(problem: PlanningProblem, task: Task, inside: bool = False) -> None:
    """Raises InputError unless start and goal keep the limits, their distance from all obstacles,
    and if asked stay inside the training."""
    if inside:
        require_inside(problem, task.source)
    bad, limits = _bad_end(problem), problem.limits
    if bad is not None:
        key = task.keys[bad[0] == "goal"]
        raise InputError(task.source, f"task.{key}: {bad[1]}", bad[2])
    cones = (
        []
        if problem.rules is None
        else problem.rules.rows(problem.ends, np.zeros_like(problem.ends))
    )
    for number, row in enumerate((row for row in cones if row.name == "cone"), start=1):
        if row.value.max() > row.limit:
            key = task.keys[int(row.value.argmax())]
            what = f"task.{key}: the tool's axis breaks tool.cone {number}"
            raise InputError(task.source, what, "move that position, or change the cone")
    for number, via in enumerate(problem.way.vias, start=1):
        if not via.of_tool and np.any((via.target < limits.lower) | (via.target > limits.upper)):
            raise InputError(
                task.source,
                f"pass {number}.deg is out of the joints' limits",
                "move that via point",
            )
        missed = _out_of_reach(problem, via)
        if missed:
            raise InputError(task.source, f"pass {number}.{missed}", "move that via point")


def _bad_end(problem: PlanningProblem) -> tuple[str, str, str] | None:
    """The end of the task at which no motion may begin or end: which, why, and the remedy; None if
    both are allowed.
    """
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


def _out_of_reach(problem: PlanningProblem, via: ViaPoint) -> str:
    """Why no motion can pass a via point, whatever its way, in words; nothing where one may."""
    arm, limits, scene = problem.scene.arm, problem.limits, problem.scene
    if not via.of_tool:
        # No pair can come farther apart than its levers let it while each joint is off by what is
        # allowed.
        gained = scene.levers.sum(axis=1) * via.within
        apart = scene.distances(via.target) + gained if len(scene.pairs) else np.ones(1)
        worst = int(np.argmin(apart))
        return f"deg: {scene.pair_name(worst)} collide there" if apart[worst] <= 0.0 else ""
    rules = problem.rules
    assert rules is not None
    rng, solver = (
        np.random.default_rng(0),
        PoseSolver(arm, rules.frame),
    )  # fixed: a property of the task
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
    duration, limits, ends, rules = (
        float(problem.durations.sum()),
        problem.limits,
        problem.ends,
        problem.rules,
    )
    if not duration > 0.0:
        return "the duration is zero"
    bad = _bad_end(problem)
    if bad is not None:
        return f"the {bad[0]} is not allowed: {bad[1]}"
    needs = {
        f"at the {name} limits it takes": need
        for name, need in least_durations(limits, np.abs(problem.goal - problem.start)).items()
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
    """What a straight line of the tool leads through, where the line leaves the joints no choice;
    else nothing.
    """
    rules, scene = problem.rules, problem.scene
    if (
        rules is None
        or problem.way.straight is None
        or not len(scene.pairs)
        or problem.n not in (3, TURNING)
    ):
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


def shortest_duration(problem: PlanningProblem) -> float:
    """No motion from rest to rest is shorter than this by the limits of each joint's speed,
    acceleration, jerk [s].
    """
    needs = list(least_durations(problem.limits, np.abs(problem.goal - problem.start)).values())
    if problem.way.speed is not None and problem.rules is not None:
        needs.append(problem.rules.length / problem.way.speed)
    return max(needs)


def least_durations(limits: Limits, way: Array) -> dict[str, float]:
    """No motion of each joint's way from rest to rest is shorter by each kind of limit, whatever
    its path [s].

    Half of a way d needs √(d / a) at an acceleration a; and a speed that is a parabola of curvature
    j, as high as it can be over a time T, covers j T³ / 12.
    """
    found = {"speed": float(np.max(way / limits.speed))}
    if limits.acceleration is not None:
        found["acceleration"] = float(np.max(2.0 * np.sqrt(way / limits.acceleration)))
    if limits.jerk is not None:
        found["jerk"] = float(np.max(np.cbrt(12.0 * way / limits.jerk)))
    return found
