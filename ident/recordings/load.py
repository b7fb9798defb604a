"""Files and folders -> sessions: the one door by which recordings come in."""

from __future__ import annotations

import itertools
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ident.errors import RecordingError, first_line
from ident.recordings import TOPIC
from ident.recordings.bad_cells import named_columns
from ident.recordings.columns import NamedColumns, take_run, unequal
from ident.recordings.parquet import column_numbers, open_table
from ident.recordings.recording import Recording, Session, TelemetryIssue
from ident.recordings.session_toml import SessionFile, settings_of
from ident.safe_read import require_regular, unchanged

BAGS = (".mcap", ".db3", ".bag")
TEXTS = (".csv", ".txt", ".tsv", ".dat")
# The file that makes a folder a ROS 2 bag.
METADATA = "metadata.yaml"
# The file that makes a folder a LeRobot data set.
DATASET = Path("meta/info.json")
# Where a folder holds one run in several formats, the first of these is read: most exact and most
# complete first.
SUFFIXES = (".parquet", *BAGS, ".npz", *TEXTS)
# Unit of a file's used blocks; share of a file that must be written on the disk, and from which
# size that is asked [bytes]; share of the memory that a file may fill.
BLOCK_BYTES = 512
SPARSE_SHARE = 0.01
LEAST_SPARSE = 1 << 28
MEMORY_SHARE = 0.5
# Samples that are read at once by whoever goes through a long session part by part.
PART_SAMPLES = 200_000
HINT = (
    "give a folder or file of runs, a Session, or a table with the columns time, "
    "<joint>/position, <joint>/effort"
)


def load_session(
    path: str | Path,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
    with_effort: bool = True,
) -> Session:
    """Reads a session: a folder of runs in file-name order, or a single file.

    Args:
        path: A folder of runs, a table (.parquet, .csv, .npz, …), or a ROS 2 bag (folder, .db3 or
            .mcap).
        topic, with_effort: Topic of the joint states, for bags; whether a torque is needed.
        session_file: By default the session.toml in the folder, or `<stem>.toml` or `session.toml`
            beside a file.

    Raises:
        RecordingError: Nothing there, or something that can't be used; says which file, what and
            the remedy.
    """
    (session,) = load_parts(path, topic, session_file, sys.maxsize, with_effort)
    return session


def load_parts(
    path: str | Path,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
    most: int = PART_SAMPLES,
    with_effort: bool = True,
) -> Iterator[Session]:
    """Recordings as one session or, where they are long, as several of consecutive runs.

    Each is read when it is asked for. A part ends with the run that fills so many samples.

    Args:
        path, topic, session_file, with_effort: As `load_session` takes them.
        most: Samples that fill a part.

    Raises:
        RecordingError: As `load_session`, when the part's turn comes.
    """
    path = Path(path)
    remedy = "give a folder of runs, a table or a bag"
    exists = False
    with suppress(OSError, ValueError):  # a name that no file can have
        exists = path.exists()
    if not exists:
        raise RecordingError(path, "no such file or folder", remedy)
    if not path.is_dir():
        require_regular(path, remedy, RecordingError)
    settings = replace(settings_of(path, session_file), with_effort=with_effort)
    notes: list[TelemetryIssue] = []
    if is_dataset(path):
        from ident.recordings.lerobot import read_dataset

        recordings = read_dataset(path, settings)
    else:
        files, notes = find_runs(path, settings)
        recordings = (load_recording(file, settings, topic) for file in files)
    before: list[Recording] = []
    for batch in _batches(recordings, most):
        whole = _as_session(
            [*before, *batch],
            path.name if path.is_dir() else path.stem,
            notes,
            payload=settings.payload,
            robot=settings.robot,
            path=path,
            metadata=dict(settings.metadata),
            effort_kind=settings.effort_kind,
            gravity=settings.gravity,
            guessed_gains=dict(settings.drive_gain) if settings.guessed else {},
        )
        yield whole.replace(runs=whole.runs[len(before) :])
        notes = []
        before = list(whole.runs[-1:])
        del batch, whole  # a part is let go before the next is read


def _batches(runs: Iterable[Recording], most: int) -> Iterator[list[Recording]]:
    batch: list[Recording] = []
    for run in runs:
        batch.append(run)
        if sum(len(recording) for recording in batch) >= most:
            yield batch
            batch = []
            del run
    if batch:
        yield batch


