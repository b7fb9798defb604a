"""What speaks for and against each change of a set, in numbers without unit, as in a diagnosis.

Changes have their turns: what explains most comes first, and each is told beside those before it
alone. Two laws that may each do most of what the other does then share the evidence as the set has
it, the first nearly all of it; beside the whole set each would seem to add next to nothing. What
all of them add in their turns is what the set adds.

Held-out scores are those of the later set's folds. Of its own a change has its size against what
its law's differs by between permuted sets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as fisher

from ident.arrays import Bool
from ident.diagnosis.change.change_sets import ChangeSet
from ident.diagnosis.change.permuted_sets import NullVariance, joint_of
from ident.inference.features import Described, of_held_out, shows_at
from ident.inference.held_out_views import HeldOutView, Scorers
from ident.inference.rivals import find_rivals, of_rivals
from ident.inference.scales import signed_log
from ident.inference.search import SetSearch, rest_of
from ident.inference.solution import Solution
from ident.regression.cross_validation import HeldOut, HeldOutScore
from ident.regression.design import Group


@dataclass(frozen=True, eq=False)
class LaterHeldOut(HeldOut):
    """Held-out scores of the later set's folds alone."""

    later: Bool[np.ndarray, " F"]

    def score(self, groups: Sequence[Group] = ()) -> HeldOutScore:
        whole = super().score(groups)
        later = self.later
        return replace(
            whole,
            misfit=whole.misfit[later],
            squares=whole.squares[later],
            weights=whole.weights[later],
        )


@dataclass(frozen=True)
class AgainstRuns:
    """A change's size against what its law's differs by between runs of one set."""

    square: float  # mean square of its coefficients, in units of what noise lets them be
    columns: int  # number of them
    null: NullVariance  # the same of its law between permuted sets

    @property
    def p_value(self) -> float:
        """Chance, by F, that one test without a change gives so large a size."""
        return float(fisher.sf(self.square / self.null.ratio, self.columns, self.null.freedom))

    def run_deviation(self, counts: tuple[int, int]) -> float:
        """Standard deviation of the effect between runs beyond noise, as a share of the change.

        Args:
            counts: Number of runs of either set.
        """
        beyond = max(self.null.ratio - 1.0, 0.0) / max(self.square, 1e-300)
        return float(np.sqrt(beyond / sum(1.0 / count for count in counts)))


def later_scorers(likely: ChangeSet) -> Scorers:
    """Scorers of the later set's folds.

    Tuned and fixed are one: the URDF plays no part of its own in what both sets share.
    """
    design = likely.design
    held_out = LaterHeldOut(likely.evidence, design.prior, design.sides.later_folds)
    return Scorers(held_out, held_out)


def describe_changes(likely: ChangeSet, scorers: Scorers) -> list[Described]:
    """Features and rivals of each change of a set, in their turns."""
    described = []
    # What both sets share cancels, a wrong URDF too: so it makes no interval wider.
    solution = Solution(likely.search, likely.search, likely.chosen)
    turns = in_turns(likely.search, likely.chosen)
    score = scorers.tuned.score()
    for number, group in enumerate(turns):
        before = turns[:number]
        after = turns[: number + 1]
        last = score
        score = scorers.tuned.score(after)
        view = HeldOutView(last, score, fixed=False)
        joints = shows_at(group, view, likely.evidence.layout.n)
        rivals = find_rivals(likely.search, after, group)
        features = {
            **_of_evidence(likely, before, group, joints),
            **of_held_out(view, scorers, joints, group),
            **_of_runs(likely, after, group),
            **of_rivals(rivals, group),
        }
        described.append(Described(group, group, solution, joints, view, features, rivals))
    return described


def in_turns(search: SetSearch, chosen: Sequence[Group]) -> list[Group]:
    """A set's members, each time the one that adds most to those before it."""
    turns: list[Group] = []
    left = list(chosen)
    while left:
        nats = [search.nats([*turns, group]) for group in left]
        turns.append(left.pop(int(np.argmax(nats))))
    return turns


def _of_evidence(
    likely: ChangeSet, before: Sequence[Group], group: Group, joints: Sequence[int]
) -> dict[str, float]:
    """What a change adds to the log evidence in its turn, and what stands beside it."""
    others = rest_of(likely.chosen, group)
    everything = likely.search.nats(likely.chosen)
    alone = likely.search.nats([*before, group]) - likely.search.nats(before)
    rows = float(likely.evidence.samples[list(joints)].sum())
    near = [other for other in others if set(other.acts_on(likely.evidence.layout.n)) & set(joints)]
    return {
        "log_nats": signed_log(alone),
        "log_nats_a_row": float(np.log(max(alone, 0.1) / max(rows, 1.0))),
        "log_rows": float(np.log(max(rows, 1.0))),
        "log_share_of_evidence": float(np.log(max(alone, 0.1) / max(everything, 1.0))),
        "event": float(group.effect.event),
        "whole_arm": float(group.effect.scope == "arm"),
        "columns": float(len(group.columns)),
        "others_here": float(len(near)),
        "names_a_joint": len(likely.chosen) / likely.evidence.layout.n,
    }


def _of_runs(likely: ChangeSet, chosen: Sequence[Group], group: Group) -> dict[str, float]:
    """A change's size against its noise, and against what its law differs by between runs.

    Args:
        likely: The likeliest set.
        chosen: Those of it beside which it is told, itself too.
        group: The change.
    """
    measured = against_runs(replace(likely, chosen=tuple(chosen)), group)
    joints = group.acts_on(likely.evidence.layout.n)
    return {
        "log_null_ratio": float(np.log(likely.ratio[joints].max())),
        "log_size_over_runs": 0.5 * float(np.log(max(measured.square / measured.null.ratio, 1e-6))),
        "parts": float(min(likely.design.sides.counts)),
    }


def against_runs(likely: ChangeSet, group: Group) -> AgainstRuns:
    """A change's size beside the others of its set, and the null variance of its law."""
    coefficients = likely.search.coefficients(likely.chosen)[group]
    covariance = likely.search.covariance(likely.chosen, group)
    square = float(coefficients @ np.linalg.pinv(covariance) @ coefficients) / len(coefficients)
    joint_ratio = float(likely.ratio[group.acts_on(likely.evidence.layout.n)].max())
    nulls = likely.design.permuted.nulls(joint_of(group), likely.design.prior, likely.chosen)
    return AgainstRuns(square * joint_ratio, len(coefficients), nulls.get(group.key, nulls[None]))
