"""What is still told of recordings whose cause others measured, when little of them is left.

    python -m tests.bench.bench_cuts INDEX [--seconds 5,10,20]

`INDEX` is that of a corpus (`python -m ident.benchmark.corpus`). Each session whose cause its
recorders measured is diagnosed whole, cut to the first seconds in which the arm moves, and as what
is left where every joint stands still. Printed: for each cut what is said of the cause (named,
weighed at some probability, or nothing), names that are wrong, and what could not be tested.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array
from ident.benchmark.corpus import Entry, read_index
from ident.benchmark.corpus_run import diagnose_entry
from ident.benchmark.labels import RIGHT, WRONG, Name, label
from ident.errors import ArmgapError
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.recordings.save import write_session

# Share of a joint's greatest speed below which it stands.
STANDS = 0.02
# Samples that a run needs to be one.
FEWEST_SAMPLES = 20


def cut_rows(run: Recording, rows: Array) -> Recording | None:
    """A run's chosen samples; None if they are too few."""
    if rows.sum() < FEWEST_SAMPLES:
        return None
    channels = {name: values[rows] for name, values in run.channels().items()}
    return replace(run, time=run.time[rows], **channels)


def speed_of(run: Recording) -> Array:
    """The fastest joint's share of its greatest speed, sample by sample."""
    interval = np.maximum(np.diff(run.time, prepend=2.0 * run.time[0] - run.time[1]), 1e-6)
    speed = np.abs(np.diff(run.position, axis=0, prepend=run.position[:1])) / interval[:, None]
    return np.max(speed / np.maximum(speed.max(axis=0), 1e-9), axis=1)


def first_seconds(session: Session, seconds: float) -> Session:
    """The first seconds from where the arm begins to move, over as many runs as they take."""
    left = seconds
    runs = []
    for run in session.runs:
        if left <= 0.0:
            break
        moving = np.flatnonzero(speed_of(run) > STANDS)
        begins = run.time[moving[0]] if len(moving) else run.time[0]
        part = cut_rows(run, (run.time >= begins) & (run.time <= begins + left))
        if part is not None:
            runs.append(part)
            left -= part.duration
    return replace(session, runs=tuple(runs))


def holds_alone(session: Session) -> Session:
    """What is left where every joint stands still."""
    parts = [cut_rows(run, speed_of(run) <= STANDS) for run in session.runs]
    return replace(session, runs=tuple(part for part in parts if part is not None))


def told(entry: Entry, session: Session) -> str:
    """What a diagnosis of a session says of the cause, and what else."""
    if not session.runs:
        return "nothing is left"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session"
        write_session(session, path)
        try:
            record = diagnose_entry(replace(entry, folder=str(path)))
        except ArmgapError as error:
            return f"refused: {error}"
    return in_words(entry, record)


def in_words(entry: Entry, record: dict[str, Any]) -> str:
    """Verdict, probability of the cause, and wrong names."""
    right, wrong = 0.0, []
    for candidate in record["candidates"]:
        judged = label(Name.of_candidate(candidate), entry)
        if judged == RIGHT:
            right = max(right, candidate["probability"])
        elif judged == WRONG and candidate["named"]:
            wrong.append(candidate["effect"])
    cause = entry.truth[0].effect
    untested = any(row["effect"] == cause for row in record["diagnosis"]["not_testable"])
    beside = f"; wrong: {', '.join(wrong)}" if wrong else ""
    hidden = "; said to be not testable" if untested else ""
    return f"{record['verdict']}, {cause} at {right:.2f}{beside}{hidden}"


def lines(entries: Sequence[Entry], seconds: Sequence[float]) -> Iterator[str]:
    """The table, a block a session."""
    for entry in entries:
        session = load_session(entry.folder)
        yield entry.case
        yield f"    whole        {told(entry, session)}"
        for length in seconds:
            yield f"    {length:4.0f} s       {told(entry, first_seconds(session, length))}"
        yield f"    holds alone  {told(entry, holds_alone(session))}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("index", type=Path)
    parser.add_argument("--seconds", default="5,10,20")
    given = parser.parse_args()
    measured = [entry for entry in read_index(given.index) if entry.kind == "measured"]
    for line in lines(measured, [float(word) for word in given.seconds.split(",")]):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
