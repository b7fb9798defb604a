"""Files of settings, results and arrays, looked at before they are read: no device, no pipe,
nothing without an end.
"""

from __future__ import annotations

import json
import math
import os
import re
import stat
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.errors import InputError, first_line

if TYPE_CHECKING:
    import numpy as np

# Settings and results are some kilobytes, a diagnosis of hundreds of runs some megabytes [bytes].
LARGEST_TEXT = 1 << 28
# Settings are written by hand [bytes].
LARGEST_TOML = 1 << 24
# Tables and elements of robots nest three to five levels deep; far fewer than this where Python's
# own recursion ends.
DEEPEST = 64
# The time that the reader of TOML takes for a dotted key grows with the square of its parts.
LONG_KEY = re.compile(
    rf"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{DEEPEST}}}"""
)
# Halves of a character, which JSON can write and no file can hold.
HALF = re.compile("[\ud800-\udfff]")
# Beyond these no number of an arm lies; integers beyond become infinite or raise errors in
# arithmetic.
LARGEST_INTEGER = 2**63
# No figure of an arm in SI units lies beyond; its square and its cube can still be reckoned with.
LARGEST_FIGURE = 1e12
# Recorded floats pack to a third at best; a constant channel to a thousandth, but that is not all
# of a recording.
LARGEST_PACKING = 100
# Of a file that somebody writes, or puts in another's place, while it is read.
CHANGED = "it changed while it was read"
AGAIN = "read it again once nothing writes to it"
# What a file may unpack to however small it is [MB]: the default, and the variable by which a user
# sets another.
LEAST_UNPACKED = 256.0
UNPACKED_BY = "ARMGAP_MOST_UNPACKED_MB"


def require_regular(
    path: Path, remedy: str, error: type[InputError] = InputError, largest: int | None = None
) -> int:
    """Passes if a path is a plain file, not larger than some size; returns its size [bytes].

    Raises:
        InputError: Nothing there, a folder, a device, a pipe, or too large.
    """
    try:
        status = path.stat()
    except (OSError, ValueError) as failed:
        raise _unreadable(path, failed, remedy, error) from None
    return _regular_size(path, status, remedy, error, largest)


def _regular_size(
    path: Path,
    status: os.stat_result,
    remedy: str,
    error: type[InputError],
    largest: int | None,
) -> int:
    """Size of what a status is of [bytes]; raises where that is no plain file, or too large."""
    if stat.S_ISDIR(status.st_mode):
        raise error(path, "is a folder, not a file", remedy)
    if not stat.S_ISREG(status.st_mode):
        raise error(path, "is a device or a pipe, not a file", remedy)
    if largest is not None and status.st_size > largest:
        what = f"is {status.st_size / 1e6:.0f} MB large, which no file of its kind is"
        raise error(path, what, remedy)
    return status.st_size


def _unreadable(path: Path, failed: Exception, remedy: str, error: type[InputError]) -> InputError:
    reason = getattr(failed, "strerror", None) or str(failed)
    return error(path, f"can't be read ({reason})", remedy)


def open_regular(
    path: Path, remedy: str, error: type[InputError] = InputError, largest: int | None = None
) -> BufferedReader:
    """A plain file, open for reading: what is looked at is what was opened.

    Its name may lead elsewhere later.

    Raises:
        InputError: As `require_regular`.
    """
    require_regular(path, remedy, error, largest)  # a device is not even opened
    try:
        # Not waiting: a pipe may have taken the file's place since.
        flags = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        descriptor = os.open(path, os.O_RDONLY | flags)
    except (OSError, ValueError) as failed:
        raise _unreadable(path, failed, remedy, error) from None
    stream = os.fdopen(descriptor, "rb")
    try:
        _regular_size(path, os.fstat(descriptor), remedy, error, largest)
    except InputError:
        stream.close()
        raise
    return stream


def read_bytes(
    path: Path,
    remedy: str,
    error: type[InputError] = InputError,
    largest: int = LARGEST_TEXT,
) -> bytes:
    """All bytes of a small file, read once: who checks them hands these on, not the file's name.

    Raises:
        InputError: As `require_regular`; or the file grows while it is read.
    """
    with open_regular(path, remedy, error, largest) as stream:
        size = os.fstat(stream.fileno()).st_size
        try:
            data = stream.read(size + 1)
        except OSError as failed:
            raise _unreadable(path, failed, remedy, error) from None
    if len(data) != size:
        raise error(path, CHANGED, AGAIN)
    return data


def read_text(
    path: Path, remedy: str, error: type[InputError] = InputError, largest: int = LARGEST_TEXT
) -> str:
    """The text of a small UTF-8 file.

    Raises:
        InputError: As `read_bytes`; or not UTF-8.
    """
    return decode(read_bytes(path, remedy, error, largest), path, remedy, error)


