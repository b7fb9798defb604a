"""Probabilities of changes: rows of pairs of sets with truth, stored, and a calibration that is
fitted to them.

    python -m ident.benchmark.change_calibration store CASES
    python -m ident.benchmark.change_calibration fit CASES… --out calibration_changes.toml

`CASES` is what `python -m ident.benchmark.real_check make … --compare` writes. `store` compares
each pair and writes what it said with a row for each change of the likeliest set, its features and
rivals; what is there already is not made again. `fit` takes those that are what was planted, or of
its class, for right and all others for wrong, each row alike, and prints how the probabilities hold
on arms that were left out whole: features and ridge are chosen anew without each. With the
probabilities are fitted how far the evidence between rivals is to be believed, and how wide
intervals have to be, as for a diagnosis.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomli_w

from ident.arrays import Array, Float
from ident.benchmark.calibrate import SIGNS, read_signs
from ident.benchmark.law_shares import Miss, Widths, fit_widths
from ident.benchmark.leave_out import (
    Problem,
    best_ridge,
    judge_left_out,
    probability_by_unit,
    score_ridges,
    select_features,
)
from ident.benchmark.logistic import Logistic
from ident.benchmark.real_rows import holds
from ident.benchmark.tempering import Choice, fit_temper
from ident.diagnosis.change.from_reports import compare_reports
from ident.errors import InputError
from ident.files import atomic_write
from ident.inference.calibration import sizes_of
from ident.inference.estimate import CLASS_ODDS
from ident.inference.rows import candidate_rows
from ident.records import JsonRecord, JsonTable, as_json
from ident.safe_read import read_json
from ident.sessions import Given, inspect_sources

# Features that a diagnosis has not, and the way in which each speaks by its meaning.
OF_CHANGES = {"log_size_over_runs": 1, "log_null_ratio": -1}
EITHER = 0  # sign of features that tell one law from another
NAMED_FROM = 0.5
# Where what was found of the pairs of a folder lies.
RESULTS = "results"
Row = JsonRecord


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of sets with what was planted and what was found."""

    answers: Mapping[str, Row]  # by folder and case
    results: Mapping[str, Row]  # by folder and case

    @classmethod
    def read(cls, folders: Sequence[Path]) -> Pairs:
        """Those that are stored.

        Raises:
            InputError: There is none.
        """
        answers: dict[str, Row] = {}
        results: dict[str, Row] = {}
        for folder in folders:
            for path in sorted((folder / RESULTS).glob("*.json")):
                record = read_json(path, "store the rows first")
                if "comparison" in record:
                    name = f"{folder.name}/{path.stem}"
                    results[name] = record
                    answers[name] = read_json(
                        folder / "answers" / path.name, "make the cases first"
                    )
        if not results:
            raise InputError(folders[0], "holds no pair of sets", "store the rows first")
        return cls(answers, results)

    def rows(self) -> list[tuple[str, Row]]:
        """All changes, each with its case."""
        return [
            (case, row) for case, record in self.results.items() for row in record.get("rows", ())
        ]

    def choices(self) -> list[Choice]:
        """For each planted change that a name or one of its rivals stands for, how likely each is.

        Returns:
            For each, the least deficit of those that are right [nats], and the deficits of the name
            (zero) and of all its rivals. A change that none of them stands for is left out.
        """
        choices = []
        for case, row in self.rows():
            members = [(as_finding(row, []), 0.0)]
            members += [
                (as_finding(row, [rival], alone=True), rival["deficit"]) for rival in row["rivals"]
            ]
            deficits = np.array([deficit for _, deficit in members])
            for effect in self.answers[case]["effects"]:
                true = [deficit for finding, deficit in members if holds(finding, effect)]
                if true:
                    choices.append(Choice(min(true), deficits))
        return choices

    def misses(self) -> list[Miss]:
        """Errors of the parameters of changes that are what was planted."""
        misses = []
        for case, row in self.rows():
            answer = self.answers[case]
            for effect in answer["effects"]:
                if row["effect"] == effect["effect"] and holds(as_finding(row, []), effect):
                    misses += _misses(row, effect["parameters"], answer["arm"])
        return misses

    @property
    def signs(self) -> dict[str, int]:
        """Features that the changes have, and the way in which each speaks by its meaning."""
        stored = {name for _, row in self.rows() for name in row["features"]}
        usual = {name: sign for name, sign in read_signs(SIGNS).items() if sign != EITHER}
        return {name: sign for name, sign in {**usual, **OF_CHANGES}.items() if name in stored}

    def table(self, temper: float) -> Problem:
        """Features and labels of all changes.

        Args:
            temper: Exponent of the evidence between rivals, which says what is of a class.
        """
        signs = self.signs
        features = []
        right = []
        arms = []
        for case, row in self.rows():
            most = np.log(CLASS_ODDS)
            near = [rival for rival in row["rivals"] if temper * rival["deficit"] <= most]
            finding = as_finding(row, near)
            features.append([row["features"][name] for name in signs])
            right.append(any(holds(finding, effect) for effect in self.answers[case]["effects"]))
            arms.append(self.answers[case]["arm"])
        alike = np.ones(len(right))
        return Problem(
            np.array(features), tuple(signs), np.array(right), alike, np.array(arms), signs
        )


