"""Clearance of one trajectory where pairs of shapes come near, and its slopes by the variables."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float, Int
from plan.planners.subproblem import ConstraintRows
from plan.planners.task_on_grid import TaskOnGrid
from plan.planners.velocity_reversals import find_dips
from plan.problem.problem import PlanningProblem

# Pairs closer than this are watched [m].
NEAR = 0.06
# At most so many of their places are watched at a time, the nearest ones.
MOST_NEAR = 90
# Places along a motion at which all pairs are looked at.
PLACES = 64
# Where a gap dips to within so much of the margin [m], it is looked at more closely, and once more
# in the same way: past an edge a gap falls and rises by half a millimetre within a five-hundredth
# of a motion.
CLOSE = (0.03, 0.005)
# Places to either side of a dip at which it is looked at more closely.
CLOSER = 8
# Unit of the clearance's shortfall [m].
CLEARANCE_UNIT = 0.1
# Clearance asked for beyond the margin, for what happens between the watched places [m].
EXTRA = 5e-4

Dips = tuple[Float[Array, " m"], Int[Array, " m"], Float[Array, " m"]]
"""Places as shares of the duration, pairs, and their gaps beyond the margin there [m]."""


def clearance_shortfall(
    task: TaskOnGrid, coefficients: Float[Array, "C n"], duration: float
) -> float:
    """By how much a trajectory comes too near to anything, in units of 10 cm; zero if it does not.

    Args:
        task: The task on its grid.
        coefficients: All of the B-spline [rad].
        duration: Of the trajectory [s].
    """
    scene = task.problem.scene
    if len(scene.pairs) == 0:
        return 0.0
    splines = task.grid.splines(coefficients, duration)
    left = float(scene.sweep(splines, task.problem.margins)[0][0])
    return max(0.5 * _extra(task.problem) - left, 0.0) / CLEARANCE_UNIT


def clearance_rows(task: TaskOnGrid, x: Float[Array, " d"]) -> ConstraintRows:
    """Clearance of the nearest pairs at the watched places, to first order.

    Args:
        task: The task on its grid.
        x: Its variables.
    """
    scene = task.problem.scene
    if len(scene.pairs) == 0:
        return ConstraintRows.none(task.size)
    coefficients = task.split(x)[0]
    even = (np.arange(PLACES) + 0.5) / PLACES
    dips = find_dips(even, _gaps(task, coefficients, even), NEAR)
    if len(dips[0]) == 0:
        return ConstraintRows.none(task.size)
    shares, pairs, gaps = _nearest(task, coefficients, dips)
    q = task.grid.positions(coefficients, shares)
    slopes = scene.gradients(q, pairs)
    still = np.zeros_like(slopes)
    bases, first = task.grid.at(shares)
    matrix = task.rows_at(bases, first, [-slopes / CLEARANCE_UNIT, still, still])
    # Half of what is asked for beyond the margin is let pass by `clearance_shortfall`: were it
    # wanted back here, a step would promise what it can't bring.
    extra = _extra(task.problem)
    room = np.maximum(gaps - extra, np.minimum(gaps - 0.5 * extra, 0.0))
    return ConstraintRows(matrix, room / CLEARANCE_UNIT)


def _extra(problem: PlanningProblem) -> float:
    """Clearance asked for beyond the margin [m]."""
    return EXTRA if problem.limits.clearance > 0 else 0.0


def _gaps(
    task: TaskOnGrid,
    coefficients: Float[Array, "C n"],
    shares: Float[Array, " m"],
    wanted: Array | None = None,
) -> Float[Array, "m P"]:
    """What pairs keep beyond their margins at some places, all of them or those wanted [m]."""
    far = task.problem.limits.clearance + NEAR
    q = task.grid.positions(coefficients, shares)
    return task.problem.scene.gaps(q, far, wanted) - task.problem.margins


def _nearest(task: TaskOnGrid, coefficients: Float[Array, "C n"], dips: Dips) -> Dips:
    """Dips looked at ever more closely, and of all of these the nearest, in order of place."""
    # Between two places the arm moves by centimetres: a dip's bottom has to be watched.
    pair_count = len(task.problem.scene.pairs)
    watched = [dips]
    spacing = 1.0 / PLACES
    for close in CLOSE:
        shares, pairs, gaps = watched[-1]
        deep = np.flatnonzero(gaps < close)
        if len(deep) == 0:
            break
        nearby = spacing * np.arange(-CLOSER, CLOSER + 1) / CLOSER
        windows = np.clip(shares[deep][:, None] + nearby, 0.0, 1.0)
        windows = np.round(windows, 12)
        closer, place = np.unique(windows, return_inverse=True)
        wanted = np.zeros((len(closer), pair_count), dtype=bool)
        wanted[place.reshape(windows.shape), pairs[deep][:, None]] = True
        watched.append(find_dips(closer, _gaps(task, coefficients, closer, wanted), NEAR))
        spacing /= CLOSER
    shares, pairs, gaps = (np.concatenate(each) for each in zip(*watched, strict=True))
    order = np.argsort(gaps)[:MOST_NEAR]
    order = order[np.argsort(shares[order])]  # pairs at one place share the arm's position
    return shares[order], pairs[order], gaps[order]