def decode(
    data: bytes,
    where: str | Path,
    remedy: str,
    error: type[InputError] = InputError,
) -> str:
    """The text that bytes of UTF-8 are, lines ended as Python ends them.

    Raises:
        InputError: Not UTF-8.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as failed:
        what = f"is not UTF-8 text ({failed.reason} at byte {failed.start})"
        raise error(where, what, remedy) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


@dataclass(frozen=True)
class FileState:
    """Which file a name leads to, and when that was changed: another state is another content."""

    device: int
    inode: int
    size: int  # [bytes]
    written_ns: int  # of its content
    changed_ns: int  # of its content, name or rights; nobody sets it at will

    @classmethod
    def of(cls, path: Path) -> FileState | None:
        """The state of a file; None where there is none."""
        try:
            status = path.stat()
        except (OSError, ValueError):
            return None
        times = (status.st_mtime_ns, status.st_ctime_ns)
        return cls(status.st_dev, status.st_ino, status.st_size, *times)


def _states(path: Path) -> dict[str, FileState | None]:
    """The states of a file, or of all that lies in a folder."""
    names = [path]
    with suppress(OSError):
        names += sorted(path.iterdir()) if path.is_dir() else []
    return {name.name: FileState.of(name) for name in names}


@contextmanager
def unchanged(
    path: Path,
    error: type[InputError] = InputError,
    where: str | Path | None = None,
) -> Iterator[None]:
    """Lets a block look at a file, or at a bag's folder, several times, by its name.

    Args:
        path: The file or folder.
        error: What is raised.
        where: The place to name, if not the path.

    Raises:
        InputError: It is not at the end what it was at the beginning.
    """
    before = _states(path)
    place = path if where is None else where
    try:
        yield
    except Exception:  # whatever a half of this file and a half of that one lead to
        if _states(path) != before:
            raise error(place, CHANGED, AGAIN) from None
        raise
    if _states(path) != before:
        raise error(place, CHANGED, AGAIN)


def read_json(path: Path, remedy: str, error: type[InputError] = InputError) -> dict[str, Any]:
    """The object in a JSON file.

    Raises:
        InputError: As `read_text`; or not JSON, no object, too deep, with a key twice, half of a
            character, integers beyond 64 bit or other numbers beyond double precision.
    """
    return parse_json(read_text(path, remedy, error), path, remedy, error)


def parse_json(
    text: str, where: str | Path, remedy: str, error: type[InputError] = InputError
) -> dict[str, Any]:
    """The object that a JSON text holds.

    Args:
        text: The text.
        where: The file, or its line, for messages.
        remedy, error: What the user can do about another text; what is raised.

    Raises:
        InputError: Not JSON, no object, too deep, or with integers beyond 64 bit.
    """
    try:
        record = json.loads(text, parse_constant=_no_number, object_pairs_hook=_single_keys)
        _look_through(record)
    except (ValueError, RecursionError) as failed:
        raise error(where, f"not JSON that can be used ({first_line(failed)})", remedy) from None
    if not isinstance(record, dict):
        raise error(where, "holds no JSON object", remedy)
    return record


def read_record(path: Path, schema: str | tuple[str, ...], remedy: str) -> dict[str, Any]:
    """The object in a JSON file of a schema of ours, or of one of several.

    Raises:
        InputError: As `read_json`; or of another schema.
    """
    record = read_json(path, remedy)
    wanted = (schema,) if isinstance(schema, str) else schema
    if record.get("schema") not in wanted:
        raise InputError(path, f"its schema is {record.get('schema')!r}, not {wanted[0]!r}", remedy)
    return record


def read_toml(path: Path, remedy: str, error: type[InputError] = InputError) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        InputError: As `read_text`; or not TOML, too deep, or with integers beyond 64 bit.
    """
    text = read_text(path, remedy, error, LARGEST_TOML)
    if LONG_KEY.search(text):
        raise error(path, f"not TOML that can be used (a key of more than {DEEPEST} parts)", remedy)
    try:
        record = tomllib.loads(text)
        _look_through(record, allows_infinite=True)
    except (ValueError, RecursionError) as failed:
        raise error(path, f"not TOML ({first_line(failed)})", remedy) from None
    return record