def _misses(row: Row, truth: JsonTable, arm: str) -> list[Miss]:
    """Errors of one change's parameters."""
    parameters = row["parameters"].items()
    intervals = {name: each for name, each in parameters if each.get("value") is not None}
    sizes = sizes_of({name: interval["value"] for name, interval in intervals.items()})
    misses = []
    for name, interval in intervals.items():
        true = truth.get(name)
        if (
            not isinstance(true, (int, float))
            or interval["low"] is None
            or interval["high"] is None
        ):
            continue
        error = true - interval["value"]
        if name == "phase_rad":
            error = float(np.angle(np.exp(1j * error)))
        half = (
            interval["high"] - interval["value"]
            if error > 0.0
            else interval["value"] - interval["low"]
        )
        if half > 0.0:  # an end at the value itself stays there, however wide the other is
            misses.append(Miss(name, abs(error), half, sizes[name], arm))
    return misses


def as_finding(row: Row, near: Sequence[Row], alone: bool = False) -> Row:
    """A stored change as a finding.

    Args:
        row, near: The change, and the rivals that are of its class.
        alone: Whether they stand in its place.
    """
    joints = [row["joint"]] if row["joint"] else row["joints"]
    here = [rival["effect"] for rival in near if rival["joint"] == row["joint"]]
    elsewhere = [rival for rival in near if rival["joint"] != row["joint"]]
    effect = "" if alone else row["effect"]
    return {"effect": effect, "joints": joints, "class": [effect, *here], "elsewhere": elsewhere}


def store(cases: Path) -> None:
    """Compares each pair that has no result."""
    for folder in sorted((cases / "cases").iterdir()):
        path = cases / RESULTS / f"{folder.name}.json"
        if path.is_file() or not (folder / "before").is_dir():
            continue
        record = compare_pair(
            [folder / "before", folder / "after"], folder / "after" / "robot.urdf"
        )
        with atomic_write(path) as scratch:
            scratch.write_text(as_json(record, None) + "\n", encoding="utf-8")
        print(folder.name, len(record["rows"]), flush=True)


def compare_pair(sides: Sequence[Path], robot: Path) -> Row:
    """What is said of two sets, and a row for each change of the likeliest set.

    Args:
        sides, robot: The recordings before and after, and the URDF.
    """
    start = time.process_time()
    record: Row = {"rows": []}
    try:
        arm, reports = inspect_sources(Given(list(sides), robot)).whole
        comparison = compare_reports(reports[:1], reports[1:], arm)
        record["comparison"] = comparison.to_dict()
        if comparison.told is not None:
            session = comparison.told.likely.design.later_session
            record["rows"] = candidate_rows(comparison.told, session, comparison.joints)
    except InputError as error:
        record["error"] = str(error)
    record["processor_seconds"] = time.process_time() - start
    return record


