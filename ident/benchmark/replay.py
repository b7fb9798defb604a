"""A decision rule on the whole stored table: what would be named, and how right that is.

    python -m ident.benchmark.replay score TABLE [--findings | --calibration FILE | --held-out]
    [--json OUT]
    python -m ident.benchmark.replay compare BEFORE AFTER [the same options, for AFTER; BEFORE by
    its findings]

Names come from what was reported (`--findings`), from a calibration's probabilities, or from those
that each row got from a fit without its own arm or world (`--held-out`, the default). A rule takes
candidates in the order of their probability and skips one that a name before it says already; what
is at 0.5 or more is a name.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from scipy.stats import binomtest

from ident.arrays import Array, Float
from ident.benchmark.calibrate import HELD_OUT_FILE, KNOWN_FROM, NAMED_FROM, read_calibration
from ident.benchmark.corpus_table import CANDIDATE, FINDING, SessionRow, Table, load_table
from ident.benchmark.labels import RIGHT, UNKNOWN, WRONG, overlap
from ident.benchmark.scoring import Score, calibration_curve, mean, share
from ident.errors import InputError
from ident.files import write_record

BINS = 5
MIN_WEIGHED = 0.02  # candidates below are no names of any bin
REFUSING = ("none_of_catalogue", "partial")
Row = dict[str, Any]


@dataclass(frozen=True)
class Said:
    """A name that a rule gives."""

    row: int  # of the table
    probability: float
    label: str


@dataclass(frozen=True)
class Outcome:
    """One session under a rule."""

    session: SessionRow
    said: tuple[Said, ...]  # names with any probability, the most probable first
    matched: frozenset[int]  # truths that a name at 0.5 or more is right of
    strict: bool  # whether the first name is a truth's own

    @property
    def sure(self) -> list[Said]:
        return [name for name in self.said if name.probability >= NAMED_FROM]

    @property
    def wrong(self) -> bool:
        """Whether a name at 0.5 or more is wrong."""
        return any(name.label == WRONG for name in self.sure)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall; a truth that is named twice is named once."""
        names = [name for name in self.sure if name.label != UNKNOWN]
        hits = sum(name.label == RIGHT for name in names)
        if not hits:
            return 0.0
        precision, recall = hits / len(names), len(self.matched) / len(self.session.truths)
        return 2.0 * precision * recall / (precision + recall)

    @property
    def good(self) -> bool:
        """Whether the session went as it should: truths named and nothing else, or silence."""
        if self.session.kind in ("single", "pair", "measured"):
            return len(self.matched) == len(self.session.truths) and not self.wrong
        if self.session.kind == "healthy":
            return not self.wrong and not self.session.told_gap and not self.session.error
        return not self.wrong and not self.session.error


def apply_rule(table: Table, probability: Float[Array, " N"]) -> dict[str, Outcome]:
    """Outcomes of all sessions, by case."""
    p = np.where(np.isfinite(probability), probability, 0.0)
    labels = table.labels(p >= KNOWN_FROM)
    rows_of: dict[str, list[int]] = {case: [] for case in table.sessions}
    for number, row in enumerate(table.rows):
        rows_of[row["case"]].append(number)
    outcomes: dict[str, Outcome] = {}
    for case, rows in rows_of.items():
        said = names_of(table, rows, p, labels)
        sure = [name for name in said if name.probability >= NAMED_FROM]
        matched = frozenset(table.rows[name.row]["matched"] for name in sure if name.label == RIGHT)
        strict = bool(sure) and bool(table.rows[sure[0].row]["strict"])
        outcomes[case] = Outcome(table.sessions[case], tuple(said), matched, strict)
    return outcomes


def names_of(table: Table, rows: Sequence[int], p: Float[Array, " N"], labels: Array) -> list[Said]:
    """Candidates of a session that no more probable one says already."""
    said: list[Said] = []
    for number in sorted(rows, key=lambda k: -p[k]):
        if p[number] < MIN_WEIGHED:
            break
        if not any(overlap(table.names[number], table.names[name.row]) for name in said):
            said.append(Said(number, float(p[number]), str(labels[number])))
    return said


# Scores


def score(table: Table, outcomes: Mapping[str, Outcome]) -> Row:
    """All scores, each with its interval and count."""
    everything = list(outcomes.values())
    record: Row = {"cases": len(everything), "all": score_some(table, everything)}
    for group in sorted({outcome.session.group for outcome in everything}):
        chosen = [outcome for outcome in everything if outcome.session.group == group]
        record[group] = score_some(table, chosen)
    record["intervals"] = score_intervals(table, everything)
    return record


