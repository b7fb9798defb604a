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

from ident.benchmark.corpus import Entry, read_index
from ident.benchmark.corpus_run import diagnose_entry
from ident.benchmark.cuts import first_seconds, holds_alone
from ident.benchmark.labels import RIGHT, WRONG, Name, label
from ident.errors import ArmgapError
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.recordings.save import write_session


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
    measured = [entry for entry in read_index(given.index) if entry.kind == "measured" and not entry.seconds]
    for line in lines(measured, [float(word) for word in given.seconds.split(",")]):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
