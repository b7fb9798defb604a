"""Sequential quadratic programming from one trajectory.

Exact slopes, a learned curvature, steps that must pay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from plan.planners.base import Ledger
from plan.planners.local_model import Linearisation, LocalModel, TrajectoryValues
from plan.planners.near_pairs import clearance_rows
from plan.planners.subproblem import Bounds, ConstraintRows, Step, solve_step
from plan.planners.transcription import ACTING, DEGREE

# Price of the largest excess over a limit (a share of it), for energy and for time, of the
# clearance's shortfall (10 cm) and of the excess over a rule of the way, as shares of the cost. A
# motion that is slowed down by a share keeps torques lower by up to twice that: were time's
# price much above that, steps would be short for the little that limits bend.
LIMIT_PRICES = (4.0, 1.5)
PRICES = (20.0, 20.0)
# They are raised tenfold, so many times at most, where something stays broken.
RAISES = 3
# A step must bring this share of what was promised.
LEAST = 0.05
# One that brings this share may be longer next time.
GOOD = 0.5
# Shortest step worth another try [rad].
SHORTEST = 1e-5
# Longest step of any [rad].
LONGEST = 1.0
# A failed step shorter than this teaches the next one what it hit [rad].
NEARBY = 0.1
# Times that a step is looked for, with the limits that the one before would have passed unwatched.
WATCHED_ANEW = 4
# One that is no longer than this has met a kink of the cost [rad].
KINKED = 1e-3
# Share of a failed step that the next may be as long as.
SHORTER = 0.3
# The same of a step that has taught the next one something.
SHORTER_TAUGHT = 0.6
# Largest change of the duration in a step, as a share of it.
DURATION_REACH = 0.2
# Curvature given to the time objective, whose own is nought: keeps coefficients that don't matter
# where they are.
CALM = 2e-3
# The same of the coefficients whatever their shape, and of the duration.
CALM_ALL = 1e-4
# Length of the step by which curvature is measured [rad].
PROBE = 0.01
# The factors by which it is believed to differ from what smoothness asks for.
STIFFEST = (1e-3, 1e2)
# What counts as kept: of a limit as a share of it, half of what the search aims lower than the
# ledger asks for.
KEPT = 5e-5
# Of the clearance as a share of 10 cm: a quarter of a millimetre more than the margin is asked for.
KEPT_CLEAR = 1e-3
# Of a rule of the way in its unit, of which a tenth more is asked for.
KEPT_RULE = 2e-4
# How far a motion is moved aside where it is moved most, between these [rad].
ASIDE = (0.4, 1.5)
# How long the part is that is moved: standard deviations of a bell, as shares of the duration.
BELL = (0.1, 0.35)


@dataclass(frozen=True, eq=False)
class Course:
    """Where a descent has come to."""

    local: LocalModel  # task and grid
    x: Float[Array, " d"]  # variables
    look: TrajectoryValues  # what the trajectory costs and breaks
    curvature: Float[Array, "d d"]  # learned second derivative of the scaled cost

    @property
    def kept(self) -> bool:
        """Whether all limits hold as far as the search looks."""
        return not _breaks(self.look)

    @property
    def rank(self) -> tuple[bool, float]:
        """Allowed before not allowed, then by what is broken or by cost."""
        if self.kept:
            return False, self.look.cost
        return True, self.look.broken


def _breaks(look: TrajectoryValues) -> bool:
    return look.limits > KEPT or look.clearance > KEPT_CLEAR or look.rules > KEPT_RULE


def begin(local: LocalModel, x: Float[Array, " d"]) -> Course:
    """A course before its first step."""
    look = local.look(x)
    curvature = first_curvature(local)
    if not local.timed:
        curvature = curvature * _stiffness(local, x, abs(look.cost), curvature)
    return Course(local, x, look, curvature)


def _stiffness(
    local: LocalModel, x: Float[Array, " d"], cost: float, curvature: Float[Array, "d d"]
) -> float:
    """How many times more the cost is bent than that, along a short way downhill."""
    scale = max(cost, 1e-9)
    about = local.linearise(x)
    gradient, bend = (derivative / scale for derivative in local.gradient(about)[:2])
    step = -np.linalg.solve(curvature + bend + 1e-9 * np.eye(len(x)), gradient)
    length = float(np.abs(step).max())
    if length < 1e-12:
        return 1.0
    step *= PROBE / length
    change = local.gradient(local.linearise(x + step))[0] / scale - gradient - bend @ step
    ratio = (change @ step) / (step @ curvature @ step)
    return float(np.clip(ratio, *STIFFEST))


def first_curvature(local: LocalModel) -> Float[Array, "d d"]:
    """A second derivative to begin with: what smoothness asks for, ∫ (dq/ds)² ds."""
    grid = local.grid
    each = local.weights
    if local.timed:  # a search for time has no quadrature
        each = np.full(len(grid.nodes), 1.0 / len(grid.nodes))
    weights = (np.diff(grid.knots)[:, None] * each).reshape(-1)
    design = np.zeros((len(weights), grid.sections + DEGREE))
    rows = np.arange(len(weights))[:, None]
    design[rows, grid.first[:, None] + ACTING] = grid.bases[1]
    free = slice(grid.held, -grid.held)
    gram = (design.T @ (weights[:, None] * design))[free, free]
    smooth = np.kron(gram, np.eye(local.n))
    if not local.timed:
        return smooth
    calm = np.diag(np.full(local.size, CALM_ALL))
    calm[:-1, :-1] += CALM * smooth
    return calm


def descend(course: Course, ledger: Ledger, steps: int, reach: float, tolerance: float) -> Course:
    """Takes up to so many steps.

    Args:
        course: Where to begin.
        ledger: Counts what is evaluated.
        steps: Most steps.
        reach: Longest first step [rad].
        tolerance: Ends where less than this share of the cost is to be gained.
    """
    descent = _Descent(course, ledger, reach, tolerance)
    last_step = 0.0
    for _ in range(steps):
        # A step that would end beyond the budget would be lost: what it leads to could no longer be
        # entered.
        if ledger.remaining == 0 or ledger.seconds_left < last_step:
            break
        before = ledger.seconds_left
        if not descent.advance():
            break
        last_step = before - ledger.seconds_left
    return descent.course


@dataclass(frozen=True, eq=False)
class _Model:
    """The cost to second order about a course's place, and its torque to first."""

    about: Linearisation
    gradient: Float[Array, " d"]  # of the scaled cost
    curvature: Float[Array, "d d"]


