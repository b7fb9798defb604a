"""What stands in a watched folder: arms, their sessions, when these were recorded, and whether they are complete."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path

from ident.errors import InputError
from ident.outputs import MARKER, is_begun
from ident.recordings.lerobot import is_dataset
from ident.recordings.load import is_run
from ident.recordings.session_toml import NAME, load_session_file

# Kind of the store's folder, by its marker: it may lie within the watched folder and is passed over there.
STORE_KIND = "watch"
# A date within a name: 2026-05-03, 26_05_03, 20260503.
DATES = re.compile(r"(?<!\d)(?:(20\d\d)|(\d\d))([-_.]?)(\d\d)\3(\d\d)(?!\d)")
# Stamps of recordings below this count from the start of something, above from 1970, up to the year 5138 [s].
EPOCH, LAST = 1e9, 1e11


class NoSession(InputError):
    """A watched folder in which no session lies yet."""


@dataclass(frozen=True)
class FoundSession:
    """A session that lies there.

    Attributes:
        arm: Name of the arm: of the folder that holds the sessions.
        name: Name of the session.
        path: Its folder.
        settings: The session.toml that holds for it: its own, its arm's, or the whole folder's.
        stamp: Of its files' names, sizes and times: another one means that it has changed.
        newest: When its newest file was written [s since 1970].
    """

    arm: str
    name: str
    path: Path
    settings: Path | None
    stamp: str
    newest: float

    @property
    def key(self) -> str:
        """Its name among all arms."""
        return f"{self.arm}/{self.name}"


def as_text(name: str | Path) -> str:
    """A name on the disk, or a text that holds one, as text: bytes that are no UTF-8 are shown by their codes."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


def find_sessions(folder: Path) -> list[FoundSession]:
    """All sessions: folders of runs in the folder (of one arm), or in folders of arms.

    Raises:
        InputError: No such folder, or no session in it.
    """
    if not folder.is_dir():
        raise InputError(folder, "no such folder", "give a folder of sessions, or of arms with sessions")
    found = list(_in_folder(folder))
    if not found:
        # Whoever goes on looking may wait for the first one.
        what = "holds no session" + (", but runs" if _is_session(folder) else "")
        raise NoSession(folder, what, "give each session a folder: FOLDER/SESSION or FOLDER/ARM/SESSION")
    return sorted(found, key=lambda one: one.key)


def _in_folder(folder: Path) -> Iterator[FoundSession]:
    for child in _folders(folder):
        if _is_session(child):
            yield _look_at(as_text(folder.resolve().name), child, folder)
            continue
        for session in _folders(child):
            if _is_session(session):
                yield _look_at(as_text(child.name), session, folder)


def _folders(folder: Path) -> list[Path]:
    found = sorted(one for one in folder.iterdir() if one.is_dir() and not one.name.startswith("."))
    return [one for one in found if not is_begun(one, STORE_KIND)]


def _is_session(folder: Path) -> bool:
    """Whether runs lie in a folder: tables, bags, a data set."""
    return is_dataset(folder) or any(is_run(one) for one in folder.iterdir())


def _look_at(arm: str, path: Path, folder: Path) -> FoundSession:
    settings = next((one for one in (path / NAME, path.parent / NAME, folder / NAME) if one.is_file()), None)
    files = sorted(one for one in path.rglob("*") if one.is_file() and one.name != MARKER)
    digest, newest = hashlib.sha256(), 0.0
    for file in [*files, *([settings] if settings is not None and settings.parent != path else [])]:
        status = file.stat()
        digest.update(f"{file.name}\0{status.st_size}\0{status.st_mtime_ns}\n".encode(errors="surrogateescape"))
        newest = max(newest, status.st_mtime)
    return FoundSession(arm, as_text(path.name), path, settings, digest.hexdigest(), newest)


def date_of(session: FoundSession, first: float | None) -> str:
    """When a session was recorded, ISO: as session.toml's `date` says, its name, its stamps, or its newest file.

    Args:
        session: The session.
        first: Its first stamp [s].
    """
    own = session.path / NAME
    written = load_session_file(own).metadata.get("date") if own.is_file() else None
    if written is not None:
        try:
            moment = written if isinstance(written, date) else datetime.fromisoformat(written)
            if isinstance(moment, datetime) and moment.tzinfo is not None:
                moment = moment.astimezone(UTC).replace(tzinfo=None)  # so that all dates can be put in order
            return moment.isoformat()
        except (ValueError, TypeError, OverflowError):
            raise InputError(own, f"date = {written!r}", "write it as 2026-05-03 or 2026-05-03T14:00:00") from None
    for match in DATES.finditer(session.name):
        try:
            return date(int(match[1] or 2000 + int(match[2])), int(match[4]), int(match[5])).isoformat()
        except ValueError:
            continue
    seconds = first if first is not None and EPOCH < first < LAST else min(max(session.newest, 0.0), LAST)
    return datetime.fromtimestamp(seconds, UTC).replace(tzinfo=None).isoformat(timespec="seconds")
