"""A task as a course of a descent on a grid, and what a course comes to as the ledger counts it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float, freeze
from plan.dynamics.power import section_nodes
from plan.initial.limit_times import at_its_limits
from plan.planners.base import Ledger
from plan.planners.descent import KEPT_CLEAR, KEPT_RULE, Course, begin
from plan.planners.local_model import LocalModel
from plan.planners.transcription import Grid, on_steps
from plan.problem.problem import SHARE, PlanningProblem
from plan.spline import Splines

# Fewest sections of the first grid, for energy and for time, whatever the task asks for: more of
# them hold what fewer can. Times of few sections hardly tell which start ends lowest.
COARSE = (6, 12)
# Shares of the duration by which a motion is slowed down until it keeps its limits between the
# nodes, too.
SLOWER = (1.0, 1.0003, 1.0006, 1.001, 1.002, 1.004, 1.008, 1.016, 1.03, 1.06)
# Rounding of the sign of the speed [rad/s] and of the modulus of power [W]: on the first grid, and
# on finer ones.
WIDTHS = ((0.05, 2.0), (0.01, 0.5), (0.003, 0.1))
# Sections from which on each is looked at in fewer places.
MANY = 12
# Places in a section, for time: of few sections, of many, of twice as many.
TIMED_NODES = (7, 5, 4)
# The same for energy, beside the section's ends: of few sections, of many.
ENERGY_NODES = (6, 4)
# Places of a section at which peaks are looked for: those of the ledger's evaluation among them,
# and close enough together for the peak where a joint turns round and its friction changes sign.
DENSE = freeze(np.unique(np.concatenate([np.linspace(0.0, 1.0, 97), section_nodes()[0]])))
# Share of its limit that a search aims at below what the ledger asks for.
AIM = 0.9999
# Limits passed between the nodes, and at them by no more than this share, are aimed lower: a motion
# slowed down for a thousandth too much torque ends per cent above one that aims a thousandth lower.
NEARLY = 0.01
# Trajectories whose positions differ by less than this all along are the same, and only the better
# goes on [rad].
SAME = 0.03
# Places at which they are compared.
COMPARED = freeze(np.linspace(0.0, 1.0, 17)[1:-1])


def begin_course(problem: PlanningProblem, parts: int | None = None) -> Course:
    """A problem's initial trajectory on a grid of its own knots.

    Where these may grow, long sections are parted, and acceleration is zero at both ends.

    Args:
        problem: The task, started from the trajectory.
        parts: Equal parts of the duration at whose ends knots are set; None for the knots' own.
    """
    timed = problem.objective == "time"
    if timed:
        problem = at_its_limits(problem)
    knots = np.round(knots_of(problem), 12)
    knots[-1] = 1.0
    if problem.grows:
        knots = parted(knots, COARSE[timed])
    knots = np.unique(on_steps(knots, parts))
    nodes, weights = nodes_of(timed, len(knots) - 1)
    grid = Grid(freeze(knots), problem.grows or problem.limits.jerk is not None, nodes, parts)
    return course_on(problem, grid, weights, WIDTHS[0])


def course_on(
    problem: PlanningProblem, grid: Grid, weights: Array, widths: tuple[float, float]
) -> Course:
    """A problem's initial trajectory on a grid, with weights of its nodes and roundings."""
    torque_aim = np.full((grid.sections, problem.n), AIM)
    speed_aim = np.full(problem.n, AIM)
    local = LocalModel(problem, grid, weights, *widths, torque_aim, speed_aim)
    initial = Splines(problem.with_ends(problem.vias)[None], problem.durations[None])
    return begin(local, local.join(grid.fit(initial), float(problem.durations.sum())))


def knots_of(problem: PlanningProblem) -> Float[Array, " K"]:
    """Ends of a problem's sections, as shares of its duration."""
    ends = np.concatenate([[0.0], np.cumsum(problem.durations)])
    return np.asarray(ends / problem.durations.sum())


def parted(knots: Float[Array, " K"], sections: int) -> Float[Array, " K"]:
    """The knots with the longest section parted until there are so many sections."""
    while len(knots) < sections + 1:
        widest = int(np.argmax(np.diff(knots)))
        middle = (knots[widest] + knots[widest + 1]) / 2
        knots = np.insert(knots, widest + 1, middle)
    return knots


def nodes_of(timed: bool, sections: int) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
    """Where a section is looked at, fewer places where there are many sections; and weights."""
    if timed:
        count = TIMED_NODES[min(sections // MANY, len(TIMED_NODES) - 1)]
        return freeze(np.linspace(0.0, 1.0, count)), freeze(np.zeros(count))
    places, weights = np.polynomial.legendre.leggauss(ENERGY_NODES[sections >= MANY])
    nodes = [0.0, *((places + 1) / 2), 1.0]
    return freeze(nodes), freeze([0.0, *(weights / 2), 0.0])


def peaks(course: Course) -> tuple[Float[Array, "K n"], Float[Array, " n"]]:
    """Largest torque of each section and largest speed, as shares of what is aimed at.

    Between the nodes, too.
    """
    local = course.local
    limits = local.problem.limits
    splines = local.splines(course.x)
    tau = np.abs(local.problem.model.torque(*splines.states(DENSE))[0])
    torque = tau.reshape(local.grid.sections, len(DENSE), local.n).max(axis=1)
    speed = splines.top_speed[0]
    return torque / (SHARE * AIM * limits.torque), speed / (SHARE * AIM * limits.speed)


def enter(course: Course, ledger: Ledger) -> float:
    """Enters a course into the ledger; where time is free it is slowed down until all limits hold.

    Returns:
        Its cost; infinite where it is not allowed.
    """
    splines = course.local.splines(course.x)
    problem = course.local.problem
    for factor in SLOWER if course.local.timed else (1.0,):
        slower = Splines(splines.points, splines.durations * factor)
        if ledger.solved:
            torque = np.abs(problem.model.torque(*slower.states(DENSE))[0])
            if np.any(torque > problem.limits.torque):
                # The ledger looks in fewer places: it would take for allowed what the certificate
                # refuses.
                continue
        carrier = problem.with_initial(slower)
        evaluation = ledger.evaluate(carrier, carrier.initial[None])
        if evaluation.feasible[0]:
            return float(evaluation.cost[0])
        if evaluation.collision[0] > 0 or evaluation.position[0] > 0:
            break
    return float("inf")


def nearly_holds(course: Course) -> bool:
    """Whether a course keeps its limits all but for a little."""
    look = course.look
    is_clear = look.clearance <= KEPT_CLEAR and look.rules <= KEPT_RULE
    return is_clear and look.limits <= NEARLY


def different(courses: Sequence[Course], most: int) -> list[Course]:
    """The first of the courses, without those that have come to where a better one is.

    So many at most. Along a way that is given all come to the same place: there another grid makes
    another course, as which of them holds the quickest time law is seen on finer ones alone.
    """
    taken: list[Course] = []
    places: dict[int, list[Array]] = {}  # by sections of the grid, where these part courses
    for course in courses:
        grid = course.local.grid
        place = grid.positions(course.local.split(course.x)[0], COMPARED)
        sections = grid.sections if course.local.problem.way.given else 0
        rivals = places.setdefault(sections, [])
        if any(np.abs(place - other).max() < SAME for other in rivals):
            continue
        taken.append(course)
        rivals.append(place)
        if len(taken) == most:
            break
    return taken
