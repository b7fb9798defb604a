"""Finer grids: into how many parts a course's sections go, and the same trajectory on these."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float, Int
from plan.planners.descent import Course, begin
from plan.planners.local_model import LocalModel

# Sections below which for energy all go in two: so few hold nothing that tells where more are due.
FEW = 12
# Sections of a finer grid for each of the one before: where sections are shorter only where limits
# switch, or the motion bends, fewer do better (`bench_plan_grids.py`).
FINER = 1.5
# Share of a finer grid's sections that go by length, for energy and for time.
EVENLY = (0.1, 0.5)
# The shortest of them, as a share of the duration.
NARROWEST = 0.002
# Share of a limit from which it binds.
BINDS = 0.95
# Local times of a section's ends.
ENDS = np.array([0.0, 1.0])
# Power of its width by which what a section misses of a smooth acceleration falls, as a square.
SMOOTH = 4


def count_finer(local: LocalModel) -> int:
    """Sections of the next finer grid."""
    sections = local.grid.sections
    if not local.timed and sections < FEW:
        return 2 * sections
    return round(FINER * sections)


def refine(course: Course, width: float, power: float, nodes: tuple[Array, Array]) -> Course:
    """A course of the same trajectory on a finer grid, before its first step.

    Args:
        course: Where the coarser search ended.
        width: Over which the sign of friction is rounded from now on [rad/s].
        power: Over which the modulus of power is rounded from now on [W].
        nodes: Places in each section as shares of it, and their quadrature weights.
    """
    local = course.local
    coefficients, duration = local.split(course.x)
    parts = choose_parts(course)
    grid = replace(local.grid.parted(parts), nodes=nodes[0])
    aims = np.repeat(local.torque_aim, parts, axis=0)
    finer = replace(local, grid=grid, weights=nodes[1], width=width, power=power, torque_aim=aims)
    free = grid.fit(local.grid.splines(coefficients, duration))
    return begin(finer, finer.join(free, duration))


def choose_parts(course: Course) -> Int[Array, " K"]:
    """Into how many parts each section goes, `count_finer` together where there is room for them.

    One after the other goes into one part more, the one that misses most. None is cut below the
    narrowest, or a controller's step.
    """
    local = course.local
    grid = local.grid
    widths = np.diff(grid.knots)
    most = np.maximum(widths / NARROWEST, 1.0)
    if grid.steps is not None:
        most = np.minimum(most, np.round(widths * grid.steps))
    missed = _missed_switches(course) if local.timed else _missed_bends(course)
    power = 1 if local.timed else SMOOTH
    parts = np.ones(grid.sections, dtype=int)
    for _ in range(count_finer(local) - grid.sections):
        gains = np.where(parts + 1 <= most, missed / parts**power, 0.0)
        if gains.max() <= 0.0:
            break
        parts[int(np.argmax(gains))] += 1
    return parts


def _missed_switches(course: Course) -> Float[Array, " K"]:
    """How much of what is to be gained for time each section holds.

    The quickest motions switch from one limit to another: half of the parts are shared out by how
    much acceleration or torque changes in a section, as a share of the limits, the others by
    length. A joint counts by how much of the time it is at its limit: others could switch elsewhere
    as well.
    """
    local = course.local
    q, dq, ddq = local.splines(course.x).states(ENDS)
    limits = local.problem.limits
    used = local.problem.model.torque(q, dq, ddq)[0] / limits.torque
    if limits.acceleration is not None:
        used = np.concatenate([used, ddq[0] / limits.acceleration], axis=1)
    used = used.reshape(local.grid.sections, len(ENDS), -1)
    binding = (np.abs(used) > BINDS).mean(axis=(0, 1)) ** 2
    change = np.abs(used[:, 1] - used[:, 0]) @ binding
    evenly = EVENLY[True]
    by_change = (1.0 - evenly) * change / max(change.sum(), 1e-12)
    return np.asarray(evenly * np.diff(local.grid.knots) + by_change)


def _missed_bends(course: Course) -> Float[Array, " K"]:
    """What each section misses of the motion of least energy, about.

    A cubic's acceleration is a line in each section. By how much the slopes of these jump at a knot
    tells how the best acceleration bends there: of that a section of width h misses h² times the
    jump over h, in torque M times it, and of the squares an integral ∝ h³ |M Δ|². A share goes by
    length alone, as a motion of which every section misses as much.
    """
    local = course.local
    grid = local.grid
    coefficients, duration = local.split(course.x)
    widths = np.diff(grid.knots)
    jumps = np.diff(grid.jerk(coefficients, duration), axis=0)
    q = grid.positions(coefficients, grid.knots[1:-1])[None]
    still = np.zeros_like(q)
    model = local.problem.model
    pushed = model.torque(q, still, jumps[None])[0] - model.torque(q, still, still)[0]
    at_knots = np.square(pushed).sum(axis=1)
    missed = widths**3 * (np.append(at_knots, at_knots[-1]) + np.append(at_knots[0], at_knots))
    evenly = EVENLY[False]
    by_length = missed.mean() * (widths * grid.sections) ** (SMOOTH + 1)
    return np.asarray(evenly * by_length + (1.0 - evenly) * missed)
