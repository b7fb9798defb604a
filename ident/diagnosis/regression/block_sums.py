"""Whitened sums of all blocks, and what friction that varies from run to run takes off them.

Sums are kept as if friction were the same in all runs. What its variation takes off a block is of rank four at the most
for each stretch of time that lies in it: products, totals and folds are made of both apart, so that no variation ever
needs a copy of the sums.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from mmap import mmap

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


def room_for_sums(count: int, size: int) -> Float[Array, "B p p"]:
    """Sums of so many blocks, zero, in memory of usual pages.

    NumPy asks for huge ones. To find and clear them takes the kernel longer than all products of a session.
    """
    return np.frombuffer(mmap(-1, count * size * size * np.dtype(float).itemsize)).reshape(count, size, size)


def add_products(sums: Float[Array, "p p"], tables: Sequence[Float[Array, "t p"]]) -> None:
    """Adds Σ x xᵀ over the first table's rows, less that over further ones', to symmetric sums.

    Only the half below the diagonal and on it is right afterwards. Sums of many blocks are far more than a processor's
    cache holds, and fetching a block's costs more than its products: all products are made before it is fetched.

    Args:
        sums: The sums, changed in place.
        tables: The rows, as many in each.
    """
    if len(tables[0]):
        made, sign = np.zeros(sums.shape), 1.0
        for table in tables:
            # BLAS counts columns first: our lower half is its upper one.
            found = dsyrk(sign, np.ascontiguousarray(table).T, beta=1.0, c=made.T, lower=0, overwrite_c=1)
            assert np.shares_memory(found, made)
            sign = -1.0
        sums += made


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
