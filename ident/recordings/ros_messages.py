"""Messages of ROS bags, read by their definitions.

The package rosbags opens the files. Its own reader of messages writes Python code from the
definitions in a file and runs it; here they are followed step by step, and what is packed is
unpacked no further than a recording needs.
"""

from __future__ import annotations

import bz2
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, Self
from urllib.parse import quote

import numpy as np
from backports import zstd
from lz4.frame import LZ4FrameDecompressor
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import MessageDefinitionFormat, Nodetype
from rosbags.rosbag1 import reader as chunks1
from rosbags.rosbag2 import reader as folders
from rosbags.rosbag2 import storage_mcap, storage_sqlite3
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ident.errors import RecordingError
from ident.safe_read import require_regular, require_unpacked

# Bags written before ROS 2 Iron carry no definitions; those of ROS itself have not changed since.
KNOWN = get_typestore(Stores.ROS2_HUMBLE).fielddefs
# A definition with all that it uses has some kilobytes [bytes]; one list of messages has few.
LARGEST_DEFINITION = 1 << 17
MOST_ENTRIES = 1 << 16
# A bag's list of its topics and files [bytes].
LARGEST_METADATA = 1 << 20
# What a chunk of messages may unpack to: writers make them of some megabytes [bytes].
LARGEST_CHUNK = 1 << 28
# By which the package reads databases.
SQLITE: Any = storage_sqlite3.apsw
# Of a table that is no plain one.
COMPUTED = re.compile(r"(?i)\bvirtual\b|\bas\s*\(")
KINDS = {"bool": "?", "byte": "B", "char": "B", "octet": "B", "float32": "f4", "float64": "f8"}
KINDS |= {
    f"{sign}int{bits}": f"{sign[:1] or 'i'}{bits // 8}"
    for sign in ("", "u")
    for bits in (8, 16, 32, 64)
}
NUMBERS = {name: np.dtype(kind) for name, kind in KINDS.items()}
Record = dict[str, Any]


