"""Initial trajectories of tasks whose way is given in part: through via points, or along a line of the tool."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count, pairwise

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from plan.initial.initial_guesses import drawn_way
from plan.initial.inverse_kinematics import PoseSolver, find_frame
from plan.initial.rrt import TreeOptions, edge_is_free
from plan.initial.starts import time_stamps
from plan.problem.pose import Pose
from plan.problem.problem import PlanningProblem
from plan.problem.rule_values import TURNING, Rules

# Via points along a straight line of the tool, or six apart in time; nodes and reach [rad] of trees between two stops.
ALONG, NODES, REACH = 12, 2000, 1.5
# Standard deviation of a bend between two stops, and of where the arm's position at a place is looked for [rad].
BEND, SPREAD = 0.3, 0.3


def iterate_rule_ways(problem: PlanningProblem, rng: np.random.Generator) -> Iterator[PlanningProblem]:
    """The task from ways that keep its rules, or nearly: one along a straight line, without end through via points."""
    rules = problem.rules
    assert rules is not None
    if rules.rules.straight is not None:
        yield _joined(problem, _along(problem, rules), "straight line of the tool")
        return
    options = TreeOptions(margins=problem.margins)
    for number in count():
        stops = _stops(problem, rules, rng, SPREAD if number > 1 else 0.0)
        points = [stops[0]]
        for a, b in pairwise(stops):
            blocked = len(problem.scene.pairs) > 0 and not edge_is_free(problem.scene, a, b, options)
            between = drawn_way(problem, rng, NODES, REACH, (a, b)) if blocked else None
            if between is not None:
                points += list(between)
            elif number:
                points.append((a + b) / 2 + rng.normal(size=problem.n) * BEND)
            points.append(b)
        inside = np.clip(np.array(points[1:-1]), problem.limits.lower, problem.limits.upper)
        yield _joined(problem, inside, f"through {number}" if number else "through the via points")


def _stops(problem: PlanningProblem, rules: Rules, rng: np.random.Generator, spread: float) -> list[Array]:
    """Start, a position at each via point, goal."""
    arm, found = problem.scene.arm, [problem.start]
    solver = PoseSolver(arm, find_frame(arm, rules.frame) or 0)
    for via in rules.rules.vias:
        if not via.of_tool:
            found.append(via.target)
            continue
        middle = (found[-1] + problem.goal) / 2 + rng.normal(size=problem.n) * spread
        found.append(solver.descend(Pose(None, via.target), middle)[0])
    return [*found, problem.goal]


def _along(problem: PlanningProblem, rules: Rules) -> Float[Array, "V n"]:
    """Positions along the tool's straight line, each found from the one before, drawn to the goal's own."""
    (place, axes), (end, _) = rules.first, rules.last
    turn = pin.log3(axes.T @ rules.last[1])
    solver = PoseSolver(problem.scene.arm, find_frame(problem.scene.arm, rules.frame) or 0)
    shares = np.arange(1, ALONG + 2) / (ALONG + 1)

    def at(share: float, guess: Array) -> Array:
        rotation = axes @ pin.exp3(share * turn) if problem.n >= TURNING else None
        return solver.descend(Pose(None, place + share * (end - place), rotation), guess)[0]

    found = [problem.start]
    for share in shares:
        found.append(at(float(share), found[-1]))
    rest = problem.goal - found[-1]
    drawn = [at(float(share), q + share * rest) for share, q in zip(shares, found[1:], strict=True)]
    return np.clip(np.array(drawn[:-1]), problem.limits.lower, problem.limits.upper)


def _joined(problem: PlanningProblem, vias: Float[Array, "V n"], label: str) -> PlanningProblem:
    """The task from these via points, the whole duration kept."""
    points = np.concatenate([[problem.start], vias, [problem.goal]])
    durations = time_stamps(points, problem.limits.speed, float(problem.durations.sum()))
    return replace(problem, vias=vias, durations=durations, label=label)
