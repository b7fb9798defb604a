"""Sets of changes by the one inference: log evidence of whole sets, with the differences between runs in it.

The paired sums already have every law in all runs beside the arm, each with a variance that was learnt: what a change
is measured against. One variance component is theirs alone: by how much laws gain between sets of permuted runs, where
nothing changed. Each joint's sums are divided by it, as a session's are by its dispersion, beside the set that is
likeliest so far; then sets are searched by their log evidence (`ident.inference.search`), until neither changes.

What speaks for and against each change of the set is told in numbers without unit, as in a diagnosis
(`ident.inference.features`); held-out scores are those of the later set's folds. Of its own a change has what it gains
against what its law gains between permuted sets, and against friction's variation from day to day.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from ident.arrays import Array, Float, Int
from ident.diagnosis.change.friction_drift import day_to_day
from ident.diagnosis.change.paired_design import PairedDesign
from ident.diagnosis.change.permuted_sets import joint_of
from ident.diagnosis.change.search import LaterHeldOut
from ident.inference.features import find_rivals, of_rivals, signed_log, squashed
from ident.inference.names import Names
from ident.inference.search import SetSearch, rest_of
from ident.regression.design import Group, Key
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, ridge_of

# Rounds of sets and the variance between runs beside them: a limit on work.
ROUNDS = 3
# Deficits beyond this many nats are all alike.
MOST_DEFICIT = 2000.0


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
        """What has the evidence, as a session's sums do."""
        return SimpleNamespace(evidence=self.evidence)

    def prior(self) -> Prior:
        """The prior of the baseline that both sets share."""
        return self.given

    def information(self, chosen: Sequence[Group], prior: Prior) -> tuple[Int[Array, " z"], Float[Array, "z z"]]:
        """Columns of the baseline, and the information on their coefficients."""
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
    ratio: Float[Array, " n"]  # by how much laws gain more between permuted sets than noise lets them, joint by joint
    chosen: tuple[Group, ...]


def choose_set(design: PairedDesign, excluded: frozenset[Key]) -> ChangeSet:
    """The likeliest set of changes.

    Args:
        design: Both sets of runs.
        excluded: Changes that these runs can't show.
    """
    names = _names(design, excluded)
    chosen: list[Group] = []
    found: ChangeSet | None = None
    for _ in range(ROUNDS):
        ratio = null_ratio(design, chosen)
        plain = design.sums.evidence
        evidence = plain.with_dispersion(plain.dispersion * ratio)
        search = SetSearch.of(ChangeModel(evidence, design.prior, names))
        before = {group.key for group in chosen}
        chosen = search.run(chosen)
        found = ChangeSet(design, search, evidence, ratio, tuple(chosen))
        if {group.key for group in chosen} == before:
            break
    assert found is not None
    return found


def _names(design: PairedDesign, excluded: frozenset[Key]) -> Names:
    names = Names.of(design.sums.evidence, design.session)
    groups = tuple(group for group in names.groups if group.key not in excluded)
    return replace(names, groups=groups)


def null_ratio(design: PairedDesign, chosen: Sequence[Group]) -> Float[Array, " n"]:
    """Mean gain a column of the laws of each joint between permuted sets, beside some changes; at least one."""
    joints = design.joints_with_rows
    found = np.ones(design.sums.evidence.layout.n)
    for joint in joints:
        try:
            found[joint] = design.permuted.nulls(joint, design.prior, chosen)[None].ratio
        except ValueError:  # a joint without laws of its own
            continue
    return found


def describe_changes(found: ChangeSet) -> list[dict[str, float]]:
    """Features of each change of a set, in its order."""
    design, evidence = found.design, found.evidence
    held_out = LaterHeldOut(evidence, design.prior, design.sides.later_folds)
    return [_features(found, held_out, group) for group in found.chosen]


