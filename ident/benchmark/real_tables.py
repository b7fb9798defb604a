"""Scores and tables of semi-real cases, from their rows (`real_rows`)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from ident.benchmark.real_rows import CONFIDENT, Row
from ident.benchmark.scores import Score, calibration_curve, calibration_error, mean, share
from ident.benchmark.summary import group_by, in_columns

# Bins of the calibration's table.
BINS = 5
# A name that was not planted, and is given to so many cases of an arm, may be the arm's own.
AGAIN = 2
# What a case's row has and its record has not.
NOT_OF_RECORD = ("new", "wrong", "measured")


def score(effects: Sequence[Row], names: Sequence[Row], cases: Sequence[Row]) -> Row:
    """Scores with intervals, and the rows that they are of."""
    single = [effect for effect in effects if effect["kind"] == "single"]
    untouched = [case for case in cases if case["kind"] == "untouched"]
    pairs = [case for case in cases if case["kind"] == "pair"]
    said = [name for name in names if not name["old"]]
    covered = [hit for effect in effects for hit in effect["covered"].values()]
    scores = {
        "strict": share(effect["strict"] for effect in single),
        "class_aware": share(effect["named"] for effect in single),
        "false_alarm": share(case["wrong"] for case in untouched),
        "set_f1": mean([case["f1"] for case in pairs]),
        "interval_coverage": share(covered),
        "calibration_error": calibration_error(
            [name["p"] for name in said], [name["right"] for name in said]
        ),
    }
    outcomes = []
    for case in cases:
        outcome = {key: value for key, value in case.items() if key not in NOT_OF_RECORD}
        outcomes.append(outcome)
    return {
        "cases": len(cases),
        **in_columns(scores),
        "effects": list(effects),
        "outcomes": outcomes,
    }


def tables(effects: Sequence[Row], names: Sequence[Row], cases: Sequence[Row]) -> Iterable[str]:
    """Lines of all tables."""
    listed = [effect for effect in effects if effect["in_catalogue"]]
    controls = [case for case in cases if case["kind"] == "control"]
    yield f"{len(cases)} cases; verdicts: {_count(case['verdict'] for case in cases)}"
    yield f"controls: {_count(case['verdict'] for case in controls)}"
    measured = [seen for case in cases for seen in case["measured"]]
    yield f"measured by others on the untouched arms, named with p >= 0.5: {_share(measured)}"
    yield from _planted_singles([effect for effect in listed if effect["kind"] == "single"])
    yield from _by_kind(cases)
    yield from _intervals(listed)
    yield from _calibration(names)
    spent = [case["seconds"] for case in cases if case["seconds"] is not None]
    if spent:
        yield f"processor seconds a case: median {np.median(spent):.1f}, most {max(spent):.1f}"
    else:
        yield ""


def _planted_singles(single: Sequence[Row]) -> Iterable[str]:
    """How many planted single effects are named, by size, arm and effect."""
    title = "planted singles in the class with p >= 0.5, by size"
    yield from _grouped(title, single, "asked", "named")
    yield from _grouped("  at any p", single, "asked", "named_at_all")
    yield from _grouped("  as the first name", single, "asked", "strict")
    yield from _grouped("  by arm", single, "arm", "named")
    yield from _grouped("  by effect", single, "effect", "named")


def _by_kind(cases: Sequence[Row]) -> Iterable[str]:
    """Pairs, and new wrong names of the other kinds of case."""
    pairs = [case["f1"] for case in cases if case["kind"] == "pair"]
    yield f"pairs: F1 {np.mean(pairs):.2f} of {len(pairs)}" if pairs else "pairs: none"
    for kind in ("untouched", "outside", "single"):
        of_kind = [case for case in cases if case["kind"] == kind]
        newly_wrong = _share(case["wrong"] for case in of_kind)
        surely_wrong = _share(_is_surely_wrong(case) for case in of_kind)
        yield f"{kind}: a new wrong name {newly_wrong}; with p >= 0.5 {surely_wrong}"
    outside = [case for case in cases if case["kind"] == "outside"]
    yield f"outside: verdicts {_count(case['verdict'] for case in outside)}"


def _is_surely_wrong(case: Row) -> bool:
    """Whether a new wrong name of a case is likely."""
    return any(name["p"] >= CONFIDENT for name in case["wrong"])


def _intervals(listed: Sequence[Row]) -> Iterable[str]:
    """How often intervals hold what was planted, and whose do not."""
    inside = []
    for effect in listed:
        for key, hit in effect["covered"].items():
            inside.append((f"{effect['effect']}.{key}", hit))
    yield f"intervals that hold what was planted: {_share(hit for _, hit in inside)}"
    yield f"  missed: {_count(key for key, hit in inside if not hit)}"


def _calibration(names: Sequence[Row]) -> Iterable[str]:
    """What was said of new names, and how often it was right; and the wrong ones."""
    fresh = [name for name in names if not name["old"]]
    wrong = Counter((name["arm"], name["name"]) for name in names if not name["right"])

    def is_once(name: Row) -> bool:
        """Whether a name is right, or of one case of its arm alone."""
        return name["right"] or wrong[name["arm"], name["name"]] < AGAIN

    once = [name for name in fresh if is_once(name)]
    for title, rows in (("", fresh), (", names of one case of the arm alone", once)):
        yield f"calibration (probability, right){title}:"
        said = [row["p"] for row in rows]
        right = [row["right"] for row in rows]
        for _, _, mean_said, share_right in calibration_curve(said, right, BINS):
            yield f"  {mean_said:.2f}: {_written(share_right)}"
    effects = (name["name"].split(":")[0] for name in fresh if not name["right"])
    yield f"wrong names: {_count(effects)}"


def _grouped(title: str, rows: Sequence[Row], key: str, hit: str) -> Iterable[str]:
    """A share over all rows, and over those of each value of a key."""
    yield f"{title}: {_share(row[hit] for row in rows)}"
    for value, of_value in group_by(rows, lambda row: row[key]).items():
        yield f"    {value}: {_share(row[hit] for row in of_value)}"


def _share(hits: Iterable[bool]) -> str:
    """A share of hits in words."""
    return _written(share(hits))


def _written(score: Score) -> str:
    """A share with its interval in words."""
    if score.value is None:
        return "0 of 0"
    percent = f"{score.value:.0%} [{score.low:.0%}, {score.high:.0%}]"
    return f"{round(score.value * score.count)} of {score.count} ({percent})"


def _count(words: Iterable[str]) -> str:
    """How often each word stands there, the most frequent first."""
    return ", ".join(f"{word} {count}" for word, count in Counter(words).most_common()) or "none"