def score_some(table: Table, outcomes: Sequence[Outcome]) -> Row:
    """Scores of some sessions."""
    singles = _of_kind(outcomes, "single")
    record: Row = {}
    sizes = {"3": (2.0, np.inf), "1": (0.7, 2.0), "below": (0.0, 0.7)}
    for word, (low, high) in sizes.items():
        chosen = [outcome for outcome in singles if low <= asked_size(outcome.session) < high]
        record[f"single {word}x class"] = _share(len(o.matched) > 0 for o in chosen)
        record[f"single {word}x strict"] = _share(o.strict for o in chosen)
        record[f"single {word}x wrong name"] = _share(o.wrong for o in chosen)
    record["measured named"] = _share(len(o.matched) > 0 for o in _of_kind(outcomes, "measured"))
    record["measured wrong name"] = _share(o.wrong for o in _of_kind(outcomes, "measured"))
    record["pair f1"] = _written(mean([o.f1 for o in _of_kind(outcomes, "pair")]))
    record["healthy told a gap"] = _share(o.session.told_gap for o in _of_kind(outcomes, "healthy"))
    record["healthy named"] = _share(o.wrong for o in _of_kind(outcomes, "healthy"))
    record["untouched new name"] = _share(o.wrong for o in _of_kind(outcomes, "untouched"))
    outside = _of_kind(outcomes, "outside")
    record["outside named"] = _share(o.wrong for o in outside)
    record["outside refused"] = _share(
        o.session.verdict in REFUSING and not o.wrong for o in outside
    )
    names = [
        name for outcome in outcomes if outcome.session.kind != "control" for name in outcome.said
    ]
    judged = [name for name in names if name.label != UNKNOWN]
    record["names right"] = sum(
        name.label == RIGHT for name in judged if name.probability >= NAMED_FROM
    )
    record["names wrong"] = sum(
        name.label == WRONG for name in judged if name.probability >= NAMED_FROM
    )
    curve = calibration_curve(
        [n.probability for n in judged], [n.label == RIGHT for n in judged], BINS
    )
    record["calibration"] = [
        {"said": round(said, 3), "right": round(hit.value or 0.0, 3), "count": hit.count}
        for _, _, said, hit in curve
    ]
    for key in ("seconds", "peak_mb"):
        values = [getattr(o.session, key) for o in outcomes if getattr(o.session, key) is not None]
        if values:
            record[key] = {
                "median": round(float(np.median(values)), 1),
                "most": round(float(np.max(values)), 1),
            }
    record["failed"] = sum(bool(outcome.session.error) for outcome in outcomes)
    return record


def score_intervals(table: Table, outcomes: Iterable[Outcome]) -> Row:
    """Coverage of right names' intervals, and the median of half-width over size, by parameter."""
    collected: dict[str, list[Row]] = {}
    for outcome in outcomes:
        for name in outcome.sure:
            row = table.rows[name.row]
            for interval in json.loads(row["intervals"]):
                key = f"{row['effect']}.{interval['parameter']}"
                half = (
                    0.5 * (interval["high"] - interval["low"]) / max(abs(interval["true"]), 1e-12)
                )
                collected.setdefault(key, []).append({**interval, "half": half})
                if row["effect"] == "payload" and asked_size(outcome.session) >= 2.0:
                    collected.setdefault(f"{key} at 3x", []).append({**interval, "half": half})
    everything = [
        interval
        for key, values in collected.items()
        if not key.endswith("at 3x")
        for interval in values
    ]
    record: Row = {"all": _intervals(everything)} if everything else {}
    record.update({key: _intervals(values) for key, values in sorted(collected.items())})
    return record


def _intervals(values: Sequence[Row]) -> Row:
    half = round(float(np.median([interval["half"] for interval in values])), 4)
    return {"inside": _share(interval["inside"] for interval in values), "median half-width": half}


def asked_size(session: SessionRow) -> float:
    """Visible size of the first truth [noise]; 0 where nobody asked for one."""
    sizes = [truth["asked"] for truth in session.truths if truth["asked"] is not None]
    return float(sizes[0]) if sizes else 0.0


def _of_kind(outcomes: Iterable[Outcome], kind: str) -> list[Outcome]:
    return [outcome for outcome in outcomes if outcome.session.kind == kind]


def _share(hits: Iterable[bool]) -> Row:
    return _written(share(hits))


def _written(value: Score) -> Row:
    if value.value is None:
        return {"value": None, "count": 0}
    numbers = {"value": value.value, "low": value.low, "high": value.high}
    rounded = {key: None if number is None else round(number, 3) for key, number in numbers.items()}
    return {**rounded, "count": value.count}


def lines_of(record: Mapping[str, Any]) -> Iterable[str]:
    """A score table in words."""
    groups = [key for key in record if key not in ("cases", "intervals")]
    yield f"{record['cases']} sessions"
    for key in record["all"]:
        yield f"{key}:"
        for group in groups:
            if key in record[group]:
                yield f"    {group:<12}{_in_words(record[group][key])}"
    yield "intervals of right names (share that holds the truth; median half-width over size):"
    for key, values in record["intervals"].items():
        yield f"    {key:<50}{_in_words(values['inside'])}; {values['median half-width']:.3f}"


