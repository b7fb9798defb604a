"""A quadratic function of an arm's figures, least where bodies stay bodies and figures that can't be negative aren't.

Minimises ½ xᵀ A x − bᵀ x over unknowns of which some may not be negative and others change the 4 × 4 matrices of links
that have to stay positive semidefinite, by Newton's method on the function less μ times the logarithms of all that has
to stay positive, μ falling. A general solver needs SciPy's linear algebra, whose loading alone costs a fifth of a
second of processor time; this one takes some ten milliseconds for an arm of six joints.

Source: Boyd and Vandenberghe, Convex Optimization, 2004, chapter 11 (barrier method; gap of ν μ).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, Int

# Largest distance of the function from its least value at which the search ends; of a log likelihood: nothing.
GAP = 1e-8
# What μ begins with, as a share of what the bounds cost at the start; and by how much it falls from one μ to the next.
FIRST_SHARE, FALL = 0.1, 0.01
# Newton's steps at one μ end when half of the decrement is below this share of ν μ (with a tenth the search strays to
# the boundary and stays there); arms need 60 to 90 steps in all, and after so many the search has failed.
CENTRED, MOST_STEPS = 1e-3, 200
# Share of the way to the boundary that a step may go, and by how much too long a step is shortened.
INSIDE, SHORTER, SUFFICIENT = 0.98, 0.5, 1e-4
# How far inside the bounds the search begins, in standard deviations of a figure and in shares of a body's own size.
FIRST_FIGURE, FIRST_BODY = 0.1, 0.01


@dataclass(frozen=True, eq=False)
class PseudoInertias:
    """Links whose matrices have to stay positive semidefinite: P_i = start_i + Σ_k x_(K i + k) shape_ik.

    Attributes:
        start: Matrices before any change, shape (n, 4, 4).
        shape: What a unit of each of a link's K unknowns changes, shape (n, K, 4, 4).
    """

    start: Float[Array, "n 4 4"]
    shape: Float[Array, "n K 4 4"]

    def at(self, x: Float[Array, " m"]) -> Float[Array, "n 4 4"]:
        """The links' matrices."""
        n, unknowns = self.shape.shape[:2]
        return self.start + np.einsum("nk,nkab->nab", x[: n * unknowns].reshape(n, unknowns), self.shape)

    def change_to(self, wanted: Float[Array, "n 4 4"]) -> Float[Array, " u"]:
        """Unknowns at which the links have these matrices; the shapes span all symmetric ones."""
        n, unknowns = self.shape.shape[:2]
        flat = self.shape.reshape(n, unknowns, 16).transpose(0, 2, 1)
        right = (wanted - self.start).reshape(n, 16)
        pairs = zip(flat, right, strict=True)
        return np.concatenate([np.linalg.lstsq(one, side, rcond=None)[0] for one, side in pairs])


def minimise(
    information: Float[Array, "m m"],
    score: Float[Array, " m"],
    free: Float[Array, " m"],
    bounded: Int[Array, " b"],
    bodies: PseudoInertias | None = None,
) -> Float[Array, " m"] | None:
    """Where ½ xᵀ A x − bᵀ x is least within the bounds, and strictly inside them.

    Args:
        information, score: A, positive definite, and b.
        free: The place where nothing bounds it.
        bounded: Positions of unknowns that may not be negative.
        bodies: Links that the first unknowns change, if any.

    Returns:
        The place, or None where the search did not come to an end.
    """
    problem = _Problem(information, score, np.asarray(bounded, dtype=int), bodies)
    x = _start(problem, free)
    level = max(FIRST_SHARE * abs(problem.value(x) - problem.value(free)) / problem.count, GAP / problem.count)
    for _ in range(MOST_STEPS):
        step, decrement = problem.newton(x, level)
        if not np.isfinite(decrement):
            return None
        if 0.5 * decrement <= CENTRED * level * problem.count:
            if level * problem.count <= GAP:
                return x
            level = max(FALL * level, 0.99 * GAP / problem.count)
            continue
        moved = problem.search(x, step, level, decrement)
        if moved is None:
            return None
        x = moved
    return None