class Bag:
    """An opened bag of ROS 1 (`.bag`) or ROS 2; a context manager.

    Attributes:
        connections: Its topics, with `topic` and `msgtype`.
    """

    def __init__(self, path: Path) -> None:
        self.old = path.suffix.lower() == ".bag"
        files = [file for file in path.iterdir() if not file.is_dir()] if path.is_dir() else [path]
        self.size = sum(require_regular(file, "give a bag", RecordingError) for file in files)
        metadata = path / "metadata.yaml"
        if metadata in files:
            require_regular(metadata, "give a bag", RecordingError, LARGEST_METADATA)
        self._reader: Any = rosbag1.Reader(path) if self.old else rosbag2.Reader(path)
        self._types: dict[str, Any] = dict(KNOWN)

    def __enter__(self) -> Self:
        self._reader.open()
        self.connections: Sequence[Any] = self._reader.connections
        for connection in self.connections:
            if connection.msgdef.format == MessageDefinitionFormat.MSG:
                size = len(connection.msgdef.data)
                if size > LARGEST_DEFINITION:
                    raise ValueError(f"the definition of {connection.msgtype} has {size} bytes")
                self._types.update(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        return self

    def __exit__(self, *_error: object) -> None:
        self._reader.close()

    def messages(self, connections: Sequence[Any]) -> Iterator[tuple[Any, int, Record]]:
        """Connection, time of receipt [ns] and content of each message; no content where nobody
        defines its type.
        """
        unpacked = 0
        for connection, receipt, raw in self._reader.messages(connections):
            unpacked += len(raw)
            require_unpacked(self.size, unpacked)
            record: Record = {}
            if connection.msgtype in self._types:
                order: Literal["<", ">"] = "<" if self.old or raw[1] & 1 else ">"
                content = memoryview(raw)[0 if self.old else 4 :]
                record = _Bytes(content, order, self._types, aligned=not self.old).record(
                    connection.msgtype
                )
            yield connection, receipt, record


class _Bytes:
    """The bytes of one message, and how far they are read."""

    def __init__(
        self, raw: memoryview, order: Literal["<", ">"], types: dict[str, Any], aligned: bool
    ) -> None:
        self.raw = raw
        self.order = order
        self.types = types
        self.aligned = aligned
        self.at = 0

    def record(self, kind: str) -> Record:
        """All fields of a type, in order."""
        fields = self.types[kind][1]
        if not fields and self.aligned:
            self.at += 1  # a message without fields has a byte on the wire
        return {name: self.value(what) for name, what in fields}

    def value(self, what: Any) -> Any:
        """One field: a number, a text, an array of numbers, a list, or a record."""
        form, inner = what
        if form == Nodetype.NAME:
            return self.record(inner)
        if form == Nodetype.BASE:
            return self.text() if inner[0] == "string" else self.numbers(inner[0], 1)[0]
        entry, count = inner
        if form == Nodetype.SEQUENCE:
            count = int(self.numbers("uint32", 1)[0])
        if entry[0] == Nodetype.BASE and entry[1][0] != "string":
            return self.numbers(entry[1][0], count)
        if count > min(len(self.raw) - self.at, MOST_ENTRIES):
            raise ValueError(f"a list of {count} entries in {len(self.raw)} bytes")
        return [self.value(entry) for _ in range(count)]

    def numbers(self, kind: str, count: int) -> np.ndarray:
        dtype = NUMBERS[kind].newbyteorder(self.order)
        if self.aligned and count:
            self.at += -self.at % dtype.itemsize
        values = np.frombuffer(self.raw, dtype, count, self.at) if count else np.empty(0, dtype)
        self.at += count * dtype.itemsize
        return values

    def text(self) -> str:
        length = int(self.numbers("uint32", 1)[0])
        text = bytes(self.raw[self.at : self.at + length])
        if len(text) < length:
            raise ValueError(f"a text of {length} bytes in {len(self.raw)}")
        self.at += length
        return text.rstrip(b"\0").decode(errors="replace")


def _bounded(decompressor: Any) -> Any:
    """A function that unpacks bytes, and stops where no writer's chunk goes on."""

    def unpack(data: bytes, _size: int = 0) -> bytes:
        unpacked = decompressor().decompress(data, max_length=LARGEST_CHUNK + 1)
        if len(unpacked) > LARGEST_CHUNK:
            raise ValueError(
                f"a chunk of {len(data)} bytes unpacks to more than {LARGEST_CHUNK / 1e6:.0f} MB"
            )
        return bytes(unpacked)

    return unpack


class _Zstandard:
    """In place of the module by which the package unpacks whole files and single messages."""

    decompress = staticmethod(_bounded(zstd.ZstdDecompressor))

    def __init__(self, file: Any) -> None:
        self.file = zstd.open(file, "rb")
        self.size = os.fstat(file.fileno()).st_size
        self.count = 0

    @classmethod
    def open(cls, file: Any, _mode: str) -> Self:
        return cls(file)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.file.close()

    def read(self, count: int) -> bytes:
        chunk = self.file.read(count)
        self.count += len(chunk)
        require_unpacked(self.size, self.count)
        return bytes(chunk)


class _Databases:
    """In place of the module by which the package opens databases: names are literal, and of tables
    only.

    The package writes a file's name into a URI as it stands: `%2e%2e%2f` in a name would be a way
    out of its folder.
    """

    SQLITE_OPEN_READONLY = SQLITE.SQLITE_OPEN_READONLY
    SQLITE_OPEN_URI = SQLITE.SQLITE_OPEN_URI
    Error = SQLITE.Error
    BEFORE_NAME = "file:"
    AFTER_NAME = "?immutable=1"

    @classmethod
    def Connection(cls, name: str, flags: int, vfs: str | None) -> Any:
        """Opens a database.

        Raises:
            ValueError: It holds views, triggers, computed columns or virtual tables, which make
                rows without end of nothing.
        """
        path = name.removeprefix(cls.BEFORE_NAME).removesuffix(cls.AFTER_NAME)
        connection = SQLITE.Connection(
            f"{cls.BEFORE_NAME}{quote(path)}{cls.AFTER_NAME}", flags=flags, vfs=vfs
        )
        for kind, sql in connection.execute("SELECT type, sql FROM sqlite_master"):
            if kind not in ("table", "index") or COMPUTED.search(str(sql)):
                connection.close()
                raise ValueError("its database has more than tables")
        return connection


storage_mcap.DECOMPRESSORS.update(
    lz4=_bounded(LZ4FrameDecompressor), zstd=_bounded(zstd.ZstdDecompressor)
)
chunks1.decompressors.update(lz4=_bounded(LZ4FrameDecompressor), bz2=_bounded(bz2.BZ2Decompressor))
setattr(storage_sqlite3, "apsw", _Databases)  # noqa: B010 - the package knows no other way
setattr(folders, "zstd", _Zstandard)  # noqa: B010 - the package knows no other way
