"""Where searches may begin: the line, taught via points, ways of trees and round obstacles, bent lines, rules."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import count, pairwise

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from ident.arrays import Array, Float
from plan.initial.inverse_kinematics import PoseSolver
from plan.initial.trees import Seed, Trees, endless, iterate_seeds
from plan.problem.problem import PlanningProblem
from plan.problem.rule_values import TURNING, Rules
from plan.problem.rules import Pose
from plan.spline import Splines

# More via points than this are thinned out: every one adds n variables.
MOST_VIAS = 5
# Shortest section, as a share of the longest.
SHORTEST = 0.2


def straight(start: Float[Array, " n"], goal: Float[Array, " n"], count: int) -> Float[Array, "V n"]:
    """Via points that part the line into equal pieces: the paper's initial condition."""
    share = np.arange(1, count + 1)[:, None] / (count + 1)
    return start + share * (goal - start)


def time_stamps(points: Float[Array, "K n"], speed: Float[Array, " n"], total: float) -> Float[Array, " S"]:
    """Section durations in proportion to the time that the slowest joint needs at its top speed [s]."""
    need = np.max(np.abs(np.diff(points, axis=0)) / speed, axis=1)
    need = np.maximum(need, max(SHORTEST * need.max(), 1e-6))
    return total * need / need.sum()


def through(problem: PlanningProblem, vias: Float[Array, "V n"], label: str) -> PlanningProblem:
    """The problem from other via points, the whole duration kept."""
    durations = time_stamps(problem.with_ends(vias), problem.limits.speed, float(problem.durations.sum()))
    return replace(problem, vias=vias, durations=durations, label=label)


def from_vias(problem: PlanningProblem, vias: Float[Array, "V n"], label: str, least: int) -> PlanningProblem:
    """The same with at least so many of them: the longest sections are parted; thinned out where they are too many."""
    points = problem.with_ends(np.asarray(vias, dtype=float).reshape(-1, problem.n))
    while len(points) < least + 2:
        longest = int(np.argmax(np.abs(np.diff(points, axis=0)).max(axis=1)))
        points = np.insert(points, longest + 1, (points[longest] + points[longest + 1]) / 2, axis=0)
    while len(points) > MOST_VIAS + 2:  # without the one that the path misses least
        detour = np.abs(points[1:-1] - (points[:-2] + points[2:]) / 2).max(axis=1)
        points = np.delete(points, int(np.argmin(detour)) + 1, axis=0)
    return through(problem, points[1:-1], label)


def from_seeds(problem: PlanningProblem, seeds: Sequence[Seed]) -> list[PlanningProblem]:
    """One problem a seed that was found, the straight line in front; ways that are the same are kept once."""
    problems, known = [problem], [problem.vias]
    for seed in seeds:
        same = any(other.shape == seed.vias.shape and np.abs(other - seed.vias).max() < 0.02 for other in known)
        if not seed.reason and len(seed.vias) and not same:
            known.append(seed.vias)
            problems.append(from_vias(problem, seed.vias, seed.label, problem.via_count))
    return problems


# Nodes and reach beyond the ends [rad] of the trees that look for any way at all, the quick look first: trees that may
# go anywhere come back by ways that are twice as long as need be. The patient ones are for where no other found any.
QUICK, PATIENT = ((400, 0.7), (1500, 1.5), (3000, np.pi), (1500, 1.5)), (20000, np.pi)
# Nodes of the trees that look for further ways, and how far they reach, the second time where the first finds none.
FURTHER, REACHES = 2000, (1.5, np.pi)
# Bent lines: standard deviation of the middle's offset [rad]; where something is in the way, of so many that are drawn
# the one that collides least.
BEND, DRAWN = 0.6, 6
# Sections by which a way of trees is followed closely, fewest first, and factors by which it is then slowed down.
CLOSELY, SLOWER = (20, 40, 80), 1.5 ** np.arange(9)


