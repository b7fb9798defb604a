"""The search among changes: the likeliest first, each beside the others and against what the same runs show by chance.

Both sets share a baseline of hundreds of columns, of which a run left out shows some that no other run does: what a
model says there is a guess, and its held-out score a matter of chance. The evidence, in which every column has a prior,
counts what is known. A change's size has a variance V, as a share of its square: that by blocks, or what its law gains
by between sets that are none (`permuted_sets`), whichever is more. With ν degrees of freedom for V, its k coefficients
have the log likelihood ratio

    Λ = ½ (ν + k) log(1 + 1 / (ν V)),

against which stands what it costs to be one of so many, and as wide beforehand as N samples are less sure than V:

    log odds = Λ − ½ k log(N V₀ / V) − log(points of its grid) − log(effects),    V₀ by the noise model alone.

Of what would stand at the same joints the name is what has most evidence; its class holds the others by theirs, V₀ / V
of it.

Source: Satterthwaite 1946 (degrees of freedom).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.stats import f as fisher
from scipy.stats import t as student

from ident.arrays import Array, Bool, Float
from ident.diagnosis.change.friction_drift import GAIN, DayToDay, day_to_day, is_gain_by_load
from ident.diagnosis.change.paired_design import PairedDesign
from ident.diagnosis.change.permuted_sets import NullVariance, joint_of
from ident.diagnosis.change.settings import CHANGE
from ident.diagnosis.selection.name_probability import Estimate, solve_effects
from ident.diagnosis.selection.refine import Refined
from ident.diagnosis.selection.search import Search
from ident.effects.intervals import NORMAL_95
from ident.regression.cross_validation import HeldOut, HeldOutScore
from ident.regression.design import Group, Key
from ident.regression.least_squares import Projection, project
from ident.regression.run_spread import block_scores, squares_left


@dataclass(frozen=True)
class Standing:
    """How a change stands against the runs' own differences."""

    p_value: float  # for one change
    spread: float  # standard deviation from run to run of the effect, as a share of the change
    widening: float  # factor on the half-widths of intervals that count the blocks' noise alone
    of_the_day: bool  # whether it is mostly unsure as friction differs by day or wanders, whatever these runs say
    of_the_runs: bool  # whether as runs or days differ, and not by noise
    nats: float  # log likelihood ratio against none
    looser: float  # log of by how much its variance exceeds that of the noise model


def measure_standing(
    gain: float, k: int, blocks: tuple[float, float], null: NullVariance, day: DayToDay, counts: tuple[int, int]
) -> Standing:
    """Holds a change against the runs.

    Args:
        gain: Squares of whitened noise that it explains.
        k: Number of its coefficients.
        blocks: Variance of its size by blocks, as a share of its square, and their number.
        null: By how much more than by noise it gains between sets that are none.
        day: What it may differ by though nothing was done.
        counts: Runs of either set.
    """
    if not gain > 0.0:  # of a size that is zero nothing is seen
        return Standing(1.0, 0.0, 1.0, False, False, 0.0, 0.0)
    by_blocks, by_runs, walk = blocks[0], max(0.0, null.ratio / gain - blocks[0]), day.walk(counts)
    # What is taken from a distribution, or is known whatever the runs say, has no degrees of freedom to count.
    estimated = by_blocks**2 / max(blocks[1] - 1.0, 1.0) + (by_runs**2 / null.freedom if by_runs > walk else 0.0)
    variance = by_blocks + max(by_runs, walk) + day.error**2
    dof = variance**2 / (estimated + 1e-300)
    error = float(np.sqrt(variance))
    known = day.error**2 + (walk if walk >= by_runs else 0.0)
    return Standing(
        p_value=float(fisher.sf(1.0 / (k * variance), k, dof)),
        spread=float(np.sqrt(by_runs / sum(1.0 / count for count in counts))),
        widening=max(1.0, float(student.ppf(0.975, dof)) / NORMAL_95 * error / float(np.sqrt(max(by_blocks, 1e-300)))),
        of_the_day=known > 0.5 * variance,
        of_the_runs=variance > 2.0 * by_blocks,
        nats=float(0.5 * (dof + k) * np.log1p(1.0 / (max(dof, 1e-9) * variance))),
        looser=float(np.log(max(variance * gain, 1.0))),
    )


@dataclass(frozen=True, eq=False)
class Weighed:
    """A change and how it stands."""

    group: Group  # the change
    standing: Standing  # how it stands against the runs
    odds: float  # log odds of it against none, beyond those that it must have


@dataclass(frozen=True, eq=False)
class LaterHeldOut(HeldOut):
    """Held-out scores whose sizes are those of the later set."""

    later: Bool[Array, " F"]

    def score(self, groups: Sequence[Group] = ()) -> HeldOutScore:
        whole = super().score(groups)
        kept = self.later[:, None]
        return replace(whole, squares=whole.squares * kept, weights=whole.weights * kept)


