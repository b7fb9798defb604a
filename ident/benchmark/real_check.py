"""Semi-real cases as a check: made, sealed, diagnosed or compared, scored.

    python -m ident.benchmark.real_check make OUT --cases 150 --seed 1 [--real DIR] [--compare]
    python -m ident.benchmark.real_check diagnose OUT [--results DIR] [--only 'case_00*']
    python -m ident.benchmark.real_check score OUT [--results DIR]

`OUT/cases` holds a session folder a case (`before` and `after` of a comparison), and the untouched recordings as
`control_…`; what was planted lies in `OUT/answers`.
"""

from __future__ import annotations

import argparse
import fnmatch
import itertools
import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.benchmark.real_score import Row, rows_of, score, tables
from ident.benchmark.run import BlindOptions, begin_check
from ident.diagnosis.change.from_reports import compare_reports
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.files import atomic_write
from ident.provenance import Provenance
from ident.results import Result
from ident.safe_read import read_json
from ident.sessions import Given, inspect_sources
from ident.show.panels import draw_bars
from ident.simulation.real.cases import make_cases
from ident.simulation.real.sources import load_sources
from ident.workers import run_tasks

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class RealReport(Result):
    """The outcome on semi-real cases: seed, SHA-256 of each case's answer, scores with their rows, tables in words."""

    seed: int
    seals: dict[str, str]
    record: dict[str, Any]
    lines: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """`ident.blind/1`, as far as real arms know it."""
        origin = {"provenance": self.provenance.to_dict()}
        return {"schema": "ident.blind/1", "seed": self.seed, "seals": self.seals, **self.record, **origin}

    def summary(self) -> str:
        return "\n".join(self.lines)

    def plot(self) -> Figure:
        shares = {name: value for name, value in self.record["scores"].items() if value is not None}
        return draw_bars(list(shares), {"semi-real": ("#0072b2", list(shares.values()))}, "share", "semi-real cases")


def read_rows(out: Path, results: Path) -> tuple[list[Row], list[Row], list[Row]]:
    """Rows of all cases of a folder that have a result; see `rows_of`."""
    answers = {path.stem: json.loads(path.read_text()) for path in sorted((out / "answers").glob("*.json"))}
    files = {name: results / f"{name}.json" for name in answers}
    return rows_of(answers, {name: json.loads(path.read_text()) for name, path in files.items() if path.is_file()})


def check_on_real(
    folder: Path, options: BlindOptions, say: Callable[[str], None], progress: Callable[[str, int, int], None]
) -> RealReport:
    """Plants effects onto the real recordings below a folder, diagnoses and scores; goes on where it was stopped.

    Args:
        folder: Real recordings.
        options: Number of cases, seed, folder for everything, workers.
        say: Told the seals, line by line, before any diagnosis.
        progress: Told what is being done, how many cases are done, and of how many.

    Raises:
        InputError: No recordings there, or another check in the folder.
    """
    seed, out = begin_check(options, {"semi_real": str(folder)}), options.out
    sealed = out / "seals.json"
    if not sealed.is_file():
        make_cases(load_sources(folder), out, options.cases, seed, paired=False)
    seals: dict[str, str] = read_json(sealed, "remove it, or choose another --out")
    for name, seal in seals.items():
        say(f"{name} sealed: sha256 {seal}")
    tasks = {name: (out / "cases" / name, out / "results" / f"{name}.json") for name in seals}
    waiting = {name: task for name, task in tasks.items() if not task[1].is_file()}
    done = itertools.count(len(seals) - len(waiting) + 1)
    run_tasks(
        diagnose_case,
        list(waiting.values()),
        options.workers,
        options.scheduler,
        lambda name: progress("diagnosing", next(done), len(seals)),
    )
    rows = read_rows(out, out / "results")
    settings = {"cases": options.cases, "seed": seed, "semi_real": str(folder)}
    origin = Provenance("ident blind", settings=settings)
    report = RealReport(seed, seals, score(*rows), tuple(tables(*rows)), provenance=origin)
    report.save(out / "blind.json")
    return report


def diagnose_case(task: tuple[Path, Path]) -> str:
    """Diagnoses a case, or compares its before and after, and writes what was found; returns its name."""
    folder, path = task
    start, used = time.perf_counter(), time.process_time()
    record: dict[str, Any] = {}
    try:
        if (folder / "before").is_dir():
            sides = [folder / "before", folder / "after"]
            arm, reports = inspect_sources(Given(sides, sides[1] / "robot.urdf")).whole
            record["comparison"] = compare_reports(reports[:1], reports[1:], arm).to_dict()
        else:
            arm, reports = inspect_sources(Given([folder], folder / "robot.urdf")).whole
            record["diagnosis"] = diagnose_reports(reports, arm, CATALOGUE)[0].to_dict()
    except InputError as error:
        record["error"] = str(error)
    record["seconds"], record["processor_seconds"] = time.perf_counter() - start, time.process_time() - used
    with atomic_write(path) as part:
        part.write_text(json.dumps(record, default=float) + "\n", encoding="utf-8")
    return folder.name


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("job", choices=("make", "diagnose", "score"))
    parser.add_argument("out", type=Path)
    parser.add_argument("--real", type=Path, default=Path(os.environ.get("IDENT_REAL_DATA", "../shared/real")))
    parser.add_argument("--cases", type=int, default=150)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--compare", action="store_true")
    parser.add_argument("--results", type=Path)
    parser.add_argument("--only", default="*")
    given = parser.parse_args()
    results = given.results or given.out / "results"
    if given.job == "make":
        make_cases(load_sources(given.real), given.out, given.cases, given.seed, given.compare, print)
    elif given.job == "score":
        print("\n".join(tables(*read_rows(given.out, results))))
    else:
        for folder in sorted((given.out / "cases").iterdir()):
            path = results / f"{folder.name}.json"
            if fnmatch.fnmatch(folder.name, given.only) and not path.is_file():
                print(diagnose_case((folder, path)), flush=True)


if __name__ == "__main__":
    main()
