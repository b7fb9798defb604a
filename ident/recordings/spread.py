"""Columns that hold several numbers a sample: lists of Parquet, arrays of two dimensions. Each number gets a name.

The numbers of `q` are `q.0`, `q.1`, …, or `q.<label>` where the file names them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from ident.recordings.columns import is_native

# A list longer than this is a picture or a cloud of points, no joints.
MOST_PLACES = 64


def list_length(column: pa.ChunkedArray) -> int:
    """How many numbers the first list of a column holds; 0 where it holds none, or is no list of numbers."""
    kind = column.type
    if pa.types.is_fixed_size_list(kind):
        length = int(kind.list_size)
    elif pa.types.is_list(kind) or pa.types.is_large_list(kind):
        first = next((one for chunk in column.chunks for one in chunk if one.is_valid), None)
        length = 0 if first is None else len(first)
    else:
        return 0
    numeric = pa.types.is_floating(kind.value_type) or pa.types.is_integer(kind.value_type)
    return length if numeric and length <= MOST_PLACES else 0


def spread_list(
    name: str, column: pa.ChunkedArray, labels: Sequence[str] = ()
) -> dict[str, pa.ChunkedArray | pa.Array]:
    """A column of lists as columns of numbers; a column of numbers as it is.

    Args:
        name: Its name.
        column: Lists of the same length; shorter ones lack numbers.
        labels: What the numbers are called; 0, 1, … if there are not as many.
    """
    length = list_length(column)
    if not length:
        return {name: column}
    import pyarrow.compute as pc  # slow to load, and few tables hold lists

    own = labels if len(set(labels)) == length else [str(i) for i in range(length)]
    return {f"{name}.{label}": pc.list_element(column, i) for i, label in enumerate(own)}


def spread_arrays(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays of one and two dimensions as columns of equal length; what holds no samples is left out.

    The samples' number is the length that most arrays have along some axis, the longer one counting. Arrays of native
    names stay as they are.
    """
    if not any(values.ndim == 2 for values in arrays.values()):
        return dict(arrays)
    numeric = {name: values for name, values in arrays.items() if values.dtype.kind in "fiu"}
    lengths = Counter(max(values.shape) for values in numeric.values() if values.ndim in (1, 2) and values.size)
    samples = max(lengths, key=lambda length: (lengths[length], length), default=0)
    columns: dict[str, np.ndarray] = {}
    for name, values in arrays.items():
        if name not in numeric or is_native(name):
            columns[name] = values
            continue
        values = values.T if values.ndim == 2 and values.shape[0] != samples else values
        if values.ndim == 0 or values.shape[0] != samples or values.ndim > 2:
            continue
        if values.ndim == 1 or values.shape[1] == 1:
            columns[name] = values.reshape(-1)
        elif values.shape[1] <= MOST_PLACES:
            columns.update({f"{name}.{i}": values[:, i] for i in range(values.shape[1])})
    return columns


def flatten(record: Mapping[str, Any], prefix: str = "") -> dict[str, np.ndarray]:
    """The arrays of nested records by their dotted names."""
    found: dict[str, np.ndarray] = {}
    for name, value in record.items():
        if isinstance(value, Mapping):
            found.update(flatten(value, f"{prefix}{name}."))
        elif not name.startswith("__"):
            found[f"{prefix}{name}"] = np.asarray(value)
    return found
