"""Fits the probabilities of candidates to a stored corpus, and says how they hold on what the fit
never saw.

    python -m ident.benchmark.calibrate store RESULTS TABLE --index INDEX
    python -m ident.benchmark.calibrate fit TABLE --results RESULTS --index INDEX --out
    calibration.toml [--features a,b,…] [--signs SIGNS.toml]
    python -m ident.benchmark.calibrate names TABLE --out calibration.toml [--features …] [--select]
    python -m ident.benchmark.calibrate gaps INDEX RESULTS [INDEX RESULTS …] --out calibration.toml
    python -m ident.benchmark.calibrate unlike TABLE [TABLE …] --out calibration.toml

`store` reads one JSON a session into a table (`corpus_table`). `fit` writes the calibration, and
beside the table the probabilities that each row gets from a fit without its own unit
(`held_out.parquet`): a unit is a real arm, a drawn world, or an arm of another simulator, and it is
left out whole. Of a file that is there, `names` fits only the odds of names anew, `gaps` only what
tells causes without a name, and `unlike` only what a parameter that no arm has says against a name.
The ridge is that of the best held-out log score. `SIGNS.toml` holds `increasing = […]` and
`decreasing = […]`: features that by their meaning speak for or against.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ident.benchmark.calibration_file import SCHEMA, summary_lines, write_calibration
from ident.benchmark.corpus import Entry, read_index
from ident.benchmark.corpus_run import result_path
from ident.benchmark.corpus_table import CANDIDATE, REAL, Table, load_table, use_index
from ident.benchmark.gap_odds import GapFit, JointRows, fit_gaps, joined
from ident.benchmark.labels import RIGHT, UNKNOWN, WRONG
from ident.benchmark.law_shares import Miss, Widths, fit_widths
from ident.benchmark.logistic import Logistic, fit_logistic
from ident.benchmark.name_odds import ROWS, SCHEMES, FittedNames, fit_calibration, judge_groups
from ident.benchmark.outcomes import NAMED_FROM
from ident.benchmark.tempering import choices, fit_growing_temper
from ident.benchmark.unlike_odds import UnlikeFit, fit_unlike
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.files import atomic_write
from ident.inference.calibration import Temper, left_of_kind, read_odds, sizes_of
from ident.inference.features import SHAPE_LEFT
from ident.records import JsonRecord, JsonTable
from ident.safe_read import read_toml

SIGNS = Path(__file__).with_name("signs.toml")
HELD_OUT_FILE = "held_out.parquet"
BODIES = {effect.id for effect in CATALOGUE if effect.as_change.body}
LEAST_RIDGE = 1e-5


@dataclass(frozen=True, eq=False)
class Further:
    """What else is fitted to the corpus."""

    gaps: GapFit
    temper: Temper
    even_nats: float  # log evidence at which half of the candidates are right
    widths: Widths | None


def fit_further(
    table: Table, fitted: FittedNames, results: JsonTable, entries: Mapping[str, Entry]
) -> Further:
    """Fits gaps at joints, the temper between rivals, and the widths of intervals."""
    gaps = fit_gaps(JointRows.of(results, entries))
    left = left_of_kind(table.features.get(SHAPE_LEFT, np.full(len(table.rows), -np.inf)))
    misses = []
    for k, (row, probability) in enumerate(zip(table.rows, fitted.held_out, strict=True)):
        session = table.sessions[row["case"]]
        # What hangs on a real arm is seen beside what its own links are off by.
        is_judged = session.group not in REAL or row["effect"] not in BODIES
        if probability >= NAMED_FROM and is_judged:
            unit = session.unit
            intervals = json.loads(row["intervals"])
            values = {interval["parameter"]: interval["value"] for interval in intervals}
            sizes = sizes_of(values)
            misses += [_miss(interval, unit, sizes, float(left[k])) for interval in intervals]
    return Further(
        gaps,
        fit_growing_temper(choices(results, entries)),
        _even_nats(table, fitted),
        fit_widths(misses),
    )


def _miss(interval: JsonTable, unit: str, sizes: Mapping[str, float], left: float) -> Miss:
    error = abs(interval["true"] - interval["value"])
    if interval["parameter"] == "phase_rad":
        error = abs(float(np.angle(np.exp(1j * error))))
    half = 0.5 * (interval["high"] - interval["low"])
    size = sizes[interval["parameter"]]
    return Miss(str(interval["parameter"]), error, half, size, unit, left)


def _even_nats(table: Table, fitted: FittedNames) -> float:
    """Log evidence at which half of the candidates of simulated arms are right, by that alone."""
    simulated = table.groups != "real"
    counted = (fitted.labels != UNKNOWN) & simulated
    values = table.features["log_nats"][counted][:, None]
    right = fitted.labels[counted] == RIGHT
    model = fit_logistic(values, right, np.ones(len(right)), ("log_nats",), LEAST_RIDGE)
    standard = -model.intercept / model.weights[0]
    return float(np.expm1(model.scaling.centre[0] + standard * model.scaling.scale[0]))


def read_results(folder: Path, cases: Iterable[str]) -> JsonRecord:
    """Stored results by case; a case without a file has none."""
    results = {}
    for case in cases:
        path = result_path(folder, case)
        if not path.is_file():
            continue
        record = json.loads(path.read_text(encoding="utf-8"))
        if "candidates" in record:
            results[case] = record
    return results


def calibration_record(table: Table, fitted: FittedNames, origin: JsonTable) -> JsonRecord:
    """What `calibration.toml` holds."""
    model = fitted.model
    features = _terms(model)
    counts = Counter(map(str, fitted.labels))
    units = sorted({session.unit for session in table.sessions.values()})
    record: JsonRecord = {
        "schema": SCHEMA,
        "intercept": model.intercept,
        "named_from": NAMED_FROM,
        "ridge": fitted.ridge,
        "feature": features,
        "origin": {
            **origin,
            "sessions": len(table.sessions),
            "right": counts[RIGHT],
            "wrong": counts[WRONG],
            "unknown": counts[UNKNOWN],
            "units": units,
        },
        "held_out": judge_groups(table, fitted),
        "ridges": {
            f"{ridge:.2e}": round(score, 5) for ridge, score in sorted(fitted.scores.items())
        },
    }
    return record


def further_record(further: Further) -> JsonRecord:
    """What `calibration.toml` holds beside the odds of names."""
    record: JsonRecord = {
        "temper": further.temper.of_thousand,
        "temper_growth": further.temper.growth,
        "even_nats": further.even_nats,
        "gap": gap_record(further.gaps),
    }
    if further.widths is not None:
        widths = further.widths
        record["widths"] = {
            "factor": widths.factor,
            "share": widths.share,
            "of_left": widths.of_left,
            "coverage_held_out": round(widths.coverage, 4),
            "count": widths.count,
        }
    return record


def gap_record(gaps: GapFit) -> JsonRecord:
    """What `calibration.toml` holds of causes without a name."""
    return {
        "intercept": gaps.model.intercept,
        "ridge": gaps.ridge,
        "feature": _terms(gaps.model),
        "held_out": {
            "told": round(gaps.told, 4),
            "false": round(gaps.false, 4),
            "open": gaps.counts[0],
            "closed": gaps.counts[1],
        },
    }


def write_gaps(corpora: Sequence[tuple[Path, Path]], out: Path, origin: JsonTable) -> JsonRecord:
    """Fits a calibration's odds of causes without a name anew; all else in its file stays.

    Args:
        corpora: Index and folder of results of each.
        out: The calibration's file.
        origin: What is written down of where the odds come from.

    Returns:
        The file's new record.

    Raises:
        InputError: There is no such file, or no result.
    """
    record = dict(read_toml(out, "fit one: python -m ident.benchmark.calibrate fit"))
    rows = []
    sessions = 0
    for index, folder in corpora:
        entries = {entry.case: entry for entry in read_index(index)}
        results = read_results(folder, entries)
        if not results:
            raise InputError(folder, "holds no result of its index", "diagnose the corpus first")
        sessions += len(results)
        rows.append(JointRows.of(results, entries))
    record["gap"] = {
        **gap_record(fit_gaps(joined(rows))),
        "origin": {**origin, "sessions": sessions},
    }
    write_calibration(out, record)
    return record


def write_names(table: Table, fitted: FittedNames, out: Path, origin: JsonTable) -> JsonRecord:
    """Writes odds of names into a calibration that is there, and the log evidence at which names
    are even; all else in its file stays.

    Args:
        table, fitted: The candidates, and the odds that were fitted to them.
        out: The calibration's file.
        origin: What is written down of where the odds come from.

    Returns:
        The file's new record.

    Raises:
        InputError: There is no such file.
    """
    before = read_toml(out, "fit one: python -m ident.benchmark.calibrate fit")
    of_names = calibration_record(table, fitted, origin)
    record = {**before, **of_names, "even_nats": _even_nats(table, fitted)}
    write_calibration(out, record)
    return record


def write_unlike(tables: Sequence[Path], out: Path, origin: JsonTable) -> JsonRecord:
    """Fits what a parameter that no arm has says anew; all else in the calibration's file stays.

    Args:
        tables: Of the candidates of some corpora.
        out: The calibration's file.
        origin: What is written down of where it comes from.

    Returns:
        The file's new record.

    Raises:
        InputError: There is no such file.
    """
    record = dict(read_toml(out, "fit one: python -m ident.benchmark.calibrate fit"))
    loaded = [load_table(table, CANDIDATE) for table in tables]
    sessions = sum(len(table.sessions) for table in loaded)
    fitted = unlike_record(fit_unlike(loaded, read_odds(record)))
    record["unlike_any_arm"] = {**fitted, "origin": {**origin, "sessions": sessions}}
    write_calibration(out, record)
    return record


def unlike_record(fit: UnlikeFit) -> JsonRecord:
    """What `calibration.toml` holds of parameters that no arm has."""
    return {
        "share": fit.share,
        "right": fit.right,
        "wrong": fit.wrong,
        "held_out_nats": round(fit.held_out_nats, 2),
    }


def _terms(model: Logistic) -> dict[str, dict[str, float]]:
    return {
        name: {
            "weight": float(model.weights[k]),
            "centre": float(model.scaling.centre[k]),
            "scale": float(model.scaling.scale[k]),
        }
        for k, name in enumerate(model.names)
        if np.isfinite(model.scaling.scale[k])
    }


def write_fit(
    table: Table,
    fitted: FittedNames,
    out: Path,
    folder: Path,
    origin: JsonTable,
    further: JsonTable,
) -> JsonRecord:
    """Writes a calibration, and beside its table what it says of units that it has not seen."""
    record = {**calibration_record(table, fitted, origin), **further}
    record["unlike_any_arm"] = unlike_record(fit_unlike([table], read_odds(record)))
    write_calibration(out, record)
    labels = [str(label) for label in fitted.labels]
    with atomic_write(folder / HELD_OUT_FILE) as temporary:
        pq.write_table(pa.table({"probability": fitted.held_out, "label": labels}), temporary)
    return record


def chosen_features(table: Table, asked: str) -> list[str]:
    """Features by name, or all that the table has."""
    names = [name for name in asked.split(",") if name]
    table.matrix(names)
    return names or sorted(table.features)


def read_signs(path: Path) -> dict[str, int]:
    """Which way features speak by their meaning; 0 where either."""
    record = read_toml(path, "give increasing = […] and decreasing = […]")
    signs = {str(name): 1 for name in record.get("increasing", ())}
    signs.update({str(name): -1 for name in record.get("decreasing", ())})
    signs.update({str(name): 0 for name in record.get("either", ())})
    return signs


def current_commit() -> str:
    """The commit of the working tree; empty where there is none."""
    command = ["git", "rev-parse", "--short", "HEAD"]
    done = subprocess.run(
        command, cwd=Path(__file__).parent, capture_output=True, text=True, check=False
    )
    return done.stdout.strip()


def _add_fit_options(job: argparse.ArgumentParser) -> None:
    """Adds what both jobs that fit odds of names take."""
    job.add_argument("table", type=Path)
    job.add_argument("--out", type=Path, required=True)
    job.add_argument("--features", default="")
    job.add_argument("--signs", type=Path, default=SIGNS)
    job.add_argument("--weights", default=ROWS, help=f"what counts alike: {', '.join(SCHEMES)}")
    job.add_argument("--select", action="store_true", help="leave needless features out")
    job.add_argument("--nested", action="store_true", help="choose them anew without each unit")
    job.add_argument("--seed", type=int, default=0, help="of the corpus, to be written down")
    job.add_argument(
        "--commit", default="", help="of the engine whose rows these are; the current one"
    )


def main() -> None:
    """The command; what it takes stands in the module's docstring."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    jobs = parser.add_subparsers(dest="job", required=True)
    storing = jobs.add_parser("store")
    storing.add_argument("results", type=Path)
    storing.add_argument("table", type=Path)
    storing.add_argument("--index", type=Path, required=True)
    fitting = jobs.add_parser("fit")
    _add_fit_options(fitting)
    fitting.add_argument("--results", type=Path, required=True)
    fitting.add_argument("--index", type=Path, required=True)
    _add_fit_options(jobs.add_parser("names"))
    unnamed = jobs.add_parser("gaps")
    unnamed.add_argument("corpora", type=Path, nargs="+", help="index and results of each corpus")
    unnamed.add_argument("--out", type=Path, required=True)
    unnamed.add_argument("--seeds", type=int, nargs="*", default=[], help="to be written down")
    unlike = jobs.add_parser("unlike")
    unlike.add_argument("tables", type=Path, nargs="+", help="tables of candidates")
    unlike.add_argument("--out", type=Path, required=True)
    unlike.add_argument("--seeds", type=int, nargs="*", default=[], help="to be written down")
    given = parser.parse_args()
    if given.job == "gaps":
        if len(given.corpora) % 2:
            unnamed.error("give the index and the results of each corpus")
        corpora = list(zip(given.corpora[::2], given.corpora[1::2], strict=True))
        when = datetime.now(UTC).strftime("%Y-%m-%d")
        origin = {"seeds": given.seeds, "commit": current_commit(), "date": when}
        record = write_gaps(corpora, given.out, origin)
        sys.stdout.write("\n".join(summary_lines(record)) + "\n")
        return
    if given.job == "unlike":
        when = datetime.now(UTC).strftime("%Y-%m-%d")
        origin = {"seeds": given.seeds, "commit": current_commit(), "date": when}
        record = write_unlike(given.tables, given.out, origin)
        sys.stdout.write("\n".join(summary_lines(record)) + "\n")
        return
    if given.job == "store":
        sessions, rows = use_index(given.index, given.results, given.table)
        sys.stdout.write(f"{sessions} sessions, {rows} rows\n")
        return
    table = load_table(given.table, CANDIDATE)
    signs = read_signs(given.signs)
    names = chosen_features(table, given.features or ",".join(signs))
    fitted = fit_calibration(table, names, signs, given.weights, given.select, given.nested)
    origin = {
        "seed": given.seed,
        "commit": given.commit or current_commit(),
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "weights": given.weights,
    }
    if given.job == "names":
        record = write_names(table, fitted, given.out, origin)
    else:
        entries = {entry.case: entry for entry in read_index(given.index)}
        results = read_results(given.results, table.sessions)
        further = further_record(fit_further(table, fitted, results, entries))
        record = write_fit(table, fitted, given.out, given.table, origin, further)
    sys.stdout.write("\n".join(summary_lines(record)) + "\n")


if __name__ == "__main__":
    main()
