"""The default planner: gradients from several starts, knots inserted until they bring no more."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float, freeze
from plan.dynamics.power import ChainTorque
from plan.errors import MethodError
from plan.initial.starts import straight
from plan.initial.ways import iterate_ways
from plan.planners.base import Candidate, Ledger, Planner
from plan.planners.descent import Course, begin, descend, refine
from plan.planners.local_model import LocalModel
from plan.planners.reference import Reference
from plan.planners.transcription import Grid
from plan.problem.problem import PlanningProblem
from plan.spline import Splines

# Via points and fewest sections of the first grid, whatever the task asks for: more of them hold what fewer can.
FIRST_VIAS, COARSE = 2, 5
# Shares of the duration by which a motion is slowed down until it keeps its limits between the nodes, too.
SLOWER = (1.0, 1.0003, 1.0006, 1.001, 1.002, 1.004, 1.008, 1.016, 1.03, 1.06)
# Rounding of the sign of the speed [rad/s] and of the modulus of power [W]: on the first grid, and on finer ones.
WIDTHS = ((0.05, 2.0), (0.01, 0.5), (0.003, 0.1))
# Share of its limit that a search aims at below what the ledger asks for.
AIM = 0.9999


@dataclass(frozen=True)
class Sequential(Planner):
    """Sequential quadratic programming from every start on a coarse grid; the best ones go on to finer grids.

    A grid with every section in two holds every trajectory of the one before, and the search begins with that, so more
    freedom never ends worse. Where the user has named what is free, the reference planner does what is asked.

    Attributes:
        starts: Initial trajectories that are tried.
        first: Steps on the coarse grid from each start.
        steps: Steps on each finer grid.
        kept: Starts that go on to finer grids.
        gains: Share of the cost that a finer grid must bring for another one to follow, for energy and for time.
        levels: Most refinements, for energy and for time.
    """

    starts: int = 14
    first: int = 40
    steps: int = 40
    kept: int = 2
    gains: tuple[float, float] = (0.005, 0.001)
    levels: tuple[int, int] = (3, 4)
    name: ClassVar[str] = "sqp"
    explores: ClassVar[bool] = True

    def search(self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator) -> None:
        """Tries the given starts, and further ones where only the straight line is given.

        Raises:
            MethodError: The model has effects without derivatives.
        """
        given = problems[0]
        if not given.grows or given.free == "times":
            Reference().search(problems, ledger, rng)
            return
        courses: list[Course] = []
        for problem in self._initial(problems, rng):
            course = begin_course(problem)
            course = descend(course, ledger, *bounds(course.local), self.first, 0.3, 1e-4)
            courses.append(course)
            enter(course, ledger)
            if ledger.remaining == 0:
                return
        courses.sort(key=lambda course: course.rank)
        for course in courses[: self.kept]:
            self._finer(course, ledger)
        if len(problems) == 1:
            _give_vias(ledger, given.via_count)

    def _initial(self, problems: Sequence[PlanningProblem], rng: np.random.Generator) -> Iterator[PlanningProblem]:
        first = problems[0]
        if len(problems) > 1 or first.label != "straight":
            yield from problems
            return
        count = FIRST_VIAS + 1
        base = replace(
            first,
            vias=straight(first.start, first.goal, FIRST_VIAS),
            durations=np.full(count, first.durations.sum() / count),
        )
        for _, problem in zip(range(self.starts), iterate_ways(base, rng), strict=False):
            yield problem

    def _finer(self, course: Course, ledger: Ledger) -> None:
        """Halves the sections until that brings less than the gain."""
        timed, cost = course.local.timed, enter(course, ledger)
        for level in range(self.levels[timed]):
            course = refine(course, *WIDTHS[min(level + 1, 2)])
            course = descend(course, ledger, *bounds(course.local), self.steps, 0.1, 1e-5)
            known, cost = cost, enter(course, ledger)
            enough = known < np.inf and cost > known * (1.0 - self.gains[timed])
            if ledger.remaining == 0 or enough:
                return


def begin_course(problem: PlanningProblem) -> Course:
    """A problem's initial trajectory on a grid of its own knots, long sections parted."""
    if not isinstance(problem.model, ChainTorque):
        raise MethodError("--method sqp", "this model has effects without derivatives", "use --method cma")
    knots = np.concatenate([[0.0], np.cumsum(problem.durations)]) / problem.durations.sum()
    knots[-1] = 1.0
    while len(knots) < COARSE + 1:
        widest = int(np.argmax(np.diff(knots)))
        knots = np.insert(knots, widest + 1, (knots[widest] + knots[widest + 1]) / 2)
    nodes, weights = _nodes(problem)
    grid = Grid(freeze(knots), problem.limits.jerk is not None, nodes)
    aims = np.full((grid.sections, problem.n), AIM), np.full(problem.n, AIM)
    local = LocalModel(problem, grid, weights, *WIDTHS[0], *aims)
    start = Splines(np.concatenate([[problem.start], problem.vias, [problem.goal]])[None], problem.durations[None])
    return begin(local, local.join(grid.fit(start), float(problem.durations.sum())))


def _nodes(problem: PlanningProblem) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
    """Where a section is looked at, and quadrature weights."""
    if problem.objective == "time":
        return freeze(np.linspace(0.0, 1.0, 7)), freeze(np.zeros(7))
    x, w = np.polynomial.legendre.leggauss(6)
    return freeze([0.0, *((x + 1) / 2), 1.0]), freeze([0.0, *(w / 2), 0.0])


def bounds(local: LocalModel) -> tuple[Array, Array]:
    """Bounds of the variables: position limits, and no farther from the ends and the via points than the reach."""
    problem = local.problem
    points = np.concatenate([[problem.start], problem.vias, [problem.goal]])
    low = np.maximum(points.min(axis=0) - problem.radius, problem.limits.lower)
    high = np.minimum(points.max(axis=0) + problem.radius, problem.limits.upper)
    count = local.grid.free
    low, high = np.tile(low, count), np.tile(high, count)
    return (np.append(low, 0.02), np.append(high, 50.0)) if local.timed else (low, high)


def enter(course: Course, ledger: Ledger) -> float:
    """Enters a course into the ledger; where time is free it is slowed down until all limits hold.

    Returns:
        Its cost; infinite where it is not allowed.
    """
    splines, problem = course.local.splines(course.x), course.local.problem
    for factor in SLOWER if course.local.timed else (1.0,):
        carrier = problem.with_initial(Splines(splines.points, splines.durations * factor))
        found = ledger.evaluate(carrier, carrier.initial[None])
        if found.feasible[0]:
            return float(found.cost[0])
        if found.collision[0] > 0 or found.position[0] > 0:
            break
    return float("inf")


def _give_vias(ledger: Ledger, count: int) -> None:
    """Parts the longest sections of the best motion, which stays as it is, until it has as many via points as asked."""
    best = ledger.best
    if best is None or best.problem.via_count >= count:
        return
    splines = best.splines
    knots = np.concatenate([[0.0], np.cumsum(splines.durations[0])])
    while len(knots) < count + 2:
        widest = int(np.argmax(np.diff(knots)))
        knots = np.insert(knots, widest + 1, (knots[widest] + knots[widest + 1]) / 2)
    points = splines.at(knots)[0]
    points[0], points[-1] = splines.points[0, 0], splines.points[0, -1]
    same = best.problem.with_initial(Splines(points[None], np.diff(knots)[None]))
    ledger.best = Candidate(same, same.initial, best.cost, best.violation)
