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
from ident.diagnosis.regression.cross_validation import HeldOut, HeldOutScore
from ident.diagnosis.regression.design import Group, Key
from ident.diagnosis.regression.least_squares import Projection, project
from ident.diagnosis.regression.run_spread import block_scores, squares_left
from ident.diagnosis.selection.name_probability import Estimate, solve_effects
from ident.diagnosis.selection.refine import Refined
from ident.diagnosis.selection.search import Search
from ident.effects.intervals import NORMAL_95


@dataclass(frozen=True)
class Significance:
    """How a change stands against the runs' own differences."""

    p_value: float  # for one change
    run_std: float  # standard deviation from run to run of the effect, as a share of the change
    widening: float  # factor on the half-widths of intervals that count the blocks' noise alone
    mostly_between_days: (
        bool  # whether it is mostly unsure as friction differs by day or wanders, whatever these runs say
    )
    mostly_between_runs: bool  # whether as runs or days differ, and not by noise
    log_likelihood_ratio: float  # log likelihood ratio against none
    log_variance_inflation: float  # log of by how much its variance exceeds that of the noise model


def measure_significance(
    gain: float, k: int, blocks: tuple[float, float], null: NullVariance, day: DayToDay, counts: tuple[int, int]
) -> Significance:
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
        return Significance(1.0, 0.0, 1.0, False, False, 0.0, 0.0)
    by_blocks, by_runs, walk = blocks[0], max(0.0, null.ratio / gain - blocks[0]), day.walk_variance(counts)
    # What is taken from a distribution, or is known whatever the runs say, has no degrees of freedom to count.
    estimated = by_blocks**2 / max(blocks[1] - 1.0, 1.0) + (by_runs**2 / null.freedom if by_runs > walk else 0.0)
    variance = by_blocks + max(by_runs, walk) + day.between_day_std**2
    dof = variance**2 / (estimated + 1e-300)
    error = float(np.sqrt(variance))
    known = day.between_day_std**2 + (walk if walk >= by_runs else 0.0)
    return Significance(
        p_value=float(fisher.sf(1.0 / (k * variance), k, dof)),
        run_std=float(np.sqrt(by_runs / sum(1.0 / count for count in counts))),
        widening=max(1.0, float(student.ppf(0.975, dof)) / NORMAL_95 * error / float(np.sqrt(max(by_blocks, 1e-300)))),
        mostly_between_days=known > 0.5 * variance,
        mostly_between_runs=variance > 2.0 * by_blocks,
        log_likelihood_ratio=float(0.5 * (dof + k) * np.log1p(1.0 / (max(dof, 1e-9) * variance))),
        log_variance_inflation=float(np.log(max(variance * gain, 1.0))),
    )


