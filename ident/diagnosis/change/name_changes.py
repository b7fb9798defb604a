"""Which changes of the likeliest set are names: their probability by a calibration that was fitted to pairs with truth.

`calibration_changes.toml` is written by `python -m ident.benchmark.change_calibration fit`; no number of it is set by
hand. A change is a name where its class is likelier than not; what could stand in its place within odds of twenty to
one, by the log evidence in which the differences between runs are counted, is its class.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ident.diagnosis.change.change_sets import ChangeSet, choose_set, describe_changes
from ident.diagnosis.change.paired_design import PairedDesign
from ident.diagnosis.selection.estimates import Estimate
from ident.inference.calibration import Odds, load_odds
from ident.inference.conclusion import EVEN_ODDS
from ident.inference.estimate import CLASS_ODDS
from ident.inference.features import find_rivals
from ident.regression.design import Group, Key

FILE = Path(__file__).with_name("calibration_changes.toml")
# Deficit in log evidence within which a change is told as one class with another [nats].
MOST_BEHIND = float(np.log(CLASS_ODDS))


@dataclass(frozen=True, eq=False)
class LikelyChange:
    """A change of the likeliest set."""

    group: Group
    features: Mapping[str, float]  # what speaks for and against it
    rivals: Mapping[Key, float]  # what could stand in its place, with its deficit in log evidence [nats]
    probability: float = field(default=np.nan)  # that it, or one of its class, is what changed

    @property
    def twins(self) -> dict[Key, float]:
        """Those of the rivals that it can't be told from, with the odds against each, the likeliest first."""
        odds = {key: float(np.exp(deficit)) for key, deficit in self.rivals.items() if deficit <= MOST_BEHIND}
        return dict(sorted(odds.items(), key=lambda pair: pair[1]))

    def told(self, estimate: Estimate, elsewhere: tuple[str, ...]) -> Estimate:
        """Its estimate with the probability, and with its class.

        Args:
            estimate: Its parameters.
            elsewhere: Ids of further effects that explain as much at another place.
        """
        odds: dict[str, float] = {}
        for (effect, _, _), against in self.twins.items():
            if effect != self.group.effect.id:
                odds[effect] = min(odds.get(effect, np.inf), against)
        share = 1.0 / (1.0 + sum(1.0 / against for against in odds.values()))
        rivals = tuple(dict.fromkeys((self.group.effect.id, *odds, *elsewhere)))
        return replace(estimate, probability=self.probability * share, rivals=rivals, odds=odds)


def weigh_changes(design: PairedDesign, excluded: frozenset[Key], odds: Odds | None = None) -> list[LikelyChange]:
    """The likeliest set of changes, each with its probability.

    Args:
        design, excluded: Both sets of runs, and what they can't show.
        odds: The calibration; what the package ships if None.
    """
    odds = load_odds(FILE) if odds is None else odds
    return [replace(one, probability=odds.probability(one.features)) for one in likely_set(design, excluded)]


def likely_set(design: PairedDesign, excluded: frozenset[Key]) -> list[LikelyChange]:
    """The likeliest set of changes with features and rivals, before any calibration."""
    found: ChangeSet = choose_set(design, excluded)
    each = zip(found.chosen, describe_changes(found), strict=True)
    return [LikelyChange(group, features, find_rivals(found.search, found.chosen, group)) for group, features in each]


def split_names(likely: list[LikelyChange]) -> tuple[list[LikelyChange], list[LikelyChange]]:
    """Those that are likelier than not, the likeliest first, and the others."""
    ordered = sorted(likely, key=lambda one: -one.probability)
    names = [one for one in ordered if one.probability >= EVEN_ODDS]
    return names, ordered[len(names) :]
