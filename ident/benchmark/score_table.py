"""Scores of a decision rule on a stored table: of all sessions, by group, by arm and by effect."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ident.benchmark.corpus_table import SessionRow, Table
from ident.benchmark.labels import RIGHT, UNKNOWN, WRONG
from ident.benchmark.outcomes import NAMED_FROM, SessionOutcome
from ident.benchmark.scores import Score, calibration_curve, mean, share
from ident.records import JsonRecord, JsonTable

BINS = 5
REFUSING = ("none_of_catalogue", "partial")
SIZES = {"3x": (2.0, np.inf), "1x": (0.7, 2.0), "below": (0.0, 0.7)}
"""Visible sizes of single effects, by the word for them [noise]."""
AT_3X = " at 3x"
CUT = "cut"
BY = ("by unit", "by effect", "intervals")
"""Tables beside those of the groups."""
Row = JsonRecord


def score(table: Table, outcomes: Mapping[str, SessionOutcome]) -> Row:
    """All scores, each with its interval and count.

    Of whole sessions, and apart from them of those that were cut.
    """
    everything = [outcome for outcome in outcomes.values() if not outcome.session.length]
    record: Row = {"cases": len(everything), "all": score_some(everything)}
    for group, chosen in _grouped(everything, lambda outcome: outcome.session.group).items():
        record[group] = score_some(chosen)
    units = _grouped(everything, lambda outcome: outcome.session.unit)
    record["by unit"] = {unit: _good(chosen) for unit, chosen in units.items()}
    visible = [outcome for outcome in everything if is_visible_single(outcome)]
    effects = _grouped(visible, lambda outcome: str(outcome.session.truths[0]["effect"]))
    record["by effect"] = {effect: _named(chosen) for effect, chosen in effects.items()}
    record["intervals"] = score_intervals(table, everything)
    cut = [outcome for outcome in outcomes.values() if outcome.session.length]
    if cut:
        record[CUT] = score_some(cut)
        for length, chosen in _grouped(
            cut, lambda outcome: f"{CUT} to {outcome.session.length:g} s"
        ).items():
            record[length] = score_some(chosen)
    return record


def score_some(outcomes: Sequence[SessionOutcome]) -> Row:
    """Scores of some sessions."""
    record: Row = {}
    singles = _of_kind(outcomes, "single")
    for word in SIZES:
        chosen = [outcome for outcome in singles if size_of(outcome.session) == word]
        record[f"single {word} class"] = _named(chosen)
        record[f"single {word} strict"] = _share(outcome.strict for outcome in chosen)
        record[f"single {word} wrong name"] = _wrong(chosen)
    measured = _of_kind(outcomes, "measured")
    record["measured named"] = _named(measured)
    record["measured wrong name"] = _wrong(measured)
    record["pair f1"] = _written(mean([outcome.f1 for outcome in _of_kind(outcomes, "pair")]))
    healthy = _of_kind(outcomes, "healthy")
    record["healthy told a gap"] = _share(outcome.session.told_gap for outcome in healthy)
    record["healthy named"] = _wrong(healthy)
    record["untouched new name"] = _wrong(_of_kind(outcomes, "untouched"))
    outside = _of_kind(outcomes, "outside")
    record["outside named"] = _wrong(outside)
    record["outside refused"] = _share(is_refused(outcome) for outcome in outside)
    record.update(score_names(outcomes))
    for key in ("seconds", "peak_mb"):
        known = [getattr(outcome.session, key) for outcome in outcomes]
        values = [value for value in known if value is not None]
        if values:
            record[key] = {
                "median": round(float(np.median(values)), 1),
                "most": round(float(np.max(values)), 1),
            }
    record["failed"] = sum(bool(outcome.session.error) for outcome in outcomes)
    return record


def score_names(outcomes: Iterable[SessionOutcome]) -> Row:
    """Names that are right or wrong, and how often what was said at a probability is right."""
    judged = [
        name
        for outcome in outcomes
        if outcome.session.kind != "control"
        for name in outcome.said
        if name.label != UNKNOWN
    ]
    sure = [name for name in judged if name.probability >= NAMED_FROM]
    said = [name.probability for name in judged]
    right = [name.label == RIGHT for name in judged]
    curve = calibration_curve(said, right, BINS)
    bins = [
        {"said": round(middle, 3), "right": round(hit.value or 0.0, 3), "count": hit.count}
        for _, _, middle, hit in curve
    ]
    return {
        "names right": sum(name.label == RIGHT for name in sure),
        "names wrong": sum(name.label == WRONG for name in sure),
        "calibration": bins,
    }


def score_intervals(table: Table, outcomes: Iterable[SessionOutcome]) -> Row:
    """Coverage of right names' intervals, and the median of half-width over size, by parameter."""
    collected: dict[str, list[Row]] = {}
    everything: list[Row] = []
    for outcome in outcomes:
        for name in outcome.sure:
            row = table.rows[name.row]
            for interval in json.loads(row["intervals"]):
                width = interval["high"] - interval["low"]
                half = 0.5 * width / max(abs(interval["true"]), 1e-12)
                judged = {"inside": interval["inside"], "half": half}
                key = f"{row['effect']}.{interval['parameter']}"
                everything.append(judged)
                collected.setdefault(key, []).append(judged)
                if size_of(outcome.session) == "3x":
                    collected.setdefault(key + AT_3X, []).append(judged)
    record = {key: _intervals(values) for key, values in sorted(collected.items())}
    return {"all": _intervals(everything), **record} if everything else {}


