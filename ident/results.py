"""What every result can do and hold: words, a record, a picture, and where it comes from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from ident.errors import RecordingError
from ident.files import write_record
from ident.origin import UNITS, code_commit, engine_versions
from ident.records import Record, as_record
from ident.safe_read import AGAIN, FileState

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.recordings.recording import Recording, Session
    from ident.recordings.series import Series

    # First digits of a recording's hash, and its series.
    KnownSeries = tuple[str, Series]


# Where a result comes from: the command, the version, its settings, and the recordings by their
# hashes. Digits of a file's hash by which it is known again.
RUN_DIGITS = 12
# What anchors the scale of a session's torque.
SCALES = {
    "recorded": "as recorded: a sensor's or the drive's own torque",
    "given": "drive gains given with the recording",
    "guessed": "drive gains guessed: gravity alone tells the scale",
}
# As much of a result as its `repr` shows [lines, characters].
LINES = 20
LINE = 100
# Why a spread over the runs is missing from a record.
ONE_RUN = "a single run tells nothing of what runs differ by"


@cache
def own_version() -> str:
    """Version of armgap; `unknown` where it is not installed but only lies on the path."""
    try:
        return version("armgap")
    except PackageNotFoundError:
        return "unknown"


def made_by() -> str:
    """What made a page, in a line: version, commit, engines and units."""
    commit = code_commit()
    code = f"armgap {own_version()}" + (f", commit {commit[:RUN_DIGITS]}" if commit else "")
    engines = ", ".join(f"{name} {number}" for name, number in engine_versions().items())
    return f"{code}; {engines}. Units: {UNITS}."


@dataclass(frozen=True)
class SessionStamp(Record):
    """One session that a result was made from.

    Attributes:
        path: Its folder or file; its name where it never was a file.
        sha256: Of its runs: of their files' hashes in order, or of their arrays where they never
            were files.
        content: SHA-256 of what its runs hold, whatever their files: times, positions, torques and
            other channels.
        scale: What the torque's scale rests on: see `SCALES`.
        first, last: Times of the first and the last sample on the session's clock [s]; None without
            any.
        runs: First digits of each file's hash, and of that of every known recording that it holds
            in another form: whether two results were made from a common recording.
    """

    path: str
    sha256: str
    first: float | None
    last: float | None
    runs: tuple[str, ...] = ()
    content: str = ""
    scale: str = ""


def scale_of(session: Session) -> str:
    """What the scale of a session's torque rests on."""
    if session.guessed_gains:
        return SCALES["guessed"]
    currents = any(run.current is not None for run in session.runs)
    return SCALES["given" if currents else "recorded"]


@dataclass(frozen=True)
class Provenance(Record):
    """Where a result comes from.

    Attributes:
        command: What was run: `ident diagnose`, or the Python function of the same job.
        version: Of armgap.
        commit: Of the code, where it is a checkout.
        engines: Versions of the libraries that reckon.
        units: Of all figures.
        settings: Options that decide the result, by name.
        sessions: The recordings.
    """

    command: str = ""
    version: str = field(default_factory=own_version)
    settings: Mapping[str, Any] = field(default_factory=dict)
    sessions: tuple[SessionStamp, ...] = ()
    commit: str | None = field(default_factory=code_commit)
    engines: Mapping[str, str] = field(default_factory=engine_versions)
    units: str = UNITS


def runs_of(stamps: Iterable[SessionStamp]) -> frozenset[str]:
    """First digits of the hashes of all files behind some stamps."""
    return frozenset(run for stamp in stamps for run in stamp.runs)


def files_of(record: Mapping[str, Any]) -> frozenset[str]:
    """First digits of the hashes of all files behind a record, as `runs_of` has them.

    Args:
        record: The provenance of a result or of a model.
    """
    runs: list[str] = []
    for session in record.get("sessions", []):
        runs += map(str, session.get("runs", []))
    for file in record.get("data", []):
        runs.append(str(file["sha256"])[:RUN_DIGITS])
    return frozenset(runs)


def known_series(record: Mapping[str, Any]) -> tuple[KnownSeries, ...]:
    """The recordings of a model, by which they are known again in another form; damaged or missing
    ones are left out.

    Args:
        record: The provenance of a model.
    """
    from ident.recordings.series import Series

    known = []
    for data in record.get("data", []):
        for moments in data.get("series", []):
            with suppress(ValueError, KeyError, TypeError):
                known.append((str(data["sha256"])[:RUN_DIGITS], Series.from_dict(moments)))
    return tuple(known)


def stamp_sessions(sessions: Iterable[Session]) -> tuple[SessionStamp, ...]:
    """One stamp a session; parts of one that follow each other share theirs."""
    ledger = StampLedger()
    for _ in ledger.passing(sessions):
        pass
    return ledger.stamps


class StampLedger:
    """Takes note of sessions while somebody else goes through them, so that a long one is read once
    only.

    Args:
        known: Recordings that are looked for in them.
    """

    def __init__(self, known: Sequence[KnownSeries] = ()) -> None:
        self._known = known
        self._open: list[_Stamping] = []

    @property
    def stamps(self) -> tuple[SessionStamp, ...]:
        """One stamp for each session that has passed so far."""
        return tuple(stamping.stamp() for stamping in self._open)

    @property
    def files(self) -> list[dict[str, Any]]:
        """Session, name, SHA-256 and series of each file so far, and of each run that never was
        one.
        """
        return [data for stamping in self._open for data in stamping.data()]

    def passing(self, sessions: Iterable[Session]) -> Iterator[Session]:
        """The sessions as they come, each noted on the way.

        One whose path is that of the one before is its next part.
        """
        for session in sessions:
            is_next_part = False
            if session.path is not None and self._open:
                is_next_part = self._open[-1].path == str(session.path)
            if not is_next_part:
                self._open.append(_Stamping(session.name, str(session.path or ""), self._known))
            self._open[-1].take(session)
            yield session
            del session