def _features(found: ChangeSet, held_out: LaterHeldOut, group: Group) -> dict[str, float]:
    others = rest_of(found.chosen, group)
    alone = found.search.nats(found.chosen) - found.search.nats(others)
    n = found.evidence.layout.n
    joints = group.acts_on(n)
    rows = float(found.evidence.samples[joints].sum())
    rivals = find_rivals(found.search, found.chosen, group)
    near = [other for other in others if set(other.acts_on(n)) & set(joints)]
    everything = max(found.search.nats(found.chosen), 1.0)
    return {
        "log_nats": signed_log(alone),
        "log_nats_a_row": float(np.log(max(alone, 0.1) / max(rows, 1.0))),
        "log_rows": float(np.log(max(rows, 1.0))),
        "log_share_of_evidence": float(np.log(max(alone, 0.1) / everything)),
        "event": float(group.effect.event),
        "whole_arm": float(group.effect.scope == "arm"),
        "columns": float(len(group.columns)),
        "friction": float(group.effect.as_change.friction),
        "others_here": float(len(near)),
        "names_a_joint": len(found.chosen) / n,
        "log_null_ratio": float(np.log(found.ratio[joints].max())),
        "parts": float(min(found.design.sides.counts)),
        **_of_held_out(found, held_out, group, joints),
        **_against_runs(found, group),
        **of_rivals(rivals, group),
    }


def _of_held_out(found: ChangeSet, held_out: LaterHeldOut, group: Group, joints: Sequence[int]) -> dict[str, float]:
    """What a change gains on folds of the later set that it never saw."""
    own = list(joints)
    before, after = held_out.score(rest_of(found.chosen, group)), held_out.score(found.chosen)
    later = held_out.later
    gains = 0.5 * (before.misfit - after.misfit)[:, own].sum(axis=1)[later]
    error = float(np.std(gains, ddof=1) * np.sqrt(len(gains))) if len(gains) > 1 else np.inf
    old, new = before.rms[own], after.rms[own]
    most = int(np.argmax(old**2 - new**2))
    fell = float(old[most] ** 2 - new[most] ** 2)
    level = max(float(found.evidence.floor[own][most]), 1e-12)
    reducible = max(float(old[most] ** 2) - level**2, 1e-3 * float(old[most] ** 2), 1e-300)
    return {
        "gain_in_errors": squashed(float(gains.sum()), error),
        "folds_that_gain": float(np.mean(gains > 0.0)),
        "share_of_square": float(np.clip(fell / max(float(old[most] ** 2), 1e-300), -1.0, 1.0)),
        "share_of_gap": float(np.clip(fell / reducible, -1.0, 1.0)),
        "log_size_over_noise": float(np.log(np.sqrt(max(fell, 1e-6 * level**2)) / level)),
        "log_left_over_noise": float(np.log(max(float(new[most]), 1e-12) / level)),
    }


def _against_runs(found: ChangeSet, group: Group) -> dict[str, float]:
    """A change's size against what its law differs by between runs of one set, and between days."""
    design = found.design
    coefficients = found.search.coefficients(found.chosen)[group]
    covariance = found.search.covariance(found.chosen, group)
    square = float(coefficients @ np.linalg.pinv(covariance) @ coefficients) / len(coefficients)
    nulls = design.permuted.nulls(joint_of(group), design.prior, found.chosen)
    null = nulls.get(group.key, nulls[None])
    joint_ratio = float(found.ratio[group.acts_on(found.evidence.layout.n)].max())
    spread = found.evidence.spread[design.joints_with_rows]
    day = day_to_day(group, design.session, coefficients, spread, design.sides.counts)
    walk = day.between_day_std**2 + day.walk_variance(design.sides.counts)
    return {
        "log_size_in_errors": 0.5 * float(np.log(max(square, 1e-6))),
        "log_size_over_runs": 0.5 * float(np.log(max(square * joint_ratio / null.ratio, 1e-6))),
        "log_size_over_days": -0.5 * float(np.log(max(walk, 1e-6))),
    }
