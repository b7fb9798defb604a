"""What each stretch's own friction level goes with.

Rows y = X β + F_r diag(level) λ_r + e of a joint in stretch r, F_r its viscous and Coulomb column,
λ_r ~ N(0, spread² I) the stretch's own share of both. FᵀX of each piece is kept apart, so that the
spread may be learnt afterwards: integrating λ out takes (XᵀF) C (FᵀX) off the sums XᵀX.

K pieces (a stretch within a block), R stretches, B blocks, p columns of a joint's rows, the torque
last.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from ident.arrays import Array, Bool, Float, Int
from ident.regression.design import LOSS_PARAMETERS

# Columns of a joint's rows, after the base parameters, that a run's own friction level scales:
# viscous and Coulomb.
FRICTION = slice(1, LOSS_PARAMETERS)
# Least square of a direction of both columns, as a share of the other's: below it is rounding.
LEAST_SQUARE = 1e-12


@dataclass(frozen=True, eq=False)
class FrictionSums:
    """Whitened sums of each stretch's two friction columns with all columns, by the blocks that it
    lies in.
    """

    stretch: Int[Array, " K"]  # of each piece: a stretch is a run, or some seconds of a long one
    block: Int[Array, " K"]
    # For each joint FᵀX of every piece, with F the viscous and the Coulomb column, shape (K, 2, p).
    sums: tuple[Float[Array, "K 2 p"], ...]
    level: Float[Array, "n 2"]  # scaled viscous and Coulomb coefficient of each joint
    rank: int  # number of base parameters, before the joint's loss columns

    @property
    def columns(self) -> slice:
        """Where a joint's two friction columns, viscous and Coulomb, stand in its rows."""
        return slice(self.rank + FRICTION.start, self.rank + FRICTION.stop)

    def taken(self, joint: int, spread: float) -> Float[Array, "p p"]:
        """What friction levels that are free within a share take off a joint's sums.

        Args:
            joint: The joint.
            spread: Relative standard deviation of its friction level from stretch to stretch.
        """
        pieces, follow = self._followed(joint, spread, None)
        size = pieces.shape[-1]
        half = pieces.reshape(-1, size).T @ follow.reshape(-1, size)
        return np.asarray(0.5 * (half + half.T))

    def _followed(
        self, joint: int, spread: float, places: Int[Array, " c"] | None
    ) -> tuple[Float[Array, "K 2 c"], Float[Array, "K 2 c"]]:
        """Sums of each piece, and what its stretch's friction level follows of them.

        Args:
            joint: The joint.
            spread: Relative standard deviation of its friction level.
            places: Columns of the joint's rows that are asked for; all if None.
        """
        whole = self._wholes[joint]
        known = self._known(whole, joint, spread)
        follow = np.einsum("kab,kbp->kap", known, _columns(whole, places))
        return _columns(self.sums[joint], places), follow[self._place]

    def taken_of_blocks(
        self, joint: int, spread: float, weights: Float[Array, " p"], count: int
    ) -> Float[Array, "B p"]:
        """What free friction levels take off each block's sums times weights (see `taken`).

        A stretch's rows X with a level of their own have the sums XᵀV⁻¹X, V⁻¹ = (I − F C Fᵀ)²; a
        block takes part in them with its rows of (I − F C Fᵀ) X, which are as independent as noise
        is.

        Args:
            joint: The joint.
            spread: Relative standard deviation of its friction level.
            weights: What each block's sums are multiplied by.
            count: Number of blocks.
        """
        pieces = self.sums[joint]
        whole = self._wholes[joint][self._place]
        place = self._place
        root = self._root(joint, spread)[place]
        of_piece = _times(root, pieces @ weights)
        of_stretch = _times(root, whole @ weights)
        again = _times(root, _times(pieces[:, :, self.columns], of_stretch))
        products = np.einsum("kap,ka->kp", pieces, of_stretch)
        products = products + np.einsum("kap,ka->kp", whole, of_piece - again)
        number = len(products)
        places = (self.block, np.arange(number))
        members = csr_array((np.ones(number), places), (count, number))
        return np.asarray(members @ products)

    def is_cut(self, folds: Int[Array, " B"]) -> bool:
        """Whether a stretch lies in several folds."""
        pairs = np.unique(np.stack([self.stretch, folds[self.block]]), axis=1)
        return len(np.unique(self.stretch)) < pairs.shape[1]

    def part(
        self,
        of_fold: Float[Array, "F c c"],
        joint: int,
        spread: float,
        folds: Int[Array, " B"],
        places: Int[Array, " c"] | None = None,
    ) -> tuple[Float[Array, "F c c"], Float[Array, "F c c"]]:
        """A joint's sums of all folds but one, and of that one alone, fold by fold.

        Where a stretch lies in several folds, each side knows its friction level by its own pieces
        only. (What the whole stretch's level leaves of some pieces is no sum of squares: models
        solved with it run away.)

        Args:
            of_fold: Whitened sums of each fold, friction the same in all runs.
            joint: The joint.
            spread: Relative standard deviation of friction that they are to count with.
            folds: Fold of each block.
            places: Columns of the joint's rows that they are of; all if None.
        """
        fold_of_piece = folds[self.block]
        if not self.is_cut(folds):
            pieces, follow = self._followed(joint, spread, places)
            of_fold = of_fold.copy()
            for fold in range(len(of_fold)):
                inside = fold_of_piece == fold
                half = _products(pieces[inside], follow[inside])
                of_fold[fold] -= 0.5 * (half + half.T)
            return of_fold.sum(axis=0) - of_fold, of_fold
        rest = of_fold.sum(axis=0) - of_fold
        of_fold = of_fold.copy()
        for fold in range(len(of_fold)):
            in_fold = fold_of_piece == fold
            for side, inside in ((of_fold, in_fold), (rest, ~in_fold)):
                whole = self._whole(joint, inside)
                known = self._known(whole, joint, spread)
                whole = _columns(whole, places)
                follow = np.einsum("rab,rbp->rap", known, whole)
                side[fold] -= _products(whole, follow)
        return rest, of_fold

    @cached_property
    def _place(self) -> Int[Array, " K"]:
        """Number of each piece's stretch."""
        return np.unique(self.stretch, return_inverse=True)[1]

    @cached_property
    def _wholes(self) -> tuple[Float[Array, "R 2 p"], ...]:
        """For each joint the sums of each stretch; those of the pieces themselves where each is a
        stretch in turn.
        """
        if np.array_equal(self._place, np.arange(len(self._place))):
            return self.sums
        everywhere = np.ones(len(self._place), dtype=bool)
        return tuple(self._whole(joint, everywhere) for joint in range(len(self.sums)))

    def _whole(self, joint: int, inside: Bool[Array, " K"]) -> Float[Array, "R 2 p"]:
        """Sums of some pieces of each stretch."""
        pieces = self.sums[joint]
        whole = np.zeros((int(self._place.max()) + 1, *pieces.shape[1:]))
        for k in np.flatnonzero(inside):
            whole[self._place[k]] += pieces[k]
        return whole

    def _known(
        self, whole: Float[Array, "R 2 p"], joint: int, spread: float
    ) -> Float[Array, "R 2 2"]:
        """By how much each stretch's friction level is known beforehand and by its rows: (Λ⁻¹ +
        FᵀF)⁻¹, also for Λ = 0.

        Times FᵀX it is what the level takes with it.
        """
        sizes = spread * self.level[joint]
        inner = np.eye(2) + sizes[:, None] * whole[:, :, self.columns] * sizes
        return np.asarray(sizes[:, None] * np.linalg.inv(inner) * sizes)

    def _root(self, joint: int, spread: float) -> Float[Array, "R 2 2"]:
        """C of each stretch, with (I − F C Fᵀ)² = I − F K Fᵀ and K = `_known`: with S² = FᵀF, of an
        eigenvalue k of S K S the matrix S C S has 1 − √(1 − k).
        """
        inner = self._wholes[joint][:, :, self.columns]
        squares, axes = np.linalg.eigh(0.5 * (inner + np.swapaxes(inner, 1, 2)))
        sizes = np.sqrt(np.maximum(squares, LEAST_SQUARE * np.maximum(squares[:, -1:], 1e-300)))
        turned_back = np.swapaxes(axes, 1, 2)
        root = (axes * sizes[:, None, :]) @ turned_back
        back = (axes * (1.0 / sizes)[:, None, :]) @ turned_back
        known = self._known(self._wholes[joint], joint, spread)
        values, vectors = np.linalg.eigh(root @ known @ root)
        less = 1.0 - np.sqrt(1.0 - np.clip(values, 0.0, 1.0))
        turned = back @ vectors
        return np.asarray((turned * less[:, None, :]) @ np.swapaxes(turned, 1, 2))

    def levels(
        self, joint: int, misfit: float
    ) -> tuple[Float[Array, "s p"], Float[Array, "R 2 2"]]:
        """Viscous and Coulomb level of each stretch in turn, as shares of the model's: how they
        follow, and how surely.

        Stretches in which the joint hardly moves are left out.

        Args:
            joint: The joint.
            misfit: Mean square of what the model leaves of a whitened row.

        Returns:
            What takes a model's weights of a row to the levels; their covariance by noise, stretch
            by stretch.
        """
        level = self.level[joint]
        whole = self._wholes[joint]
        information = level[:, None] * whole[:, :, self.columns] * level
        information += 1e-3 * np.trace(information, axis1=1, axis2=2)[:, None, None] * np.eye(2)
        moved = np.linalg.eigvalsh(information)[:, 0] > 1e-9
        inverse = np.linalg.inv(information[moved])
        levels = inverse @ (level[:, None] * whole[moved])
        return levels.reshape(-1, whole.shape[2]), misfit * inverse


def _columns(sums: Float[Array, "K 2 p"], places: Int[Array, " c"] | None) -> Float[Array, "K 2 c"]:
    """Some columns of sums; all if None."""
    return sums if places is None else sums[:, :, places]


def _products(sums: Float[Array, "K 2 c"], follow: Float[Array, "K 2 c"]) -> Float[Array, "c c"]:
    """Products of two columns of some sums, over all of them.

    Piece by piece, so that rounding does not depend on which other columns are asked for.
    """
    total = np.zeros((sums.shape[2], sums.shape[2]))
    for first, second in zip(sums, follow, strict=True):
        total += first[0, :, None] * second[0] + first[1, :, None] * second[1]
    return total


def _times(matrices: Float[Array, "K 2 2"], vectors: Float[Array, "K 2"]) -> Float[Array, "K 2"]:
    """Each matrix times its vector."""
    return np.asarray(np.einsum("kab,kb->ka", matrices, vectors))
