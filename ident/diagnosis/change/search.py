"""The search among changes: by log evidence alone, each change beside the others.

Both sets share a baseline of hundreds of columns, of which a run left out shows some that no other run does: what a
model says there is a guess, and its held-out score a matter of chance. The evidence, in which every column has a prior,
counts what is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array
from ident.diagnosis.change.between_run_variance import Standing
from ident.diagnosis.change.friction_drift import is_gain_by_load
from ident.diagnosis.regression.design import Group, Key
from ident.diagnosis.regression.least_squares import Projection, project
from ident.diagnosis.selection.gates import Gates, Named, SearchResults
from ident.diagnosis.selection.search import Search

# Odds that a change must have to be named, if something has changed as likely as not.
LEAST_ODDS = 10.0
IN_ITS_PLACE = "what runs or days differ by, which fits better, may be all of it"
# Changes of greatest evidence that are tried at each step: one that closes next to nothing of its gap is passed over.
MOST_TRIED = 4


def least_nats(effects: int) -> float:
    """Log evidence that a change must have, if something has changed as likely as not.

    Args:
        effects: Number of effects that it may be; of their places and points each pays for itself.
    """
    return float(np.log(max(effects, 1) * LEAST_ODDS))


def count_effects(search: Search) -> int:
    """How many effects may have changed, wherever."""
    return len({group.effect.id for group in search.evidence.layout.groups})


def count_changes(search: Search) -> int:
    """How many changes may be, whatever their inner parameters."""
    return len({group.key for group in search.evidence.layout.groups} - search.barred)


@dataclass(frozen=True, eq=False)
class _ByEvidence(Gates):
    """What a change showed; it passes by its evidence, unless a larger cause of slightly another law may leave as much.

    Attributes:
        needed: Log evidence that it must have [nats].
    """

    needed: float = np.inf

    @property
    def passed(self) -> bool:
        return self.evidence >= self.needed and self.own_share >= self.settings.least_own_share


@dataclass(frozen=True, eq=False)
class ChangeSearch(Search):
    """Forward steps and swaps by log evidence."""

    def judge(
        self, gram: Array, tuned: Projection, chosen: Sequence[Group], short: Sequence[tuple[float, Group]]
    ) -> list[Named]:
        needed = least_nats(count_effects(self))
        return [
            replace(item, gates=_ByEvidence(**{**vars(item.gates), "needed": needed}))
            for item in super().judge(gram, tuned, chosen, short)
        ]

    def p_values(self, projection: Projection, short: Sequence[Group]) -> dict[Key, float]:
        return {group.key: 0.0 for group in short}

    def helps(self, projection: Projection, others: Sequence[Group], group: Group) -> bool:
        return True

    def steadier(self, projection: Projection, others: Sequence[Group], group: Group) -> Group:
        return group

    def _forward(self, gram: Array, chosen: Sequence[Group]) -> Named | None:
        model = project(gram, self.evidence, self.prior, chosen)
        best = sorted(self.best_by_key(model, chosen).values(), key=lambda pair: -pair[0])
        tried = None
        for pair in (pair for pair in best[:MOST_TRIED] if pair[0] > 0.0):
            (item,) = self.judge(gram, model, chosen, [pair])
            if item.gates.passed:
                return item
            tried = tried or item
        return tried

    def _beats(self, projection: Projection, others: Sequence[Group], rival: Group, holder: Group) -> bool:
        return True


def log_odds(search: ChangeSearch, group: Group, standing: Standing) -> float:
    """Of a change against none, beyond those that it must have: its likelihood ratio, less what its freedom costs."""
    freedom = len(group.columns)
    cost = search.cost_of(group) - 0.5 * freedom * standing.looser
    least = search.cost_of(replace(group, columns=group.columns[:0])) + 0.5 * freedom * np.log(2.0)
    return float(standing.nats - max(cost, least) - least_nats(count_effects(search)))


def stand_ins(search: ChangeSearch, found: SearchResults, differing: Sequence[Group]) -> dict[int, str]:
    """Names that say nothing beside what was found to differ from run to run or from day to day: they stood in for it.

    Args:
        search: The search.
        found: Its names.
        differing: What explained more, and is no change for it.
    """
    if not differing:
        return {}
    gram, names = search.evidence.gram(), [item.group for item in found.named]
    told = {one.key for one in names}
    unnamed = [group for group in differing if group.key not in told]
    refused = {}
    for slot, name in enumerate(names):
        model = project(gram, search.evidence, search.prior, [one for one in names if one is not name])
        others = [group for group in unnamed if not is_gain_by_load(model, name, group)]
        if others and not search.judged_beside(gram, [*names, *others], slot).gates.passed:
            refused[slot] = IN_ITS_PLACE
    return refused
