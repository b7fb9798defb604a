"""Symmetric sums of columns over many blocks: the half below the diagonal alone, or they would fill
the memory.

Columns that are zero throughout, as those of links before a joint in its rows, take no room.

What friction that varies from run to run takes off a block is of rank four at the most for each
stretch of time that lies in it, and what a joint's holds add is of rank one for each of them:
products, totals and folds are made of sums and rows apart, so that neither ever needs a copy of the
sums.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg.blas import dspmv, dsyrk
from scipy.linalg.lapack import dtpttr, dtrttp

from ident.arrays import Array, Float, Int
from ident.regression.spooled import SpooledArrays

# Sums of one joint that are more numbers than this wait on disk: 40 MB.
HELD_NUMBERS = 5_000_000

Halves = list[Float[Array, " h"]] | SpooledArrays
"""Of each block its sums below the diagonal and on it, in memory or on disk."""


@dataclass(frozen=True, eq=False)
class SymmetricSums:
    """Sums Σ x xᵀ of the same p columns over several blocks or folds."""

    # Of each block the h = a (a + 1) / 2 sums of its nonzero columns below the diagonal and on it,
    # row by row.
    half: Halves
    nonzero: Int[Array, " a"]  # number of each column that is; the sums of all others are zero
    size: int  # number p of columns
    # further rows x that are not in `half`
    rows: Float[Array, "k p"] = field(default_factory=lambda: np.zeros((0, 0)))
    # Number of the block that each of them is in.
    place: Int[Array, " k"] = field(default_factory=lambda: np.zeros(0, dtype=int))
    factor: float = 1.0  # by which all of it counts

    @classmethod
    def of(cls, whole: Float[Array, "K p p"], room: SpooledArrays | None = None) -> SymmetricSums:
        """Packed from whole symmetric matrices, one a block.

        Args:
            whole: The matrices.
            room: Where large ones wait on disk; in memory if None.
        """
        nonzero = np.flatnonzero(whole.any(axis=(0, 1)))
        square = np.ix_(nonzero, nonzero)
        halves = (pack(sums[square]) for sums in whole)
        numbers = len(whole) * half_size(len(nonzero))
        return cls(stored(halves, numbers, room), nonzero, whole.shape[1])

    def __len__(self) -> int:
        return len(self.half)

    def with_rows(self, rows: Float[Array, "k p"], place: Int[Array, " k"]) -> SymmetricSums:
        """A copy with further rows in some of the blocks; of sums that have none yet.

        Rows that are more numbers than the sums are added to a copy of these, where these have all
        their columns.

        Args:
            rows: The rows.
            place: Index of the block of each.
        """
        rows = rows / np.sqrt(self.factor)
        numbers = len(self) * half_size(len(self.nonzero))
        other_columns = np.delete(rows, self.nonzero, axis=1)
        if rows.size <= numbers or other_columns.any():
            return replace(self, rows=rows, place=place)
        room = self.half if isinstance(self.half, SpooledArrays) else None
        halves = self._halves_with(rows[:, self.nonzero], place)
        return replace(self, half=stored(halves, numbers, room))

    def _halves_with(
        self, rows: Float[Array, "k a"], place: Int[Array, " k"]
    ) -> Iterator[Float[Array, " h"]]:
        """Packed sums of each block with further rows of its nonzero columns."""
        for block, half in enumerate(self.half):
            further = rows[place == block]
            yield half + pack(further.T @ further)

    def divided(self, factor: float) -> SymmetricSums:
        """Sums of columns that count in units so much larger that the sums shrink by a factor.

        Nothing is copied.
        """
        return replace(self, factor=self.factor / factor)

    def weighted(self, weights: Float[Array, " K"]) -> SymmetricSums:
        """A copy with each block's sums times a weight; of sums that have no further rows."""
        pairs = zip(weights, self.half, strict=True)
        return replace(self, half=[weight * half for weight, half in pairs])

    def part(self, columns: Int[Array, " c"]) -> Float[Array, "K c c"]:
        """Sums of some columns, block by block."""
        every_spot = self._spot[columns]
        seen = np.flatnonzero(every_spot >= 0)
        spots = every_spot[seen]
        high = np.maximum(spots[:, None], spots)
        low = np.minimum(spots[:, None], spots)
        in_half = high * (high + 1) // 2 + low
        packed = np.array([half[in_half] for half in self.half])
        sums = packed.reshape(len(self), len(seen), len(seen))
        if len(seen) < len(columns):
            shown = sums
            sums = np.zeros((len(self), len(columns), len(columns)))
            sums[:, seen[:, None], seen] = shown
        if len(self.rows):
            of_rows = self.rows[:, columns]
            products = of_rows[:, :, None] * of_rows[:, None, :]
            np.add.at(sums, self.place, products)
        return np.asarray(self.factor * sums)

    def over(self, blocks: Sequence[int] | Int[Array, " b"] | None = None) -> Float[Array, "p p"]:
        """Sums over some blocks, given by index, or over all if None."""
        members = range(len(self)) if blocks is None else blocks
        half = np.zeros(half_size(len(self.nonzero)))
        for block in members:  # none of them is copied
            half += self.half[block]
        sums = np.zeros((self.size, self.size))
        upper, *_ = dtpttr(len(self.nonzero), half, uplo="U")
        square = np.ix_(self.nonzero, self.nonzero)
        sums[square] = np.triu(upper) + np.triu(upper, 1).T
        if len(self.rows):
            inside = np.isin(self.place, np.asarray(members))
            rows = self.rows[inside]
            sums += rows.T @ rows
        return np.asarray(self.factor * sums)

    def diagonal(self) -> Float[Array, " p"]:
        """Sum of each column's squares over all blocks."""
        index = np.arange(len(self.nonzero))
        on_diagonal = index * (index + 3) // 2
        packed = np.zeros(len(index))
        for half in self.half:
            packed = packed + half[on_diagonal]
        diagonal = np.zeros(self.size)
        diagonal[self.nonzero] = packed
        if len(self.rows):
            diagonal = diagonal + (self.rows**2).sum(axis=0)
        return np.asarray(self.factor * diagonal)

    def times(self, weights: Float[Array, " p"]) -> Float[Array, "K p"]:
        """Each block's sums times a vector of weights of the columns."""
        packed_weights = weights[self.nonzero]
        width = len(packed_weights)
        products = np.zeros((len(self), self.size))
        if width:
            of_blocks = [dspmv(width, 1.0, half, packed_weights) for half in self.half]
            products[:, self.nonzero] = of_blocks
        if len(self.rows):
            of_rows = self.rows @ weights
            np.add.at(products, self.place, of_rows[:, None] * self.rows)
        return np.asarray(self.factor * products)

    @cached_property
    def _spot(self) -> Int[Array, " p"]:
        """Where each column stands among the nonzero ones, -1 of those that are zero."""
        spots = np.full(self.size, -1)
        spots[self.nonzero] = np.arange(len(self.nonzero))
        return spots