@dataclass(frozen=True, eq=False)
class TestedChange:
    """A change and how it stands."""

    group: Group  # the change
    significance: Significance  # how it stands against the runs
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
    def threshold(self) -> float:
        """Log evidence that a change must have; of their places and points effects pay for themselves."""
        return float(np.log(CHANGE.least_odds * len({group.effect.id for group in self.evidence.layout.groups})))

    @cached_property
    def tests(self) -> int:
        """How many changes may be, whatever their inner parameters."""
        return len({group.key for group in self.evidence.layout.groups} - self.excluded)

    def find(self) -> tuple[list[TestedChange], dict[Key, TestedChange]]:
        """Changes that stand, and those that explained as much as a change must and did not.

        What did not stand beside few names is tried again beside more: what they explain was chance to it. A name that
        fell stays out.
        """
        names: list[Group] = []
        rejected: dict[Key, TestedChange] = {}
        eliminated: set[Key] = set()
        while len(names) < self.settings.most_effects * self.evidence.layout.n:
            step = self._forward_step(names, rejected, eliminated)
            if step is None:
                break
            names = self._prune([*names, step], rejected, eliminated)
        return self.test(names), rejected

    def _forward_step(
        self, names: Sequence[Group], rejected: dict[Key, TestedChange], eliminated: set[Key]
    ) -> Group | None:
        """The likeliest further change that stands beside the names."""
        tried: dict[Key, TestedChange] = {}
        for one in self.candidates(names):
            if one.key not in eliminated:
                last = self.test([*names, one])[-1]
                day_limited = [each.group for each in tried.values() if each.significance.mostly_between_days]
                stands = last.odds > 0.0 and self._exceeds_model_error(last.group, names)
                if stands and not self.is_friction_drift(last.group, names, day_limited):
                    return last.group
                tried[one.key] = rejected[one.key] = last
        return None

    def _exceeds_model_error(self, group: Group, names: Sequence[Group]) -> bool:
        """Whether a change is more than what a larger cause of slightly another law may leave at its joints."""
        models = (project(self.evidence.gram(), self.evidence, self.prior, one) for one in ((), names, (*names, group)))
        none, before, after = (squares_left(self.evidence, model).sum(axis=1) for model in models)
        joints = group.acts_on(self.evidence.layout.n)
        own, all_of_them = (before - after)[joints], (none - after)[joints]
        most = int(np.argmax(own))
        return bool(own[most] >= self.settings.least_own_share * all_of_them[most])

    def is_friction_drift(self, group: Group, names: Sequence[Group], day_limited: Sequence[Group]) -> bool:
        """Whether a change says nothing beside friction that differs from day to day: it stands in for it."""
        gram = self.evidence.gram()
        model = project(gram, self.evidence, self.prior, names)
        others = [one for one in day_limited if not is_gain_by_load(model, group, one)]
        return bool(others) and self.log_evidence_beside(gram, group, [*names, *others]) < self.threshold

    def _prune(self, names: list[Group], rejected: dict[Key, TestedChange], eliminated: set[Key]) -> list[Group]:
        """The names, each at its best point or with a likelier one in its place, without those that do not stand."""
        for _ in range(CHANGE.rounds):
            before = list(names)
            for slot, own in enumerate(names):
                others = names[:slot] + names[slot + 1 :]
                rivals = {one: score for one, score in self._rivals(own, others).items() if one.key not in eliminated}
                names[slot] = max(rivals, key=rivals.__getitem__, default=own)
            if names == before:
                break
        while names:
            weakest = min(self.test(names), key=lambda one: one.odds)
            if weakest.odds > 0.0:
                break
            rejected[weakest.group.key] = weakest
            eliminated.add(weakest.group.key)
            names = [group for group in names if group is not weakest.group]
        return names

    def candidates(self, names: Sequence[Group]) -> dict[Group, float]:
        """What may have changed beside the names, of that which has enough evidence, most first; with its evidence."""
        known = frozenset(names)
        if known not in self._candidate_cache:
            model = project(self.evidence.gram(), self.evidence, self.prior, names)
            best = {group: score for score, group in self.best_by_key(model, names).values() if score >= self.threshold}
            joints = {joint_of(group) for group in best}
            # What counts at a joint is what all laws there gain by chance.
            null_ratio = {joint: self.design.permuted.nulls(joint, self.prior, names)[None].ratio for joint in joints}
            counts = {group: score / null_ratio[joint_of(group)] for group, score in best.items()}
            scores = block_scores(self.evidence, model)

            def odds(group: Group) -> float:
                """A test by its blocks, to which what shows in few of them or changes its sign is nothing."""
                gain, scaled = self.gain_of(model, group)
                uneven = float(np.square(scores[:, group.columns] @ scaled).sum()) / gain**2 * len(scores)
                return 0.5 * (len(scores) + len(group.columns)) * np.log1p(1.0 / uneven) - self.complexity_cost(group)

            tried = (sorted(counts, key=key, reverse=True)[: CHANGE.most_weighed] for key in (counts.__getitem__, odds))
            likely = sorted({one for some in tried for one in some}, key=lambda one: -counts[one])
            self._candidate_cache[known] = {one: best[one] for one in likely}
        return self._candidate_cache[known]

    @cached_property
    def _candidate_cache(self) -> dict[frozenset[Group], dict[Group, float]]:
        """What was found already: it is needed again."""
        return {}

    def _rivals(self, own: Group, others: Sequence[Group]) -> dict[Group, float]:
        """What would stand at a change's joints in its place, itself among it; with its evidence."""
        n = self.evidence.layout.n
        here = set(own.acts_on(n))
        near = {one: score for one, score in self.candidates(others).items() if here & set(one.acts_on(n))}
        return {one: score for one, score in near.items() if self.test([*others, one])[-1].odds > 0.0}

    def test(self, names: Sequence[Group]) -> list[TestedChange]:
        """How each name stands beside the others, its variance by blocks counted."""
        known = tuple(names)
        if known not in self._test_cache:
            model = project(self.evidence.gram(), self.evidence, self.prior, names)
            solved = solve_effects(Refined(self, tuple(names)), [False] * len(names))[0] if names else []
            pairs = zip(names, solved, strict=True)
            self._test_cache[known] = [self._test_one(group, model, names, *each) for group, each in pairs]
        return self._test_cache[known]

    @cached_property
    def _test_cache(self) -> dict[tuple[Group, ...], list[TestedChange]]:
        """What was weighed already: it is needed again."""
        return {}

    def with_class(
        self, estimate: Estimate, tested: Sequence[TestedChange], slot: int, confounded: Sequence[Group], gain: bool
    ) -> Estimate:
        """An estimate with how likely it is, and with what else it may be, likeliest first.

        Args:
            estimate: Of one of the names.
            weighed: All names.
            slot: Which of them.
            places: What explains as much elsewhere.
            gain: Whether a gain would look alike.
        """
        others = [one.group for k, one in enumerate(tested) if k != slot]
        own, significance = tested[slot].group, tested[slot].significance
        name, log_odds = own.effect.id, CHANGE.temper * tested[slot].odds
        best: dict[str, float] = {name: log_odds}
        evidence = self.log_evidence_beside(self.evidence.gram(), own, others)
        for one, score in self._rivals(own, others).items():
            # Evidence is worth as much less as the change's variance exceeds that of the noise model.
            odds = log_odds + CHANGE.against * (score - evidence) / np.exp(significance.log_variance_inflation)
            best[one.effect.id] = max(best.get(one.effect.id, -np.inf), odds)
        total = float(np.logaddexp.reduce([*best.values(), 0.0]))  # nothing at all is as likely at the threshold
        near = sorted((-best[one], one) for one in best if one != name and best[one] > log_odds - CHANGE.class_nats)
        likely = self.settings.most_sure * float(np.exp(log_odds - total))
        odds = {one: float(np.exp(log_odds + log)) for log, one in near}
        more = [group.effect.id for group in confounded] + ([GAIN] if gain else [])
        rivals = tuple(dict.fromkeys((name, *(one for _, one in near), *more)))
        return replace(estimate, probability=likely, rivals=rivals, odds=odds)

    def _test_one(
        self,
        group: Group,
        model: Projection,
        names: Sequence[Group],
        beta: Float[Array, " k"],
        cells: Float[Array, "k k"],
    ) -> TestedChange:
        """A change among names, itself among them, by the model of all, its coefficients and their covariance."""
        design, scale, freedom = self.design, self.evidence.scale[group.columns], len(group.columns)
        at = np.flatnonzero(np.isin(model.inside, group.columns))
        along = np.linalg.inv(model.spread[np.ix_(at, at)]) @ (beta * scale)
        gain = float(beta * scale @ along)
        variance = float(along @ (cells * np.outer(scale, scale)) @ along) / max(gain, 1e-300) ** 2
        day = day_to_day(group, design.session, beta, self.evidence.spread[design.joints_with_rows], self.sessions)
        nulls = design.permuted.nulls(joint_of(group), self.prior, names)
        null = nulls.get(group.key, nulls[None])
        blocks = variance, len(self.evidence.fold_of_block)
        significance = measure_significance(gain, freedom, blocks, null, day, design.sides.counts)
        cost = self.complexity_cost(group) - 0.5 * freedom * significance.log_variance_inflation
        least_cost = self.complexity_cost(replace(group, columns=group.columns[:0])) + 0.5 * freedom * np.log(2.0)
        odds = significance.log_likelihood_ratio - max(cost, least_cost) - self.threshold
        if not significance.mostly_between_days:  # what decides came of few permutations
            odds -= np.log(CHANGE.few_dealt_odds)
        return TestedChange(group, significance, float(odds))
