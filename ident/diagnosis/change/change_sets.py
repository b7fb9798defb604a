"""Sets of changes by the one inference: log evidence of whole sets, with the differences between
runs in it.

The paired sums already have every law in all runs beside the arm, each with a variance that was
learnt: what a change is measured against. Two variance components are theirs alone. Friction of
another day stands beside every set (`daily_friction`). And laws gain between sets of permuted runs,
where nothing changed: each joint's sums are divided by how much more than noise lets them, as a
session's are by its dispersion, beside the set that is likeliest so far. Then sets are searched by
their log evidence (`ident.inference.search`) from two starts, until neither changes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from ident.arrays import Array, Float, Int
from ident.diagnosis.change.daily_friction import daily_friction
from ident.diagnosis.change.laws import UNLISTED
from ident.diagnosis.change.paired_design import PairedDesign
from ident.inference.names import Names
from ident.inference.search import SetSearch
from ident.regression.design import Group, Key
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, ridge_of

# Rounds of sets and the variance between runs beside them: a limit on work.
ROUNDS = 3


@dataclass(frozen=True, eq=False)
class ChangeModel:
    """The paired sums as a search of sets takes them."""

    evidence: Evidence
    given: Prior
    names: Names

    @cached_property
    def gram(self) -> Float[Array, "P P"]:
        """Whitened sums of all joints, the torque last."""
        return self.evidence.gram()

    @property
    def last(self) -> int:
        """Number of the torque's column."""
        return len(self.gram) - 1

    @property
    def sums(self) -> Any:
        """An object whose `evidence` is this one's, as a session's sums have it."""
        return SimpleNamespace(evidence=self.evidence)

    def prior(self) -> Prior:
        """The prior of the baseline that both sets share."""
        return self.given

    def information(
        self, chosen: Sequence[Group], prior: Prior
    ) -> tuple[Int[Array, " z"], Float[Array, "z z"]]:
        """Columns of the baseline, and the information on their coefficients.

        Args:
            chosen: None of them: must be empty.
            prior: Of the baseline.
        """
        assert not chosen
        tuned = np.arange(self.evidence.layout.tuned)
        information = self.gram[np.ix_(tuned, tuned)].copy()
        prior.add_to(information, self.evidence.layout)
        information[tuned, tuned] += ridge_of(self.gram, self.evidence, tuned)
        return tuned, information


@dataclass(frozen=True, eq=False)
class ChangeSet:
    """The likeliest set of changes, with the variance between runs beside it."""

    design: PairedDesign
    search: SetSearch
    evidence: Evidence
    # By how much laws gain more between permuted sets than noise lets them, joint by joint.
    ratio: Float[Array, " n"]
    chosen: tuple[Group, ...]

    @property
    def odds(self) -> dict[Key, float]:
        """Log odds of each change beforehand, by its key [nats]."""
        return {group.key: odds for group, odds in self.search.names.log_odds.items()}


def choose_set(
    design: PairedDesign, excluded: frozenset[Key], odds: Mapping[Key, float] | None = None
) -> ChangeSet:
    """The likeliest set of changes.

    Args:
        design: Both sets of runs.
        excluded: Keys of the changes that these runs can't show.
        odds: Log odds of changes beforehand that coarser grids gave them; those of this grid if
            None [nats].
    """
    names = _names(design, excluded, odds or {})
    daily = daily_friction(design)
    beside = replace(names, deviation={**names.deviation, **daily})
    chosen: list[Group] = []
    likely: ChangeSet | None = None
    for _ in range(ROUNDS):
        ratio = null_ratio(design, chosen)
        plain = design.sums.evidence
        evidence = plain.with_dispersion(plain.dispersion * ratio)
        search = SetSearch.of(ChangeModel(evidence, design.prior, beside))
        search = replace(search, names=names, rest=search.beside(list(daily)))
        before = {group.key for group in chosen}
        chosen = _from_both_starts(search, chosen)
        likely = ChangeSet(design, search, evidence, ratio, tuple(chosen))
        if {group.key for group in chosen} == before:
            break
    assert likely is not None
    return likely


def _from_both_starts(search: SetSearch, chosen: Sequence[Group]) -> list[Group]:
    """The likelier of the sets that are reached from two starts.

    What follows no law is in no law's place: torque over angle and direction, it can do most of
    what any law can. So one start is the likeliest set of laws alone, to which it may come; the
    other is the set so far.

    Args:
        search: Sums of all candidates.
        chosen: The set so far.
    """
    laws = tuple(group for group in search.names.groups if group.effect.id != UNLISTED)
    of_laws = [group for group in chosen if group.effect.id != UNLISTED]
    alone = replace(search, names=replace(search.names, groups=laws))
    reached = [search.run(alone.run(of_laws)), search.run(chosen)]
    return max(reached, key=search.nats)


def _names(design: PairedDesign, excluded: frozenset[Key], odds: Mapping[Key, float]) -> Names:
    names = Names.of(design.sums.evidence, design.session)
    groups = tuple(group for group in names.groups if group.key not in excluded)
    log_odds = {group: odds.get(group.key, names.log_odds[group]) for group in groups}
    return replace(names, groups=groups, log_odds=log_odds)


def null_ratio(design: PairedDesign, chosen: Sequence[Group]) -> Float[Array, " n"]:
    """Mean gain a column of the laws of each joint between permuted sets, in units of the noise's.

    Args:
        design: Both sets of runs.
        chosen: Changes beside which it is measured.

    Returns:
        By joint, at least 1; 1 for a joint without rows or laws of its own.
    """
    joints = design.joints_with_rows
    ratio = np.ones(design.sums.evidence.layout.n)
    for joint in joints:
        try:
            ratio[joint] = design.permuted.nulls(joint, design.prior, chosen)[None].ratio
        except ValueError:  # a joint without laws of its own
            continue
    return ratio
