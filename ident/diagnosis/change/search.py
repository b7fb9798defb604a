"""Stepwise selection of changes, with a test against the differences between runs of one set.

The baseline has hundreds of columns that some runs do not determine, so held-out scores are too uncertain here, and the
evidence with its priors decides. The relative variance V of a change's size is that between blocks, or that of the
law's gain between permuted sets (`permuted_sets`), whichever is more; for friction it is at least that of a random
walk, and between-day variance is added. With ν degrees of freedom for V, k coefficients have the log likelihood ratio

    Λ = ½ (ν + k) log(1 + 1 / (ν V)),

and, the prior as wide as N samples are less certain than V, V₀ by the noise model alone,

    log odds = Λ − ½ k log(N V₀ / V) − log(points of its grid) − log(effects).

Of the significant candidates at the same joints the one of greatest log evidence is selected; the others form its
class, their log evidence differences scaled by V₀ / V.

Source: Satterthwaite 1946 (degrees of freedom).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.stats import f as fisher
from scipy.stats import t as student

from ident.arrays import Array, Bool, Float
from ident.diagnosis.change.friction_drift import GAIN, DayToDay, day_to_day, is_gain_by_load
from ident.diagnosis.change.paired_design import PairedDesign
from ident.diagnosis.change.permuted_sets import NullVariance, joint_of
from ident.diagnosis.change.settings import CHANGE
from ident.diagnosis.selection.candidates import Candidates
from ident.diagnosis.selection.estimates import Estimate, Refined, solve_effects
from ident.effects.intervals import NORMAL_95
from ident.regression.cross_validation import HeldOut, HeldOutScore
from ident.regression.design import Group, Key
from ident.regression.least_squares import Projection, project
from ident.regression.run_spread import block_scores, squares_left


@dataclass(frozen=True)
class Significance:
    """Significance of a change against the differences between runs and days."""

    p_value: float  # of a single test
    run_std: float  # between-run standard deviation of the effect, as a share of the change
    widening: float  # factor on the half-widths of intervals that have the variance between blocks alone
    mostly_between_days: bool  # whether between-day variance and the random walk are most of its variance
    mostly_between_runs: bool  # whether the variance between blocks is less than half of its variance
    log_likelihood_ratio: float  # of the change against none [nats]
    log_variance_inflation: float  # log ratio of its variance to that of the noise model


def measure_significance(
    gain: float, k: int, blocks: tuple[float, float], null: NullVariance, day: DayToDay, counts: tuple[int, int]
) -> Significance:
    """Tests a change by F with Satterthwaite's degrees of freedom.

    Args:
        gain, k: Fall of the whitened misfit by the change, and number of its coefficients.
        blocks: Variance of its size between blocks, as a share of its square, and the number of blocks.
        null: Null variance of its gain between permuted sets.
        day, counts: Variation of friction without a change, and number of runs of either set.
    """
    if not gain > 0.0:
        return Significance(1.0, 0.0, 1.0, False, False, 0.0, 0.0)
    by_blocks, by_runs, walk = blocks[0], max(0.0, null.ratio / gain - blocks[0]), day.walk_variance(counts)
    # Only estimated variances limit the degrees of freedom; between-day variance and the walk's step are given.
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
    """A change with the result of its test."""

    group: Group  # the change
    significance: Significance  # its test
    log_odds: float  # log odds of the change against none, less the threshold; positive if it is significant


@dataclass(frozen=True, eq=False)
class LaterHeldOut(HeldOut):
    """Held-out scores of the later set's folds alone."""

    later: Bool[Array, " F"]

    def score(self, groups: Sequence[Group] = ()) -> HeldOutScore:
        whole = super().score(groups)
        kept = self.later[:, None]
        return replace(whole, squares=whole.squares * kept, weights=whole.weights * kept)


