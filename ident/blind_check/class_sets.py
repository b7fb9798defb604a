"""Classes that hold the truth 19 times in 20: the odds by which they are cut, chosen by split conformal prediction.

A finding's class are the names against which the holder's odds are at most `selection.class_odds`. The score of a case
is the odds of the holder against the true effect. Of cases drawn as these were, at least 95 % score no more than the
k-th least of n scores, k = ⌈0.95 (n + 1)⌉, whatever the odds mean and however the recordings differ.

Sources: Vovk, Gammerman and Shafer 2005; Angelopoulos and Bates 2021.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, inf, isfinite, log10
from typing import Any

import numpy as np

from ident.blind_check.scoring import Outcome
from ident.blind_check.statistics import Score, binomial_ends, mean, share

LEVEL = 0.95
ASKED = f"{100.0 * LEVEL:g} %"
# Odds for which it is told how often classes hold the truth, and how large they are.
SHOWN_ODDS = (1.0, 3.0, 10.0, 30.0, 100.0)
DIGITS = 4


@dataclass(frozen=True)
class ClassCut:
    """What classes are at certain odds, over the very cases that are told of.

    Attributes:
        odds: Names against which the holder's odds are at most these stand in the class.
        holds: Share of cases whose class holds the truth.
        size: Names in a class.
    """

    odds: float
    holds: Score
    size: Score

    def to_dict(self) -> dict[str, Any]:
        return {"odds": self.odds, "holds": vars(self.holds), "size": vars(self.size)}


@dataclass(frozen=True)
class ClassSets:
    """The odds that a class needs.

    Attributes:
        cases: Single effects that got a name.
        not_weighed: Of these, where the true effect was not among the names that were weighed.
        odds: The least that hold the truth in 95 % of further cases; None where that can't be reached.
        low, high: Ends of their 95 % interval; infinite where the cases leave it open.
        cuts: Classes at these and other odds.
    """

    cases: int
    not_weighed: int
    odds: float | None
    low: float
    high: float
    cuts: tuple[ClassCut, ...]

    @property
    def most(self) -> float:
        """The highest share that these cases could vouch for."""
        return (self.cases - self.not_weighed) / (self.cases + 1)

    @property
    def words(self) -> str:
        """The odds, or why there are none."""
        if self.odds is not None:
            ends = f"{self.low:.3g}, {self.high:.3g}" if isfinite(self.high) else f"{self.low:.3g} and more"
            return f"{ASKED} hold the truth at odds of {self.odds:.4g} [{ends}], from {self.cases} named effects"
        if self.cases < fewest_cases():
            return f"{ASKED} can't be reached: {self.cases} named effects, and {fewest_cases()} are needed"
        why = f"in {self.not_weighed} of {self.cases} the true effect was not weighed"
        return f"{ASKED} can't be reached, {floor(100.0 * self.most)} % at the most: {why}"

    def to_dict(self) -> dict[str, Any]:
        return {
            "level": LEVEL,
            "cases": self.cases,
            "not_weighed": self.not_weighed,
            "odds": self.odds,
            "interval": [self.low if isfinite(self.low) else None, self.high if isfinite(self.high) else None],
            "most": self.most,
            "cuts": [one.to_dict() for one in self.cuts],
            "words": self.words,
        }


def fewest_cases() -> int:
    """Cases below which no odds can be vouched for."""
    return ceil(LEVEL / (1.0 - LEVEL) - 1e-9)


def conformal_quantile(scores: Sequence[float], level: float = LEVEL) -> float:
    """What a further score does not exceed with the chance asked for, all exchangeable; infinite of too few scores."""
    rank = ceil((len(scores) + 1) * level - 1e-9)
    return sorted(scores)[rank - 1] if rank <= len(scores) else inf


def measure_class_sets(outcomes: Sequence[Outcome]) -> ClassSets:
    """The odds that the named single effects among some cases speak for."""
    named = [one for one in outcomes if one.kind == "single" and one.class_score is not None]
    scores = sorted(one.class_score for one in named if one.class_score is not None)
    found = conformal_quantile(scores)
    odds = _rounded_up(found) if isfinite(found) else None
    first, last = binomial_ends(len(scores), LEVEL)
    return ClassSets(
        cases=len(scores),
        not_weighed=sum(not isfinite(one) for one in scores),
        odds=odds,
        low=scores[max(first, 1) - 1] if scores else inf,
        high=scores[last] if last < len(scores) else inf,
        cuts=tuple(_cut(named, one) for one in sorted({*SHOWN_ODDS, *filter(None, [odds])})) if named else (),
    )


def _cut(named: Sequence[Outcome], odds: float) -> ClassCut:
    holds = share([one.class_score is not None and one.class_score <= odds for one in named])
    return ClassCut(odds, holds, mean([1.0 + sum(near <= odds for near in one.odds.values()) for one in named]))


def _rounded_up(odds: float) -> float:
    """To as many digits as a settings file has, never less."""
    unit = 10.0 ** (floor(log10(odds)) + 1 - DIGITS)
    return float(f"{np.ceil(odds / unit * (1.0 - 1e-12)) * unit:.{DIGITS}g}")
