"""Sums by which each stretch's own friction level is integrated out of a joint's regression.

A joint's whitened rows in stretch r (a run, or some seconds of a long one) are

    y = X β + F diag(level) λ + e,    λ ~ N(0, spread² I),    e ~ N(0, I),

F the viscous and the Coulomb column of X, `level` their coefficients in the model, and λ by what
share this stretch's friction differs from them. With Λ = spread² diag(level)² and λ integrated
out, the rows' weight is

    (I + F Λ Fᵀ)⁻¹ = I − F C Fᵀ,    C = (Λ⁻¹ + FᵀF)⁻¹,

and the sums XᵀX become XᵀX − (XᵀF) C (FᵀX). C is the covariance that is left of the stretch's
friction coefficients once its rows are known; C FᵀX is how they follow the columns. Only FᵀX is
kept, so that the spread may be learnt afterwards.

Shapes: K pieces (what of a stretch lies in one block), R stretches, B blocks, F folds, p columns
of a joint's rows, torque last, and c columns that are asked for.

Source: Searle, Casella and McCulloch 1992 (variance components).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular
from scipy.sparse import csr_array

from ident.arrays import Array, Bool, Float, Int
from ident.regression.design import LOSS_PARAMETERS

# Columns of a joint's rows, after the base parameters, that a run's own friction level scales:
# viscous and Coulomb.
FRICTION = slice(1, LOSS_PARAMETERS)
# Least square of a direction of both columns, as a share of the other's: below it is rounding.
LEAST_SQUARE = 1e-12
# What is added to the information on a stretch's two levels, as a share of their sum, so that
# levels of which one column says nothing can be told.
RIDGE = 1e-3
# Least information on a level's share, in units of the whitened noise: below it the joint rests.
LEAST_INFORMATION = 1e-9


@dataclass(frozen=True, eq=False)
class WalkingLevels:
    """Friction levels of a joint's stretches, each near the one before, integrated out."""

    half: Float[Array, "2R p"]  # H, of which HᵀH is what they take off the joint's XᵀX
    nats: float  # −½ log |I + Λ^½ FᵀF Λ^½| [nats]

    @property
    def absorbed(self) -> Float[Array, "p p"]:
        """What these levels take off a joint's XᵀX."""
        return self.half.T @ self.half


def walking_covariance(stretches: int, spread: float, walk: float) -> Float[Array, "R R"]:
    """Covariance of the relative friction levels of stretches one after the other.

    A share `walk` of their variance is a random walk's. About their mean, levels of R stretches
    vary by `spread`² in the mean, whatever share of it walks.

    Args:
        stretches: R, their number.
        spread: Relative standard deviation.
        walk: The share, between 0 and 1.
    """
    number = np.arange(1, stretches + 1)
    gathered = np.minimum(number[:, None], number)
    # The mean variance of a walk of R steps of variance one about its own mean is
    # (R² − 1) / 6R; of independent levels it is 1 − 1/R.
    step = 6.0 / (stretches + 1.0)
    return spread**2 * ((1.0 - walk) * np.eye(stretches) + walk * step * gathered)