class _Descent:
    """What is known between two steps: prices, the longest step, slopes of the last place."""

    def __init__(self, course: Course, ledger: Ledger, reach: float, tolerance: float) -> None:
        self.course = course
        self._ledger = ledger
        self._reach = reach
        self._tolerance = tolerance
        self._limits = course.local.bounds
        self._scale = max(abs(course.look.cost), 1e-9)
        self._prices = np.array([LIMIT_PRICES[course.local.timed], *PRICES])
        self._raised = 0
        # Derivative of the cost where the last step began, what bends it there, and that step.
        self._slope: Array | None = None
        self._bent = np.zeros_like(course.curvature)
        self._step = np.zeros(0)
        self._failed = course.look  # where the last failed step led

    def advance(self) -> bool:
        """Takes one step; false where none pays, or the budget is spent."""
        local = self.course.local
        x = self.course.x
        about = local.linearise(x)
        gradient, bend, rows = local.gradient(about)
        bend = bend / self._scale
        self._ledger.count(1)
        if self._slope is not None and not local.timed:
            change = (gradient - self._slope) / self._scale
            change = change - 0.5 * (self._bent + bend) @ self._step
            learned = _learn(self.course.curvature, self._step, change)
            self.course = replace(self.course, curvature=learned)
        self._slope = gradient
        self._bent = bend
        groups = [rows, clearance_rows(local, x), local.rule_rows(x)]
        model = _Model(about, gradient / self._scale, self.course.curvature + bend)
        while self._reach > SHORTEST and self._ledger.remaining > 0:
            promise = self._solve(model, groups)
            if promise is None:
                self._reach *= SHORTER
                continue
            if promise[1] < self._tolerance:
                if not _breaks(self.course.look) or self._raised == RAISES:
                    return False
                self._prices = self._prices * 10.0
                self._raised += 1
                continue
            if self._try(promise) or self._correct(promise, groups, model):
                return True
            model = self._learn_from_failure(promise[0], model)
            self._shorten(promise, groups)
        return False

    def _learn_from_failure(self, step: Float[Array, " d"], model: _Model) -> _Model:
        """The cost bent as much along a failed step as it has turned out to be.

        About where power or speed changes its sign the cost is bent far more than elsewhere, and
        a step is only as long as its model is true. Time is not bent.
        """
        if self.course.local.timed or np.abs(step).max() > KINKED:
            return model
        rise = (self._failed.cost - self.course.look.cost) / self._scale
        seen = 2.0 * (rise - float(model.gradient @ step))
        bent = model.curvature @ step
        taken = float(step @ bent)
        if taken < 1e-16 or seen <= taken:
            return model
        more = (seen - taken) / taken**2
        return replace(model, curvature=model.curvature + more * np.outer(bent, bent))

    def _correct(self, promise: Step, groups: list[ConstraintRows], model: _Model) -> bool:
        """Whether a step pays that keeps the limits as they are where a failed one has led, too.

        The second-order correction: what bends a limit is seen from there to first order.
        """
        step = promise[0]
        course = self.course
        local = course.local
        failed = self._failed
        if failed.limits <= course.look.limits + KEPT or self._ledger.remaining == 0:
            return False
        there = local.gradient(local.linearise(course.x + step))[2]
        self._ledger.count(1)
        seen = ConstraintRows(there.matrix, there.room + there.matrix @ step)
        corrected = self._solve(model, [ConstraintRows.join([groups[0], seen]), *groups[1:]])
        if corrected is None:
            return False
        return self._try((corrected[0], promise[1]))

    def _solve(self, model: _Model, groups: list[ConstraintRows]) -> Step | None:
        """The best step within reach; limits that it would pass unwatched join the first group."""
        local = self.course.local
        bounds = self._bounds()
        for _ in range(WATCHED_ANEW):
            promise = solve_step(
                model.gradient, model.curvature, groups, self._prices, bounds, local.timed
            )
            if promise is None:
                return None
            passed = local.passed_limits(model.about, promise[0])
            if len(passed.room) == 0:
                break
            groups[0] = ConstraintRows.join([groups[0], passed])
        return promise

    def _bounds(self) -> Bounds:
        """How far the next step may go in each variable."""
        local = self.course.local
        x = self.course.x
        low, high = self._limits
        span = np.full(local.size, self._reach)
        if local.timed:
            span[-1] = min(self._reach, DURATION_REACH) * x[-1]
        return np.maximum(low - x, -span), np.minimum(high - x, span)

    def _try(self, promise: Step) -> bool:
        """Whether a step brings what it should; then it is taken.

        Args:
            promise: The step, and what it should bring.
        """
        now = self.course.look
        step, promised = promise
        x = self.course.x + step
        length = float(np.abs(step).max())
        look = self.course.local.look(x)
        self._ledger.count(1)
        brought = now.merit(self._prices, self._scale) - look.merit(self._prices, self._scale)
        share = brought / promised
        if share < LEAST:
            self._failed = look
            return False
        if share > GOOD:
            self._reach = min(2.0 * max(length, 0.5 * self._reach), LONGEST)
        self._step = step
        self.course = replace(self.course, x=x, look=look)
        return True

    def _shorten(self, promise: Step, groups: list[ConstraintRows]) -> None:
        """Makes the next step shorter than one that failed; what that hit joins the clearance."""
        step = promise[0]
        length = float(np.abs(step).max())
        shorter = SHORTER
        if self._failed.clearance > self.course.look.clearance + KEPT and length < NEARBY:
            hit = _hit(self.course.local, self.course.x, step)
            groups[1] = ConstraintRows.join([groups[1], hit])
            shorter = SHORTER_TAUGHT
        self._reach = shorter * min(self._reach, length)


