"""Initial trajectories that keep a task's rules, or nearly."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count, pairwise

import numpy as np

from ident.arrays import Array, Float
from plan.initial.inverse_kinematics import PoseSolver
from plan.initial.line_pace import positions_along, timed_line
from plan.initial.trees import Trees
from plan.initial.vias import through
from plan.problem.problem import PlanningProblem
from plan.problem.rule_values import Rules
from plan.problem.rules import Pose

# Nodes of the trees between two stops, and how far beyond these they reach [rad].
NODES = 2000
REACH = 1.5
# Standard deviation of a bend between two stops, and of where the arm's position at a place is
# looked for [rad].
SPREAD = 0.3


def iterate_rule_ways(
    problem: PlanningProblem, rng: np.random.Generator
) -> Iterator[PlanningProblem]:
    """The task from ways that keep its rules, or nearly.

    One along a straight line; without end through via points.
    """
    rules = problem.rules
    assert rules is not None
    if rules.rules.straight is not None:
        if problem.objective == "time" and problem.grows:
            yield timed_line(problem, rules)
        vias = positions_along(problem, rules)
        yield through(problem, vias, "straight line of the tool, evenly")
        return
    trees = Trees.of(problem, rng)
    for number in count():
        points = _through_stops(problem, rules, trees, number)
        inside = np.clip(points[1:-1], problem.limits.lower, problem.limits.upper)
        label = f"through {number}" if number else "through the via points"
        yield through(problem, inside, label)


def _through_stops(
    problem: PlanningProblem, rules: Rules, trees: Trees, number: int
) -> Float[Array, "K n"]:
    """A way through the via points, round what is in the way between them.

    Args:
        problem: The task.
        rules: Its rules.
        trees: Look for ways between two stops; their source of randomness is used here, too.
        number: Of the way. The first one is not bent, and each looks for the arm's positions in
            other places from the third on.
    """
    rng = trees.rng
    stops = _stops(problem, rules, rng, SPREAD if number > 1 else 0.0)
    points = [stops[0]]
    for before, after in pairwise(stops):
        between = None
        if len(problem.scene.pairs) > 0 and not trees.edge_is_free(before, after):
            between = trees.vias(before, after, NODES, REACH)
        if between is not None:
            points += list(between)
        elif number > 0:
            bend = rng.normal(size=problem.n) * SPREAD
            points.append((before + after) / 2 + bend)
        points.append(after)
    return np.array(points)


def _stops(
    problem: PlanningProblem, rules: Rules, rng: np.random.Generator, spread: float
) -> list[Array]:
    """Start, a position at each via point, goal."""
    solver = PoseSolver(problem.scene.arm, rules.frame)
    stops = [problem.start]
    for via in rules.rules.vias:
        if not via.of_tool:
            stops.append(via.target)
            continue
        middle = (stops[-1] + problem.goal) / 2
        guess = middle + rng.normal(size=problem.n) * spread
        position, _ = solver.descend(Pose(None, via.target), guess)
        stops.append(position)
    return [*stops, problem.goal]
