"""Arrays that wait on disk until they are asked for: sums and tables that would fill the memory.

They go to an unnamed temporary file, which vanishes with the process that made it, and are mapped
into memory one by one: what is asked for is read, what is let go is gone.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from math import prod
from mmap import ACCESS_READ, ALLOCATIONGRANULARITY, mmap
from tempfile import TemporaryFile, gettempdir
from typing import IO, Any

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError


class SpooledArrays(Sequence[Float[Array, "..."]]):
    """Arrays of any shape and kind in one temporary file, or in that of others; entries are
    read-only maps, or changed.

    Attributes:
        change: What is made of an array when it is asked for, by its index; nothing if None.
    """

    def __init__(
        self, arrays: Iterable[Float[Array, "..."]] = (), beside: SpooledArrays | None = None
    ) -> None:
        self.change: Callable[[int, Array], Array] | None = None
        self._file: IO[bytes]
        if beside is None:
            self._file = TemporaryFile(prefix="armgap-")  # noqa: SIM115
        else:
            self._file = beside._file
        self._spots: list[tuple[int, tuple[int, ...], np.dtype[Any]]] = []
        for values in arrays:
            self.append(values)

    def __len__(self) -> int:
        return len(self._spots)

    def append(self, values: Float[Array, "..."]) -> None:
        """Writes one more array at the end of the sequence."""
        self._spots.append((-1, (-1,), np.dtype(float)))
        self[len(self) - 1] = values

    def __setitem__(self, index: int, values: Float[Array, "..."]) -> None:
        """Writes an array in the place of one; who holds that may see either.

        Raises:
            InputError: The disk of temporary files is full.
        """
        values = np.asarray(values)
        (offset, *kind) = self._spots[index]
        try:
            where = (
                (offset, os.SEEK_SET) if kind == [values.shape, values.dtype] else (0, os.SEEK_END)
            )
            self._spots[index] = self._file.seek(*where), values.shape, values.dtype
            self._file.write(values.tobytes())
            self._file.flush()
        except OSError as error:
            remedy = "free some space there, or name a roomier folder in the variable TMPDIR"
            raise InputError(
                gettempdir(), f"can't hold a long session: {error.strerror}", remedy
            ) from None

    def __getitem__(self, index: Any) -> Any:
        number = range(len(self))[index]
        if not isinstance(number, int):
            return tuple(self[k] for k in number)
        offset, shape, kind = self._spots[number]
        if 0 in shape:
            return np.zeros(shape, dtype=kind)
        array = self._mapped(offset, shape, kind)
        return array if self.change is None else self.change(number, array)

    def _mapped(self, offset: int, shape: tuple[int, ...], kind: np.dtype[Any]) -> Array:
        """A read-only view of a part of the file; its pages go with the last view of them."""
        before = offset % ALLOCATIONGRANULARITY
        count = prod(shape)
        pages = mmap(
            self._file.fileno(),
            before + count * kind.itemsize,
            access=ACCESS_READ,
            offset=offset - before,
        )
        return np.frombuffer(pages, dtype=kind, count=count, offset=before).reshape(shape)
