"""How the arm stands at a cycle's stops, where several positions do as well.

The arm brings a frame to a pose in several ways, and often several poses do: a suction cup may grip
a round part at any turn. What a way to stand costs depends on the motions before and behind it,
so all stops are chosen together: the least sum of what straight motions from stop to stop cost,

    min Σ_k c_k(q_k, q_k+1)   with   q_k of stop k's positions,

is a shortest path through layers, found by dynamic programming. Straight motions know no obstacles,
so the few cheapest routes are looked at by a short search of each motion, and the best is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.model.hybrid import HybridModel
from plan.command_options import SolveOptions
from plan.dynamics.power import energy
from plan.geometry.clearance_proof import why_refused
from plan.initial.vias import straight
from plan.planners.base import Ledger
from plan.problem.problem import PlanningProblem
from plan.problem.stops import Stop
from plan.problem.task_file import Task
from plan.solving.cycle_legs import leg_tasks, moving_time
from plan.solving.obstruction import least_durations, shortest_duration
from plan.solving.set_up import reach_any, set_up
from plan.solving.solve import QUICK, QUICK_SECONDS
from plan.spline import Splines

# Routes through the stops that are looked at by short searches, the cheapest ones.
ROUTES = 4
# Share of the budget that those may take.
SHARE = 1.0 / 3.0

Route = tuple[int, ...]
"""Number of the position that is taken at each stop."""


def choose_stops(task: Task, model: HybridModel | None, options: SolveOptions) -> Task:
    """The cycle with one position for each stop: together the cheapest that were found.

    Raises:
        InputError: A stop has none that is allowed, or the cycle is at fault.
    """
    legs = leg_tasks(task, options.objective)
    if all(stop.is_chosen for stop in task.stops):
        return task
    problems = [set_up(leg, model, options) for leg in legs]
    layers: list[Sequence[Array]] = [[task.start]]
    for number, stop in enumerate(task.stops, start=1):
        beside = problems[number - 1 : number + 1]
        layers.append(_allowed_positions(task, stop, number, beside))
    layers.append([task.goal])
    free = moving_time(task, options.objective)
    each = None if free is None else free / len(legs)
    pairs = zip(problems, pairwise(layers), strict=True)
    costs = [_straight_costs(problem, *ends, each) for problem, ends in pairs]
    routes = cheapest_routes(costs, ROUTES)
    best = routes[0]
    if len(routes) > 1:
        best = _best_by_search(problems, layers, routes, free, options)
    stops = []
    for stop, layer, number in zip(task.stops, layers[1:-1], best[1:-1], strict=True):
        stops.append(replace(stop, q=layer[number], choices=(), poses=()))
    return replace(task, stops=tuple(stops))


def cheapest_routes(costs: Sequence[Float[Array, "a b"]], most: int) -> list[Route]:
    """The cheapest routes through layers, the best first, by dynamic programming.

    Args:
        costs: What it costs to go from each place of a layer to each of the next.
        most: So many routes at most.
    """
    known: list[list[tuple[float, Route]]] = [[(0.0, (k,))] for k in range(len(costs[0]))]
    for table in costs:
        reached: list[list[tuple[float, Route]]] = []
        for goal in range(table.shape[1]):
            ways = []
            for start, routes in enumerate(known):
                for cost, route in routes:
                    ways.append((cost + float(table[start, goal]), (*route, goal)))
            reached.append(sorted(ways)[:most])
        known = reached
    ends = sorted(way for ways in known for way in ways)
    return [route for _, route in ends[:most]]


def _allowed_positions(
    task: Task,
    stop: Stop,
    number: int,
    beside: Sequence[PlanningProblem],
) -> list[Array]:
    """The positions of a stop at which a motion may end and the next may begin.

    Args:
        task: The cycle.
        stop: The stop.
        number: Which one, for messages.
        beside: The motion before and the motion behind it.
    """
    if stop.is_chosen:
        return [stop.q]
    before = beside[0]
    name = f"leg {number}.pose"
    positions = [*stop.choices, *reach_any(before, task, stop.poses, name)]
    limits = before.limits
    allowed = []
    refused = ""
    for q in positions:
        if np.any(q < limits.lower) or np.any(q > limits.upper):
            refused = refused or "a joint is out of its limits"
            continue
        for problem in beside:
            reason = why_refused(problem.scene, q, limits.clearance)
            if reason is not None:
                refused = refused or reason[0]
                break
        else:
            allowed.append(q)
    if not allowed:
        what = f"leg {number}: none of its {len(positions)} positions is allowed ({refused})"
        raise InputError(task.source, what, "move it or the obstacle")
    return allowed


def _straight_costs(
    problem: PlanningProblem,
    starts: Sequence[Array],
    goals: Sequence[Array],
    duration: float | None,
) -> Float[Array, "a b"]:
    """What straight motions from each start to each goal cost.

    Args:
        problem: The motion, between any ends.
        starts, goals: The ends [rad].
        duration: Of each motion [s]; None where time is the objective.
    """
    shape = (len(starts), len(goals))
    if duration is None:
        shortest = np.zeros(shape)
        for row, start in enumerate(starts):
            for column, goal in enumerate(goals):
                needs = least_durations(problem.limits, np.abs(goal - start))
                shortest[row, column] = max(needs.values())
        return shortest
    firsts = np.repeat(np.stack(starts), shape[1], axis=0)
    lasts = np.tile(np.stack(goals), (shape[0], 1))
    ends = np.stack([firsts, lasts], axis=1)
    splines = Splines(ends, np.full((len(ends), 1), duration))
    return energy(problem.model, splines, problem.metric).reshape(shape)


def _best_by_search(
    problems: Sequence[PlanningProblem],
    layers: Sequence[Sequence[Array]],
    routes: Sequence[Route],
    free: float | None,
    options: SolveOptions,
) -> Route:
    """The route whose motions cost least by a short search each; the first where none is found.

    Args:
        problems: The motions in turn, between any ends.
        layers: Positions of the start, of each stop, and of the goal.
        routes: The routes.
        free: How long the arm may move in all [s]; None where time is the objective.
        options: How.
    """
    searches = len(routes) * len(problems)
    most, seconds = options.budget
    share = max(1, int(SHARE * most / searches))
    share_seconds = min(QUICK_SECONDS, SHARE * seconds / searches)
    sums = []
    for route in routes:
        motions = []
        ends = pairwise(layer[number] for layer, number in zip(layers, route, strict=True))
        for problem, (start, goal) in zip(problems, ends, strict=True):
            if not np.array_equal(start, goal):
                vias = straight(start, goal, problem.via_count)
                motions.append(replace(problem, start=start, goal=goal, vias=vias))
        needs = [shortest_duration(motion) for motion in motions]
        whole = 0.0
        for motion, need in zip(motions, needs, strict=True):
            if free is not None:
                total = free * need / sum(needs)
                count = len(motion.durations)
                motion = replace(motion, durations=np.full(count, total / count))
            ledger = Ledger(share, share_seconds)
            rng = np.random.default_rng(options.seed)
            best = QUICK.run([motion], ledger, rng).best
            whole += best.cost if best is not None and best.feasible else np.inf
        sums.append(whole)
    return routes[int(np.argmin(sums))]
