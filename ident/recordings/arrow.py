"""Arrow's columns of doubles as NumPy arrays. Arrow's own `to_numpy` loads pandas where there is one: half a second."""

from __future__ import annotations

import numpy as np
import pyarrow as pa


def as_numbers(column: pa.ChunkedArray | pa.DoubleArray) -> np.ndarray:
    """The numbers of a column of doubles; NaN where there is none."""
    chunks = column.chunks if isinstance(column, pa.ChunkedArray) else [column]
    parts = [_chunk(chunk) for chunk in chunks if len(chunk)]
    return np.concatenate([np.empty(0), *parts]) if len(parts) != 1 else parts[0]


def _chunk(chunk: pa.DoubleArray) -> np.ndarray:
    if chunk.null_count:
        return np.asarray(chunk.to_numpy(zero_copy_only=False))
    return np.frombuffer(chunk.buffers()[1], dtype=float)[chunk.offset : chunk.offset + len(chunk)]