def iterate_ways(
    problem: PlanningProblem, rng: np.random.Generator, solved: Callable[[], bool], left: Callable[[], float] = endless
) -> Iterator[PlanningProblem]:
    """Initial trajectories without end, so that the one who asks decides when it is enough.

    Args:
        problem: The task, started from the straight line.
        rng: Source of randomness.
        solved: Whether a plan is known; if not after a way of trees, it is followed closely, and if not after the line
            either, trees look farther.
        left: Processor time that is left, at which trees end [s].

    Yields:
        The task from one initial trajectory after the other, each with its label.
    """
    trees, least, ends = Trees.of(problem, rng, left), problem.via_count, (problem.start, problem.goal)
    blocked = len(problem.scene.pairs) > 0 and not trees.edge_is_free(*ends)

    def of_trees(looks: Sequence[tuple[int, float]], label: str) -> Iterator[PlanningProblem]:
        way = any_way(problem, trees, looks)
        if way is not None:
            yield from_vias(problem, way, label, least)
            if not solved():
                yield follow_closely(problem, way)

    if blocked:
        yield from of_trees(QUICK[:1], "trees")
    yield problem
    if blocked and not solved():
        yield from of_trees(QUICK[1:], "farther trees")
    seeds = iterate_seeds(problem, trees, FURTHER) if blocked else iter(())
    for number in count(1):
        seed = next(seeds, None)
        if seed is not None and not seed.reason and len(seed.vias):
            yield from_vias(problem, seed.vias, seed.label, least)
        drawn = (trees.vias(*ends, FURTHER, reach) for reach in REACHES if blocked)
        further = next((one for one in drawn if one is not None), None)
        if further is not None:
            yield from_vias(problem, further, f"trees {number}", least)
        bends = [_bent(problem, rng, f"bent {number}") for _ in range(DRAWN if blocked else 1)]
        yield min(bends, key=lambda bent: float(bent.initial_evaluation.collision[0])) if blocked else bends[0]


def follow_closely(problem: PlanningProblem, way: Float[Array, "V n"]) -> PlanningProblem:
    """The task from a trajectory that is bent round the way's corners, and nowhere else far from it.

    A spline through a few via points leaves the edges between them, and in a narrow place gradients alone don't find
    back. Where time is free, it takes as long as it must for the limits to hold.
    """
    points = problem.with_ends(way)
    total = float(problem.durations.sum())
    stamps = np.concatenate([[0.0], np.cumsum(time_stamps(points, problem.limits.speed, total))])
    found = []
    for sections in CLOSELY:
        even = np.linspace(0.0, total, sections + 1)
        near = np.stack([np.interp(even, stamps, column) for column in points.T], axis=1)
        splines = Splines(near[None], np.full((1, sections), total / sections))
        found.append((-float(problem.scene.sweep(splines, problem.margins)[0][0]), splines))
        if -found[-1][0] >= 0.0:
            break
    splines = min(found, key=lambda pair: pair[0])[1]
    for factor in SLOWER if problem.objective == "time" else (1.0,):
        slower = problem.with_initial(Splines(splines.points, splines.durations * factor), label="trees, closely")
        if not slower.initial_evaluation.speed[0] + slower.initial_evaluation.torque[0] > 0.0:
            break
    return slower


def any_way(
    problem: PlanningProblem, trees: Trees, looks: Sequence[tuple[int, float]] = QUICK
) -> Float[Array, "V n"] | None:
    """Via points of the first way for which there is time; else of the quickest one found, None if there is none."""
    best, quickest = None, np.inf
    for nodes, reach in looks:
        found = trees.vias(problem.start, problem.goal, nodes, reach)
        if found is None:
            continue
        need = float(np.max(np.abs(np.diff(problem.with_ends(found), axis=0)) / problem.limits.speed, axis=1).sum())
        if problem.objective == "time" or need < problem.durations.sum():
            return found
        best, quickest = (found, need) if need < quickest else (best, quickest)
    return trees.vias(problem.start, problem.goal, *PATIENT) if best is None and looks != QUICK[:1] else best


def _bent(problem: PlanningProblem, rng: np.random.Generator, label: str) -> PlanningProblem:
    """The straight line bent by a random amount, most in its middle."""
    count = max(problem.via_count, 3) if problem.grows else problem.via_count
    shares = np.arange(1, count + 1) / (count + 1)
    bend: Array = rng.normal(size=problem.n) * BEND
    vias = straight(problem.start, problem.goal, count) + np.sin(np.pi * shares)[:, None] * bend
    return from_vias(problem, np.clip(vias, problem.limits.lower, problem.limits.upper), label, count)


# Via points along a straight line of the tool, or six apart in time; nodes and reach [rad] of trees between two stops.
ALONG, NODES, REACH = 12, 2000, 1.5
# Steps of a line whose time law is looked for, and the least push [1/s²] that is taken where no limit leaves one;
# sections of the motion that begins with that law, and the share of them that stands where its pace changes.
FINE_LINE, LEAST_PUSH, TIMED, RAMPS = 240, 1e-3, 24, 0.7
# Standard deviation of a bend between two stops, and of where the arm's position at a place is looked for [rad].
SPREAD = 0.3


