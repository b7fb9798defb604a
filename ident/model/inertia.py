"""Link inertias and which of their combinations act on the joint torques.

Only some combinations of the 10 n inertial numbers act on the joint torques: the base parameters. `nominal` keeps the
URDF's inertias; `base` fits the base parameters and changes the URDF's numbers as little as that needs; `consistent`
searches all numbers near the URDF's under the condition that every link could be a real body.

Source: Gautier 1991 (base parameters by QR).

Losses and link inertias as a convex program: what least squares leave, within what an arm can be.

    minimise ½ xᵀ A x − bᵀ x   with   xₖ ≥ 0  for losses,   P(π + S x) ⪰ 0  for every link

A and b are the normal equations of all runs, weights and priors in them; x the changes of the links' inertial numbers π
in units S, then the losses. P is a link's 4 × 4 pseudo-inertia, positive semidefinite for every body that can exist.
Solved by an interior-point method of our own (`interior_point`).

Source: Wensing, Kim and Slotine 2018, eq. 12 (pseudo-inertia).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr
from scipy.optimize import nnls

from ident.arrays import Array, Float, Int, freeze
from ident.model.interior_point import NO_BODIES, Bodies, Program, minimise
from ident.model.loss import InertiaFigure
from ident.robot.arm import ArmModel
from ident.robot.tolerance import PRIOR_SHARE as PRIOR_SHARE
from ident.robot.tolerance import parameter_scale as parameter_scale

PER_LINK = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
# Columns whose pivot is smaller than this share of the largest act on no joint torque.
RANK_TOLERANCE = 1e-9
STATES_FOR_RANK = 200


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Which combinations of inertial numbers act on the joint torques: β = B π."""

    columns: tuple[int, ...]  # indices of the r independent regressor columns
    mapping: Float[Array, "r 10n"]  # B, shape (r, 10n)
    names: tuple[str, ...]  # names of the independent columns, such as `link_2.mx`

    @property
    def rank(self) -> int:
        return len(self.columns)


@dataclass(frozen=True, eq=False)
class InertiaResults:
    """An arm's inertias as they were identified."""

    arm: ArmModel  # the arm with its identified inertias
    base: BaseParameters  # the base parameters
    change: Float[Array, " r"]  # change of the base parameters against the URDF, shape (r,)
    std: Float[Array, " r"]  # their standard deviations; the prior's where the data are silent
    # Share of each base parameter's prior variance that the data take away, 0 (silent) to 1.
    informed: Float[Array, " r"]
    condition_number: float  # of the column-scaled, whitened base regressor: over 100 is poor excitation

    def figures(self, reach: Float[Array, " r"]) -> tuple[InertiaFigure, ...]:
        """The base parameters one by one, `reach` being half the width of each one's interval."""
        values = self.base.mapping @ self.arm.inertial_parameters
        return tuple(
            InertiaFigure(name, float(value), float(value - half), float(value + half), float(informed))
            for name, value, half, informed in zip(self.base.names, values, reach, self.informed, strict=True)
        )


def base_parameters(arm: ArmModel) -> BaseParameters:
    """Base parameters of an arm's structure, from random states (fixed seed: the result is a property of the arm)."""
    rng = np.random.default_rng(0)
    q, dq, ddq = (rng.uniform(-np.pi, np.pi, (STATES_FOR_RANK, arm.n)) for _ in range(3))
    rows = arm.regressor(q, dq, ddq).reshape(-1, 10 * arm.n)
    factor, order = qr(rows, mode="r", pivoting=True)
    pivots = np.abs(np.diag(factor))
    rank = int(np.sum(pivots > RANK_TOLERANCE * pivots[0]))
    columns, others = order[:rank], order[rank:]
    mapping = np.zeros((rank, 10 * arm.n))
    mapping[:, columns] = np.eye(rank)
    mapping[:, others] = np.linalg.solve(factor[:rank, :rank], factor[:rank, rank : 10 * arm.n])
    names = tuple(f"{arm.links[i // 10]}.{PER_LINK[i % 10]}" for i in columns)
    return BaseParameters(tuple(int(i) for i in columns), freeze(mapping), names)


def lift_base(base: BaseParameters, scale: Float[Array, " 10n"]) -> Float[Array, "10n r"]:
    """Smallest change of the inertial numbers, in units of their scale, that changes the base parameters by one."""
    weighted = base.mapping * scale**2
    return weighted.T @ np.linalg.inv(weighted @ base.mapping.T)


def base_prior(base: BaseParameters, scale: Float[Array, " 10n"]) -> Float[Array, "r r"]:
    """Information on the base parameters that lies in trusting each inertial number to its scale."""
    return np.linalg.inv((base.mapping * scale**2) @ base.mapping.T)


