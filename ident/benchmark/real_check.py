"""Semi-real cases as a check: made, sealed, diagnosed or compared, scored.

    python -m ident.benchmark.real_check make OUT --cases 150 --seed 1 [--real DIR] [--compare]
                                              [--arms ARM,…] [--kept-back]
    python -m ident.benchmark.real_check diagnose OUT [--results DIR] [--only 'case_00*']
    python -m ident.benchmark.real_check score OUT [--results DIR]

`OUT/cases` holds a session folder a case (`before` and `after` of a comparison), and the untouched
recordings as `control_…`; what was planted lies in `OUT/answers`.
"""

from __future__ import annotations

import argparse
import fnmatch
import itertools
import json
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ident.benchmark.real_rows import Row, rows_of
from ident.benchmark.real_tables import score, tables
from ident.benchmark.run import BlindOptions, Progress, Say, begin_check
from ident.diagnosis.change.from_reports import compare_reports
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.files import atomic_write
from ident.records import JsonRecord, as_json
from ident.results import Provenance, Result
from ident.safe_read import read_json
from ident.sessions import Given, inspect_sources
from ident.show.palette import FLEXIBLE
from ident.show.results import draw_bars
from ident.simulation.real.cases import make_cases
from ident.simulation.real.sources import load_sources
from ident.workers import run_tasks

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class RealReport(Result):
    """The outcome on semi-real cases.

    Seed, SHA-256 of each case's answer, scores with their rows, tables in words.
    """

    seed: int
    seals: dict[str, str]
    record: JsonRecord
    lines: tuple[str, ...]

    def to_dict(self) -> JsonRecord:
        """`ident.blind/1`, as far as real arms know it."""
        origin = {"provenance": self.provenance.to_dict()}
        return {
            "schema": "ident.blind/1",
            "seed": self.seed,
            "seals": self.seals,
            **self.record,
            **origin,
        }

    def summary(self) -> str:
        return "\n".join(self.lines)

    def plot(self) -> Figure:
        shares = {name: value for name, value in self.record["scores"].items() if value is not None}
        row = (FLEXIBLE, list(shares.values()))
        return draw_bars(list(shares), {"semi-real": row}, "share", "semi-real cases")


def read_rows(out: Path, results: Path) -> tuple[list[Row], list[Row], list[Row]]:
    """Rows of all cases of a folder that have a result; see `rows_of`.

    Args:
        out: The check's folder.
        results: Folder of a JSON a diagnosed case.
    """
    answers: dict[str, Row] = {}
    records: dict[str, Row] = {}
    for answer in sorted((out / "answers").glob("*.json")):
        answers[answer.stem] = json.loads(answer.read_text())
        result = results / answer.name
        if result.is_file():
            records[answer.stem] = json.loads(result.read_text())
    return rows_of(answers, records)


def check_on_real(folder: Path, options: BlindOptions, say: Say, progress: Progress) -> RealReport:
    """Plants effects onto the real recordings below a folder, diagnoses and scores.

    Goes on where it was stopped.

    Raises:
        InputError: No recordings there, or another check in the folder.
    """
    seed = begin_check(options, {"semi_real": str(folder)})
    out = options.out
    sealed = out / "seals.json"
    if not sealed.is_file():
        make_cases(load_sources(folder), out, options.cases, seed, paired=False)
    seals: dict[str, str] = read_json(sealed, "remove it, or choose another --out")
    for name, seal in seals.items():
        say(f"{name} sealed: sha256 {seal}")
    tasks = {name: (out / "cases" / name, out / "results" / f"{name}.json") for name in seals}
    waiting = {name: task for name, task in tasks.items() if not task[1].is_file()}
    done = itertools.count(len(seals) - len(waiting) + 1)

    def count(name: str) -> None:
        progress("diagnosing", next(done), len(seals))

    run_tasks(diagnose_case, list(waiting.values()), options.workers, options.scheduler, count)
    rows = read_rows(out, out / "results")
    settings = {"cases": options.cases, "seed": seed, "semi_real": str(folder)}
    origin = Provenance("ident blind", settings=settings)
    report = RealReport(seed, seals, score(*rows), tuple(tables(*rows)), provenance=origin)
    report.save(out / "blind.json")
    return report


def diagnose_case(task: tuple[Path, Path]) -> str:
    """Diagnoses a case, or compares its before and after, and writes what was found.

    Returns its name.
    """
    folder, path = task
    start = time.perf_counter()
    used = time.process_time()
    record: JsonRecord = {}
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
    record["seconds"] = time.perf_counter() - start
    record["processor_seconds"] = time.process_time() - used
    with atomic_write(path) as scratch:
        scratch.write_text(as_json(record, None) + "\n", encoding="utf-8")
    return folder.name


def main() -> None:
    """The command; what it takes stands in the module's docstring."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("job", choices=("make", "diagnose", "score"))
    parser.add_argument("out", type=Path)
    parser.add_argument(
        "--real", type=Path, default=Path(os.environ.get("IDENT_REAL_DATA", "../shared/real"))
    )
    parser.add_argument("--cases", type=int, default=150)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--compare", action="store_true")
    parser.add_argument(
        "--arms", default="", help="physical arms, separated by commas; all if none is given"
    )
    parser.add_argument(
        "--kept-back", action="store_true", help="the arms that stay closed until a release"
    )
    parser.add_argument("--results", type=Path)
    parser.add_argument("--only", default="*")
    given = parser.parse_args()
    results = given.results or given.out / "results"
    if given.job == "make":
        arms = tuple(filter(None, given.arms.split(",")))
        sources = load_sources(given.real, given.kept_back, arms)
        make_cases(sources, given.out, given.cases, given.seed, given.compare, print)
    elif given.job == "score":
        print("\n".join(tables(*read_rows(given.out, results))))
    else:
        for folder in sorted((given.out / "cases").iterdir()):
            path = results / f"{folder.name}.json"
            if fnmatch.fnmatch(folder.name, given.only) and not path.is_file():
                print(diagnose_case((folder, path)), flush=True)


if __name__ == "__main__":
    main()
