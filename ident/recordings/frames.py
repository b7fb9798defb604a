"""Tables in memory -> recordings: pandas, Polars, pyarrow, or a mapping of arrays, with the native columns' names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ident.errors import RecordingError, first_line
from ident.recordings.archives import unequal
from ident.recordings.bad_cells import screen_cells
from ident.recordings.columns import NamedColumns, Table, take_run
from ident.recordings.load import join_runs
from ident.recordings.parquet import column_numbers
from ident.recordings.recording import Recording, Session
from ident.recordings.session_toml import SessionFile

Source = str | Path | Session | Recording | Any
PathOrSession = str | Path | Session
HINT = "give a folder or file of runs, a Session, or a table with the columns time, <joint>/position, <joint>/effort"


def is_frame(source: object) -> bool:
    """Whether something is a table in memory: whatever speaks Arrow, an older pandas frame, a mapping of arrays."""
    return isinstance(source, Mapping) or hasattr(source, "__arrow_c_stream__") or _is_pandas(source)


def read_frame(frame: Any, name: str = "frame", settings: SessionFile | None = None) -> Recording:
    """One run from a table in memory, as from a file of the same columns.

    Args:
        frame: A table of pandas, Polars or pyarrow, or a mapping of names to arrays; columns as of a native table.
        name: Name of the run, and of the table in messages.
        settings: As of a session.toml.

    Raises:
        RecordingError: No table, a needed column is missing or holds no numbers, columns of different lengths.
    """
    table, path, settings = _as_table(frame, name), Path(name), settings or SessionFile()
    names = tuple(table.column_names)
    if not table.num_rows:
        raise RecordingError(name, "has no rows", "give a table with samples")

    def read(chosen: Mapping[int, str]) -> Table:
        columns = {native: column_numbers(table.column(index), names[index], name) for index, native in chosen.items()}
        return screen_cells(columns, path)

    return take_run(name, NamedColumns(names, read, dict), settings, path).replace(source=None)


def gather_sources(source: Source | Sequence[Source], settings: SessionFile | None = None) -> list[PathOrSession]:
    """What a user gave as recordings, as a list of paths and sessions.

    A list of paths or sessions is so many sessions; tables and recordings that follow each other are the runs of one.

    Raises:
        RecordingError: Something that holds no recording; nothing at all.
    """
    listed = list(source) if isinstance(source, list | tuple) else [source]
    found: list[PathOrSession] = []
    runs: list[Recording] = []
    for one in listed:
        if isinstance(one, Recording):
            runs.append(one)
        elif is_frame(one):
            runs.append(read_frame(one, f"table_{len(runs) + 1:02}", settings))
        else:
            _close(runs, found)
            if not isinstance(one, str | Path | Session):
                raise RecordingError("source", f"a {type(one).__name__} holds no recording", HINT)
            found.append(one)
    _close(runs, found)
    if not found:
        raise RecordingError("source", "holds no recording", HINT)
    return found


def _close(runs: list[Recording], found: list[PathOrSession]) -> None:
    """The runs so far become a session."""
    if runs:
        found.append(join_runs(runs, f"tables_{len(found) + 1}"))
        runs.clear()


def _is_pandas(source: object) -> bool:
    return type(source).__module__.split(".")[0] == "pandas" and hasattr(source, "columns")


def _as_table(frame: Any, name: str) -> pa.Table:
    try:
        if not isinstance(frame, Mapping):
            return pa.Table.from_pandas(frame, preserve_index=False) if _is_pandas(frame) else pa.table(frame)
        arrays = {str(key): np.asarray(values) for key, values in frame.items()}
        for key, values in arrays.items():
            if values.ndim != 1:
                what = f"has {values.ndim} dimensions"
                raise RecordingError(f"{name}, column {key}", what, "give one array a column")
        lengths = {key: len(values) for key, values in arrays.items()}
        if len(set(lengths.values())) > 1:
            raise RecordingError(name, *unequal(lengths))
        return pa.table(arrays)
    except (pa.ArrowInvalid, pa.ArrowTypeError, pa.ArrowNotImplementedError, TypeError, ValueError) as error:
        raise RecordingError(name, f"is no table of numbers ({first_line(error)})", HINT) from None