def _intervals(values: Sequence[Row]) -> Row:
    half = float(np.median([interval["half"] for interval in values]))
    inside = _share(interval["inside"] for interval in values)
    return {"inside": inside, "median half-width": round(half, 4)}


# Words for sessions


def asked_size(session: SessionRow) -> float:
    """Visible size of the first truth [noise]; 0 where nobody asked for one."""
    sizes = [truth["asked"] for truth in session.truths if truth["asked"] is not None]
    return float(sizes[0]) if sizes else 0.0


def size_of(session: SessionRow) -> str:
    """The word for a session's size."""
    size = asked_size(session)
    return next(word for word, (low, high) in SIZES.items() if low <= size < high)


def is_visible_single(outcome: SessionOutcome) -> bool:
    """Whether it is of one effect that shows."""
    return outcome.session.kind == "single" and size_of(outcome.session) != "below"


def is_refused(outcome: SessionOutcome) -> bool:
    """Whether it is told that no name explains it, and given none that is wrong."""
    return outcome.session.verdict in REFUSING and not outcome.wrong


def _of_kind(outcomes: Iterable[SessionOutcome], kind: str) -> list[SessionOutcome]:
    return [outcome for outcome in outcomes if outcome.session.kind == kind]


def _grouped(
    outcomes: Iterable[SessionOutcome], key: Callable[[SessionOutcome], str]
) -> dict[str, list[SessionOutcome]]:
    groups: dict[str, list[SessionOutcome]] = {}
    for outcome in outcomes:
        groups.setdefault(key(outcome), []).append(outcome)
    return dict(sorted(groups.items()))


# Shares


def _named(outcomes: Iterable[SessionOutcome]) -> Row:
    return _share(len(outcome.matched) > 0 for outcome in outcomes)


def _wrong(outcomes: Iterable[SessionOutcome]) -> Row:
    return _share(outcome.wrong for outcome in outcomes)


def _good(outcomes: Iterable[SessionOutcome]) -> Row:
    """Share of sessions that went as they should; controls and effects that do not show apart."""
    judged: list[SessionOutcome] = []
    for outcome in outcomes:
        hidden = outcome.session.kind == "single" and not is_visible_single(outcome)
        if outcome.session.kind != "control" and not hidden:
            judged.append(outcome)
    return _share(outcome.good for outcome in judged)


def _share(hits: Iterable[bool]) -> Row:
    return _written(share(hits))


def _written(value: Score) -> Row:
    if value.value is None:
        return {"value": None, "count": 0}
    numbers = {"value": value.value, "low": value.low, "high": value.high}
    rounded = {key: round(number or 0.0, 3) for key, number in numbers.items()}
    return {**rounded, "count": value.count}


# In words


def lines_of(record: JsonTable) -> Iterable[str]:
    """A score table in words."""
    groups = [key for key in record if key not in ("schema", "cases", *BY)]
    yield f"{record['cases']} sessions"
    for key in record["all"]:
        yield f"{key}:"
        for group in groups:
            if key in record[group]:
                yield f"    {group:<12}{_in_words(record[group][key])}"
    yield "as it should be, by what can be left out whole:"
    for unit, values in record["by unit"].items():
        yield f"    {unit:<32}{_in_words(values)}"
    yield "visible singles named, by effect:"
    for effect, values in record["by effect"].items():
        yield f"    {effect:<32}{_in_words(values)}"
    yield "intervals of right names (share that holds the truth; median half-width over size):"
    for key, values in record["intervals"].items():
        yield f"    {key:<52}{_in_words(values['inside'])}; {values['median half-width']:.3f}"


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
