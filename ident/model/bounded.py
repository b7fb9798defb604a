"""Least squares of which some unknowns can't be negative, by an interior-point solver.

    minimise Σ |Aᵢ x − bᵢ|²  subject to xₖ ≥ 0 for some k

The program that CVXPY would write for it, number by number, without CVXPY: that takes a second of processor time to
load, its solver some milliseconds. What rows leave is an unknown of its own, yᵢ = Aᵢ x − bᵢ: unknowns are y, then x.

Source: Goulart and Chen 2024 (Clarabel).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float


def solve_bounded(
    tables: Sequence[tuple[Float[Array, "T k"], Float[Array, " T"]]], bounded: Sequence[int]
) -> Float[Array, " k"]:
    """The unknowns that leave least of all tables' rows.

    Args:
        tables: Rows Aᵢ and what they are to be, bᵢ; all in the same k unknowns.
        bounded: Which unknowns can't be negative.

    Raises:
        ArithmeticError: The solver found no solution.
    """
    import clarabel  # both are for those who solve something
    from scipy.sparse import csc_array

    rows, target = np.concatenate([table for table, _ in tables]), np.concatenate([goal for _, goal in tables])
    count, unknowns = rows.shape
    squares = csc_array(np.diag(np.repeat([2.0, 0.0], [count, unknowns])))
    held = np.zeros((len(bounded), unknowns))
    held[np.arange(len(bounded)), list(bounded)] = -1.0
    equations = csc_array(np.block([[-np.eye(count), rows], [np.zeros((len(bounded), count)), held]]))
    right = np.concatenate([target, np.zeros(len(bounded))])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.ZeroConeT(count), clarabel.NonnegativeConeT(len(bounded))]
    solver = clarabel.DefaultSolver(squares, np.zeros(count + unknowns), equations, right, cones, settings)
    found = solver.solve()
    if str(found.status) not in ("Solved", "AlmostSolved"):
        raise ArithmeticError(f"least squares of {unknowns} unknowns with bounds: {found.status}")
    return np.array(found.x[count:])
