"""NumPy archives. An array of two dimensions is as many columns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.recordings.bad_cells import named_columns
from ident.recordings.columns import TIME, NamedColumns, is_native
from ident.recordings.parquet import MOST_PLACES
from ident.recordings.recording import CHANNELS
from ident.safe_read import read_arrays


def open_arrays(path: Path, always: bool = False) -> NamedColumns:
    """The columns of an archive of arrays, read when they are asked for.

    Native columns, or arrays `position`, `velocity`, `effort`, … of all joints with `joints`; or
    any names.

    Args:
        path: The archive.
        always: Whether an array `position` without `joints` is as good as one under any other name.

    Raises:
        RecordingError: Not an archive, or no names of the joints; when columns are read: different
            lengths.
    """
    named = read_arrays(path, "write it with numpy.savez", RecordingError)
    stacked = "position" in named and ("joints" in named or not always)
    arrays = _unstack(named, path) if stacked else spread_arrays(named)
    names = tuple(arrays)

    def is_column(values: np.ndarray) -> bool:
        return values.ndim == 1 and values.dtype.kind in "fiu"

    def load(chosen: Sequence[int]) -> list[Float[Array, " T"]]:
        for name in (names[index] for index in chosen):
            if not is_column(arrays[name]):
                what = f"has {arrays[name].ndim} dimensions of {arrays[name].dtype}"
                remedy = "a native column is one-dimensional and holds numbers"
                raise RecordingError(f"{path}, array {name}", what, remedy)
        return [arrays[names[index]].astype(float) for index in chosen]

    def numbers() -> dict[str, Float[Array, " T"]]:
        return {name: values.astype(float) for name, values in arrays.items() if is_column(values)}

    return named_columns(names, load, path, numbers)


def _unstack(arrays: Mapping[str, np.ndarray], path: Path) -> dict[str, np.ndarray]:
    """2-D arrays of all joints -> one column a joint and channel."""
    if "joints" not in arrays:
        raise RecordingError(path, "has no array joints", "add the names: joints = ['joint_1', …]")
    joints = [str(name) for name in np.atleast_1d(arrays["joints"])]
    twice = next((name for name in joints if joints.count(name) > 1), None)
    if twice is not None:
        raise RecordingError(
            f"{path}, array joints", f"names {twice!r} twice", "give each joint one column"
        )
    columns = {TIME: np.atleast_1d(arrays[TIME])} if TIME in arrays else {}
    for channel in (channel for channel in CHANNELS if channel in arrays):
        values = arrays[channel]
        if values.ndim != 2 or values.shape[1] != len(joints):
            remedy = f"make it (samples, {len(joints)} joints)"
            raise RecordingError(f"{path}, array {channel}", f"has shape {values.shape}", remedy)
        columns.update(
            {f"{joint}/{channel}": values[:, index] for index, joint in enumerate(joints)}
        )
    return columns


def spread_arrays(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays of one and two dimensions as columns of equal length; what holds no samples is left
    out.

    The samples' number is the length that most arrays have along some axis, the longer one
    counting. Arrays of native names stay as they are.

    Returns:
        By name; the columns of a table are `<name>.0`, `<name>.1`, …
    """
    if not any(values.ndim == 2 for values in arrays.values()):
        return dict(arrays)
    numeric = {name: values for name, values in arrays.items() if values.dtype.kind in "fiu"}
    lengths = Counter(
        max(values.shape) for values in numeric.values() if values.ndim in (1, 2) and values.size
    )
    samples = max(lengths, key=lambda length: (lengths[length], length), default=0)
    columns: dict[str, np.ndarray] = {}
    for name, values in arrays.items():
        if name not in numeric or is_native(name):
            columns[name] = values
            continue
        values = values.T if values.ndim == 2 and values.shape[0] != samples else values
        if values.ndim not in (1, 2) or values.shape[0] != samples:
            continue
        if values.ndim == 1 or values.shape[1] == 1:
            columns[name] = values.reshape(-1)
        elif values.shape[1] <= MOST_PLACES:
            for i in range(values.shape[1]):
                columns[f"{name}.{i}"] = values[:, i]
    return columns
