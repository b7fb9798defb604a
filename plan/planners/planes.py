"""Separating planes between boxes along a trajectory: the reference planner's clearance constraints."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from plan.geometry.boxes import Box
from plan.planners.reference_graph import slot_size
from plan.problem.problem import PlanningProblem
from plan.spline import Splines

# Local times of a section at which clearance is watched.
WATCHED = np.linspace(0.0, 1.0, 17)[1:]
# Pairs closer than this are given a plane [m].
NEAR = 0.08


def count_near(problem: PlanningProblem, splines: Splines) -> int:
    """Number of watched places and pairs that come near each other."""
    q = splines.states(WATCHED)[0][0]
    return int((problem.scene.gaps(q[:-1]) < NEAR).sum())


def make_slots(problem: PlanningProblem, splines: Splines, count: int, extra: float) -> Float[Array, "m count"]:
    """Parameters of the clearance constraints for the closest places of a trajectory.

    At each of them the plane's normal is the one between the nearest points (the deepest, under penetration), so
    the constraint is tight where the trajectory is now. Solving and choosing the planes anew by turns can't make
    a trajectory worse, and comes to rest only where the exact problem is stationary.

    Args:
        problem: Task and scene.
        splines: The trajectory now.
        count: Room for constraints; places beyond it, farther away, are left out.
        extra: Clearance to keep beyond each pair's margin [m].
    """
    n, vias = problem.n, problem.via_count
    out = np.zeros((slot_size(n, vias), count))
    _switch_off(out, vias)
    q = splines.states(WATCHED)[0][0]
    margins = problem.margins.pairs
    gaps = problem.scene.gaps(q) - margins
    gaps[-1] = np.inf  # the goal itself can't be moved
    order = np.argsort(gaps, axis=None)[:count]
    for slot, (place, pair) in enumerate(zip(*np.unravel_index(order, gaps.shape), strict=True)):
        if gaps[place, pair] > 2 * NEAR:
            break
        section, step = divmod(int(place), len(WATCHED))
        normal, boxes = problem.scene.tight(q[place], int(pair))
        out[:, slot] = _slot(problem, section, WATCHED[step], normal, extra + margins[pair], boxes)
    return out


def _switch_off(slots: Float[Array, "m count"], vias: int) -> None:
    slots[0] = 1.0
    slots[vias + 5] = -10.0  # a margin that nothing breaks


def _slot(
    problem: PlanningProblem, section: int, s: float, normal: Array, margin: float, boxes: list[Box]
) -> Float[Array, " m"]:
    which = np.eye(problem.via_count + 1)[section]
    carriers = [
        np.concatenate([np.eye(problem.n + 1)[box.joint], box.rotation.T.reshape(-1), box.centre, box.half])
        for box in boxes
    ]
    return np.concatenate([which, [s], normal, [margin], *carriers])