def _in_words(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(f"{row['said']:.2f}: {row['right']:.2f} ({row['count']})" for row in value)
    if not isinstance(value, Mapping):
        return str(value)
    if "median" in value:
        return f"median {value['median']}, most {value['most']}"
    if value["value"] is None:
        return "none"
    return f"{value['value']:.2f} [{value['low']:.2f}, {value['high']:.2f}] of {value['count']}"


# Paired comparison


CRITERIA: dict[str, tuple[tuple[str, ...], Callable[[Outcome], bool]]] = {
    "single named": (("single",), lambda outcome: len(outcome.matched) > 0),
    "single named first": (("single",), lambda outcome: outcome.strict),
    "single without a wrong name": (("single",), lambda outcome: not outcome.wrong),
    "pair wholly named": (
        ("pair",),
        lambda outcome: len(outcome.matched) == len(outcome.session.truths),
    ),
    "measured named": (("measured",), lambda outcome: len(outcome.matched) > 0),
    "healthy without a gap": (("healthy",), lambda outcome: not outcome.session.told_gap),
    "healthy without a name": (("healthy",), lambda outcome: not outcome.wrong),
    "untouched without a new name": (("untouched",), lambda outcome: not outcome.wrong),
    "outside without a name": (("outside",), lambda outcome: not outcome.wrong),
    "as it should be": ((), lambda outcome: outcome.good),
}
"""What is compared, of which kinds of session (all but controls if none is named)."""


def compare(before: Mapping[str, Outcome], after: Mapping[str, Outcome]) -> Row:
    """Case by case: how many are right only before, and only after, with the exact probability of
    so uneven a split.

    Source: McNemar 1947.
    """
    common = sorted(set(before) & set(after))
    record: Row = {"cases": len(common)}
    for word, (kinds, criterion) in CRITERIA.items():
        cases = [case for case in common if before[case].session.kind in kinds]
        if not kinds:
            cases = [case for case in common if before[case].session.kind != "control"]
        pairs = [(case, criterion(before[case]), criterion(after[case])) for case in cases]
        lost = [case for case, first, second in pairs if first and not second]
        won = [case for case, first, second in pairs if second and not first]
        changed = len(lost) + len(won)
        record[word] = {
            "count": len(pairs),
            "before": sum(first for _, first, _ in pairs),
            "after": sum(second for _, _, second in pairs),
            "only before": len(lost),
            "only after": len(won),
            "p": round(float(binomtest(len(won), changed).pvalue), 4) if changed else 1.0,
            "lost": lost,
            "won": won,
        }
    for key in ("seconds", "peak_mb"):
        ratios = [
            _ratio(getattr(before[c].session, key), getattr(after[c].session, key)) for c in common
        ]
        known = [ratio for ratio in ratios if ratio is not None]
        if known:
            record[key] = {"median after over before": round(float(np.median(known)), 3)}
    return record


def _ratio(before: float | None, after: float | None) -> float | None:
    return after / before if before and after else None


def comparison_lines(record: Mapping[str, Any]) -> Iterable[str]:
    """A paired comparison in words."""
    yield f"{record['cases']} sessions in both"
    for word, values in record.items():
        if isinstance(values, Mapping) and "count" in values:
            yield (
                f"{word:<32}{values['before']:>4} -> {values['after']:>4} of {values['count']:>4}; "
                f"only before {values['only before']}, only after {values['only after']} "
                f"(p {values['p']:.3f})"
            )
        elif isinstance(values, Mapping):
            yield f"{word}: " + ", ".join(f"{key} {value}" for key, value in values.items())


# Commands


def load_rule(
    folder: Path, findings: bool, calibration: Path | None
) -> tuple[Table, Float[Array, " N"]]:
    """A table, and the probabilities by which its rows are named.

    Raises:
        InputError: Held-out probabilities are wanted and there are none, or they are of another
        table.
    """
    if findings:
        table = load_table(folder, FINDING)
        return table, table.probability
    table = load_table(folder, CANDIDATE)
    if calibration is not None:
        model = read_calibration(calibration)
        return table, model.probability(table.matrix(model.names))
    path = folder / HELD_OUT_FILE
    if not path.is_file():
        raise InputError(
            path, "no such file", "fit a calibration to the table first, or give --calibration"
        )
    probability = pq.read_table(path).column("probability").to_numpy()
    if len(probability) != len(table.rows):
        what = f"has {len(probability)} rows, the table {len(table.rows)}"
        raise InputError(path, what, "fit a calibration to this table")
    return table, np.asarray(probability, dtype=float)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("job", choices=("score", "compare"))
    parser.add_argument("tables", type=Path, nargs="+")
    parser.add_argument("--findings", action="store_true")
    parser.add_argument("--calibration", type=Path)
    parser.add_argument("--held-out", action="store_true", help="the default")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    table, probability = load_rule(given.tables[-1], given.findings, given.calibration)
    outcomes = apply_rule(table, probability)
    if given.job == "score":
        record = score(table, outcomes)
        lines = list(lines_of(record))
    else:
        table_before, probability_before = load_rule(given.tables[0], True, None)
        record = compare(apply_rule(table_before, probability_before), outcomes)
        lines = list(comparison_lines(record))
    if given.json:
        write_record(given.json, record)
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