def iterate_rule_ways(problem: PlanningProblem, rng: np.random.Generator) -> Iterator[PlanningProblem]:
    """The task from ways that keep its rules, or nearly: one along a straight line, without end through via points."""
    rules = problem.rules
    assert rules is not None
    if rules.rules.straight is not None:
        if problem.objective == "time" and problem.grows:
            yield timed_line(problem, rules)
        yield through(problem, positions_along(problem, rules), "straight line of the tool, evenly")
        return
    trees = Trees.of(problem, rng)
    for number in count():
        stops = _stops(problem, rules, rng, SPREAD if number > 1 else 0.0)
        points = [stops[0]]
        for a, b in pairwise(stops):
            blocked = len(problem.scene.pairs) > 0 and not trees.edge_is_free(a, b)
            between = trees.vias(a, b, NODES, REACH) if blocked else None
            if between is not None:
                points += list(between)
            elif number:
                points.append((a + b) / 2 + rng.normal(size=problem.n) * SPREAD)
            points.append(b)
        inside = np.clip(np.array(points[1:-1]), problem.limits.lower, problem.limits.upper)
        yield through(problem, inside, f"through {number}" if number else "through the via points")


def _stops(problem: PlanningProblem, rules: Rules, rng: np.random.Generator, spread: float) -> list[Array]:
    """Start, a position at each via point, goal."""
    arm, found = problem.scene.arm, [problem.start]
    solver = PoseSolver(arm, rules.frame)
    for via in rules.rules.vias:
        if not via.of_tool:
            found.append(via.target)
            continue
        middle = (found[-1] + problem.goal) / 2 + rng.normal(size=problem.n) * spread
        found.append(solver.descend(Pose(None, via.target), middle)[0])
    return [*found, problem.goal]


def positions_along(problem: PlanningProblem, rules: Rules, count: int = ALONG) -> Float[Array, "V n"]:
    """Positions along the tool's straight line, each found from the one before, drawn to the goal's own."""
    (place, axes), (end, _) = rules.first, rules.last
    turn = pin.log3(axes.T @ rules.last[1])
    solver = PoseSolver(problem.scene.arm, rules.frame)
    shares = np.arange(1, count + 2) / (count + 1)

    def at(share: float, guess: Array) -> Array:
        rotation = axes @ pin.exp3(share * turn) if problem.n >= TURNING else None
        return solver.descend(Pose(None, place + share * (end - place), rotation), guess)[0]

    found = [problem.start]
    for share in shares:
        found.append(at(float(share), found[-1]))
    rest = problem.goal - found[-1]
    drawn = [at(float(share), q + share * rest) for share, q in zip(shares, found[1:], strict=True)]
    return np.clip(np.array(drawn[:-1]), problem.limits.lower, problem.limits.upper)


def timed_line(problem: PlanningProblem, rules: Rules) -> PlanningProblem:
    """The task from its tool's line, passed as quickly as speed, acceleration and torque let it.

    Most of the knots stand where the tool gets going or comes to rest, evenly by how much its speed changes there, the
    others evenly in time: a ramp takes a hundredth of the time, and a grid of equal sections holds none that is short.
    """
    fine = problem.with_ends(positions_along(problem, rules, FINE_LINE - 1))
    pace = quickest_pace(problem, fine, rules)
    steps = 2.0 / (pace[1:] + pace[:-1]) / FINE_LINE
    times = np.concatenate([[0.0], np.cumsum(steps)])
    change = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(pace)))])
    progress = (1.0 - RAMPS) * times / times[-1] + RAMPS * change / max(change[-1], 1e-12)
    knots = np.interp(np.arange(1, TIMED) / TIMED, progress, times)
    even = np.linspace(0.0, 1.0, FINE_LINE + 1)
    place = CubicHermiteSpline(times, even, pace)(knots)
    vias = CubicSpline(even, fine)(place)
    stamps = np.concatenate([[0.0], knots, times[-1:]])
    return replace(problem, vias=vias, durations=np.diff(stamps), label="straight line of the tool")


def quickest_pace(problem: PlanningProblem, q: Float[Array, "K n"], rules: Rules) -> Float[Array, " K"]:
    """Pace along a path of equal steps, as its share a second, from rest to rest within all limits [1/s].

    Along a path q(s), x = (ds/dt)² and u = d²s/dt², speed is q' √x and acceleration q' u + q'' x; torque is linear
    in u. A pass backwards and one forwards take the least and the largest u that all limits allow.

    Source: Bobrow, Dubowsky and Gibson, Time-optimal control of robotic manipulators along specified paths, 1985.
    """
    limits, step = problem.limits, 1.0 / (len(q) - 1)
    slope = np.gradient(q, step, axis=0, edge_order=2)
    bend = np.gradient(slope, step, axis=0, edge_order=2)
    top = (limits.speed / np.maximum(np.abs(slope), 1e-9)).min(axis=1)
    if problem.way.speed is not None:
        top = np.minimum(top, problem.way.speed / max(rules.length, 1e-9))
    most = np.full(problem.n, np.inf) if limits.acceleration is None else limits.acceleration

    def push(k: int, x: float, sign: float) -> float:
        """Largest u times its sign at a place; at least a little, so that the pass goes on."""
        speed = slope[k] * np.sqrt(max(x, 1e-12))
        still = bend[k] * x
        room = (most - np.sign(sign * slope[k]) * still) / np.maximum(np.abs(slope[k]), 1e-9)
        states = np.stack([q[k], q[k]]), np.stack([speed, speed]), np.stack([still, still + sign * slope[k]])
        at_rest, pushed = problem.model.torque(*(state[None] for state in states))[0]
        rise = pushed - at_rest
        free = (limits.torque - np.sign(rise) * at_rest) / np.maximum(np.abs(rise), 1e-9)
        return max(float(min(room.min(), free.min())), LEAST_PUSH)

    x = np.square(top)
    x[[0, -1]] = 0.0
    for k in range(len(q) - 2, -1, -1):
        x[k] = min(x[k], x[k + 1] + 2.0 * step * push(k + 1, x[k + 1], -1.0))
    for k in range(len(q) - 1):
        x[k + 1] = min(x[k + 1], x[k] + 2.0 * step * push(k, x[k], 1.0))
    return np.sqrt(x)


