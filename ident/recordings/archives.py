"""Named arrays: NumPy archives, and MATLAB files to version 7.2. An array of two dimensions is as many columns."""

from __future__ import annotations

import math
import struct
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RecordingError, first_line
from ident.recordings.bad_cells import named_columns
from ident.recordings.columns import TIME, NamedColumns, is_native
from ident.recordings.parquet import MOST_PLACES
from ident.recordings.recording import CHANNELS
from ident.safe_read import DEEPEST, read_arrays, require_regular, require_unpacked

# Of a MATLAB file: bytes before the first element; kind of a packed one; what is unpacked at a time.
HEADER, PACKED, BLOCK = 128, 15, 1 << 20
# Its version, in either order of bytes; kinds of elements that hold numbers or texts, and the one that holds others;
# classes of arrays that hold numbers or texts alone.
VERSION_5, MATRIX, SIZES, SPARSE, PLAIN = (b"\x00\x01", b"\x01\x00"), 14, 5, 5, range(4, 16)
KINDS = (*range(1, 8), 9, 12, 13, MATRIX, 16, 17, 18)


def open_arrays(path: Path, always: bool = False) -> NamedColumns:
    """Native columns, or arrays `position`, `velocity`, `effort`, … of all joints with `joints`; or any names.

    Fields of MATLAB's structs are `struct.field`.

    Args:
        path: A .npz or .mat file.
        always: Whether an array `position` without `joints` is as good as one under any other name.

    Raises:
        RecordingError: Not an archive, or no names of the joints; when columns are read: different lengths.
    """
    packed = path.suffix.lower() == ".mat"
    named = load_mat(path) if packed else read_arrays(path, "write it with numpy.savez", RecordingError)
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
        raise RecordingError(f"{path}, array joints", f"names {twice!r} twice", "give each joint one column")
    columns = {TIME: np.atleast_1d(arrays[TIME])} if TIME in arrays else {}
    for channel in (one for one in CHANNELS if one in arrays):
        values = arrays[channel]
        if values.ndim != 2 or values.shape[1] != len(joints):
            remedy = f"make it (samples, {len(joints)} joints)"
            raise RecordingError(f"{path}, array {channel}", f"has shape {values.shape}", remedy)
        columns.update({f"{joint}/{channel}": values[:, index] for index, joint in enumerate(joints)})
    return columns


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
        if values.ndim not in (1, 2) or values.shape[0] != samples:
            continue
        if values.ndim == 1 or values.shape[1] == 1:
            columns[name] = values.reshape(-1)
        elif values.shape[1] <= MOST_PLACES:
            columns.update({f"{name}.{i}": values[:, i] for i in range(values.shape[1])})
    return columns


def load_mat(path: Path) -> dict[str, np.ndarray]:
    """All arrays of a .mat file by their dotted names, without their dimensions of one.

    Raises:
        RecordingError: Not a MATLAB file, or one of version 7.3, which is HDF5.
    """
    from scipy.io import loadmat

    remedy = "write it with save(…, '-v7')"
    try:
        _require_elements(path)
        waiting: list[tuple[str, Any]] = [("", loadmat(path, simplify_cells=True))]
        arrays: dict[str, np.ndarray] = {}
        while waiting:
            name, value = waiting.pop(0)
            if isinstance(value, Mapping):
                inner = [(f"{name}.{key}" if name else key, one) for key, one in value.items() if key[:2] != "__"]
                waiting = [*inner, *waiting]
            else:
                arrays[name] = np.squeeze(np.asarray(value))
    except NotImplementedError:
        raise RecordingError(path, "is a MATLAB 7.3 file (HDF5)", remedy) from None
    except Exception as error:  # zlib, struct, NumPy and the reader each raise their own
        raise RecordingError(path, f"not a MATLAB file ({first_line(error)})", remedy) from None
    return {name: values for name, values in arrays.items() if values.ndim}


def _require_elements(path: Path) -> None:
    """Raises ValueError for packed arrays far larger than their file, and for parts by which scipy's reader crashes.

    Source: MAT-File Format, "MAT-file data elements": a tag of kind and size; kind 15 is packed by zlib.
    """
    size, unpacked = require_regular(path, "give a MATLAB file", RecordingError), 0
    with path.open("rb") as file:
        head = file.read(HEADER)
        order = "<" if head[-2:] == b"IM" else ">"
        while head[124:126] in VERSION_5 and len(tag := file.read(8)) == 8:
            kind, length = struct.unpack(f"{order}II", tag)
            end, packed, element = file.tell() + length, zlib.decompressobj(), bytearray()
            while kind == PACKED and file.tell() < end and (block := file.read(min(BLOCK, end - file.tell()))):
                while block:
                    element += packed.decompress(block, BLOCK)
                    require_unpacked(size, unpacked + len(element))
                    block = packed.unconsumed_tail
            unpacked += len(element)
            _require_parts(memoryview(element if kind == PACKED else tag + file.read(length)), order, 0)
            file.seek(end)


def _require_parts(data: memoryview, order: str, depth: int) -> None:
    """Raises ValueError where elements are of no kind, go on beyond the one that holds them, or nest without end."""
    at, kind_of_array = 0, 0
    while at < len(data):
        kind, length = struct.unpack_from(f"{order}II", data, at)
        begin, step = at + 8, 8 + length + -length % 8
        if kind >> 16:  # four bytes at most stand in the tag itself
            kind, length, begin, step = kind & 0xFFFF, kind >> 16, at + 4, 8
        inside = begin + length <= (at + 8 if begin == at + 4 else len(data))
        if kind not in KINDS or not inside or depth > DEEPEST or (kind == MATRIX and kind_of_array in PLAIN):
            raise ValueError(f"an element of kind {kind} and {length} bytes")
        if kind == MATRIX:
            _require_parts(data[begin : begin + length], order, depth + 1)
        elif depth and at == 0:
            kind_of_array = struct.unpack_from(f"{order}I", data, begin)[0] & 0xFF
            if kind_of_array == SPARSE:
                raise ValueError("a sparse array: save the recording without it")
        elif depth and at == 16 and kind == SIZES:  # behind the flags; an entry takes a byte at least
            size = math.prod(struct.unpack_from(f"{order}{length // 4}i", data, begin))
            if not 0 <= size <= len(data):
                raise ValueError(f"an array of {size} entries in {len(data)} bytes")
        at += step