def read_arrays(
    path: Path, remedy: str, error: type[InputError] = InputError
) -> dict[str, np.ndarray]:
    """The plain arrays of a NumPy archive; nothing is unpickled, nothing larger than its file lets
    expect is made.

    Raises:
        InputError: As `require_regular`; or not such an archive.
    """
    import numpy as np  # slow to load, and a command's help reads no arrays

    try:
        file = open_regular(path, remedy, error)
        with file, np.load(file, allow_pickle=False) as archive:
            # Nobody's recording of floats is far larger than its file.
            unpacked = sum(entry.file_size for entry in archive.zip.infolist())
            require_unpacked(os.fstat(file.fileno()).st_size, unpacked)
            for name in (names := archive.zip.namelist()):
                if names.count(name) > 1:
                    raise ValueError(f"it holds {name!r} twice")
                with archive.zip.open(name) as stream:
                    old = np.lib.format.read_magic(stream) == (1, 0)
                    read = (
                        np.lib.format.read_array_header_1_0
                        if old
                        else np.lib.format.read_array_header_2_0
                    )
                    shape, _, kind = read(stream)
                size = archive.zip.getinfo(name).file_size
                if (
                    math.prod(shape) * kind.itemsize > size
                ):  # its header speaks of more numbers than follow
                    raise ValueError(f"an array of shape {shape} in {size} bytes")
            return {name: np.asarray(archive[name]) for name in archive.files}
    except InputError:
        raise
    except Exception as failed:  # zipfile, zlib, struct and NumPy each raise their own
        raise error(
            path, f"not a NumPy archive of plain arrays ({first_line(failed)})", remedy
        ) from None


def require_unpacked(packed: int, unpacked: int) -> None:
    """Passes if what a file unpacks to is in proportion to its size: one limit for every kind of
    file.

    Raises:
        ValueError: It is more than `LARGEST_PACKING` times the file, and more than the user's
            limit.
    """
    try:
        least = float(os.environ.get(UNPACKED_BY, LEAST_UNPACKED)) * 1e6
    except ValueError:
        least = LEAST_UNPACKED * 1e6
    if unpacked > max(LARGEST_PACKING * packed, least):
        sizes = f"{packed / 1e6:.1f} MB unpack to {unpacked / 1e9:.1f} GB or more"
        raise ValueError(f"{sizes}; {UNPACKED_BY} allows it")


def toml_key(name: str) -> str:
    """A name as it must stand before the `=` of a TOML file."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def toml_line(key: str, value: object) -> str:
    """A key and its value as one line of a TOML file, without a line end; a table within braces."""
    return f"{toml_key(key)} = {_toml_value(value)}"


def _toml_value(value: object) -> str:
    if isinstance(value, Mapping):
        return f"{{{', '.join(toml_line(key, entry) for key, entry in value.items())}}}"
    return json.dumps(value, ensure_ascii=False)


def require_finite(value: Any, name: str) -> float:
    """A finite number that a figure of an arm can be, or ValueError: texts, truth values, NaN and
    infinity are none.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} is {value!r}, which is no finite number")
    if abs(value) > LARGEST_FIGURE:
        raise ValueError(f"{name} is {value:g}, beyond any arm's")
    return float(value)


def _look_through(record: object, allows_infinite: bool = False) -> None:
    """Raises ValueError for what would end in an overflow or in a recursion without end."""
    waiting: list[tuple[Any, int]] = [(record, 0)]
    while waiting:
        value, depth = waiting.pop()
        if depth > DEEPEST:
            raise ValueError(f"more than {DEEPEST} levels deep")
        if isinstance(value, dict):
            waiting += [(name, depth) for name in value]
            waiting += [(inner, depth + 1) for inner in value.values()]
        elif isinstance(value, list):
            waiting += [(element, depth + 1) for element in value]
        elif isinstance(value, str) and HALF.search(value):
            raise ValueError("half of a character in a text")
        elif isinstance(value, int) and abs(value) > LARGEST_INTEGER:
            raise ValueError("an integer of more than 64 bit")
        elif isinstance(value, float) and math.isinf(value) and not allows_infinite:
            raise ValueError("a number beyond double precision")


def _single_keys(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """A table of JSON, or ValueError where a key stands twice: readers would take either one."""
    record: dict[str, object] = {}
    for name, value in pairs:
        if name in record:
            raise ValueError(f"the key {name!r} stands twice")
        record[name] = value
    return record


def _no_number(name: str) -> None:
    """What `NaN` and `Infinity` are, which are not JSON; earlier versions wrote them."""


def urdf_from(file: Path, robot: str) -> str:
    """The robot that a file names: a URDF by its path from the file's folder on, where it is there.

    The last joint of one of its arms may stand behind the path: `../robot.urdf:left_wrist`.
    """
    whole, colon, tip = robot.rpartition(":")
    for path, arm in ((robot, ""), (whole, colon + tip)):
        beside = file.parent / path
        if path.endswith((".urdf", ".xml", ".xacro")) and beside.is_file():
            return f"{beside}{arm}"
    return robot
