"""What no search could help: ends that are not allowed, places out of reach, too little time,
blocked lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from plan.geometry.clearance_proof import why_refused
from plan.geometry.scene import Scene
from plan.initial.inverse_kinematics import PoseSolver
from plan.initial.line_pace import positions_along
from plan.problem.problem import Limits, PlanningProblem
from plan.problem.rule_values import TURNING
from plan.problem.rules import Pose, ViaPoint
from plan.problem.scene_keys import as_given
from plan.problem.task_file import Task

# Positions from which a place that has to be passed is tried before it counts as out of reach.
PLACES_TRIED = 40
# Positions along a straight line at which it is looked for what stands in its way.
LOOKED_AT = 60
# How much deeper than it may be off the line a link has to be in something for no dodging to help
# [m].
DEEPER = 0.02


def require_valid_ends(problem: PlanningProblem, task: Task, inside: bool = False) -> None:
    """Raises InputError unless start and goal keep the limits, their distance from all obstacles,
    and if asked stay inside the training."""
    if inside:
        require_inside(problem, task.source)
    bad = _bad_end(problem)
    if bad is not None:
        key = task.keys[bad.name == "goal"]
        raise InputError(task.source, f"task.{key}: {bad.what}", bad.remedy)
    _require_cones(problem, task)
    for number, via in enumerate(problem.way.vias, start=1):
        reason = None if via.of_tool else _out_of_limits(problem, via.target)
        if reason is not None:
            raise InputError(task.source, f"pass {number}.deg: {reason[0]}", reason[1])
        missed = _out_of_reach(problem, via)
        if missed:
            raise InputError(task.source, f"pass {number}.{missed}", "move that via point")


def _require_cones(problem: PlanningProblem, task: Task) -> None:
    """Raises InputError where the tool leans out of a cone at start or goal."""
    if problem.rules is None:
        return
    rows = problem.rules.rows(problem.ends, np.zeros_like(problem.ends))
    cones = [row for row in rows if row.name == "cone"]
    for number, row in enumerate(cones, start=1):
        if row.value.max() > row.limit:
            key = task.keys[int(row.value.argmax())]
            what = f"task.{key}: the tool's axis breaks tool.cone {number}"
            raise InputError(task.source, what, "move that position, or change the cone")


@dataclass(frozen=True)
class BadEnd:
    """An end of the task at which no motion may begin or end."""

    name: str  # `start` or `goal`
    what: str  # why
    remedy: str


def _bad_end(problem: PlanningProblem) -> BadEnd | None:
    """The first end that is not allowed; None if both are."""
    for name, q in zip(("start", "goal"), problem.ends, strict=True):
        refused = _out_of_limits(problem, q)
        if refused is None:
            refused = why_refused(problem.scene, q, problem.limits.clearance)
        if refused is not None:
            return BadEnd(name, *refused)
    return None


def _out_of_limits(problem: PlanningProblem, q: Float[Array, " n"]) -> tuple[str, str] | None:
    """What is wrong with a position that is out of the joints' limits, and the remedy."""
    limits = problem.limits
    arm = problem.scene.arm
    outside = np.flatnonzero((q < limits.lower) | (q > limits.upper))
    if len(outside) == 0:
        return None
    j = int(outside[0])
    slides = bool(arm.sliding_joints[j])
    low = as_given(limits.lower[j], slides, 0)
    high = as_given(limits.upper[j], slides, 0)
    what = f"{as_given(q[j], slides)} of {arm.joint_names[j]} is out of its limits"
    return what, f"stay within {low} to {high}"


def _out_of_reach(problem: PlanningProblem, via: ViaPoint) -> str:
    """Why no motion can pass a via point, whatever its way, in words; nothing where one may."""
    if not via.of_tool:
        return _collides_at(problem.scene, via)
    rules = problem.rules
    assert rules is not None
    rng = np.random.default_rng(0)  # fixed: a property of the task
    solver = PoseSolver(problem.scene.arm, rules.frame)
    low = np.maximum(problem.limits.lower, -np.pi)
    high = np.minimum(problem.limits.upper, np.pi)
    places = rng.uniform(low, high, (PLACES_TRIED, problem.n))
    nearest = np.inf
    for begin in (problem.start, problem.goal, *places):
        _, errors = solver.descend(Pose(None, via.target), begin)
        nearest = min(nearest, errors[0])
        if nearest <= via.within:
            return ""
    return f"xyz_m is out of reach: {rules.frame} comes within {1000.0 * nearest:.0f} mm of it"