def compute_condition(information: Array) -> float:
    """Condition number of the column-scaled regressor behind an information matrix."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values = np.linalg.eigvalsh(information / np.outer(size, size))
    if values[-1] <= 0.0:
        return float("inf")
    return float(np.sqrt(values[-1] / max(values[0], 1e-16 * values[-1])))


# Eigenvalues of a pseudo-inertia above minus this share of its trace count as not negative.
TOLERANCE = 1e-9
# Eigenvalues that bodies found here keep at least, in units of the link's mass and its size.
MARGIN = 1e-7
# Eigenvalues of the scaled normal equations below this share of the largest are rounding.
ROUNDING = 1e-13


def pseudo_inertia(link: Float[Array, "... 10"]) -> Float[Array, "... 4 4"]:
    """The matrix that is positive semidefinite for every body that can exist, of one link or of many.

    Args:
        link: m, m·c, and Ixx Ixy Iyy Ixz Iyz Izz about the joint frame [kg, kg m, kg m²].
    """
    mass, mx, my, mz, xx, xy, yy, xz, yz, zz = np.moveaxis(np.asarray(link, dtype=float), -1, 0)
    half = 0.5 * (xx + yy + zz)
    rows = [[half - xx, -xy, -xz, mx], [-xy, half - yy, -yz, my], [-xz, -yz, half - zz, mz], [mx, my, mz, mass]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def is_consistent(parameters: Float[Array, " 10n"]) -> bool:
    """Whether every link could be a real body."""
    matrices = pseudo_inertia(parameters.reshape(-1, 10))
    values = np.linalg.eigvalsh(matrices)[:, 0]
    sound = values >= -TOLERANCE * np.trace(matrices, axis1=1, axis2=2)
    return bool(np.all(sound & (matrices[:, 3, 3] > 0.0)))


def solve_bounded(
    information: Float[Array, "m m"],
    score: Float[Array, " m"],
    nonnegative: Sequence[int] | Int[Array, " b"],
    links: Float[Array, " 10n"] | None = None,
    scale: Float[Array, " 10n"] | None = None,
    free_links: Collection[int] = (),
) -> Float[Array, " m"]:
    """Minimises ½ xᵀ A x − bᵀ x within bounds.

    Args:
        information, score: A, positive semidefinite, and b.
        nonnegative: Positions of unknowns that may not be negative.
        links: Inertial numbers π, if the first 10 n unknowns are changes of them.
        scale: What a unit of each of these unknowns is; one if None.
        free_links: Links that need be no body.

    Raises:
        ArithmeticError: The solver found no solution.
    """
    # In units of what the data know of each unknown.
    size = np.sqrt(np.maximum(np.diag(information), ROUNDING * np.diag(information).max(initial=1e-300)))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    kept = np.maximum(values, ROUNDING * values.max())
    scaled, right = (vectors * kept) @ vectors.T, score / size
    free = vectors @ ((vectors.T @ right) / kept)
    positive = np.asarray(nonnegative, dtype=int)
    bodies = NO_BODIES if links is None else _bodies(links, scale, free_links, size)
    found = minimise(Program(scaled, right, positive, bodies), free) / size
    found[positive] = np.maximum(found[positive], 0.0)
    return found


def _bodies(
    links: Float[Array, " 10n"],
    scale: Float[Array, " 10n"] | None,
    free_links: Collection[int],
    size: Float[Array, " m"],
) -> Bodies:
    """Pseudo-inertias of the links as functions of the scaled unknowns, in units of each link's mass and size."""
    steps = np.ones(len(links)) if scale is None else np.asarray(scale)
    unit = pseudo_inertia(np.eye(10))
    constant, slopes, unknowns = [], [], []
    for link in range(len(links) // 10):
        if link in free_links:
            continue
        own = np.arange(10 * link, 10 * link + 10)
        mass, moment = max(steps[own[0]], 1e-12), max(steps[own[4]], 1e-12)
        frame = 1.0 / np.sqrt([moment, moment, moment, mass])
        units = np.outer(frame, frame)
        constant.append(units * pseudo_inertia(links[own]) - MARGIN * np.eye(4))
        slopes.append(units * unit * (steps[own] / size[own])[:, None, None])
        unknowns.append(own)
    if not constant:
        return NO_BODIES
    return Bodies(np.array(constant), np.array(slopes), np.array(unknowns))


def solve_partly_non_negative(sums: Float[Array, "k+1 k+1"], bounded: Iterable[int]) -> Float[Array, " k"]:
    """Least squares of which some unknowns can't be negative: the free ones are eliminated, the rest is bounded.

    The same as `solve_bounded` without links, in a part of its time: for arms that are tuned again and again.

    Args:
        sums: Sums of squares and products of the unknowns' columns and, last, of what they are to be.
        bounded: Positions of the unknowns that can't be negative.
    """
    power = np.diag(sums)
    seen = np.flatnonzero(power[:-1] > 0.0)  # an unknown without rows, as of a joint at rest, stays zero
    kept = np.intersect1d(seen, np.array(list(bounded), dtype=int))
    free = np.setdiff1d(seen, kept)
    scale = np.sqrt(np.where(power > 0.0, power, 1.0))
    values, vectors = np.linalg.eigh(sums / np.outer(scale, scale))
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T  # rootᵀ root: the scaled sums
    triangle = np.asarray(np.linalg.qr(root[:, [*free, *kept, -1]], mode="r"))
    count = len(free)
    found = np.zeros(len(sums) - 1)
    if triangle[count:, count:-1].size:  # SciPy's routine spoils memory where there is nothing to solve
        found[kept], _ = nnls(triangle[count:, count:-1], triangle[count:, -1])
    left = triangle[:count, -1] - triangle[:count, count:-1] @ found[kept]
    found[free] = np.linalg.lstsq(triangle[:count, :count], left, rcond=None)[0]
    return found * scale[-1] / scale[:-1]
