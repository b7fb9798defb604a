"""Sequential quadratic programming from one trajectory: exact slopes, a learned curvature, steps that must pay."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float, Int
from plan.planners.base import Ledger
from plan.planners.local_model import LocalModel, Look
from plan.planners.subproblem import ConstraintRows, solve_step
from plan.planners.transcription import DEGREE

# Price of the largest excess over a limit (a share of it), of the clearance's shortfall (10 cm) and of the excess over
# a rule of the way, as shares of the cost; raised tenfold, so many times at most, where something stays broken.
PRICES, RAISES = (4.0, 20.0, 20.0), 3
# A step must bring this share of what was promised; one that brings the larger share may be longer next time.
LEAST, GOOD = 0.05, 0.5
# Shortest step worth another try [rad].
SHORTEST = 1e-5
# A failed step shorter than this teaches the next one what it hit [rad].
NEARBY = 0.1
# Curvature given to the time objective, whose own is nought: keeps coefficients that don't matter where they are.
CALM = 2e-3
# Length of the step by which curvature is measured [rad], and the factors that are believed.
PROBE, STIFFEST = 0.01, (1e-3, 1e2)
# What counts as kept: of a limit as a share of it (half of what the search aims lower than the ledger asks for), of the
# clearance as a share of 10 cm, of a rule of the way in its unit. A quarter of a millimetre more than the margin is
# asked for, and of a rule a tenth more.
KEPT, KEPT_CLEAR, KEPT_RULE = 5e-5, 1e-3, 2e-4
# Local times of a section's ends.
ENDS = np.array([0.0, 1.0])
# Sections of a finer grid for each of the one before, for energy and for time: where sections are
# shorter only where limits switch, fewer do better (`bench_plan_grids.py`).
FINER = (2.0, 1.5)
# Share of a finer grid's sections that go by length, and the shortest one, as a share of the
# duration.
EVENLY, NARROWEST = 0.5, 0.002
# Share of a limit from which it binds.
BINDS = 0.95


@dataclass(frozen=True, eq=False)
class Course:
    """Where a descent has come to."""

    local: LocalModel  # task and grid
    x: Float[Array, " d"]  # variables
    look: Look  # what the trajectory costs and breaks
    curvature: Float[Array, "d d"]  # learned second derivative of the scaled cost

    @property
    def kept(self) -> bool:
        """Whether all limits hold as far as the search looks."""
        return not _breaks(self.look)

    @property
    def rank(self) -> tuple[bool, float]:
        """Allowed before not allowed, then by what is broken or by cost."""
        return (not self.kept, self.look.cost if self.kept else self.look.broken)


def _breaks(look: Look) -> bool:
    return look.limits > KEPT or look.clearance > KEPT_CLEAR or look.rules > KEPT_RULE


def begin(local: LocalModel, x: Float[Array, " d"]) -> Course:
    """A course before its first step."""
    look, curvature = local.look(x), first_curvature(local)
    if local.timed:
        return Course(local, x, look, curvature)
    # How much more the cost is bent than that, along a short way downhill.
    scale = max(abs(look.cost), 1e-9)
    gradient, bend = (part / scale for part in local.gradient(x)[:2])
    step = -np.linalg.solve(curvature + bend + 1e-9 * np.eye(len(x)), gradient)
    length = float(np.abs(step).max())
    if length < 1e-12:
        return Course(local, x, look, curvature)
    step *= PROBE / length
    change = local.gradient(x + step)[0] / scale - gradient - bend @ step
    return Course(local, x, look, curvature * float(np.clip((change @ step) / (step @ curvature @ step), *STIFFEST)))


def first_curvature(local: LocalModel) -> Float[Array, "d d"]:
    """A second derivative to begin with: what smoothness asks for, ∫ (dq/ds)² ds."""
    grid = local.grid
    weights = (np.diff(grid.knots)[:, None] * local.weights).reshape(-1)
    design = np.zeros((len(weights), grid.sections + DEGREE))
    design[np.arange(len(weights))[:, None], grid.first[:, None] + np.arange(DEGREE + 1)] = grid.bases[1]
    gram = (design.T @ (weights[:, None] * design))[grid.held : -grid.held, grid.held : -grid.held]
    smooth = np.kron(gram, np.eye(local.n))
    if not local.timed:
        return smooth
    calm = np.diag(np.full(local.size, 1e-4))
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
    local, x, now, curvature = course.local, course.x, course.look, course.curvature
    low, high = local.bounds
    scale = max(abs(now.cost), 1e-9)
    prices, raised = np.array(PRICES), 0
    slope: Array | None = None
    bent = np.zeros_like(curvature)
    taken = np.zeros(0)
    for _ in range(steps):
        if ledger.remaining == 0:
            break
        gradient, bend, rows = local.gradient(x)
        bend = bend / scale
        ledger.count(1)
        if slope is not None and not local.timed:
            curvature = _learn(curvature, taken, (gradient - slope) / scale - 0.5 * (bent + bend) @ taken)
        slope, bent = gradient, bend
        clear, ruled = local.clearance_rows(x), local.rule_rows(x)
        taken = np.zeros(0)
        while reach > SHORTEST and ledger.remaining > 0:
            span = np.full(local.size, reach)
            if local.timed:
                span[-1] = min(reach, 0.2) * x[-1]
            bounds = np.maximum(low - x, -span), np.minimum(high - x, span)
            groups = [rows, clear, ruled]
            found = solve_step(gradient / scale, curvature + bend, groups, prices, bounds, local.timed)
            if found is None:
                reach *= 0.3
                continue
            step, promised = found
            if promised < tolerance:
                if _breaks(now) and raised < RAISES:
                    prices, raised = prices * 10.0, raised + 1
                    continue
                return Course(local, x, now, curvature)
            new = local.look(x + step)
            ledger.count(1)
            share = (now.merit(prices, scale) - new.merit(prices, scale)) / promised
            if share > GOOD:
                reach = min(2.0 * max(float(np.abs(step).max()), 0.5 * reach), 1.0)
            elif share < LEAST:
                length = float(np.abs(step).max())
                learned = new.clearance > now.clearance + KEPT and length < NEARBY
                if learned:
                    # To first order about where the step failed, as seen from before it: the distance of two boxes
                    # bends where another edge or face comes nearest, and a step that missed that knows it now.
                    hit = local.clearance_rows(x + step)
                    missed = hit.room < 0.0
                    seen = ConstraintRows(hit.matrix[missed], hit.room[missed] + hit.matrix[missed] @ step)
                    clear = ConstraintRows.join([clear, seen])
                reach = (0.6 if learned else 0.3) * min(reach, length)
                continue
            x, now, taken = x + step, new, step
            break
        if len(taken) == 0:
            break
    return Course(local, x, now, curvature)


def _learn(curvature: Float[Array, "d d"], step: Float[Array, " d"], change: Float[Array, " d"]) -> Float[Array, "d d"]:
    """BFGS with Powell's damping, so that the curvature stays positive."""
    bent = curvature @ step
    curved, seen = float(step @ bent), float(step @ change)
    if curved < 1e-16:
        return curvature
    if seen < 0.2 * curved:
        share = 0.8 * curved / (curved - seen)
        change = share * change + (1.0 - share) * bent
        seen = float(step @ change)
    return curvature - np.outer(bent, bent) / curved + np.outer(change, change) / seen


