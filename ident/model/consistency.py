"""Inertial numbers that a real arm could have: the nearest ones in the sense of the data.

Every link must be a body that can exist: its 4 × 4 pseudo-inertia is positive semidefinite. Rotor inertia and friction
are not negative. Given normal equations that is a small convex program; where its own search finds no end, Clarabel
solves it.

Source: Wensing, Kim and Slotine 2018, eq. 12 (pseudo-inertia).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.model.barrier import PseudoInertias, minimise

# Row and column of each entry of a symmetric 4 × 4 matrix, in the order of Clarabel's triangles.
TRIANGLE = [(row, column) for column in range(4) for row in range(column + 1)]
# Eigenvalues of a pseudo-inertia above minus this share of its trace count as not negative.
TOLERANCE = 1e-9


def pseudo_inertia(link: Float[Array, "... 10"]) -> Float[Array, "... 4 4"]:
    """The matrix that is positive semidefinite for every body that can exist, of one link or of many."""
    mass, mx, my, mz, xx, xy, yy, xz, yz, zz = np.moveaxis(np.asarray(link, dtype=float), -1, 0)
    half = 0.5 * (xx + yy + zz)
    rows = [[half - xx, -xy, -xz, mx], [-xy, half - yy, -yz, my], [-xz, -yz, half - zz, mz], [mx, my, mz, mass]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def is_consistent(parameters: Float[Array, " 10n"]) -> bool:
    """Whether every link could be a real body."""
    matrices = pseudo_inertia(parameters.reshape(-1, 10))
    values = np.linalg.eigvalsh(matrices)[:, 0]
    return bool(np.all(values >= -TOLERANCE * np.trace(matrices, axis1=1, axis2=2)))


def solve_bounded(
    information: Float[Array, "m m"],
    score: Float[Array, " m"],
    bounded: Array,
    links: Float[Array, " 10n"] | None = None,
    scale: Float[Array, " 10n"] | None = None,
) -> Float[Array, " m"]:
    """Minimises ½ xᵀ A x − bᵀ x with bounds.

    Args:
        information, score: A and b.
        bounded: Positions of unknowns that may not be negative.
        links: Inertial numbers before any change, if the first 10 n unknowns are changes of them.
        scale: What a unit of each of these unknowns is.

    Raises:
        ArithmeticError: The solver found no solution.
    """
    inside = _without_bounds(information, score)
    if inside is not None and np.all(inside[bounded] >= 0.0):
        bodies = None if links is None else links + (1.0 if scale is None else scale) * inside[: len(links)]
        if bodies is None or is_consistent(bodies):
            return inside
    if inside is not None:
        found = minimise(information, score, inside, bounded, None if links is None else _bodies(links, scale))
        if found is not None:
            return found
    return _solve_in_general(information, score, bounded, links, scale)


def _bodies(links: Float[Array, " 10n"], scale: Float[Array, " 10n"] | None) -> PseudoInertias:
    steps = (np.ones(len(links)) if scale is None else scale).reshape(-1, 10)
    return PseudoInertias(pseudo_inertia(links.reshape(-1, 10)), steps[:, :, None, None] * pseudo_inertia(np.eye(10)))


def _solve_in_general(
    information: Float[Array, "m m"],
    score: Float[Array, " m"],
    bounded: Array,
    links: Float[Array, " 10n"] | None,
    scale: Float[Array, " 10n"] | None,
) -> Float[Array, " m"]:
    """The same by a general solver, for what the data leave open.

    Raises:
        ArithmeticError: It found no solution.
    """
    import clarabel  # slow to load: with it come SciPy's LAPACK bindings

    size = len(score)
    rows, right = np.zeros((len(bounded), size)), np.zeros(len(bounded))
    rows[np.arange(len(bounded)), bounded] = -1.0
    cones: list[object] = [clarabel.NonnegativeConeT(len(bounded))] if len(bounded) else []
    if links is not None:
        steps = np.ones(len(links)) if scale is None else scale
        bodies, start = _body_rows(links, steps)
        rows = np.concatenate([rows, np.pad(-bodies, ((0, 0), (0, size - len(links))))])
        right = np.concatenate([right, start])
        cones += [clarabel.PSDTriangleConeT(4) for _ in range(len(links) // 10)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    weight = float(np.max(np.diag(information)))
    quadratic = _Sparse.of(np.triu(information / weight))
    solver = clarabel.DefaultSolver(quadratic, -score / weight, _Sparse.of(rows), right, cones, settings)
    found = solver.solve()
    if not np.all(np.isfinite(found.x)) or "Solved" not in str(found.status):
        raise ArithmeticError(f"no consistent figures were found ({found.status})")
    return np.asarray(found.x)


def _without_bounds(information: Float[Array, "m m"], score: Float[Array, " m"]) -> Float[Array, " m"] | None:
    """The minimum where nothing bounds it; None where the data leave it open."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    try:
        root = np.linalg.cholesky(information / np.outer(size, size))
    except np.linalg.LinAlgError:
        return None
    return np.asarray(np.linalg.solve(root.T, np.linalg.solve(root, score / size)) / size)


@dataclass(frozen=True, eq=False)
class _Sparse:
    """A matrix by its columns, as far as Clarabel asks for one of SciPy's: loading those costs more than solving."""

    data: Array
    indices: Array
    indptr: Array
    shape: tuple[int, int]
    has_canonical_format: bool = True

    @classmethod
    def of(cls, full: Float[Array, "r c"]) -> _Sparse:
        column, row = np.nonzero(full.T)
        ends = np.concatenate([[0], np.cumsum(np.bincount(column, minlength=full.shape[1]))])
        return cls(full[row, column], row, ends, (full.shape[0], full.shape[1]))

    @property
    def nnz(self) -> int:
        return len(self.data)


def nearest_consistent(parameters: Float[Array, " 10n"], scale: Float[Array, " 10n"]) -> Float[Array, " 10n"]:
    """The nearest inertial numbers that a real arm could have, distances in units of `scale`."""
    if is_consistent(parameters):
        return parameters
    size = len(parameters)
    change = _solve_in_general(np.eye(size), np.zeros(size), np.arange(0), parameters, scale)
    return np.asarray(parameters + scale * change)


def _body_rows(links: Float[Array, " 10n"], scale: Float[Array, " 10n"]) -> tuple[Array, Array]:
    """Each link's pseudo-inertia as a scaled triangle: rows for unit changes, and the values before any change."""
    count = len(links) // 10
    unit = pseudo_inertia(np.eye(10))
    root = np.array([1.0 if row == column else np.sqrt(2.0) for row, column in TRIANGLE])
    shape = root[:, None] * np.array([unit[:, row, column] for row, column in TRIANGLE])
    rows, start = np.zeros((10 * count, 10 * count)), np.zeros(10 * count)
    for i in range(count):
        part = slice(10 * i, 10 * i + 10)
        rows[part, part] = shape * scale[part]
        start[part] = shape @ links[part]
    return rows, start