def load_recording(
    path: str | Path, session_file: SessionFile | None = None, topic: str = TOPIC
) -> Recording:
    """Reads one run from a file or a bag folder.

    Args:
        path: The file or folder; its name without the suffix becomes the run's.
        session_file: What a session.toml says; nothing if None. None is looked for beside the file.
        topic: Topic of the joint states, for bags.

    Raises:
        RecordingError: The file can't be used.
    """
    path = Path(path)
    settings = session_file or SessionFile()
    name = path.name if path.is_dir() else path.stem
    with unchanged(path, RecordingError):
        return take_run(name, open_run(path, settings, topic), settings, path)


def open_run(path: Path, settings: SessionFile | None, topic: str = TOPIC) -> NamedColumns:
    """The columns of one run, whatever the format of its file.

    Args:
        path: The file or bag folder.
        settings: What session.toml says; None where the columns are still to be found out.
        topic: Topic of the joint states, for bags.

    Raises:
        RecordingError: The file can't be used.
    """
    suffix = path.suffix.lower()
    if not path.is_dir():
        require_readable_size(path)
    if path.is_dir() or suffix in BAGS:
        from ident.recordings.bags import open_bag

        return open_bag(path, settings, topic)
    if suffix in TEXTS:
        from ident.recordings.text import open_text

        return open_text(path)
    if suffix == ".parquet":
        return open_table(path)
    if suffix == ".npz":
        from ident.recordings.archives import open_arrays

        return open_arrays(path, always=settings is None or bool(settings.columns))
    raise RecordingError(
        path, f"unknown kind of file {suffix!r}", f"give one of: {', '.join(SUFFIXES)}"
    )