def count_finer(local: LocalModel) -> int:
    """Sections of the next finer grid."""
    return round(FINER[local.timed] * local.grid.sections)


def refine(course: Course, width: float, power: float, nodes: tuple[Array, Array]) -> Course:
    """The same trajectory on a finer grid, with its own rounding of sign and power, and nodes."""
    local, (coefficients, duration) = course.local, course.local.split(course.x)
    parts = choose_parts(course)
    grid = replace(local.grid.parted(parts), nodes=nodes[0])
    aims = np.repeat(local.torque_aim, parts, axis=0)
    finer = replace(local, grid=grid, weights=nodes[1], width=width, power=power, torque_aim=aims)
    x = finer.join(grid.fit(local.grid.splines(coefficients, duration)), duration)
    return begin(finer, x)


def choose_parts(course: Course) -> Int[Array, " K"]:
    """Into how many parts each section goes, `count_finer` together.

    For energy every section goes in two. The quickest motions switch from one limit to another: a
    section in which acceleration or torque changes by much holds what is to be gained, so half of
    the parts are shared out by that change, as a share of the limits, the others by length. A joint
    counts by how much of the time it is at its limit: others could switch elsewhere as well.
    """
    local = course.local
    sections = local.grid.sections
    if not local.timed:
        return np.full(sections, 2)
    q, dq, ddq = local.splines(course.x).states(ENDS)
    limits = local.problem.limits
    used = local.problem.model.torque(q, dq, ddq)[0] / limits.torque
    if limits.acceleration is not None:
        used = np.concatenate([used, ddq[0] / limits.acceleration], axis=1)
    used = used.reshape(sections, len(ENDS), -1)
    binding = (np.abs(used) > BINDS).mean(axis=(0, 1)) ** 2
    change = np.abs(used[:, 1] - used[:, 0]) @ binding
    widths = np.diff(local.grid.knots)
    wanted = EVENLY * widths + (1.0 - EVENLY) * change / max(change.sum(), 1e-12)
    parts = np.ones(sections, dtype=int)
    for _ in range(count_finer(local) - sections):
        room = widths / (parts + 1) >= NARROWEST
        parts[int(np.argmax(np.where(room, wanted / parts, 0.0)))] += 1
    return parts