@dataclass(frozen=True, eq=False)
class FrictionSums:
    """Whitened sums FᵀX of each stretch, in the pieces into which blocks cut it."""

    stretch: Int[Array, " K"]  # of each piece
    block: Int[Array, " K"]  # of each piece
    sums: tuple[Float[Array, "K 2 p"], ...]  # for each joint FᵀX of every piece
    level: Float[Array, "n 2"]  # scaled viscous and Coulomb coefficient of each joint
    rank: int  # number of base parameters, before the joint's loss columns

    @property
    def columns(self) -> slice:
        """Where a joint's two friction columns, viscous and Coulomb, stand in its rows."""
        return slice(self.rank + FRICTION.start, self.rank + FRICTION.stop)

    @cached_property
    def by_stretch(self) -> tuple[Float[Array, "R 2 p"], ...]:
        """For each joint FᵀX of every stretch, its pieces added up."""
        pieces = len(self._stretch_of_piece)
        if np.array_equal(self._stretch_of_piece, np.arange(pieces)):
            return self.sums
        everywhere = np.ones(pieces, dtype=bool)
        return tuple(self._add_pieces(joint, everywhere) for joint in range(len(self.sums)))

    def absorbed(self, joint: int, spread: float) -> Float[Array, "p p"]:
        """What free friction levels take off a joint's XᵀX: Σ (XᵀF) C (FᵀX) over all stretches.

        Args:
            joint: Index of the joint.
            spread: Relative standard deviation of its friction level from stretch to stretch.
        """
        pieces = self.sums[joint]
        of_stretches = self._responses(joint, spread)
        responses = of_stretches[self._stretch_of_piece]
        size = pieces.shape[-1]
        flat_pieces = pieces.reshape(-1, size)
        flat_responses = responses.reshape(-1, size)
        half = flat_pieces.T @ flat_responses
        return np.asarray(0.5 * (half + half.T))

    def walking(self, joint: int, spread: float, walk: float) -> WalkingLevels:
        """A joint's friction levels where part of their variance gathers from stretch to stretch.

        Args:
            joint: Index of the joint.
            spread: Relative standard deviation of its friction level from stretch to stretch.
            walk: Share of that variance, between 0 and 1, that is a random walk's.
        """
        whole = self.by_stretch[joint]
        stretches = len(whole)
        root = np.linalg.cholesky(walking_covariance(stretches, spread, walk))
        scaled = self.level[joint][:, None] * whole
        # The viscous levels of all stretches first, then the Coulomb levels.
        tied = root.T @ np.swapaxes(scaled, 0, 1)
        seen = whole[:, :, self.columns] * np.outer(self.level[joint], self.level[joint])
        inner = np.eye(2 * stretches)
        for a, b in np.ndindex(2, 2):
            rows = slice(a * stretches, (a + 1) * stretches)
            columns = slice(b * stretches, (b + 1) * stretches)
            inner[rows, columns] += root.T @ (seen[:, a, b, None] * root)
        factor = np.linalg.cholesky(0.5 * (inner + inner.T))
        flat = tied.reshape(2 * stretches, -1)
        half = solve_triangular(factor, flat, lower=True, check_finite=False)
        return WalkingLevels(half, -float(np.log(np.diag(factor)).sum()))

    def absorbed_by_block(
        self, joint: int, spread: float, weights: Float[Array, " p"], count: int
    ) -> Float[Array, "B p"]:
        """What free friction levels take off each block's XᵀX w.

        A stretch has the sums XᵀV⁻¹X, V⁻¹ = I − F C Fᵀ = (I − F D Fᵀ)². A block takes part in them
        with its rows of (I − F D Fᵀ) X, which are as independent of other blocks' as noise is. With
        b the block's share of a stretch's sums, FᵀX = Σ (FᵀX)_b, it loses

            (XᵀF)_b D FᵀX w + (XᵀF) (D (FᵀX)_b w − D (FᵀF)_b D FᵀX w).

        Args:
            joint: Index of the joint.
            spread: Relative standard deviation of its friction level from stretch to stretch.
            weights: w, one for each column of the joint's rows.
            count: Number of blocks, B.
        """
        stretch = self._stretch_of_piece
        pieces = self.sums[joint]
        whole = self.by_stretch[joint][stretch]
        root = self._root(joint, spread)[stretch]
        of_piece = _times(root, pieces @ weights)
        of_stretch = _times(root, whole @ weights)
        friction = pieces[:, :, self.columns]
        twice = _times(root, _times(friction, of_stretch))
        products = np.einsum("kap,ka->kp", pieces, of_stretch)
        products = products + np.einsum("kap,ka->kp", whole, of_piece - twice)
        number = len(products)
        places = (self.block, np.arange(number))
        members = csr_array((np.ones(number), places), (count, number))
        return np.asarray(members @ products)

    def crosses_folds(self, folds: Int[Array, " B"]) -> bool:
        """Whether some stretch lies in several folds.

        Args:
            folds: Fold of each block.
        """
        pairs = np.unique(np.stack([self.stretch, folds[self.block]]), axis=1)
        return len(np.unique(self.stretch)) < pairs.shape[1]

    def split_by_fold(
        self,
        fold_sums: Float[Array, "F c c"],
        joint: int,
        spread: float,
        folds: Int[Array, " B"],
        places: Int[Array, " c"] | None = None,
    ) -> tuple[Float[Array, "F c c"], Float[Array, "F c c"]]:
        """A joint's sums with free friction levels, fold by fold.

        Where a stretch lies in several folds, each side knows its friction level by its own pieces
        only. (What the whole stretch's level leaves of some pieces is no sum of squares: models
        solved with it run away.)

        Args:
            fold_sums: XᵀX of each fold, friction the same in all stretches.
            joint: Index of the joint.
            spread: Relative standard deviation of its friction level from stretch to stretch.
            folds: Fold of each block.
            places: Columns of the joint's rows that the sums are of; all if None.

        Returns:
            Sums over all folds but each in turn, and over each fold.
        """
        fold_of_piece = folds[self.block]
        inside = fold_sums.copy()
        if not self.crosses_folds(folds):
            pieces = _select(self.sums[joint], places)
            of_stretches = self._responses(joint, spread, places)
            responses = of_stretches[self._stretch_of_piece]
            for fold in range(len(fold_sums)):
                members = fold_of_piece == fold
                half = _sum_of_products(pieces[members], responses[members])
                inside[fold] -= 0.5 * (half + half.T)
            return inside.sum(axis=0) - inside, inside
        outside = fold_sums.sum(axis=0) - fold_sums
        for fold in range(len(fold_sums)):
            members = fold_of_piece == fold
            inside[fold] -= self._absorbed_by_pieces(joint, spread, members, places)
            outside[fold] -= self._absorbed_by_pieces(joint, spread, ~members, places)
        return outside, inside

    def estimate_levels(
        self, joint: int, misfit: float
    ) -> tuple[Float[Array, "s p"], Float[Array, "R 2 2"]]:
        """How each stretch's friction level follows from what a model leaves of its rows.

        With L = diag(level), a stretch's shares are λ = (L FᵀF L)⁻¹ L FᵀX w, w the weights with
        which a row's product is what the model leaves of it. Stretches in which the joint hardly
        moves are left out.

        Args:
            joint: Index of the joint.
            misfit: Mean square of what the model leaves of a whitened row.

        Returns:
            (L FᵀF L)⁻¹ L FᵀX of the stretches in turn, two rows each, viscous and Coulomb; and the
            covariance of each stretch's two shares by noise.
        """
        level = self.level[joint]
        whole = self.by_stretch[joint]
        information = level[:, None] * whole[:, :, self.columns] * level
        total = np.trace(information, axis1=1, axis2=2)
        information += RIDGE * total[:, None, None] * np.eye(2)
        least = np.linalg.eigvalsh(information)[:, 0]
        moved = least > LEAST_INFORMATION
        inverse = np.linalg.inv(information[moved])
        scaled = level[:, None] * whole[moved]
        shares = inverse @ scaled
        return shares.reshape(-1, whole.shape[2]), misfit * inverse

    @cached_property
    def _stretch_of_piece(self) -> Int[Array, " K"]:
        """Index of each piece's stretch, counted from 0 without gaps."""
        _, stretch_of_piece = np.unique(self.stretch, return_inverse=True)
        return stretch_of_piece

    def _add_pieces(self, joint: int, members: Bool[Array, " K"]) -> Float[Array, "R 2 p"]:
        """FᵀX of every stretch by some of its pieces alone."""
        pieces = self.sums[joint]
        stretches = int(self._stretch_of_piece.max()) + 1
        whole = np.zeros((stretches, *pieces.shape[1:]))
        for k in np.flatnonzero(members):
            whole[self._stretch_of_piece[k]] += pieces[k]
        return whole

    def _absorbed_by_pieces(
        self,
        joint: int,
        spread: float,
        members: Bool[Array, " K"],
        places: Int[Array, " c"] | None,
    ) -> Float[Array, "c c"]:
        """Σ (XᵀF) C (FᵀX) where a stretch consists of some of its pieces alone."""
        whole = self._add_pieces(joint, members)
        covariance = self._covariance(whole, joint, spread)
        selected = _select(whole, places)
        responses = np.einsum("rab,rbp->rap", covariance, selected)
        return _sum_of_products(selected, responses)

    def _responses(
        self, joint: int, spread: float, places: Int[Array, " c"] | None = None
    ) -> Float[Array, "R 2 c"]:
        """C FᵀX of every stretch: how its two friction coefficients follow the columns."""
        whole = self.by_stretch[joint]
        covariance = self._covariance(whole, joint, spread)
        selected = _select(whole, places)
        return np.asarray(np.einsum("rab,rbp->rap", covariance, selected))

    def _covariance(
        self, whole: Float[Array, "R 2 p"], joint: int, spread: float
    ) -> Float[Array, "R 2 2"]:
        """C = (Λ⁻¹ + FᵀF)⁻¹ of every stretch, as Λ^½ (I + Λ^½ FᵀF Λ^½)⁻¹ Λ^½: also for Λ = 0.

        Args:
            whole: FᵀX of the stretches.
            joint: Index of the joint.
            spread: Relative standard deviation of its friction level from stretch to stretch.
        """
        deviation = spread * self.level[joint]
        information = deviation[:, None] * whole[:, :, self.columns] * deviation
        inverse = np.linalg.inv(np.eye(2) + information)
        return np.asarray(deviation[:, None] * inverse * deviation)

    def _root(self, joint: int, spread: float) -> Float[Array, "R 2 2"]:
        """D of every stretch, with (I − F D Fᵀ)² = I − F C Fᵀ.

        With S = (FᵀF)^½, S D S has the eigenvectors of S C S, and the eigenvalue 1 − √(1 − k) for
        each eigenvalue k.
        """
        whole = self.by_stretch[joint]
        inner = whole[:, :, self.columns]
        symmetric = 0.5 * (inner + np.swapaxes(inner, 1, 2))
        squares, axes = np.linalg.eigh(symmetric)
        largest = np.maximum(squares[:, -1:], 1e-300)
        sizes = np.sqrt(np.maximum(squares, LEAST_SQUARE * largest))
        inverse_sizes = 1.0 / sizes
        transposed = np.swapaxes(axes, 1, 2)
        root = (axes * sizes[:, None, :]) @ transposed
        inverse_root = (axes * inverse_sizes[:, None, :]) @ transposed
        covariance = self._covariance(whole, joint, spread)
        values, vectors = np.linalg.eigh(root @ covariance @ root)
        explained = np.clip(values, 0.0, 1.0)
        lost = 1.0 - np.sqrt(1.0 - explained)
        turned = inverse_root @ vectors
        scaled = turned * lost[:, None, :]
        return np.asarray(scaled @ np.swapaxes(turned, 1, 2))


def _select(sums: Float[Array, "K 2 p"], places: Int[Array, " c"] | None) -> Float[Array, "K 2 c"]:
    """Some columns of sums; all if None."""
    return sums if places is None else sums[:, :, places]


def _sum_of_products(
    sums: Float[Array, "K 2 c"], responses: Float[Array, "K 2 c"]
) -> Float[Array, "c c"]:
    """Σ over K of sums_kᵀ responses_k.

    Piece by piece, so that rounding does not depend on which other columns are asked for.
    """
    size = sums.shape[2]
    total = np.zeros((size, size))
    for first, second in zip(sums, responses, strict=True):
        viscous = first[0, :, None] * second[0]
        coulomb = first[1, :, None] * second[1]
        total += viscous + coulomb
    return total


def _times(matrices: Float[Array, "K 2 2"], vectors: Float[Array, "K 2"]) -> Float[Array, "K 2"]:
    """Each matrix times its vector."""
    return np.asarray(np.einsum("kab,kb->ka", matrices, vectors))
