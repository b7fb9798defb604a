"""Sessions of which little is left: their first seconds of motion, or where every joint stands.

    python -m ident.benchmark.cuts DIR --seed 1

cuts the whole sessions that `DIR/index.json` lists, and lists the cuts there, too. Other people's
recordings are short, so a corpus has short ones: each session of which it is worth asking is cut to
a length that is drawn for it. What was put there stays the truth, whether the part that is left
shows it or not.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.benchmark.corpus import INDEX, Entry, count_kinds, read_index, write_index
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.recordings.save import write_session

# Lengths that are drawn [s].
LENGTHS_S = (5.0, 10.0, 20.0)
# Kinds of session that are cut: those that answer whether a short log is told too much of, or
# enough.
CUT_KINDS = ("control", "healthy", "measured", "outside", "single", "untouched")
# Visible size below which a whole session shows nothing of an effect [noise].
LEAST_VISIBLE = 0.7
# Share of a joint's greatest speed below which it stands.
STANDS = 0.02
# Samples that a run needs to be one.
FEWEST_SAMPLES = 20


def cut_rows(run: Recording, rows: Bool[Array, " T"]) -> Recording | None:
    """A run's chosen samples; None if they are too few."""
    return run.at(rows) if rows.sum() >= FEWEST_SAMPLES else None


def speed_of(run: Recording) -> Float[Array, " T"]:
    """The fastest joint's speed as a share of its own greatest in the run, 0 to 1, by sample."""
    interval = np.maximum(np.diff(run.time, prepend=2.0 * run.time[0] - run.time[1]), 1e-6)
    step = np.diff(run.position, axis=0, prepend=run.position[:1])
    speed = np.abs(step) / interval[:, None]
    return np.asarray(np.max(speed / np.maximum(speed.max(axis=0), 1e-9), axis=1))


def first_seconds(session: Session, seconds: float) -> Session:
    """The first seconds from where the arm begins to move, over as many runs as they take.

    Args:
        session: The session.
        seconds: How many [s].
    """
    left = seconds
    runs = []
    for run in session.runs:
        if left <= 0.0:
            break
        moving = np.flatnonzero(speed_of(run) > STANDS)
        begins = run.time[moving[0]] if len(moving) else run.time[0]
        stretch = cut_rows(run, (run.time >= begins) & (run.time <= begins + left))
        if stretch is not None:
            runs.append(stretch)
            left -= stretch.duration
    return replace(session, runs=tuple(runs))


def holds_alone(session: Session) -> Session:
    """What is left where every joint stands still."""
    stretches = [cut_rows(run, speed_of(run) <= STANDS) for run in session.runs]
    return replace(session, runs=tuple(still for still in stretches if still is not None))


def is_worth_a_cut(entry: Entry) -> bool:
    """Whether a session is of a kind that is cut, and shows what was put there."""
    if entry.kind != "single":
        return entry.kind in CUT_KINDS
    asked = entry.truth[0].asked
    return asked is None or asked >= LEAST_VISIBLE


def cut_entry(entry: Entry, seconds: float, folder: Path) -> Entry:
    """A cut session in the corpus's words; its control is cut to the same length."""
    control = cut_name(entry.control, seconds) if entry.control else ""
    return replace(
        entry,
        case=cut_name(entry.case, seconds),
        folder=str(folder),
        control=control,
        seconds=seconds,
    )


def cut_name(case: str, seconds: float) -> str:
    """Name of a case that was cut."""
    return f"{case}_first_{seconds:g}s"


def plan_cuts(entries: Iterable[Entry], seed: int) -> Iterator[tuple[Entry, float]]:
    """Each session that is cut, with its length; a control once for every length."""
    rng = np.random.default_rng([seed, 7])
    for entry in entries:
        drawn = float(rng.choice(LENGTHS_S))
        if not is_worth_a_cut(entry):
            continue
        for seconds in LENGTHS_S if entry.kind == "control" else (drawn,):
            yield entry, seconds


def make_cuts(
    entries: Sequence[Entry], out: Path, seed: int, say: Callable[[str], None]
) -> list[Entry]:
    """Writes the cut sessions, and returns their entries.

    Args:
        entries: Sessions that are whole.
        out: Folder that is to hold a session folder a cut.
        seed: Of the lengths.
        say: Told of each cut.
    """
    made = []
    for entry, seconds in plan_cuts(entries, seed):
        folder = out / cut_name(entry.case, seconds).replace("/", "__")
        if not folder.is_dir():
            session = first_seconds(load_session(entry.folder), seconds)
            if not session.runs:
                continue
            write_session(session, folder)
        made.append(cut_entry(entry, seconds, folder))
        say(made[-1].case)
    return made


def add_cuts(folder: Path, seed: int, say: Callable[[str], None]) -> list[Entry]:
    """Cuts the whole sessions of a corpus, and lists them in its index, too."""
    whole = [entry for entry in read_index(folder / INDEX) if not entry.seconds]
    entries = [*whole, *make_cuts(whole, folder / "cuts", seed, say)]
    write_index(folder, entries)
    return entries


def main() -> None:
    """The command; what it takes stands in the module's docstring."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()

    def say(line: str) -> None:
        sys.stdout.write(line + "\n")
        sys.stdout.flush()

    say(count_kinds(add_cuts(given.folder, given.seed, say)))


if __name__ == "__main__":
    main()
