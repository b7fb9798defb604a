"""A corpus as one check: sessions are made, diagnosed, stored and scored; or a calibration is
fitted to them.

Everything lies in one folder and is had once: `real` and `worlds` (sessions and answers), `other`
(sessions of other simulators, where somebody puts them there), `results` (a JSON a session),
`table`, `calibration.toml`, `score.json`.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from ident.arrays import Array, Float
from ident.benchmark.calibrate import (
    SIGNS,
    current_commit,
    fit_further,
    further_record,
    read_results,
    read_signs,
    write_fit,
)
from ident.benchmark.calibration_file import read_calibration, summary_lines
from ident.benchmark.corpus import INDEX, count_kinds, make_index, make_real, read_index
from ident.benchmark.corpus_run import run_all
from ident.benchmark.corpus_table import CANDIDATE, FINDING, Table, load_table, store
from ident.benchmark.corpus_worlds import make_world_cases, plan_world_cases
from ident.benchmark.name_odds import fit_calibration
from ident.benchmark.outcomes import apply_rule
from ident.benchmark.run import BlindOptions, Progress, Say
from ident.benchmark.score_table import lines_of, score
from ident.errors import InputError
from ident.files import write_record
from ident.records import JsonRecord
from ident.results import Provenance, Result
from ident.show.palette import FLEXIBLE
from ident.show.results import draw_bars

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCORE_SCHEMA = "ident.corpus_score/1"
CALIBRATION_FILE = "calibration.toml"
SIGNS_FILE = "signs.toml"
SHOWN = ("single 3x class", "single 1x class", "healthy told a gap", "untouched new name")
"""Scores that the picture shows."""


@dataclass(frozen=True, eq=False)
class CorpusReport(Result):
    """What a corpus says of a diagnosis, or of a calibration: a record and the same in words."""

    record: JsonRecord
    lines: tuple[str, ...]

    def to_dict(self) -> JsonRecord:
        return {**self.record, "provenance": self.provenance.to_dict()}

    def summary(self) -> str:
        return "\n".join(self.lines)

    def plot(self) -> Figure:
        scores = self.record.get("all", {})
        shown: dict[str, float] = {}
        for key in SHOWN:
            value = scores.get(key, {}).get("value")
            if value is not None:
                shown[key] = float(value)
        colours = {"corpus": (FLEXIBLE, list(shown.values()))}
        return draw_bars(list(shown), colours, "share", "sessions of the corpus")


def check_corpus(
    folder: Path, recordings: Path | None, options: BlindOptions, say: Say, progress: Progress
) -> CorpusReport:
    """Makes what a corpus lacks, diagnoses what has no result yet, and scores all of it.

    Args:
        folder: Of the corpus; one that was stopped goes on.
        recordings: Folder of real recordings, for the semi-real part; no such part is made without.
        options: Number of cases of each part, their seed, and the worlds; no drawn world without.
        say: Is told each case as it is made.
        progress: Is told how many are diagnosed.

    Raises:
        InputError: There is nothing to be made and nothing there.
    """
    seed = options.seed or 0
    if recordings is not None and not (folder / "real").is_dir():
        make_real(folder, recordings, options.cases, seed, kept_back=False, say=say)
    if options.worlds:
        tasks = plan_world_cases(folder / "worlds", options.cases, seed, options.worlds)
        make_world_cases(tasks, say)
    others = [folder / "other"] if (folder / "other").is_dir() else []
    entries = make_index(folder, others)
    if not entries:
        what = "holds no session with its truth"
        raise InputError(folder, what, "make some: --semi-real DIR, or --worlds all")
    say(count_kinds(entries))
    done = 0

    def count(line: str) -> None:
        nonlocal done
        done += 1
        progress("diagnosing", done, len(entries))

    run_all(entries, folder / "results", say=count)
    store(entries, folder / "results", folder / "table")
    table, probability = _probabilities(folder)
    record = {"schema": SCORE_SCHEMA, **score(table, apply_rule(table, probability))}
    write_record(folder / "score.json", record)
    settings = {"cases": options.cases, "seed": seed, "worlds": options.worlds}
    made_by = Provenance("ident blind", settings=settings)
    return CorpusReport(record, tuple(lines_of(record)), provenance=made_by)


def _probabilities(folder: Path) -> tuple[Table, Float[Array, " N"]]:
    """Rows, and how probable each is by the corpus's calibration, or as reported without one."""
    if (folder / CALIBRATION_FILE).is_file():
        table = load_table(folder / "table", CANDIDATE)
        model = read_calibration(folder / CALIBRATION_FILE)
        return table, model.probability(table.matrix(model.names))
    table = load_table(folder / "table", FINDING)
    return table, table.probability


def calibrate_corpus(folder: Path, seed: int | None) -> CorpusReport:
    """Fits the calibration to a stored corpus and writes it there.

    Raises:
        InputError: Nothing is stored, or too little.
    """
    entries = {entry.case: entry for entry in read_index(folder / INDEX)}
    table = load_table(folder / "table", CANDIDATE)
    path = folder / SIGNS_FILE
    signs = read_signs(path if path.is_file() else SIGNS)
    fitted = fit_calibration(table, list(signs), signs)
    results = read_results(folder / "results", table.sessions)
    further = further_record(fit_further(table, fitted, results, entries))
    date = datetime.now(UTC).strftime("%Y-%m-%d")
    origin = {"seed": seed or 0, "commit": current_commit(), "date": date}
    out = folder / CALIBRATION_FILE
    record = write_fit(table, fitted, out, folder / "table", origin, further)
    made_by = Provenance("ident blind", settings={"calibrate": str(folder), "seed": seed})
    return CorpusReport(record, tuple(summary_lines(record)), provenance=made_by)
