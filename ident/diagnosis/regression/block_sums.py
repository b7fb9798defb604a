"""Whitened sums of all blocks, and what friction that varies from run to run takes off them.

Sums are kept as if friction were the same in all runs. What its variation takes off a block is of rank four at the most
for each stretch of time that lies in it: products, totals and folds are made of both apart, so that no variation ever
needs a copy of the sums.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.blas import dsyrk

from ident.arrays import Array, Float, Int
from ident.compiled import compiled


@dataclass(frozen=True, eq=False)
class WhitenedSums:
    """Sums of all columns with each other, friction the same in all runs.

    Attributes:
        of_joint: For each joint, the sums of every block, (B, p, p).
        fold_of_block: Fold of each block.
    """

    of_joint: tuple[Float[Array, "B p p"], ...]
    fold_of_block: Int[Array, " B"]

    @cached_property
    def by_fold(self) -> tuple[Float[Array, "F p p"], ...]:
        """For each joint, the sums of every fold."""
        folds = range(int(self.fold_of_block.max()) + 1)
        members = [np.flatnonzero(self.fold_of_block == fold) for fold in folds]
        return tuple(np.stack([_sum(sums, blocks) for blocks in members]) for sums in self.of_joint)

    @cached_property
    def total(self) -> tuple[Float[Array, "p p"], ...]:
        """For each joint, the sums of all blocks."""
        return tuple(folds.sum(axis=0) for folds in self.by_fold)


def _sum(sums: Float[Array, "B p p"], blocks: Int[Array, " b"]) -> Float[Array, "p p"]:
    """Sum over some blocks, none of which is copied."""
    found = np.zeros(sums.shape[1:])
    for block in blocks:
        found += sums[block]
    return found


def add_products(sums: Float[Array, "p p"], table: Float[Array, "t p"], sign: float) -> None:
    """Adds Σ x xᵀ over a table's rows, times a sign, to one half of symmetric sums: below the diagonal and on it.

    Args:
        sums: The sums, changed in place.
        table: The rows.
        sign: Of the summands.
    """
    if len(table):
        # BLAS counts columns first: our lower half is its upper one.
        found = dsyrk(sign, np.ascontiguousarray(table).T, beta=1.0, c=sums.T, lower=0, overwrite_c=1)
        assert np.shares_memory(found, sums)


@compiled("f3")
def mirror(sums: Array) -> None:
    """Fills the half above the diagonal of symmetric sums (B, p, p) from the one below it, in place.

    Tile by tile, for columns are far apart in memory.
    """
    size = sums.shape[1]
    for b in range(len(sums)):
        for first in range(0, size, 16):
            for start in range(0, first + 16, 16):
                for i in range(first, min(first + 16, size)):
                    for j in range(start, min(start + 16, i)):
                        sums[b, j, i] = sums[b, i, j]