class _Stamping:
    """A stamp in the making: hashes and times of a session whose parts come one after the other."""

    def __init__(self, name: str, path: str, known: Sequence[KnownSeries]) -> None:
        self.name = name
        self.path = path
        self._known = known
        self._files: dict[Path, bytes] = {}
        self._digest = hashlib.sha256()
        self._content = hashlib.sha256()
        self._scale = ""
        self._runs: dict[str, None] = {}
        self._names: dict[str, str] = {}
        self._series: dict[str, list[Series]] = {}
        self._times: list[float] = []

    def take(self, session: Session) -> None:
        """Takes note of a part of the session."""
        from ident.recordings.series import SearchedRun, Series

        self._scale = scale_of(session)
        for run in session.runs:
            self._content.update(content_of(run))
            digest = self._digest_of(run)
            hexadecimal = digest.hex()
            self._digest.update(digest)
            self._runs[hexadecimal[:RUN_DIGITS]] = None
            name = run.name if run.source is None else run.source.name
            self._names.setdefault(hexadecimal, name)
            series = Series.of(run)
            if series is not None:
                self._series.setdefault(hexadecimal, []).append(series)
            searched = SearchedRun(run)
            for known, theirs in self._known:
                if known not in self._runs and theirs.is_in(searched):
                    self._runs[known] = None
            ends = (*run.time[:1], *run.time[-1:])
            self._times += [float(time) for time in ends if isfinite(time)]

    def data(self) -> list[dict[str, Any]]:
        """What a model's provenance says of the session."""
        records = []
        for digest, name in sorted(self._names.items(), key=lambda item: item[1]):
            series = self._series.get(digest, [])
            record = {
                "session": self.name,
                "file": name,
                "sha256": digest,
                "series": [recorded.to_dict() for recorded in series],
            }
            records.append(record)
        return records

    def _digest_of(self, run: Recording) -> bytes:
        """Of the run's file, else of its arrays."""
        if run.source is not None and run.source.is_file():
            if run.source not in self._files:
                with run.source.open("rb") as stream:
                    self._files[run.source] = hashlib.file_digest(stream, "sha256").digest()
                if run.state is not None and FileState.of(run.source) != run.state:
                    what = "it changed since it was read: the result would name another content"
                    raise RecordingError(run.source, what, AGAIN)
            return self._files[run.source]
        return content_of(run)

    def stamp(self) -> SessionStamp:
        """The stamp of all that was noted so far."""
        return SessionStamp(
            self.path or self.name,
            self._digest.hexdigest(),
            min(self._times, default=None),
            max(self._times, default=None),
            tuple(self._runs),
            self._content.hexdigest(),
            self._scale,
        )


def content_of(run: Recording) -> bytes:
    """SHA-256 of what a run holds: its joints by their names' order, times, channels as doubles."""
    order = sorted(range(len(run.joints)), key=lambda index: run.joints[index])
    digest = hashlib.sha256("\0".join(sorted(run.joints)).encode() + run.time.tobytes())
    for name, values in run.channels().items():
        digest.update(name.encode() + values[:, order].tobytes())
    return digest.digest()


def _shortened(line: str) -> str:
    """A line, cut where it is longer than `LINE`."""
    return line if len(line) <= LINE else f"{line[: LINE - 1]}…"


# What every result can do: tell itself in words, as a record, as a picture, and in a notebook.


@dataclass(frozen=True, eq=False, kw_only=True)
class Result:
    """Base of all results.

    Attributes:
        provenance: Where it comes from.
    """

    # How a result looks is known above, where pictures are made, and asked for by name when
    # somebody looks: a module with `write(console, result)` and `draw(result)`.
    SHOWN_BY: ClassVar[str] = "ident.show.results"
    # Of a result whose fields are the keys of its record.
    SCHEMA: ClassVar[str] = ""

    provenance: Provenance = field(default_factory=Provenance)

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Every result is shown by its first lines, not by all its arrays."""
        super().__init_subclass__(**kwargs)
        cls.__repr__ = Result._first_lines  # type: ignore[assignment,method-assign]

    def _first_lines(self) -> str:
        """The kind of result, and the first lines of its summary."""
        every = self.summary().splitlines()
        lines = [f"{type(self).__name__}:"]
        lines += [_shortened(line) for line in every[:LINES]]
        if len(every) > LINES:
            lines.append(f"  … {len(every) - LINES} more lines: print(….summary())")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """The record that the command writes with --json; `ident schema` says what it holds."""
        record = {"schema": self.SCHEMA}
        for key in fields(self):
            record[key.name] = as_record(getattr(self, key.name))
        return record

    def with_provenance(self, provenance: Provenance) -> Self:
        """A copy of the result with this origin."""
        return replace(self, provenance=provenance)

    def summary(self) -> str:
        """The result in plain lines, as the command prints it."""
        as_text = import_module("ident.show.results").as_text
        return str(as_text(lambda console: import_module(self.SHOWN_BY).write(console, self)))

    def plot(self) -> Figure:
        """The result as a picture."""
        from matplotlib.text import Text

        figure: Figure = import_module(self.SHOWN_BY).draw(self)
        for text in figure.findobj(Text):
            text.set_parse_math(False)  # a joint's name is no formula
            text.set_usetex(False)
        return figure

    def save(self, path: str | Path) -> None:
        """Writes the record as JSON, whole or not at all."""
        write_record(path, self.to_dict())

    def _repr_html_(self) -> str:
        return str(import_module("ident.show.results").as_html(self))