def require_readable_size(path: Path) -> None:
    """Passes if a file is a plain one whose rows can be held; a table takes several times its size
    while it is read.

    Raises:
        RecordingError: A device, a pipe, a file with a hole of gigabytes, or one larger than the
            memory.
    """
    size = require_regular(path, "give a table or a bag", RecordingError)
    held = path.stat().st_blocks * BLOCK_BYTES
    if size > LEAST_SPARSE and held < SPARSE_SHARE * size:
        what = (
            f"is {size / 1e9:.1f} GB large, of which {held / 1e9:.1f} GB are written: a file with "
            "holes"
        )
        raise RecordingError(path, what, "write it again")
    try:
        memory = float(os.sysconf("SC_PAGE_SIZE")) * float(os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        memory = float("inf")
    if size > MEMORY_SHARE * memory:
        what = f"is {size / 1e9:.1f} GB large, more than this machine's memory can hold at once"
        raise RecordingError(path, what, "part it into several runs")


def is_dataset(path: Path) -> bool:
    """Whether a folder is a LeRobot data set."""
    return path.is_dir() and (path / DATASET).is_file()


def is_run(entry: Path, suffixes: Sequence[str] = SUFFIXES) -> bool:
    """Whether something in a folder is a run: a bag's folder, or a file of a kind that holds
    recordings.
    """
    known = (entry / METADATA).is_file() if entry.is_dir() else entry.suffix.lower() in suffixes
    return known and not entry.name.startswith(".")


def find_runs(path: Path, settings: SessionFile) -> tuple[list[Path], list[TelemetryIssue]]:
    """The runs of a session in file-name order; of one run in several formats, one is taken.

    Args:
        path: A folder, or a single file, which is the only run.
        settings: What session.toml says.

    Returns:
        The files, and a note for each run that is there in several formats.

    Raises:
        RecordingError: There are none.
    """
    if path.is_file() or (path / METADATA).is_file():
        return [path], []
    # Without [columns], a text that is not a CSV is more likely a remark than a recording.
    suffixes = SUFFIXES if settings.columns else SUFFIXES[: SUFFIXES.index(".csv") + 1]
    by_stem: dict[str, list[Path]] = {}
    for entry in sorted(child for child in path.iterdir() if is_run(child, suffixes)):
        by_stem.setdefault(entry.name if entry.is_dir() else entry.stem, []).append(entry)
    if not by_stem:
        raise RecordingError(
            path, "holds no runs", f"put recordings there: {', '.join(suffixes)} or bag folders"
        )
    files = []
    notes = []
    for stem in sorted(by_stem):
        kinds = {
            candidate: SUFFIXES.index(".mcap" if candidate.is_dir() else candidate.suffix.lower())
            for candidate in by_stem[stem]
        }
        first, *others = sorted(kinds, key=lambda candidate: kinds[candidate])
        files.append(first)
        if others:
            evidence = (
                f"{path.name}: {first.name} is read, not "
                f"{', '.join(other.name for other in others)}"
            )
            notes.append(
                TelemetryIssue("duplicate_run", (), "note", evidence, "none needed; or remove one")
            )
    return files, notes


def _as_session(
    runs: Sequence[Recording], name: str, notes: Sequence[TelemetryIssue] = (), **settings: Any
) -> Session:
    """Runs as a session, their joints in the order of the first run's; where clocks restart they
    are independent.

    Raises:
        RecordingError: A run has other joints than the first.
    """
    first = runs[0]
    for run in runs:
        different = set(run.joints) ^ set(first.joints)
        if different:
            what = f"has other joints than {first.name}: {', '.join(sorted(different))}"
            remedy = "a session is one set-up of the arm: give the run as a session of its own"
            raise RecordingError(run.source or run.name, what, remedy)
    same = [run if run.joints == first.joints else run.select(first.joints) for run in runs]
    for before, after in itertools.pairwise(same):
        # A table without time has no clock to share.
        if not before.time.max(initial=-float("inf")) < after.time.min(initial=float("inf")):
            evidence = (
                f"{after.name} starts at {after.time[0]:.3f} s, "
                f"before {before.name} ends at {before.time[-1]:.3f} s: "
                "the runs are taken as independent"
            )
            remedy = (
                "none needed; record all runs on one clock to see what changes from run to run, "
                "as with warmth"
            )
            notes = [*notes, TelemetryIssue("clock_restarts", (), "note", evidence, remedy)]
            return Session(name, tuple(same), common_clock=False, notes=tuple(notes), **settings)
    return Session(name, tuple(same), notes=tuple(notes), **settings)


Source = str | Path | Session | Recording | Any
PathOrSession = str | Path | Session


def read_frame(frame: Any, name: str = "frame", settings: SessionFile | None = None) -> Recording:
    """One run from a table in memory, as from a file of the same columns.

    Args:
        frame: A table of pandas, Polars or pyarrow, or a mapping of names to arrays; columns as of
            a native table.
        name, settings: Name of the run, and of the table in messages; what a session.toml says.

    Raises:
        RecordingError: No table, a needed column is missing or holds no numbers, columns of
            different lengths.
    """
    table = _as_table(frame, name)
    path = Path(name)
    settings = settings or SessionFile()
    names = tuple(table.column_names)

    def load(chosen: Sequence[int]) -> list[Any]:
        return [column_numbers(table.column(index), names[index], name) for index in chosen]

    return take_run(name, named_columns(names, load, path), settings, path).replace(
        source=None, state=None
    )


def gather_sources(
    source: Source | Sequence[Source], settings: SessionFile | None = None
) -> list[PathOrSession]:
    """What a user gave as recordings, as a list of paths and sessions.

    A list of paths or sessions is so many sessions; tables and recordings that follow each other
    are the runs of one.

    Args:
        source: A path, session, recording or table in memory, or a sequence of these.
        settings: What a session.toml says, for tables in memory.

    Raises:
        RecordingError: Something that holds no recording; nothing at all.
    """
    sources: list[PathOrSession] = []
    runs: list[Recording] = []

    def close() -> None:
        """The runs so far become a session."""
        if runs:
            sources.append(_as_session(runs, f"tables_{len(sources) + 1}"))
            runs.clear()

    for entry in source if isinstance(source, list | tuple) else [source]:
        if isinstance(entry, Recording):
            runs.append(entry)
        elif (
            isinstance(entry, Mapping) or hasattr(entry, "__arrow_c_stream__") or _is_pandas(entry)
        ):
            runs.append(read_frame(entry, f"table_{len(runs) + 1:02}", settings))
        elif isinstance(entry, str | Path | Session):
            close()
            sources.append(entry)
        else:
            raise RecordingError("source", f"a {type(entry).__name__} holds no recording", HINT)
    close()
    if not sources:
        raise RecordingError("source", "holds no recording", HINT)
    return sources


def _is_pandas(source: object) -> bool:
    """A frame of pandas, old ones that don't speak Arrow among them."""
    return type(source).__module__.split(".")[0] == "pandas" and hasattr(source, "columns")


def _as_table(frame: Any, name: str) -> pa.Table:
    try:
        if not isinstance(frame, Mapping):
            return (
                pa.Table.from_pandas(frame, preserve_index=False)
                if _is_pandas(frame)
                else pa.table(frame)
            )
        arrays = {str(key): np.asarray(values) for key, values in frame.items()}
        for key, values in arrays.items():
            if values.ndim != 1:
                what = f"has {values.ndim} dimensions"
                raise RecordingError(f"{name}, column {key}", what, "give one array a column")
        lengths = {key: len(values) for key, values in arrays.items()}
        if len(set(lengths.values())) > 1:
            raise RecordingError(name, *unequal(lengths))
        return pa.table(arrays)
    except (
        pa.ArrowInvalid,
        pa.ArrowTypeError,
        pa.ArrowNotImplementedError,
        TypeError,
        ValueError,
    ) as error:
        raise RecordingError(name, f"is no table of numbers ({first_line(error)})", HINT) from None
