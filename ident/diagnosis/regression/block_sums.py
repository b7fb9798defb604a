"""Whitened sums of all blocks, and what friction that varies from run to run takes off them.

Sums are kept as if friction were the same in all runs. What its variation takes off a block is of rank four at the most
for each stretch of time that lies in it: products, totals and folds are made of both apart, so that no variation ever
needs a copy of the sums.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float, Int


@dataclass(frozen=True, eq=False)
class BlockSums:
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
