"""Parquet files and NumPy archives."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.recordings.arrow import as_numbers
from ident.recordings.bad_cells import screen_cells
from ident.recordings.columns import TIME, Table, native_names
from ident.recordings.recording import CHANNELS
from ident.recordings.session_toml import SessionFile
from ident.recordings.spread import list_length, spread_arrays, spread_list
from ident.safe_read import read_arrays, require_regular, require_unpacked

if TYPE_CHECKING:
    import pyarrow.parquet as pq

# How an ISO 8601 time ends that says its zone.
ZONE = re.compile(r"(Z|[+-]\d\d:?\d\d)$")


def read_parquet(path: Path, session_file: SessionFile) -> tuple[Table, tuple[str, ...]]:
    """Reads the native columns of a Parquet file, and tells the file's own column names.

    Raises:
        RecordingError: Not a Parquet file, no rows, or a column that holds no numbers.
    """
    try:
        with open_parquet(path) as file:
            lists = _lists(file)
            names = tuple(spread for name in file.schema_arrow.names for spread in lists.get(name, (name,)))
            chosen = native_names(names, session_file, path)
            table = file.read(columns=_top_names(names, lists, chosen))
            wanted = {names[index] for index in chosen}
            cells = {
                spread: values
                for name in table.column_names
                for spread, values in spread_list(name, table.column(name)).items()
                if spread in wanted
            }
    except RecordingError:
        raise
    except (pa.ArrowException, OSError, ValueError, UnicodeDecodeError) as error:
        raise RecordingError(path, f"not a whole Parquet file ({_first_line(error)})", "write the file again") from None
    if chosen and table.num_rows == 0:
        raise RecordingError(path, "has no rows", "give a table with samples")
    columns = {native: column_numbers(cells[names[i]], names[i], path) for i, native in chosen.items()}
    return screen_cells(columns, path), names


def open_parquet(path: Path) -> pq.ParquetFile:
    """A Parquet file whose numbers are in proportion to its size: constants pack without end.

    Raises:
        RecordingError: No plain file.
        ValueError: It unpacks to more than any recording; pyarrow raises its own where it is none.
    """
    import pyarrow.parquet as pq  # slow to load, and text tables need none

    size = require_regular(path, "give a table", RecordingError)
    file = pq.ParquetFile(path)  # not read_table: that loads all of pyarrow's data sets, at half a second
    groups = [file.metadata.row_group(i) for i in range(file.num_row_groups)]
    require_unpacked(size, 8 * sum(one.column(j).num_values for one in groups for j in range(one.num_columns)))
    return file


def _lists(file: pq.ParquetFile) -> dict[str, list[str]]:
    """Names of the numbers in each column of lists, told from the first row."""
    nested = [one.name for one in file.schema_arrow if pa.types.is_nested(one.type)]
    first = next(file.iter_batches(batch_size=1, columns=nested), None) if nested else None
    if first is None:
        return {}
    columns = {name: pa.chunked_array([first.column(i)]) for i, name in enumerate(first.schema.names)}
    return {name: list(spread_list(name, column)) for name, column in columns.items() if list_length(column)}


def _top_names(names: Sequence[str], lists: Mapping[str, Sequence[str]], chosen: Mapping[int, str]) -> list[str]:
    """The file's own columns that hold the chosen ones, each once."""
    home = {spread: name for name, members in lists.items() for spread in members}
    return list(dict.fromkeys(home.get(names[index], names[index]) for index in chosen))