@dataclass(frozen=True, eq=False)
class Fitted:
    """A calibration with how it holds on arms that were left out."""

    names: Logistic
    ridge: float  # that which holds best on arms left out
    held_out: Float[Array, " N"]  # probabilities there, features and ridge chosen without the arm
    temper: float
    widths: Widths
    pairs: int  # number of pairs that have a change

    @classmethod
    def of(cls, pairs: Pairs) -> tuple[Fitted, Problem]:
        """The whole calibration of pairs, and the rows that it was fitted to.

        Raises:
            InputError: Too few parameters are known for the widths of intervals.
        """
        temper = fit_temper(pairs.choices())
        widths = fit_widths(pairs.misses())
        if widths is None:
            what = "too few changes are what was planted"
            raise InputError("RESULTS", what, "store more pairs")
        rows = pairs.table(temper)
        names, ridge, held_out = fit(rows)
        count = len({case for case, _ in pairs.rows()})
        return cls(names, ridge, held_out, temper, widths, count), rows


def fit(rows: Problem) -> tuple[Logistic, float, Float[Array, " N"]]:
    """The regression, its ridge, and the probabilities on arms left out.

    These are of features and a ridge that were chosen without the arm, too.
    """
    held_out = probability_by_unit(judge_left_out(rows), rows.units, rows.features, rows.names)
    chosen = select_features(rows)
    ridge = best_ridge(score_ridges(chosen))
    return chosen.fit(ridge), ridge, held_out


def write(fitted: Fitted, rows: Problem, out: Path) -> None:
    """Writes the calibration, as TOML with what it was fitted to, into a file."""
    model = fitted.names
    terms = {}
    for k, name in enumerate(model.names):
        if np.isfinite(model.scaling.scale[k]):
            centre = float(model.scaling.centre[k])
            scale = float(model.scaling.scale[k])
            terms[name] = {"weight": float(model.weights[k]), "centre": centre, "scale": scale}
    record = {
        "schema": "ident.calibration_changes/1",
        "intercept": model.intercept,
        "ridge": fitted.ridge,
        "temper": fitted.temper,
        "pairs": fitted.pairs,
        "rows": len(rows.right),
        "arms": sorted(np.unique(rows.units).tolist()),
        "widths": {
            "factor": fitted.widths.factor,
            "share": fitted.widths.share,
            "coverage_held_out": fitted.widths.coverage,
            "count": fitted.widths.count,
        },
        "feature": terms,
    }
    with atomic_write(out) as scratch:
        scratch.write_text(tomli_w.dumps(record), encoding="utf-8")


def main() -> None:
    """The command; what it takes stands in the module's docstring."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("job", choices=("store", "fit"))
    parser.add_argument("cases", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=Path("calibration_changes.toml"))
    given = parser.parse_args()
    if given.job == "store":
        for cases in given.cases:
            store(cases)
        return
    fitted, rows = Fitted.of(Pairs.read(given.cases))
    write(fitted, rows, given.out)
    print("\n".join(summary_lines(fitted, rows)))


def summary_lines(fitted: Fitted, rows: Problem) -> list[str]:
    """How the calibration holds, in words."""
    named = fitted.held_out >= NAMED_FROM
    score = rows.score(fitted.held_out)
    widths = fitted.widths
    right = int((named & rows.right).sum())
    wrong = int((named & ~rows.right).sum())
    fit = f"ridge {fitted.ridge:.3g}; held-out log score {score:.3f} nats a change"
    figures = f"factor {widths.factor:.2f}, law's share {widths.share:.3f}"
    held = f"they hold {widths.coverage:.3f} on arms left out"
    return [
        f"{len(rows.right)} changes of {fitted.pairs} pairs, {int(rows.right.sum())} of them right",
        f"{fit}; temper {fitted.temper:.3f}",
        f"named on arms left out: {right} right, {wrong} wrong",
        f"intervals of {widths.count} parameters: {figures}; {held}",
    ]


if __name__ == "__main__":
    main()