@dataclass(frozen=True, eq=False, kw_only=True)
class ChangeSearch(Search):
    """Changes by how likely they are."""

    design: PairedDesign  # both sets of runs
    sessions: tuple[int, int] = (1, 1)  # number of sessions of each

    @cached_property
    def least(self) -> float:
        """Log evidence that a change must have; of their places and points effects pay for themselves."""
        return float(np.log(CHANGE.least_odds * len({group.effect.id for group in self.evidence.layout.groups})))

    @cached_property
    def asked(self) -> int:
        """How many changes may be, whatever their inner parameters."""
        return len({group.key for group in self.evidence.layout.groups} - self.barred)

    def find(self) -> tuple[list[Weighed], dict[Key, Weighed]]:
        """Changes that stand, and those that explained as much as a change must and did not.

        What did not stand beside few names is tried again beside more: what they explain was chance to it. A name that
        fell stays out.
        """
        names: list[Group] = []
        failed: dict[Key, Weighed] = {}
        fallen: set[Key] = set()
        while len(names) < self.settings.most_effects * self.evidence.layout.n:
            step = self._next(names, failed, fallen)
            if step is None:
                break
            names = self._settled([*names, step], failed, fallen)
        return self.weigh(names), failed

    def _next(self, names: Sequence[Group], failed: dict[Key, Weighed], fallen: set[Key]) -> Group | None:
        """The likeliest further change that stands beside the names."""
        tried: dict[Key, Weighed] = {}
        for one in self.candidates(names):
            if one.key not in fallen:
                last = self.weigh([*names, one])[-1]
                daily = [each.group for each in tried.values() if each.standing.of_the_day]
                stands = last.odds > 0.0 and self._counts(last.group, names)
                if stands and not self.stands_in(last.group, names, daily):
                    return last.group
                tried[one.key] = failed[one.key] = last
        return None

    def _counts(self, group: Group, names: Sequence[Group]) -> bool:
        """Whether a change is more than what a larger cause of slightly another law may leave at its joints."""
        models = (project(self.evidence.gram(), self.evidence, self.prior, one) for one in ((), names, (*names, group)))
        none, before, after = (squares_left(self.evidence, model).sum(axis=1) for model in models)
        joints = group.acts_on(self.evidence.layout.n)
        own, all_of_them = (before - after)[joints], (none - after)[joints]
        most = int(np.argmax(own))
        return bool(own[most] >= self.settings.least_own_share * all_of_them[most])

    def stands_in(self, group: Group, names: Sequence[Group], daily: Sequence[Group]) -> bool:
        """Whether a change says nothing beside friction that differs from day to day: it stands in for it."""
        gram = self.evidence.gram()
        model = project(gram, self.evidence, self.prior, names)
        others = [one for one in daily if not is_gain_by_load(model, group, one)]
        return bool(others) and self.score_beside(gram, group, [*names, *others]) < self.least

    def _settled(self, names: list[Group], failed: dict[Key, Weighed], fallen: set[Key]) -> list[Group]:
        """The names, each at its best point or with a likelier one in its place, without those that do not stand."""
        for _ in range(CHANGE.rounds):
            before = list(names)
            for slot, own in enumerate(names):
                others = names[:slot] + names[slot + 1 :]
                rivals = {one: score for one, score in self._rivals(own, others).items() if one.key not in fallen}
                names[slot] = max(rivals, key=rivals.__getitem__, default=own)
            if names == before:
                break
        while names:
            weakest = min(self.weigh(names), key=lambda one: one.odds)
            if weakest.odds > 0.0:
                break
            failed[weakest.group.key] = weakest
            fallen.add(weakest.group.key)
            names = [group for group in names if group is not weakest.group]
        return names

    def candidates(self, names: Sequence[Group]) -> dict[Group, float]:
        """What may have changed beside the names, of that which has enough evidence, most first; with its evidence."""
        known = frozenset(names)
        if known not in self._candidates:
            model = project(self.evidence.gram(), self.evidence, self.prior, names)
            best = {group: score for score, group in self.best_by_key(model, names).values() if score >= self.least}
            joints = {joint_of(group) for group in best}
            # What counts at a joint is what all laws there gain by chance.
            chance = {joint: self.design.permuted.nulls(joint, self.prior, names)[None].ratio for joint in joints}
            counts = {group: score / chance[joint_of(group)] for group, score in best.items()}
            scores = block_scores(self.evidence, model)

            def odds(group: Group) -> float:
                """A test by its blocks, to which what shows in few of them or changes its sign is nothing."""
                gain, scaled = self.gain_of(model, group)
                uneven = float(np.square(scores[:, group.columns] @ scaled).sum()) / gain**2 * len(scores)
                return 0.5 * (len(scores) + len(group.columns)) * np.log1p(1.0 / uneven) - self.cost_of(group)

            tried = (sorted(counts, key=key, reverse=True)[: CHANGE.most_weighed] for key in (counts.__getitem__, odds))
            likely = sorted({one for some in tried for one in some}, key=lambda one: -counts[one])
            self._candidates[known] = {one: best[one] for one in likely}
        return self._candidates[known]

    @cached_property
    def _candidates(self) -> dict[frozenset[Group], dict[Group, float]]:
        """What was found already: it is needed again."""
        return {}

    def _rivals(self, own: Group, others: Sequence[Group]) -> dict[Group, float]:
        """What would stand at a change's joints in its place, itself among it; with its evidence."""
        n = self.evidence.layout.n
        here = set(own.acts_on(n))
        near = {one: score for one, score in self.candidates(others).items() if here & set(one.acts_on(n))}
        return {one: score for one, score in near.items() if self.weigh([*others, one])[-1].odds > 0.0}

    def weigh(self, names: Sequence[Group]) -> list[Weighed]:
        """How each name stands beside the others, its variance by blocks counted."""
        known = tuple(names)
        if known not in self._weighs:
            model = project(self.evidence.gram(), self.evidence, self.prior, names)
            solved = solve_effects(Refined(self, tuple(names)), [False] * len(names))[0] if names else []
            pairs = zip(names, solved, strict=True)
            self._weighs[known] = [self._weighed(group, model, names, *each) for group, each in pairs]
        return self._weighs[known]

    @cached_property
    def _weighs(self) -> dict[tuple[Group, ...], list[Weighed]]:
        """What was weighed already: it is needed again."""
        return {}

    def with_class(
        self, estimate: Estimate, weighed: Sequence[Weighed], slot: int, places: Sequence[Group], gain: bool
    ) -> Estimate:
        """An estimate with how likely it is, and with what else it may be, likeliest first.

        Args:
            estimate: Of one of the names.
            weighed: All names.
            slot: Which of them.
            places: What explains as much elsewhere.
            gain: Whether a gain would look alike.
        """
        others = [one.group for k, one in enumerate(weighed) if k != slot]
        own, standing = weighed[slot].group, weighed[slot].standing
        name, sure = own.effect.id, CHANGE.temper * weighed[slot].odds
        best: dict[str, float] = {name: sure}
        evidence = self.score_beside(self.evidence.gram(), own, others)
        for one, score in self._rivals(own, others).items():
            # Evidence is worth as much less as the change's variance exceeds that of the noise model.
            odds = sure + CHANGE.against * (score - evidence) / np.exp(standing.looser)
            best[one.effect.id] = max(best.get(one.effect.id, -np.inf), odds)
        total = float(np.logaddexp.reduce([*best.values(), 0.0]))  # nothing at all is as likely at the threshold
        near = sorted((-best[one], one) for one in best if one != name and best[one] > sure - CHANGE.class_nats)
        likely = self.settings.most_sure * float(np.exp(sure - total))
        odds = {one: float(np.exp(sure + log)) for log, one in near}
        more = [group.effect.id for group in places] + ([GAIN] if gain else [])
        rivals = tuple(dict.fromkeys((name, *(one for _, one in near), *more)))
        return replace(estimate, probability=likely, rivals=rivals, odds=odds)

    def _weighed(
        self,
        group: Group,
        model: Projection,
        names: Sequence[Group],
        beta: Float[Array, " k"],
        cells: Float[Array, "k k"],
    ) -> Weighed:
        """A change among names, itself among them, by the model of all, its coefficients and their covariance."""
        design, scale, freedom = self.design, self.evidence.scale[group.columns], len(group.columns)
        at = np.flatnonzero(np.isin(model.inside, group.columns))
        along = np.linalg.inv(model.spread[np.ix_(at, at)]) @ (beta * scale)
        gain = float(beta * scale @ along)
        variance = float(along @ (cells * np.outer(scale, scale)) @ along) / max(gain, 1e-300) ** 2
        day = day_to_day(group, design.session, beta, self.evidence.spread[design.judged], self.sessions)
        nulls = design.permuted.nulls(joint_of(group), self.prior, names)
        null = nulls.get(group.key, nulls[None])
        blocks = variance, len(self.evidence.fold_of_block)
        standing = measure_standing(gain, freedom, blocks, null, day, design.sides.counts)
        cost = self.cost_of(group) - 0.5 * freedom * standing.looser
        least = self.cost_of(replace(group, columns=group.columns[:0])) + 0.5 * freedom * np.log(2.0)
        odds = standing.nats - max(cost, least) - self.least
        if not standing.of_the_day:  # what decides came of few permutations
            odds -= np.log(CHANGE.few_dealt_odds)
        return Weighed(group, standing, float(odds))