def _collides_at(scene: Scene, via: ViaPoint) -> str:
    """Which bodies collide however the joints pass a via point, in words; nothing where none do."""
    if not len(scene.pairs):
        return ""
    # No pair can come farther apart than its levers let it while each joint is off by what is
    # allowed.
    gained = scene.levers.sum(axis=1) * via.within
    apart = scene.distances(via.target) + gained
    worst = int(np.argmin(apart))
    return f"deg: {scene.pair_name(worst)} collide there" if apart[worst] <= 0.0 else ""


def require_inside(problem: PlanningProblem, source: Path) -> None:
    """Raises InputError where start or goal themselves lie beyond the training."""
    known = problem.trained
    assert known is not None
    arm = problem.scene.arm
    lowest = known.low[0, : problem.n]
    highest = known.high[0, : problem.n]
    for name, q in (("start", problem.start), ("goal", problem.goal)):
        outside = np.flatnonzero((q < lowest) | (q > highest))
        if len(outside):
            j = int(outside[0])
            slides = bool(arm.sliding_joints[j])
            here = f"the {name}'s {arm.joint_names[j]}, {as_given(q[j], slides)},"
            span = f"{as_given(lowest[j], slides)} to {as_given(highest[j], slides)}"
            what = f"{here} lies beyond the model's training ({span})"
            remedy = "move it, fit a model to recordings from there, or leave out --stay-inside"
            raise InputError(source, what, remedy)


def find_obstruction(problem: PlanningProblem) -> str:
    """Why no search could help: the reason in words, or nothing."""
    duration = float(problem.durations.sum())
    if not duration > 0.0:
        return "the duration is zero"
    bad = _bad_end(problem)
    if bad is not None:
        return f"the {bad.name} is not allowed: {bad.what}"
    return _too_short(problem, duration) or _line_blocked(problem) or _too_heavy(problem)


def _too_short(problem: PlanningProblem, duration: float) -> str:
    """Which limit no motion of a duration keeps, in words; nothing where none is in the way."""
    if problem.objective != "energy":
        return ""
    needs = least_durations(problem.limits, np.abs(problem.goal - problem.start))
    limit = max(needs, key=lambda name: needs[name])
    need = needs[limit]
    bound = f"at the {limit} limits it takes"
    speed = problem.way.speed
    if speed is not None and problem.rules is not None and need <= duration:
        need = problem.rules.length / speed
        bound = f"at {speed:g} m/s the tool takes"
    if duration >= need:
        return ""
    leave = f" ({problem.known}; --beyond leaves it)" if problem.known else ""
    return f"{duration:g} s is too short: {bound} {need:.3f} s at least{leave}"


def _too_heavy(problem: PlanningProblem) -> str:
    """Which joint can't hold the arm at an end, in words; nothing where all can."""
    still = np.zeros_like(problem.ends)[None]
    holding = np.abs(problem.model.torque(problem.ends[None], still, still)[0])
    share = holding / problem.limits.torque
    if not share.max() > 1.0:
        return ""
    end, joint = np.unravel_index(int(np.argmax(share)), share.shape)
    usable = f"it may use {problem.limits.torque[joint]:.3g} N m"
    needed = f"that takes {holding[end, joint]:.3g} N m, and {usable}"
    return f"joint {joint + 1} can't hold the arm at the {('start', 'goal')[end]}: {needed}"


def _line_blocked(problem: PlanningProblem) -> str:
    """What a straight line of the tool leads through, where the line leaves the joints no choice;
    else nothing.
    """
    rules = problem.rules
    scene = problem.scene
    if rules is None or problem.way.straight is None:
        return ""
    if not len(scene.pairs) or problem.n not in (3, TURNING):
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
    durations = {"speed": float(np.max(way / limits.speed))}
    if limits.acceleration is not None:
        durations["acceleration"] = float(np.max(2.0 * np.sqrt(way / limits.acceleration)))
    if limits.jerk is not None:
        durations["jerk"] = float(np.max(np.cbrt(12.0 * way / limits.jerk)))
    return durations
