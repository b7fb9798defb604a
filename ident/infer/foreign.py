"""Foreign tables of any kind that recordings can be in, as named columns of numbers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.recordings.lerobot import is_dataset, longest_episode
from ident.recordings.load import open_run


@dataclass(frozen=True, eq=False)
class ForeignTable:
    """Columns of one run under their own names.

    Attributes:
        source: The file.
        columns: Name -> numbers, all of one length, in the file's order; a column without a name by its number.
        has_names: Whether the file names its columns.
        rate_hz: Rate that the file states [Hz], or None.
    """

    source: Path
    columns: dict[str, Float[Array, " T"]]
    has_names: bool = True
    rate_hz: float | None = None


def read_foreign(path: Path) -> ForeignTable:
    """Reads all columns of a table, a bag or a data set that hold some numbers, and have the usual length.

    Raises:
        RecordingError: It can't be read, or holds no numbers.
    """
    has_names, rate = True, None
    if is_dataset(path):
        columns, rate = longest_episode(path)
    else:
        run = open_run(path, None)
        columns, has_names = dict(run.numbers()), run.has_names
    lengths = [len(values) for values in columns.values()]
    usual = max(set(lengths), key=lengths.count, default=0)
    kept = {name: one for name, one in columns.items() if len(one) == usual and np.isfinite(one).any()}
    return ForeignTable(path, kept, has_names, rate)
