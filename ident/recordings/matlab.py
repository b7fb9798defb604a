"""MATLAB files (to version 7.2): arrays and structs of arrays as columns."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ident.errors import RecordingError
from ident.recordings.columns import Table
from ident.recordings.parquet import columns_of
from ident.recordings.session_toml import SessionFile
from ident.recordings.spread import flatten


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
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise RecordingError(path, "is a MATLAB 7.3 file (HDF5)", "write it with save(…, '-v7')") from None
    except Exception as error:  # zlib, struct, NumPy and the reader each raise their own
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise RecordingError(path, f"not a MATLAB file ({reason})", "write it with save(…, '-v7')") from None
    arrays = {name: np.squeeze(values) for name, values in flatten(content).items()}
    return {name: values for name, values in arrays.items() if values.ndim}
