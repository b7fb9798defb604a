"""Where a result comes from: the command, the version, its settings, and the recordings by their hashes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from math import isfinite
from typing import TYPE_CHECKING, Any

from ident.records import Record

if TYPE_CHECKING:
    from pathlib import Path

    from ident.recordings.recording import Recording, Session


@cache
def own_version() -> str:
    """Version of armgap; `unknown` where it is not installed but only lies on the path."""
    try:
        return version("armgap")
    except PackageNotFoundError:
        return "unknown"


# Digits of a file's hash by which it is known again.
RUN_DIGITS = 12


@dataclass(frozen=True)
class SessionStamp(Record):
    """One session that a result was made from.

    Attributes:
        path: Its folder or file; its name where it never was a file.
        sha256: Of its runs: of their files' hashes in order, or of their arrays where they never were files.
        first, last: Times of the first and the last sample on the session's clock [s]; None without any.
        runs: First digits of each file's hash: whether two results were made from a common recording.
    """

    path: str
    sha256: str
    first: float | None
    last: float | None
    runs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Provenance(Record):
    """Where a result comes from.

    Attributes:
        command: What was run: `ident diagnose`, or the Python function of the same job.
        version: Of armgap.
        settings: Options that decide the result, by name.
        sessions: The recordings.
    """

    command: str = ""
    version: str = field(default_factory=own_version)
    settings: Mapping[str, Any] = field(default_factory=dict)
    sessions: tuple[SessionStamp, ...] = ()


def runs_of(stamps: Iterable[SessionStamp]) -> frozenset[str]:
    """First digits of the hashes of all files behind some stamps."""
    return frozenset(run for stamp in stamps for run in stamp.runs)


def files_of(record: Mapping[str, Any]) -> frozenset[str]:
    """The same of a record's provenance: of a result's sessions, or of the data of a model."""
    runs = (run for one in record.get("sessions", []) for run in one.get("runs", []))
    return frozenset((*map(str, runs), *(str(one["sha256"])[:RUN_DIGITS] for one in record.get("data", []))))


def stamp_sessions(sessions: Iterable[Session]) -> tuple[SessionStamp, ...]:
    """One stamp a session; parts of one that follow each other share theirs."""
    ledger = StampLedger()
    for _ in ledger.passing(sessions):
        pass
    return ledger.stamps


class StampLedger:
    """Takes note of sessions while somebody else goes through them, so that a long one is read once only."""

    def __init__(self) -> None:
        self._open: list[_Stamping] = []

    @property
    def stamps(self) -> tuple[SessionStamp, ...]:
        """Of what has passed so far."""
        return tuple(one.stamp() for one in self._open)

    @property
    def files(self) -> list[dict[str, Any]]:
        """Session, name and SHA-256 of each file so far."""
        return [
            {"session": one.name, "file": path.name, "sha256": digest.hex()}
            for one in self._open
            for path, digest in sorted(one.files.items())
        ]

    def passing(self, sessions: Iterable[Session]) -> Iterator[Session]:
        """The same sessions, noted on the way; one of the path of the last is its next part."""
        for session in sessions:
            if session.path is None or not self._open or self._open[-1].path != str(session.path):
                self._open.append(_Stamping(session.name, str(session.path or "")))
            self._open[-1].take(session.runs)
            yield session
            del session


class _Stamping:
    """A stamp in the making: hashes and times of a session whose parts come one after the other."""

    def __init__(self, name: str, path: str) -> None:
        self.name, self.path = name, path
        self.files: dict[Path, bytes] = {}
        self._digest = hashlib.sha256()
        self._runs: dict[str, None] = {}
        self._times: list[float] = []

    def take(self, runs: Iterable[Recording]) -> None:
        for run in runs:
            digest = self._digest_of(run)
            self._digest.update(digest)
            self._runs[digest.hex()[:RUN_DIGITS]] = None
            self._times += [float(time) for time in (*run.time[:1], *run.time[-1:]) if isfinite(time)]

    def _digest_of(self, run: Recording) -> bytes:
        """Of the run's file, else of its arrays."""
        if run.source is not None and run.source.is_file():
            if run.source not in self.files:
                with run.source.open("rb") as stream:
                    self.files[run.source] = hashlib.file_digest(stream, "sha256").digest()
            return self.files[run.source]
        digest = hashlib.sha256(run.time.tobytes())
        for name, values in run.channels().items():
            digest.update(name.encode() + values.tobytes())
        return digest.digest()

    def stamp(self) -> SessionStamp:
        first, last = (min(self._times), max(self._times)) if self._times else (None, None)
        return SessionStamp(self.path or self.name, self._digest.hexdigest(), first, last, tuple(self._runs))
