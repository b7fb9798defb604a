"""The simplest set that explains: one effect after the other, and all that is left is noise.

Beside noise as small as the recordings' own, no set of a catalogue explains a real arm, and many
small effects together imitate one large one that is missing among them. Here noise is what the set
so far leaves, joint by joint, with no discrepancy and a URDF as sure as URDFs usually are. What
explains most of that comes first and lowers it, until nothing is worth its own coefficients.

Source: Hoeting, Raftery and Madigan 1996 (outliers and variables chosen at once); Seber and Lee
2003, section 12 (forward selection).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.inference.components import ModelSums
from ident.inference.search import SetSearch
from ident.regression.design import Group, Key

# Steps for each joint: a limit on work.
STEPS_A_JOINT = 2


@dataclass(frozen=True, eq=False)
class SimplestSet:
    """Effects in the order in which they explain most, with noise as large as what they leave.

    Attributes:
        model: Sums, with each joint's dispersion beside the set.
        search: The same after the baseline.
        chosen: The effects in their order.
        nats: What each added to the log evidence when it came [nats].
        alone: What each candidate by name would add first of all [nats].
        last: What each other candidate would add now [nats].
    """

    model: ModelSums
    search: SetSearch
    chosen: tuple[Group, ...]
    nats: tuple[float, ...]
    alone: Mapping[Key, float]
    last: Mapping[Key, float]

    def step_of(self, key: Key) -> int | None:
        """Index of the step at which the effect of a key came; None if it did not come."""
        keys = [group.key for group in self.chosen]
        return keys.index(key) if key in keys else None

    def nats_in_turn(self, key: Key) -> float:
        """What the effect of a key added when it came or, if it did not, would add last [nats];
        else 0.
        """
        step = self.step_of(key)
        return self.last.get(key, 0.0) if step is None else self.nats[step]

    def most_like(self, group: Group) -> float:
        """The most that any effect that acts on the same rows would add first of all [nats]; at
        least 0 where there is none.
        """
        alike = [other for other in self.model.names.groups if is_alike(other, group)]
        return max((self.alone.get(other.key, 0.0) for other in alike), default=0.0)


def is_alike(first: Group, second: Group) -> bool:
    """Whether two effects act on the same rows: those of the same joint alone, or of all joints."""
    if first.effect.rows != second.effect.rows:
        return False
    return first.effect.rows == "all" or first.joint == second.joint


def explain_simply(model: ModelSums) -> SimplestSet:
    """The simplest set that explains: the best effect is added until none adds anything.

    After each step all that the set leaves at a joint counts as noise; and an effect that beside
    the new one is another law than its name's (a spring whose rest went beyond any turn) gives its
    place to that law.

    Args:
        model: Sums without discrepancies.
    """
    model = with_misfit(model, ())
    search = SetSearch.of(model)
    alone = best_by_name(search, ())
    chosen: list[Group] = []
    nats: list[float] = []
    while len(chosen) < STEPS_A_JOINT * model.sums.evidence.layout.n:
        addition = search.best(chosen)
        if addition is None or addition[0] <= 0.0:
            break
        nats.append(addition[0])
        chosen.append(addition[1])
        model = with_misfit(model, chosen)
        search = SetSearch.of(model)
        standing = search.standing_for(chosen)
        nats = [added for added, group in zip(nats, standing, strict=True) if group is not None]
        chosen = [group for group in standing if group is not None]
    last = best_by_name(search, chosen)
    return SimplestSet(model, search, tuple(chosen), tuple(nats), alone, last)


def with_misfit(model: ModelSums, chosen: Sequence[Group]) -> ModelSums:
    """A model whose dispersion makes all that a set leaves at a joint noise."""
    left = model.residual(chosen).mean_square
    return model.with_dispersion(np.maximum(1.0, model.components.dispersion * left))


def best_by_name(search: SetSearch, chosen: Sequence[Group]) -> dict[Key, float]:
    """What each effect would add to a set at its best grid point, by key [nats].

    Those that can't be added are left out.
    """
    best: dict[Key, float] = {}
    for gain, group in zip(search.gains(chosen), search.names.groups, strict=True):
        if np.isfinite(gain):
            best[group.key] = max(best.get(group.key, -np.inf), float(gain))
    return best