def column_numbers(column: pa.ChunkedArray | pa.Array, name: str, where: str | Path) -> Float[Array, " T"]:
    """A column as float; timestamps and durations become seconds.

    Raises:
        RecordingError: It holds no numbers.
    """
    try:
        if pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
            column = column.cast(pa.timestamp("ns", "UTC" if ZONE.search(str(column[0])) else None))  # ISO 8601
        if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
            nanoseconds = column.cast(pa.timestamp("ns") if pa.types.is_timestamp(column.type) else pa.duration("ns"))
            return nanoseconds.cast(pa.int64()).to_numpy() * 1e-9
        # A cast loads all of Arrow's functions, at a tenth of a second.
        # Unsafe, as nanoseconds since 1970 need more than 53 bits: a float rounds them to a quarter of a microsecond.
        return as_numbers(column if pa.types.is_float64(column.type) else column.cast(pa.float64(), safe=False))
    except (pa.ArrowException, ValueError, TypeError) as error:
        raise RecordingError(
            f"{where}, column {name}", f"holds no numbers ({_first_line(error)})", "write it as numbers"
        ) from None


def read_npz(path: Path, session_file: SessionFile) -> tuple[Table, tuple[str, ...]]:
    """Reads an archive of native columns, or of 2-D arrays `position`, `velocity`, `effort`, … with `joints`.

    Raises:
        RecordingError: Not an archive, arrays of different lengths, or no names of the joints.
    """
    return columns_of(load_npz(path), path, session_file)


def columns_of(
    arrays: Mapping[str, np.ndarray], path: Path, session_file: SessionFile
) -> tuple[Table, tuple[str, ...]]:
    """The native columns of named arrays: one a column, or one of all joints a channel, under any names.

    Raises:
        RecordingError: As `read_npz`.
    """
    arrays = spread_joints(arrays, path, always=bool(session_file.columns))
    names = tuple(arrays)
    chosen = native_names(names, session_file, path)
    columns: dict[str, Float[Array, " T"]] = {}
    for index, native in chosen.items():
        values = arrays[names[index]]
        if values.ndim != 1 or values.dtype.kind not in "fiu":
            raise RecordingError(
                f"{path}, array {names[index]}",
                f"has {values.ndim} dimensions of {values.dtype}",
                "a native column is one-dimensional and holds numbers",
            )
        columns[native] = values.astype(float)
    lengths = {native: len(values) for native, values in columns.items()}
    if len(set(lengths.values())) > 1:
        first, *rest = lengths
        other = next(name for name in rest if lengths[name] != lengths[first])
        raise RecordingError(
            path, f"{first} has {lengths[first]} samples and {other} {lengths[other]}", "make them equally long"
        )
    if columns and not next(iter(lengths.values())):
        raise RecordingError(path, "has no samples", "give a recording with samples")
    return screen_cells(columns, path), names


def spread_joints(arrays: Mapping[str, np.ndarray], path: Path, always: bool) -> dict[str, np.ndarray]:
    """Arrays of all joints as columns: native ones where the joints are named, else `position.0` and the like.

    Raises:
        RecordingError: An array `position` without `joints`, unless `always`.
    """
    stacked = "position" in arrays and ("joints" in arrays or not always)
    return _unstack(arrays, path) if stacked else spread_arrays(arrays)


def load_npz(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an archive.

    Raises:
        RecordingError: Not one of plain arrays.
    """
    return read_arrays(path, "write it with numpy.savez", RecordingError)


def _unstack(arrays: Mapping[str, np.ndarray], path: Path) -> dict[str, np.ndarray]:
    """2-D arrays of all joints -> one column a joint and channel."""
    if "joints" not in arrays:
        raise RecordingError(path, "has no array joints", "add the names: joints = ['joint_1', …]")
    joints = [str(name) for name in np.atleast_1d(arrays["joints"])]
    twice = next((name for name in joints if joints.count(name) > 1), None)
    if twice is not None:
        raise RecordingError(f"{path}, array joints", f"names {twice!r} twice", "give each joint one column")
    columns = {TIME: np.atleast_1d(arrays[TIME])} if TIME in arrays else {}
    for channel in CHANNELS:
        if channel not in arrays:
            continue
        values = arrays[channel]
        if values.ndim != 2 or values.shape[1] != len(joints):
            raise RecordingError(
                f"{path}, array {channel}", f"has shape {values.shape}", f"make it (samples, {len(joints)} joints)"
            )
        columns.update({f"{joint}/{channel}": values[:, index] for index, joint in enumerate(joints)})
    return columns


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