def _start(problem: _Problem, free: Float[Array, " m"]) -> Float[Array, " m"]:
    """A place inside the bounds, near the one without them."""
    x = free.copy()
    floor = FIRST_FIGURE / np.sqrt(np.diag(problem.information)[problem.bounded])
    x[problem.bounded] = np.maximum(x[problem.bounded], floor)
    if problem.bodies is not None:
        matrices = problem.bodies.at(x)
        # A body's own scale: its entries are of different units.
        size = np.sqrt(np.maximum(np.diagonal(matrices, axis1=1, axis2=2), 1e-9))
        size = np.maximum(size, 1e-3 * size.max(axis=1, keepdims=True))
        outer = size[:, :, None] * size[:, None, :]
        values, vectors = np.linalg.eigh(matrices / outer)
        raised = np.maximum(values, FIRST_BODY)
        inside = (vectors * raised[:, None, :]) @ vectors.transpose(0, 2, 1) * outer
        change = problem.bodies.change_to(inside)
        x[: len(change)] = change
    return x


@dataclass(frozen=True, eq=False)
class _Problem:
    information: Array
    score: Array
    bounded: Array
    bodies: PseudoInertias | None

    @property
    def count(self) -> int:
        """ν: logarithms, and four for each body."""
        return len(self.bounded) + (0 if self.bodies is None else 4 * len(self.bodies.start))

    def value(self, x: Array) -> float:
        """The function without the barrier."""
        return float(x @ (0.5 * (self.information @ x) - self.score))

    def barred(self, x: Array, level: float) -> float:
        """The function with the barrier; infinite outside the bounds."""
        if np.any(x[self.bounded] <= 0.0):
            return np.inf
        barrier = float(np.log(x[self.bounded]).sum())
        if self.bodies is not None:
            try:
                root = np.linalg.cholesky(self.bodies.at(x))
            except np.linalg.LinAlgError:
                return np.inf
            barrier += 2.0 * float(np.log(np.diagonal(root, axis1=1, axis2=2)).sum())
        return self.value(x) - level * barrier

    def newton(self, x: Array, level: float) -> tuple[Array, float]:
        """Newton's step at μ, and its squared decrement; infinite where it can't be told."""
        slope = self.information @ x - self.score
        bend = self.information.copy()
        slope[self.bounded] -= level / x[self.bounded]
        bend[self.bounded, self.bounded] += level / x[self.bounded] ** 2
        try:
            if self.bodies is not None:
                n, unknowns = self.bodies.shape.shape[:2]
                root = np.linalg.inv(np.linalg.cholesky(self.bodies.at(x)))[:, None]
                turned = (root @ self.bodies.shape @ root.swapaxes(-1, -2)).reshape(n, unknowns, 16)
                slope[: n * unknowns] -= level * turned[:, :, ::5].sum(axis=-1).ravel()
                own = level * (turned @ turned.transpose(0, 2, 1))
                for i in range(n):
                    part = slice(i * unknowns, (i + 1) * unknowns)
                    bend[part, part] += own[i]
            size = np.sqrt(np.diag(bend))
            step = -np.linalg.solve(bend / np.outer(size, size), slope / size) / size
        except np.linalg.LinAlgError:
            return x, np.inf
        return step, float(-step @ slope)

    def search(self, x: Array, step: Array, level: float, decrement: float) -> Array | None:
        """A step that stays inside and goes down; None where there is none."""
        length = min(1.0, INSIDE * self._room(x, step))
        before = self.barred(x, level)
        while length > 1e-12:
            moved = x + length * step
            now = self.barred(moved, level)
            if now <= before - SUFFICIENT * length * decrement + 1e-14 * abs(before):
                return moved
            length *= SHORTER
        return None

    def _room(self, x: Array, step: Array) -> float:
        """How many steps it is to the boundary."""
        shrink = -step[self.bounded] / x[self.bounded]
        most = float(shrink.max(initial=0.0))
        if self.bodies is not None:
            root = np.linalg.inv(np.linalg.cholesky(self.bodies.at(x)))
            change = root @ (self.bodies.at(step) - self.bodies.start) @ root.swapaxes(-1, -2)
            most = max(most, float(-np.linalg.eigvalsh(change)[:, 0].min()))
        return 1.0 / max(most, 1e-12)
