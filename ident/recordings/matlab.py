"""MATLAB files (to version 7.2): arrays and structs of arrays as columns."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

from ident.errors import RecordingError
from ident.recordings.columns import Table
from ident.recordings.parquet import columns_of
from ident.recordings.session_toml import SessionFile
from ident.recordings.spread import flatten
from ident.safe_read import require_regular, require_unpacked

# Bytes before the first element; kind of a packed one; what is unpacked at a time.
HEADER, PACKED, BLOCK = 128, 15, 1 << 20


def read_mat(path: Path, session_file: SessionFile) -> tuple[Table, tuple[str, ...]]:
    """Reads a .mat file as a NumPy archive of the same arrays would be read; fields of structs are `struct.field`.

    Raises:
        RecordingError: Not a MATLAB file, or one of version 7.3, which is HDF5.
    """
    return columns_of(load_mat(path), path, session_file)


def load_mat(path: Path) -> dict[str, np.ndarray]:
    """All arrays of a .mat file, without their dimensions of one.

    Raises:
        RecordingError: As `read_mat`.
    """
    from scipy.io import loadmat

    try:
        _require_elements(path)
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise RecordingError(path, "is a MATLAB 7.3 file (HDF5)", "write it with save(…, '-v7')") from None
    except Exception as error:  # zlib, struct, NumPy and the reader each raise their own
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise RecordingError(path, f"not a MATLAB file ({reason})", "write it with save(…, '-v7')") from None
    arrays = {name: np.squeeze(values) for name, values in flatten(content).items()}
    return {name: values for name, values in arrays.items() if values.ndim}


def _require_elements(path: Path) -> None:
    """Raises ValueError for packed arrays far larger than their file.

    Source: MAT-File Format, "MAT-file data elements": a tag of kind and size; kind 15 is packed by zlib.
    """
    size, unpacked = require_regular(path, "give a MATLAB file", RecordingError), 0
    with path.open("rb") as file:
        order = "<" if file.read(HEADER)[-2:] == b"IM" else ">"
        while len(tag := file.read(8)) == 8:
            kind, length = struct.unpack(f"{order}II", tag)
            end, packed = file.tell() + length, zlib.decompressobj()
            while kind == PACKED and file.tell() < end and (block := file.read(min(BLOCK, end - file.tell()))):
                while block:
                    unpacked += len(packed.decompress(block, BLOCK))
                    require_unpacked(size, unpacked)
                    block = packed.unconsumed_tail
            file.seek(end)
