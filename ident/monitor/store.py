"""The folders of a watch: arms and sessions that come in, and the store of what was found
of them.
"""

from __future__ import annotations

import hashlib
import math
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

import pyarrow as pa
import pyarrow.parquet as pq

from ident.errors import InputError
from ident.files import atomic_write
from ident.outputs import MARKER, is_begun, real_path
from ident.recordings.load import is_dataset, is_run
from ident.recordings.parquet import require_in_proportion
from ident.recordings.session_toml import NAME, load_session_file
from ident.records import JsonRecord, JsonTable
from ident.safe_read import open_regular, require_unpacked

# Kind of the store's folder, by its marker: it may lie within the watched folder and is passed over
# there.
STORE_KIND = "watch"
# A date within a name: 2026-05-03, 26_05_03, 20260503.
DATES = re.compile(r"(?<!\d)(?:(20\d\d)|(\d\d))([-_.]?)(\d\d)\3(\d\d)(?!\d)")
# Stamps of recordings below this count from the start of something, above from 1970, up to the year
# 5138 [s].
EPOCH = 1e9
LAST = 1e11


class NoSession(InputError):
    """A watched folder in which no session lies yet."""


# Columns of each kind of table, by the names of their types.
COLUMNS: dict[str, dict[str, str]] = {
    "figures": {
        **dict.fromkeys(("arm", "session", "date", "joint", "figure", "unit"), "string"),
        **dict.fromkeys(("value", "low", "high", "std"), "float64"),
    },
    "effects": {
        **dict.fromkeys(("arm", "session", "date", "effect", "joints"), "string"),
        **dict.fromkeys(("probability", "shrink"), "float64"),
        "action": "string",
    },
    "sessions": {
        **dict.fromkeys(("arm", "session", "date", "status", "verdict", "reason"), "string"),
        "samples": "int64",
        "duration_s": "float64",
        **dict.fromkeys(("stamp", "path", "robot"), "string"),
    },
    "alarms": {
        **dict.fromkeys(("arm", "joint", "figure", "session", "since"), "string"),
        **dict.fromkeys(("evidence", "probability", "before", "after", "low", "high"), "float64"),
        **dict.fromkeys(("spread", "scale", "scale_low", "scale_high"), "float64"),
    },
}
SCHEMAS = {kind: pa.schema(list(columns.items())) for kind, columns in COLUMNS.items()}
DONE = "sessions"
# Names of files have 255 bytes at the most; an ending and a temporary name's beginning need some.
LONGEST_NAME = 180
# Whatever else is missing in a row, without these it says nothing; a fit session's estimates have
# all their numbers.
NEEDED = (
    "arm",
    "session",
    "date",
    "joint",
    "figure",
    "status",
    "effect",
    "value",
    "low",
    "high",
    "std",
)


@dataclass(frozen=True)
class FoundSession:
    """A session that lies there."""

    arm: str  # name of the arm: of the folder that holds the sessions
    name: str  # name of the session
    path: Path  # its folder
    # the session.toml that holds for it: its own, its arm's, or the whole folder's
    settings: Path | None
    stamp: str  # of its files' names, sizes and times: another one means that it has changed
    newest: float  # when its newest file was written [s since 1970]

    @property
    def key(self) -> str:
        """Its name among all arms."""
        return f"{self.arm}/{self.name}"


def as_text(name: str | Path) -> str:
    """A name on the disk, or a text that holds one, as text: bytes that are no UTF-8 are shown by
    their codes.
    """
    return os.fsencode(name).decode("utf-8", "backslashreplace")


def find_sessions(folder: Path) -> list[FoundSession]:
    """All sessions: folders of runs in the folder (of one arm), or in folders of arms.

    Raises:
        InputError: No such folder, or no session in it.
    """
    if not folder.is_dir():
        raise InputError(
            folder, "no such folder", "give a folder of sessions, or of arms with sessions"
        )
    sessions = []
    for child in _folders(folder):
        if _is_session(child):
            sessions.append(_look_at(as_text(real_path(folder).name), child, folder))
        else:
            sessions += [
                _look_at(as_text(child.name), subfolder, folder)
                for subfolder in _folders(child)
                if _is_session(subfolder)
            ]
    if not sessions:
        # Whoever goes on looking may wait for the first one.
        what = "holds no session" + (", but runs" if _is_session(folder) else "")
        raise NoSession(
            folder, what, "give each session a folder: FOLDER/SESSION or FOLDER/ARM/SESSION"
        )
    return sorted(sessions, key=lambda session: session.key)


def _folders(folder: Path) -> list[Path]:
    folders = sorted(
        subfolder
        for subfolder in folder.iterdir()
        if subfolder.is_dir() and not subfolder.name.startswith(".")
    )
    return [subfolder for subfolder in folders if not is_begun(subfolder, STORE_KIND)]


def _is_session(folder: Path) -> bool:
    """Whether runs lie in a folder: tables, bags, a data set."""
    return is_dataset(folder) or any(is_run(entry) for entry in folder.iterdir())


