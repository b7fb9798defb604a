"""The search among changes: by log evidence alone, each change beside the others.

Both sets share a baseline of hundreds of columns, of which a run left out shows some that no other run does: what a
model says there is a guess, and its held-out score a matter of chance. The evidence, in which every column has a prior,
counts what is known. Blocks vary more than whitened noise would: log evidence is divided by the variance inflation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array
from ident.diagnosis.regression.design import Group, Key
from ident.diagnosis.regression.least_squares import Projection, project
from ident.diagnosis.selection.gates import Gates, Named
from ident.diagnosis.selection.intervals import inflation
from ident.diagnosis.selection.search import Search

# Chance that anything is named where nothing changed: a false alarm stops a cell.
ALARM = 0.01


def least_nats(asked: int) -> float:
    """Log evidence that a change must have: what makes up for its being one of so many, at the odds of a false alarm.

    Args:
        asked: Number of changes that may be.
    """
    return float(np.log(max(asked, 1) / ALARM))


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
        found, needed = [], least_nats(count_changes(self))
        for item in super().judge(gram, tuned, chosen, short):
            # What it explains would count as variation of the blocks were it not in the model.
            spare = inflation(self.evidence, project(gram, self.evidence, self.prior, [*chosen, item.group]))
            figures = {**vars(item.gates), "evidence": item.gates.evidence / spare, "needed": needed}
            found.append(replace(item, gates=_ByEvidence(**figures)))
        return found

    def p_values(self, projection: Projection, short: Sequence[Group]) -> dict[Key, float]:
        return {group.key: 0.0 for group in short}

    def helps(self, projection: Projection, others: Sequence[Group], group: Group) -> bool:
        return True

    def steadier(self, projection: Projection, others: Sequence[Group], group: Group) -> Group:
        return group

    def _forward(self, gram: Array, chosen: Sequence[Group]) -> Named | None:
        model = project(gram, self.evidence, self.prior, chosen)
        best = max(self.best_by_key(model, chosen).values(), key=lambda pair: pair[0], default=None)
        return None if best is None or best[0] <= 0.0 else self.judge(gram, model, chosen, [best])[0]

    def _beats(self, projection: Projection, others: Sequence[Group], rival: Group, holder: Group) -> bool:
        return True