def _hit(local: LocalModel, x: Float[Array, " d"], step: Float[Array, " d"]) -> ConstraintRows:
    """What a failed step hit, to first order about where it failed, as seen from before it.

    The distance of two boxes bends where another edge or face comes nearest, and a step that missed
    that knows it now.
    """
    hit = clearance_rows(local, x)
    missed = hit.room < 0.0
    return ConstraintRows(hit.matrix[missed], hit.room[missed] + hit.matrix[missed] @ step)


def _learn(
    curvature: Float[Array, "d d"], step: Float[Array, " d"], change: Float[Array, " d"]
) -> Float[Array, "d d"]:
    """BFGS with Powell's damping, so that the curvature stays positive."""
    bent = curvature @ step
    curved = float(step @ bent)
    seen = float(step @ change)
    if curved < 1e-16:
        return curvature
    if seen < 0.2 * curved:
        share = 0.8 * curved / (curved - seen)
        change = share * change + (1.0 - share) * bent
        seen = float(step @ change)
    forgotten = np.outer(bent, bent) / curved
    return curvature - forgotten + np.outer(change, change) / seen


def move_aside(course: Course, rng: np.random.Generator) -> Float[Array, " d"]:
    """Variables of a motion a part of which is moved aside, or comes earlier or later.

    Obstacles, and the modulus of power, part what motions cost into many basins that lie close to
    one another. A descent ends in the one where it began; one from beside its end may find the
    next.

    Args:
        course: Where a descent has ended.
        rng: Source of randomness.
    """
    local = course.local
    grid = local.grid
    free = slice(grid.held, -grid.held)
    bell = np.exp(-np.square((grid.places[free] - rng.uniform()) / rng.uniform(*BELL)))
    along = np.gradient(local.split(course.x)[0], axis=0)[free]
    aside = np.broadcast_to(rng.normal(size=local.n), along.shape)
    moved = bell[:, None] * (aside if rng.choice([True, False]) else along * np.sign(rng.normal()))
    low, high = np.log(ASIDE)
    moved *= np.exp(rng.uniform(low, high)) / max(float(np.abs(moved).max()), SHORTEST)
    x = course.x.copy()
    x[: moved.size] += moved.reshape(-1)
    lowest, highest = local.bounds
    return np.clip(x, lowest, highest)
