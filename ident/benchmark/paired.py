"""Two engines, or two rules, on the same sessions: case by case."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from scipy.stats import binomtest

from ident.benchmark.outcomes import SessionOutcome
from ident.benchmark.score_table import is_visible_single
from ident.records import JsonRecord, JsonTable

Row = JsonRecord
CRITERIA: dict[str, tuple[tuple[str, ...], Callable[[SessionOutcome], bool]]] = {
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
"""What is compared, of which kinds of session; of all if none is named."""


def compare(before: Mapping[str, SessionOutcome], after: Mapping[str, SessionOutcome]) -> Row:
    """Case by case: how many are right only before, and only after, with the exact probability of
    so uneven a split.

    Source: McNemar 1947.
    """
    common = sorted(set(before) & set(after))
    record: Row = {"cases": len(common)}
    for word, (kinds, criterion) in CRITERIA.items():
        cases = [case for case in common if is_compared(before[case], kinds)]
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


def is_compared(outcome: SessionOutcome, kinds: Sequence[str]) -> bool:
    """Whether a session counts in a comparison of two engines.

    Controls never do, nor single effects that hardly show.

    Args:
        outcome: What became of the session.
        kinds: Kinds of sessions that count; all if empty.
    """
    kind = outcome.session.kind
    if kind == "control" or (kind == "single" and not is_visible_single(outcome)):
        return False
    return kind in kinds or not kinds


def _ratio(before: float | None, after: float | None) -> float | None:
    return after / before if before and after else None


def comparison_lines(record: JsonTable) -> Iterable[str]:
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