@dataclass(frozen=True, eq=False, kw_only=True)
class ChangeSearch(Candidates):
    """Stepwise selection of changes."""

    design: PairedDesign  # both sets of runs
    sessions: tuple[int, int] = (1, 1)  # number of sessions of each set
    first_look: bool = False  # whether what it finds is looked at once more, on finer grids
    # Test results by the changes that were tested together; what a search must not accept changes none of them.
    tested: dict[frozenset[Group], dict[Group, TestedChange]] = field(default_factory=dict)

    @cached_property
    def threshold(self) -> float:
        """Least log odds of a change, corrected for the number of effects; their grids have a cost of their own."""
        return float(np.log(CHANGE.least_odds * len({group.effect.id for group in self.evidence.layout.groups})))

    @cached_property
    def tests(self) -> int:
        """Number of changes that are tested, grid points not counted."""
        return len({group.key for group in self.evidence.layout.groups} - self.excluded)

    def find(self) -> tuple[list[TestedChange], dict[Key, TestedChange]]:
        """Significant changes, and candidates of enough log evidence that failed the test.

        A candidate that failed is tested again beside more changes, which explain part of its null variance; an
        eliminated change stays out.
        """
        changes: list[Group] = []
        rejected: dict[Key, TestedChange] = {}
        eliminated: set[Key] = set()
        while len(changes) < self.settings.most_effects * self.evidence.layout.n:
            step = self._forward_step(changes, rejected, eliminated)
            if step is None:
                break
            changes = self._prune([*changes, step], rejected, eliminated)
        return self.test(changes), rejected

    def _forward_step(
        self, changes: Sequence[Group], rejected: dict[Key, TestedChange], eliminated: set[Key]
    ) -> Group | None:
        """The most likely candidate that is significant beside the changes selected so far; None if none is."""
        tried: dict[Key, TestedChange] = {}
        for one in self.candidates(changes):
            if one.key not in eliminated:
                (last,) = self.test([*changes, one], one)
                day_limited = [each.group for each in tried.values() if each.significance.mostly_between_days]
                significant = last.log_odds > 0.0 and self._exceeds_model_error(last.group, changes)
                if significant and not self.is_friction_drift(last.group, changes, day_limited):
                    return last.group
                tried[one.key] = rejected[one.key] = last
        return None

    def _exceeds_model_error(self, group: Group, changes: Sequence[Group]) -> bool:
        """Whether a change explains more than a larger cause may leave at its joints by the error of its law."""
        gram = self.evidence.gram()
        models = (project(gram, self.evidence, self.prior, one) for one in ((), changes, (*changes, group)))
        none, before, after = (squares_left(self.evidence, model).sum(axis=1) for model in models)
        joints = group.acts_on(self.evidence.layout.n)
        own, all_of_them = (before - after)[joints], (none - after)[joints]
        most = int(np.argmax(own))
        return bool(own[most] >= self.settings.least_own_share * all_of_them[most])

    def is_friction_drift(self, group: Group, changes: Sequence[Group], day_limited: Sequence[Group]) -> bool:
        """Whether a change loses its log evidence beside candidates that may be between-day variation of friction."""
        gram = self.evidence.gram()
        model = project(gram, self.evidence, self.prior, changes)
        others = [one for one in day_limited if not is_gain_by_load(model, group, one)]
        return bool(others) and self.log_evidence_beside(gram, group, [*changes, *others]) < self.threshold

    def _prune(self, changes: list[Group], rejected: dict[Key, TestedChange], eliminated: set[Key]) -> list[Group]:
        """Swaps each change for the most likely rival, and eliminates those that are not significant."""
        for _ in range(CHANGE.rounds):
            before = list(changes)
            for slot, own in enumerate(changes):
                others = changes[:slot] + changes[slot + 1 :]
                rivals = {one: score for one, score in self._rivals(own, others).items() if one.key not in eliminated}
                changes[slot] = max(rivals, key=rivals.__getitem__, default=own)
            if changes == before:
                break
        while changes:
            weakest = min(self.test(changes), key=lambda one: one.log_odds)
            if weakest.log_odds > 0.0:
                break
            rejected[weakest.group.key] = weakest
            eliminated.add(weakest.group.key)
            changes = [group for group in changes if group is not weakest.group]
        return changes

    def candidates(self, changes: Sequence[Group]) -> dict[Group, float]:
        """Candidates of enough log evidence beside the changes, with their log evidence, the most likely first."""
        known = frozenset(changes)
        if known not in self._candidate_cache:
            model = project(self.evidence.gram(), self.evidence, self.prior, changes)
            scored = self.best_by_key(model, changes).values()
            best = {group: score for score, group in scored if score >= self.threshold}
            joints = {joint_of(group) for group in best}
            # Gains at a joint are compared in units of the null variance of all laws there.
            null_ratio = {joint: self.design.permuted.nulls(joint, self.prior, changes)[None].ratio for joint in joints}
            scaled_scores = {group: score / null_ratio[joint_of(group)] for group, score in best.items()}
            scores = block_scores(self.evidence, model)

            def odds(group: Group) -> float:
                """Log odds by the variance between blocks: low if few blocks show it, or with changing sign."""
                gain, scaled = self.gain_of(model, group)
                uneven = float(np.square(scores[:, group.columns] @ scaled).sum()) / gain**2 * len(scores)
                return 0.5 * (len(scores) + len(group.columns)) * np.log1p(1.0 / uneven) - self.complexity_cost(group)

            orders = (sorted(scaled_scores, key=key, reverse=True) for key in (scaled_scores.__getitem__, odds))
            tried = {one for order in orders for one in order[: CHANGE.most_weighed]}
            likely = sorted(tried, key=lambda one: -scaled_scores[one])
            self._candidate_cache[known] = {one: best[one] for one in likely}
        return self._candidate_cache[known]

    @cached_property
    def _candidate_cache(self) -> dict[frozenset[Group], dict[Group, float]]:
        """Candidates by the changes beside which they were evaluated."""
        return {}

    def _rivals(self, own: Group, others: Sequence[Group]) -> dict[Group, float]:
        """Significant candidates at a change's joints in its place, itself among them, with their log evidence."""
        n = self.evidence.layout.n
        here = set(own.acts_on(n))
        near = {one: score for one, score in self.candidates(others).items() if here & set(one.acts_on(n))}
        return {one: score for one, score in near.items() if self.test([*others, one], one)[0].log_odds > 0.0}

    def test(self, changes: Sequence[Group], only: Group | None = None) -> list[TestedChange]:
        """Tests each change, or only one of them, beside the others."""
        known, asked = self.tested.setdefault(frozenset(changes), {}), changes if only is None else [only]
        if not known.keys() >= set(asked):
            model = project(self.evidence.gram(), self.evidence, self.prior, changes)
            solved = solve_effects(Refined(self, tuple(changes)), [False] * len(changes))[0]
            for group, each in zip(changes, solved, strict=True):
                if group in asked and group not in known:
                    known[group] = self._test_one(group, model, changes, *each)
        return [known[group] for group in asked]

    def with_class(
        self, estimate: Estimate, tested: Sequence[TestedChange], slot: int, confounded: Sequence[Group], gain: bool
    ) -> Estimate:
        """An estimate with its probability and its class, the most likely rival first.

        Args:
            estimate, tested, slot: Estimate of one of the changes, all changes, and its index among them.
            confounded, gain: Effects elsewhere that explain as much, and whether a gain error would.
        """
        others = [one.group for k, one in enumerate(tested) if k != slot]
        own, significance = tested[slot].group, tested[slot].significance
        name, log_odds = own.effect.id, CHANGE.temper * tested[slot].log_odds
        best: dict[str, float] = {name: log_odds}
        evidence = self.log_evidence_beside(self.evidence.gram(), own, others)
        for one, score in self._rivals(own, others).items():
            # Log evidence assumes the noise model: it is divided by the change's variance inflation.
            odds = log_odds + CHANGE.against * (score - evidence) / np.exp(significance.log_variance_inflation)
            best[one.effect.id] = max(best.get(one.effect.id, -np.inf), odds)
        total = float(np.logaddexp.reduce([*best.values(), 0.0]))  # no change has odds of one at the threshold
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
        changes: Sequence[Group],
        beta: Float[Array, " k"],
        cells: Float[Array, "k k"],
    ) -> TestedChange:
        """Tests one of several changes by the model of all, its coefficients `beta` and their covariance `cells`."""
        design, scale, freedom = self.design, self.evidence.scale[group.columns], len(group.columns)
        at = np.flatnonzero(np.isin(model.inside, group.columns))
        along = np.linalg.inv(model.spread[np.ix_(at, at)]) @ (beta * scale)
        gain = float(beta * scale @ along)
        variance = float(along @ (cells * np.outer(scale, scale)) @ along) / max(gain, 1e-300) ** 2
        day = day_to_day(group, design.session, beta, self.evidence.spread[design.joints_with_rows], self.sessions)
        nulls = design.permuted.nulls(joint_of(group), self.prior, changes)
        null = nulls.get(group.key, nulls[None])
        blocks = variance, len(self.evidence.fold_of_block)
        significance = measure_significance(gain, freedom, blocks, null, day, design.sides.counts)
        cost = self.complexity_cost(group) - 0.5 * freedom * significance.log_variance_inflation
        least_cost = self.complexity_cost(replace(group, columns=group.columns[:0])) + 0.5 * freedom * np.log(2.0)
        odds = significance.log_likelihood_ratio - max(cost, least_cost) - self.threshold
        # Its variance was estimated from few permutations. (On coarse grids a law leaves part of itself.)
        if not (significance.mostly_between_days or self.first_look):
            odds -= np.log(CHANGE.few_dealt_odds)
        return TestedChange(group, significance, float(odds))