# Local times of a section at which a motion is looked at, and how much longer than its rates alone ask for it may last.
LOOKS, LONGER = np.linspace(0.0, 1.0, 25), np.geomspace(1.0, 100.0, 60)
# Digits of a duration that count: so that the same motion from two guesses is the same to the last bit.
DIGITS = 4
# Via points that hold a motion of each joint at its own limits.
HELD = 11


def at_its_limits(problem: PlanningProblem) -> PlanningProblem:
    """The same initial trajectory, lasting just as long as its limits of speed, acceleration, jerk and torque ask for.

    Speed goes with 1/T, acceleration with 1/T², jerk with 1/T³; torque, in which gravity and friction stay, is looked
    at for growing T. What breaks its torque limit at any T, as a motion through a pose that can't be held, lasts as
    long as the rates ask for.
    """
    shares = np.round(problem.durations / problem.durations.sum(), 12)
    points = problem.with_ends(problem.vias)
    limits, unit = problem.limits, Splines(points[None], shares[None])
    needs = [unit.top_speed[0] / limits.speed]
    q, dq, ddq = unit.states(LOOKS)
    if limits.acceleration is not None:
        needs.append(np.sqrt(np.abs(ddq[0]).max(axis=0) / limits.acceleration))
    if limits.jerk is not None:
        needs.append(np.cbrt(unit.top_jerk[0] / limits.jerk))
    rows = [] if problem.rules is None else problem.rules.rows(q[0], dq[0])
    tool = max((float(np.sqrt(row.value.max() / row.aim)) for row in rows if row.by_speed is not None), default=0.0)
    least = max(tool, float(np.max(np.concatenate(needs))), 1e-3)
    times = least * LONGER
    while times[-1] / times[0] > 1.001:
        stretch = times[:, None, None]
        states = (np.repeat(part, len(times), axis=0) for part in (q, dq, ddq))
        torque = problem.model.torque(*(part / stretch**order for order, part in enumerate(states)))
        kept = (np.abs(torque) <= limits.torque).all(axis=(1, 2))
        if not kept[-1]:
            times = np.array([least])
            break
        first = len(kept) - int(np.argmin(kept[::-1])) if not kept.all() else 0
        times = np.geomspace(times[max(first - 1, 0)], times[first], len(LONGER)) if first else times[:1]
    total = float(f"{times[-1] * 1.0005:.{DIGITS - 1}e}")
    return replace(problem, durations=shares * total)


def quickest_of_each_joint(problem: PlanningProblem) -> PlanningProblem | None:
    """The motion that is quickest by the limits of speed, acceleration and jerk alone, all joints arriving together.

    Exact for a task without obstacles whose torque limits leave the room.

    Returns:
        None where acceleration has no limit.

    Source: Berscheid and Kröger, Jerk-limited real-time trajectory generation with arbitrary target states, 2021.
    """
    limits = problem.limits
    if limits.acceleration is None:
        return None
    from ruckig import InputParameter, Result, Ruckig, Trajectory

    asked, found = InputParameter(problem.n), Trajectory(problem.n)
    asked.current_position, asked.target_position = problem.start.tolist(), problem.goal.tolist()
    asked.max_velocity, asked.max_acceleration = limits.speed.tolist(), limits.acceleration.tolist()
    asked.max_jerk = [float("inf")] * problem.n if limits.jerk is None else limits.jerk.tolist()
    if Ruckig(problem.n).calculate(asked, found) not in (Result.Working, Result.Finished):
        return None
    times = found.duration * np.arange(1, HELD + 1) / (HELD + 1)
    vias = np.array([found.at_time(float(time))[0] for time in times])
    even = np.full(HELD + 1, found.duration / (HELD + 1))
    return replace(problem, vias=vias, durations=even, label="each joint at its limits")