def _look_at(arm: str, path: Path, folder: Path) -> FoundSession:
    settings = next(
        (file for file in (path / NAME, path.parent / NAME, folder / NAME) if file.is_file()), None
    )
    below = [file for file in path.rglob("*") if file.is_file()]
    files = sorted(file for file in below if file.name != MARKER)
    digest = hashlib.sha256()
    newest = 0.0
    for file in [*files, *([settings] if settings is not None and settings.parent != path else [])]:
        status = file.stat()
        digest.update(
            f"{file.name}\0{status.st_size}\0{status.st_mtime_ns}\n".encode(
                errors="surrogateescape"
            )
        )
        newest = max(newest, status.st_mtime)
    return FoundSession(arm, as_text(path.name), path, settings, digest.hexdigest(), newest)


def date_of(session: FoundSession, first: float | None) -> str:
    """When a session was recorded, ISO: as session.toml's `date` says, its name, its stamps, or its
    newest file.
    """
    file = session.path / NAME
    written = load_session_file(file).metadata.get("date") if file.is_file() else None
    if written is not None:
        try:
            moment = written if isinstance(written, date) else datetime.fromisoformat(written)
            if isinstance(moment, datetime) and moment.tzinfo is not None:
                # so that all dates can be put in order
                moment = moment.astimezone(UTC).replace(tzinfo=None)
            return moment.isoformat()
        except (ValueError, TypeError, OverflowError):
            raise InputError(
                file, f"date = {written!r}", "write it as 2026-05-03 or 2026-05-03T14:00:00"
            ) from None
    for match in DATES.finditer(session.name):
        try:
            year = int(match[1] or 2000 + int(match[2]))
            return date(year, int(match[4]), int(match[5])).isoformat()
        except ValueError:
            continue
    seconds = (
        first if first is not None and EPOCH < first < LAST else min(max(session.newest, 0.0), LAST)
    )
    return datetime.fromtimestamp(seconds, UTC).replace(tzinfo=None).isoformat(timespec="seconds")


# The store of a watch: Parquet files that others read too, one of each kind a session.
# figures/ARM/SESSION.parquet   arm, session, date, joint, figure, unit, value, low, high, std
# effects/ARM/SESSION.parquet   arm, session, date, effect, joints, probability, shrink, action
# sessions/ARM/SESSION.parquet  arm, session, date, status, verdict, reason, samples, duration_s,
# stamp, path, robot The file below sessions/ is written last: where it is, the session is done.
# DuckDB: `from 'STORE/figures/*/*.parquet'`.


@dataclass(frozen=True)
class Store:
    """A folder of results."""

    folder: Path  # where it is

    def place(self, kind: str, arm: str, session: str, suffix: str = ".parquet") -> Path:
        """The file of a session; names that no file can have are quoted.

        Args:
            kind: Kind of table, the folder's name.
            arm: The arm's name.
            session: The session's name.
            suffix: With its dot.
        """
        return self.folder / kind / _file_name(arm) / f"{_file_name(session)}{suffix}"

    def page(self, arm: str) -> Path:
        """The page of an arm."""
        return self.folder / f"arm-{_file_name(arm)}.html"

    def read(self, kind: str) -> list[JsonRecord]:
        """All rows of a kind, in the order of their files' names; a file that is none of ours
        counts as not there.

        So does a table of other columns, and one that unpacks to more than any of ours.
        """
        complete: list[JsonRecord] = []
        for path in sorted((self.folder / kind).glob("*/*.parquet")):
            try:
                with open_regular(path, "a watch writes it again") as stream:
                    file = pq.ParquetFile(stream)
                    require_in_proportion(stream)
                    is_ours = file.schema_arrow.equals(SCHEMAS[kind])
                    rows = _rows(stream, SCHEMAS[kind]) if is_ours else []
            except (pa.ArrowException, OSError, ValueError, InputError):
                continue
            for row in rows:
                needed = [row[name] for name in NEEDED if name in row]
                if all(
                    math.isfinite(cell) if isinstance(cell, float) else cell is not None
                    for cell in needed
                ):
                    complete.append(row)
        return complete


def _rows(stream: BinaryIO, schema: pa.Schema) -> list[JsonRecord]:
    """The rows of an open table.

    Raises:
        ValueError: Its texts, each of which stands once in the file, come to more than any of ours.
    """
    texts = [column.name for column in schema if pa.types.is_string(column.type)]
    table = pq.ParquetFile(stream, read_dictionary=texts).read()
    for name in texts:
        lengths = [
            len(text) for chunk in table[name].chunks for text in chunk.dictionary.to_pylist()
        ]
        size = os.fstat(stream.fileno()).st_size
        require_unpacked(size, table.num_rows * max(lengths, default=0))
    return table.to_pylist()


def write_rows(path: Path, kind: str, rows: Iterable[JsonTable]) -> None:
    """Writes a table of a kind, whole or not at all."""
    table = pa.Table.from_pylist([dict(row) for row in rows], schema=SCHEMAS[kind])
    with atomic_write(path) as temporary:
        pq.write_table(table, temporary, compression="zstd")


def _file_name(name: str) -> str:
    """A name that every file system takes; a long one keeps its beginning and a digest of all of
    it.
    """
    quoted = quote(name, safe=" +=@,()") or "_"
    if len(quoted) <= LONGEST_NAME:
        return quoted
    return f"{quoted[: LONGEST_NAME - 17]}-{hashlib.sha256(name.encode()).hexdigest()[:16]}"