def stored(
    halves: Iterable[Float[Array, " h"]], numbers: int, room: SpooledArrays | None
) -> Halves:
    """One joint's packed sums, block by block.

    Args:
        halves: The sums of each block, packed.
        numbers: How many numbers they are together.
        room: Where many numbers go on disk; in memory if None.
    """
    if room is None or numbers <= HELD_NUMBERS:
        return list(halves)
    return SpooledArrays(halves, room)


def half_size(columns: int) -> int:
    """Number of entries of a symmetric matrix of so many columns on the diagonal and to one
    side.
    """
    return columns * (columns + 1) // 2


def pack(whole: Float[Array, "p p"]) -> Float[Array, " h"]:
    """The half of a symmetric matrix below the diagonal and on it, row by row; the other half is
    not read.
    """
    # LAPACK counts columns first: our lower half is its upper one.
    return np.asarray(dtrttp(whole.T, uplo="U")[0])


def add_half(sums: Halves, block: int, whole: Float[Array, "p p"]) -> None:
    """Adds a matrix to a block's packed sums, in place.

    Args:
        sums: Packed sums of all blocks; those of the block may be of the matrix's first columns
            alone.
        block: Index of the block.
        whole: The symmetric matrix.
    """
    half = pack(whole)
    before = sums[block]
    half[: len(before)] += before
    sums[block] = half


def add_products(sums: Float[Array, "p p"], table: Float[Array, "t p"], sign: float) -> None:
    """Adds Σ x xᵀ over a table's rows, times a sign, to one half of symmetric sums: below the
    diagonal and on it.

    Args:
        sums: The sums, changed in place.
        table: The rows.
        sign: Of the summands.
    """
    if not len(table):
        return
    # BLAS counts columns first: our lower half is its upper one.
    rows = np.ascontiguousarray(table).T
    result = dsyrk(sign, rows, beta=1.0, c=sums.T, lower=0, overwrite_c=1)
    assert np.shares_memory(result, sums)
