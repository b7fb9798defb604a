"""The default planner: gradients from several starts, knots inserted until they bring no more."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from typing import ClassVar

import numpy as np

from ident.arrays import freeze
from ident.errors import InputError
from plan.initial.limit_times import at_its_limits, quickest_of_each_joint
from plan.initial.rule_ways import iterate_rule_ways
from plan.initial.starts import iterate_ways
from plan.initial.vias import straight
from plan.planners.base import BudgetSpentError, Candidate, Ledger, Planner
from plan.planners.courses import (
    WIDTHS,
    begin_course,
    course_on,
    different,
    enter,
    knots_of,
    nearly_holds,
    nodes_of,
    parted,
    peaks,
)
from plan.planners.descent import (
    KEPT,
    Course,
    begin,
    descend,
    move_aside,
)
from plan.planners.evolution import Evolution
from plan.planners.refinement import count_finer, refine
from plan.planners.transcription import Grid
from plan.problem.problem import STRAIGHT, PlanningProblem
from plan.spline import Splines

# Via points of the first grid.
FIRST_VIAS = 2
# Times that limits are aimed lower until they hold between the nodes, too.
SETTLED = 3
# A descent from a start ends where less than this share of the cost is to be gained.
ROUGHLY = 1e-4
# The same on the first finer grid, the second, and so on: what a coarse grid leaves undone the next
# one does anyway.
TOLERANCES = (5e-5, 2e-5, 1e-5)
# The same on knots that are named, where no finer grid follows.
CLOSELY = 1e-6
# A descent whose last step was cut short begins anew with a fresh curvature as long as that brings
# such a share.
ANEW = 1e-3
# The best motion is polished as long as that brings such a share.
POLISHED = 5e-4
# Longest first step of a descent [rad]: from a start, from what steps have come to, from what a
# descent has ended at, and where limits are aimed a little lower.
FROM_START = 0.3
FROM_COURSE = 0.1
FROM_END = 0.05
FROM_SETTLED = 0.02
# Starts after which the best of them goes on at once: so a plan near the best comes early, and the
# same steps are not taken again where it is still among the best when all have been tried.
LEAD = 3
# By so many grids, for energy and for time.
LEADS = (2, 1)
# A start whose cost lies this many times above the best after a third of its steps is given up.
FAR = 1.25
# A motion that was moved aside is given up where it collides so much by then, in units of 10 cm.
LOST = 0.2
# Grids are not made finer than this: a step's programme has as many variables as all joints'
# sections.
FINEST = 96
# Most refinements, for energy and for time.
LEVELS = (5, 4)
# A motion that was moved aside is given up early where it costs so many times as much as before.
DEARER = 1.05
# While asked seconds are left, in turns: so many motions are moved aside, each one of so many of
# the best, and the best one that was not refined is. The search ends after so many turns in which
# nothing better came.
MOVED = 10
BEST = 3
IDLE = 4
# Fewest via points that a motion without acceleration at its ends leaves free.
SOFT_VIAS = 3
# Trajectories by which CMA-ES moves time stamps that are named.
STAMPS = 4000

# Cost and course on the next finer grid, of courses that were refined.
Refined = dict[Course, tuple[float, Course]]


@dataclass(frozen=True)
class Sequential(Planner):
    """Sequential quadratic programming from every start; the best ones go on to finer grids.

    Motions start and end without acceleration, so that they are executed as they are planned. A
    search for the shortest time begins at the limits, so that it does not depend on the duration
    that the task guesses.

    A grid whose sections are parts of those of the one before holds every trajectory of that, and
    the search begins with it, so more freedom never ends worse. Where the user has named what is
    free, the knots stay the initial trajectory's, and the time stamps, if they are free, are moved
    by CMA-ES: few numbers, whose slopes would need every knot's.
    """

    starts: int = 10  # initial trajectories that are tried
    first: int = 36  # steps on the coarse grid from each start
    # Most steps on each finer grid: nearly all end of themselves, and one that does not has ended
    # 3 % above.
    steps: int = 80
    # Starts that go on to the first finer grid, to the second, and so on; the last number counts
    # from there on.
    kept: tuple[int, ...] = (4, 2, 1)
    # Share of the time that a finer grid must bring for the next to follow. Of energy all are made:
    # one that has brought nothing has been followed by one that brought a hundredth.
    gain: float = 0.001
    levels: int = max(LEVELS)  # most refinements, of which no more than `LEVELS` are made
    # Equal parts of the duration at whose ends all knots are set, where a controller takes its
    # points there alone; None where they may lie anywhere.
    parts: int | None = None
    name: ClassVar[str] = "sqp"
    explores: ClassVar[bool] = True

    def search(
        self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator
    ) -> None:
        """Tries the given starts, and further ones where only the straight line is given."""
        given = problems[0]
        if not given.grows or given.free == "times":
            self._search_named(problems, ledger, rng)
            return
        ways = self._initial(problems, ledger, rng)
        self._search(ways, max(self.starts, len(problems)), ledger, rng)
        best = ledger.best
        if len(problems) == 1 and best is not None and best.problem.via_count < given.via_count:
            ledger.best = _with_vias(best, given.via_count)

    def _search_named(
        self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator
    ) -> None:
        """Via points on the knots that are given, from several ways, and then time stamps.

        Raises:
            InputError: A jerk limit holds so many points at the ends that none is left.
        """
        problems = [replace(problem, grows=False) for problem in problems]
        first = problems[0]
        if first.limits.jerk is not None and first.via_count < SOFT_VIAS:
            what = f"with a jerk limit {first.via_count} via points leave nothing free"
            raise InputError("--variables", what, f"give task.via_points = {SOFT_VIAS} or more")
        if first.searches_vias:
            ways = self._initial(problems, ledger, rng, first.via_count)
            self._move_vias(islice(ways, max(self.starts, len(problems))), ledger)
        if first.searches_times and ledger.remaining > 0:
            best = ledger.best
            starts = problems if best is None else [best.problem.with_initial(best.splines)]
            step = 0.05 if best is None else 0.02
            Evolution(step=step, most=STAMPS).search(starts, ledger, rng)

    def _move_vias(self, ways: Iterable[PlanningProblem], ledger: Ledger) -> None:
        """Tries some ways, and takes the best of them on with less rounding, on the same knots."""
        courses: list[Course] = []
        for problem in ways:
            courses.append(self._try(begin_course(problem), ledger, courses))
            if ledger.remaining == 0:
                return
        for course in sorted(courses, key=lambda course: course.rank)[: self.kept[0]]:
            for width, power in WIDTHS[1:]:
                local = replace(course.local, width=width, power=power)
                course = begin(local, course.x)
                course = descend(course, ledger, self.steps, FROM_COURSE, CLOSELY)
                course, _ = self.settle(course, ledger)

    def _search(
        self,
        ways: Iterator[PlanningProblem],
        count: int,
        ledger: Ledger,
        rng: np.random.Generator,
    ) -> None:
        """Tries so many ways and takes the best to finer grids, as many on each as `kept` says.

        Args:
            ways: Initial trajectories, the most promising first.
            count: How many of them are tried.
            ledger: Counts what is evaluated.
            rng: Source of randomness.
        """
        courses: list[Course] = []
        known: Refined = {}
        for problem in islice(ways, count):
            course = begin_course(problem, self.parts)
            courses.append(self._try(course, ledger, courses))
            if ledger.remaining == 0:
                return
            if len(courses) == LEAD < self.starts:
                best = min(courses, key=lambda course: course.rank)
                self._finer([best], ledger, known, range(LEADS[best.local.timed]))
        if courses:
            courses.sort(key=lambda course: course.rank)
            most = min(self.levels, LEVELS[courses[0].local.timed])
            before = ledger.seconds_left
            finer = self._finer(courses, ledger, known, range(most))
            self._polish(ledger)
            whole = most == LEVELS[courses[0].local.timed]
            if whole and not finer[0].local.problem.way.given:
                taken = before - ledger.seconds_left
                self._go_on(ways, finer, ledger, rng, taken)

    def _go_on(
        self,
        ways: Iterator[PlanningProblem],
        courses: Sequence[Course],
        ledger: Ledger,
        rng: np.random.Generator,
        taken: float,
    ) -> None:
        """Looks on while asked seconds are left: beside the best courses, and along further ways.

        What a course costs on the first finer grid tells little of which is best on the last, so
        one after the other is refined.

        Args:
            ways: Further initial trajectories.
            courses: On the first finer grid, the best ones first.
            ledger: Counts what is evaluated.
            rng: Source of randomness.
            taken: Processor time that finer grids may take, as a guess [s].
        """
        most = LEVELS[courses[0].local.timed]
        refined = [courses[0]]
        idle = 0
        while ledger.kept_back > 0.0 and idle < IDLE:
            best = ledger.best
            if ledger.seconds_left > taken:
                reached = [*courses, *self._beside(courses, ledger, rng)]
                for way in islice(ways, 1):
                    course = self._try(begin_course(way, self.parts), ledger, reached)
                    reached.append(self._refine(course, ledger, 0)[1])
                reached.sort(key=lambda course: course.rank)
                courses = different(reached, self.starts)
            fresh = next((course for course in courses if course not in refined), None)
            if fresh is None or ledger.remaining == 0:
                return
            before = ledger.seconds_left
            self._finer([fresh], ledger, {}, range(1, most))
            taken = before - ledger.seconds_left
            refined.append(fresh)
            self._polish(ledger)
            idle = idle + 1 if ledger.best is best else 0

    def _beside(
        self, courses: Sequence[Course], ledger: Ledger, rng: np.random.Generator
    ) -> list[Course]:
        """Where descents lead that begin a little beside the best courses."""
        ends = []
        for _ in range(MOVED):
            if ledger.remaining == 0:
                break
            course = courses[int(rng.integers(min(BEST, len(courses))))]
            beside = begin(course.local, move_aside(course, rng))
            beside = descend(beside, ledger, self.first // 3, FROM_COURSE, TOLERANCES[0])
            is_lost = beside.look.clearance > LOST
            is_far = beside.look.cost > DEARER * course.look.cost
            if is_lost or is_far or len(different([course, beside], 2)) == 1:
                continue
            beside = descend(beside, ledger, self.steps, FROM_COURSE, TOLERANCES[0])
            ends.append(self.settle(beside, ledger)[0])
        return ends

    def _polish(self, ledger: Ledger) -> None:
        """Descends anew from the best motion while that pays and asked seconds are left.

        Beside an edge of an obstacle, and where a joint turns round, a descent has ended some
        thousandths above the least that its own grid holds: with coarser roundings first and a
        fresh curvature it goes on.
        """
        best = ledger.best
        while best is not None and best.feasible and ledger.kept_back > 0.0:
            problem = best.problem
            if ledger.remaining == 0 or problem.objective == "time":
                return
            again = problem.with_initial(best.splines, label=problem.label)
            descend_on_knots(again, ledger, self.steps)
            polished = ledger.best
            if polished is None or polished.cost > best.cost * (1.0 - POLISHED):
                return
            best = polished

    def _try(self, course: Course, ledger: Ledger, others: Sequence[Course]) -> Course:
        """Steps on the coarse grid; given up early where it lies far above the best.

        One that collides by then goes on: it may come out on the side where none other begins.
        """
        early = self.first // 3
        course = descend(course, ledger, early, FROM_START, ROUGHLY)
        enter(course, ledger)
        if not ledger.solved:
            course, _ = self.settle(course, ledger)
        best = min((other.rank for other in others), default=(True, np.inf))
        if best < (False, course.look.cost / FAR):
            return course
        course = descend(course, ledger, self.first - early, FROM_COURSE, ROUGHLY)
        return self.settle(course, ledger)[0]

    def settle(self, course: Course, ledger: Ledger) -> tuple[Course, float]:
        """Enters a course; with tighter limits again where they hold at its nodes alone.

        Returns:
            Where the steps have come to, and the least cost that was allowed.
        """
        cost = enter(course, ledger)
        for turn in range(SETTLED):
            if ledger.remaining == 0 or not nearly_holds(course):
                break
            if turn > 0 and cost < np.inf:
                break
            torque, speed = peaks(course)
            torque = np.maximum(torque, 1.0)
            speed = np.maximum(speed, 1.0)
            if max(torque.max(), speed.max()) <= 1.0 + KEPT:
                break
            local = course.local
            aims = {"torque_aim": local.torque_aim / torque, "speed_aim": local.speed_aim / speed}
            course = begin(replace(local, **aims), course.x)
            course = descend(course, ledger, self.steps // 10, FROM_SETTLED, TOLERANCES[-1])
            cost = min(cost, enter(course, ledger))
        return course, cost

    def _initial(
        self,
        problems: Sequence[PlanningProblem],
        ledger: Ledger,
        rng: np.random.Generator,
        vias: int = FIRST_VIAS,
    ) -> Iterator[PlanningProblem]:
        """The ways that are given; where that is the straight line alone, others as well."""
        first = problems[0]
        if len(problems) > 1 or first.label != STRAIGHT:
            yield from problems
            return
        count = vias + 1
        base = replace(
            first,
            vias=straight(first.start, first.goal, vias),
            durations=np.full(count, first.durations.sum() / count),
        )
        if base.objective == "time":
            base = at_its_limits(base)
            each = None if base.way.given else quickest_of_each_joint(base)
            if each is not None and base.grows:
                yield each
        way = first.way
        if way.straight is not None or way.vias:
            yield from iterate_rule_ways(base, rng)
            return
        yield from iterate_ways(base, rng, lambda: ledger.solved, lambda: ledger.seconds_left)

    def _finer(
        self,
        courses: Sequence[Course],
        ledger: Ledger,
        done: Refined,
        levels: range,
    ) -> Sequence[Course]:
        """Parts the sections until that brings less than the gain, on each grid for fewer courses.

        What a course costs on a coarse grid tells little of what it will on a fine one: of ten
        starts the seventh best has ended 2 % below the best. So several go on, and are compared
        again on each grid.

        Args:
            courses: The best ones first.
            ledger: Counts what is evaluated.
            done: What became of courses on finer grids; filled.
            levels: Numbers of the refinements that are made.

        Returns:
            The courses on the first of the finer grids, the best ones first.
        """
        timed = courses[0].local.timed
        known = np.inf
        first = courses
        for level in levels:
            finer: list[tuple[float, Course]] = []
            for course in different(courses, self.kept[min(level, len(self.kept) - 1)]):
                if course not in done:
                    done[course] = self._refine(course, ledger, level)
                if ledger.remaining == 0:
                    return first
                finer.append(done[course])
            finer.sort(key=lambda reached: (reached[1].rank, reached[0]))
            courses = [course for _, course in finer]
            cost = min(cost for cost, _ in finer)
            if level == levels.start:
                first = courses
            if timed and level > 0 and known < np.inf and cost > known * (1.0 - self.gain):
                return first
            known = min(known, cost)
        return first

    def _refine(self, course: Course, ledger: Ledger, level: int) -> tuple[float, Course]:
        """Cost and course after steps on a finer grid; as they were where none finer is made."""
        sections = count_finer(course.local)
        if sections > FINEST:
            return (course.look.cost if course.kept else np.inf), course
        nodes = nodes_of(course.local.timed, sections)
        refined = refine(course, *WIDTHS[min(level + 1, len(WIDTHS) - 1)], nodes)
        tolerance = TOLERANCES[min(level, len(TOLERANCES) - 1)]
        refined = descend(refined, ledger, self.steps, FROM_COURSE, tolerance)
        while not refined.local.timed and ledger.remaining > 0:
            anew = begin(refined.local, refined.x)
            anew = descend(anew, ledger, self.steps, FROM_END, tolerance)
            brought = refined.look.cost - anew.look.cost
            if anew.rank >= refined.rank:
                break
            refined = anew
            if brought < ANEW * abs(anew.look.cost):
                break
        refined, cost = self.settle(refined, ledger)
        return cost, refined


def _with_vias(best: Candidate, count: int) -> Candidate:
    """The same motion, its longest sections parted until it has so many via points."""
    splines = best.splines
    times = np.concatenate([[0.0], np.cumsum(splines.durations[0])])
    knots = parted(times, count + 1)
    points = splines.at(knots)[0]
    points[0] = splines.points[0, 0]
    points[-1] = splines.points[0, -1]
    same = best.problem.with_initial(Splines(points[None], np.diff(knots)[None]))
    return Candidate(same, same.initial, best.cost, best.violation)


def descend_on_knots(problem: PlanningProblem, ledger: Ledger, steps: int) -> None:
    """Takes a motion to the least energy on its own knots, for which it may have been moved.

    Args:
        problem: The task, its duration fixed, started from the motion.
        ledger: Gets what is found, until its budget ends.
        steps: Most steps, on a coarser and on a finer rounding of the signs of speed and power.
    """
    knots = knots_of(problem)
    knots[-1] = 1.0
    nodes, weights = nodes_of(False, len(knots) - 1)
    grid = Grid(freeze(knots), True, nodes)
    if grid.free < 1:
        return
    course = course_on(problem, grid, weights, WIDTHS[1])
    planner = Sequential(steps=steps)
    with suppress(BudgetSpentError):
        for width, power in WIDTHS[1:]:
            course = begin(replace(course.local, width=width, power=power), course.x)
            course = descend(course, ledger, steps, FROM_COURSE, TOLERANCES[-1])
            course = planner.settle(course, ledger)[0]
