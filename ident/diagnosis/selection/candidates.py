"""Evaluation of candidate effects beside a model: log evidence, held-out scores, acceptance criteria.

With G = ½ (fall of the whitened misfit) by an effect of k columns, its log evidence is, after Schwarz (BIC),

    G − ½ k log N − log(grid points × joints),

N the samples of its rows. Where the size of its coefficients is known beforehand, a prior replaces ½ k log N.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.selection.criteria import AcceptanceCriteria, Evaluated
from ident.diagnosis.selection.settings import USUAL_SELECTION, SelectionSettings
from ident.effects import optional
from ident.effects.intervals import SizePrior
from ident.effects.rigid_body import LinkInertialError, UnknownPayload
from ident.regression.cross_validation import HeldOut, HeldOutScore
from ident.regression.design import Group, Key
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection, project
from ident.regression.run_spread import squares_left

# A block belongs to an event if it holds this share of the largest block's power; less is a filter's tail.
LEAST_ACTIVE_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class Candidates:
    """All candidate effects of a session at all points of their grids, and how they are evaluated."""

    evidence: Evidence  # block sums of all columns
    prior: Prior  # prior of the inertias: the URDF's tolerance
    held_out: HeldOut  # cross-validation scores with that prior
    excluded: frozenset[Key] = frozenset()  # candidates that the search must not accept
    settings: SelectionSettings = USUAL_SELECTION  # thresholds of the criteria

    def evaluate_beside(self, gram: Array, groups: Sequence[Group], slot: int) -> Evaluated:
        """Evaluates one of several effects beside all the others.

        Args:
            gram, groups: Normal equations of the whole session, and the effects.
            slot: Index of the effect that is evaluated.
        """
        others = [other for k, other in enumerate(groups) if k != slot]
        projection = project(gram, self.evidence, self.prior, others)
        score = self.log_evidence_of(projection, groups[slot])
        return self.evaluate(gram, projection, others, [(score, groups[slot])])[0]

    def log_evidence_of(self, projection: Projection, group: Group) -> float:
        """Log evidence that an effect adds to a solved model: half the fall of the misfit less its complexity cost.

        Of an effect with essential columns these alone count until they exceed a threshold of their own.
        """
        gain, scaled = self.gain_of(projection, group)
        if group.prior is not None:
            known = projection.rest(group.columns)
            return 0.5 * gain - self.prior_cost(group, group.prior, scaled, known) - self._grid_cost[group.effect.id]
        column = self._cost_of_column(group)
        essential = optional.essential(group.effect, group.variant)
        if essential:
            own = gain - projection.gain_without(group, essential)
            if 0.5 * own - len(essential) * column < self.settings.essential_nats:
                gain = own
        return 0.5 * gain - self.complexity_cost(group)

    def gain_of(self, projection: Projection, group: Group) -> tuple[float, Array]:
        """Fall of the misfit by an effect, and its scaled coefficients.

        The fall is 0 where the coefficients belong to another point of the grid
        (`optional.stands_for`), and of a heavier last link, which is a load.
        """
        gain, scaled = projection.gain(group)
        estimate = scaled / self.evidence.scale[group.columns]
        holds = optional.stands_for(group.effect, group.variant, estimate)
        carries = group.key == self._carrier and scaled[0] > 0.0
        return gain if holds and not carries else 0.0, scaled

    @cached_property
    def _carrier(self) -> Key | None:
        """Key of the last link, whose first column is its mass, where a load is a candidate, too; else None."""
        listed = any(group.effect.id == UnknownPayload.id for group in self.evidence.layout.groups)
        return (LinkInertialError.id, self.evidence.layout.n - 1, None) if listed else None

    def complexity_cost(self, group: Group) -> float:
        """Cost of an effect's columns and of the choice of its grid point and joint [nats]."""
        return len(group.columns) * self._cost_of_column(group) + self._grid_cost[group.effect.id]

    def prior_cost(self, group: Group, prior: SizePrior, scaled: Array, known: Array) -> float:
        """Cost of coefficients that have a prior of their size [nats].

        Args:
            group, prior, scaled: The effect, the prior, and its scaled coefficients.
            known: Information of the recordings about these, after the model.
        """
        scale = self.evidence.scale[group.columns]
        return prior.cost(scaled / scale, scale[:, None] * known * scale)

    def _cost_of_column(self, group: Group) -> float:
        """Cost of one free coefficient by Schwarz's criterion, ½ log N [nats]."""
        return float(self._costs_of_rows[group.joint if group.effect.rows == "own" else -1])

    @cached_property
    def _costs_of_rows(self) -> Float[Array, " m"]:
        """½ log N of the rows of each joint and, last, of all [nats]."""
        counts = self.evidence.samples
        return 0.5 * np.log(np.maximum(np.append(counts, counts.sum()), 10.0))

    @cached_property
    def _grid_cost(self) -> dict[str, float]:
        """By effect, cost of choosing among its grid points and joints [nats]; all effects have equal prior odds."""
        groups = self.evidence.layout.groups
        counts = {effect.id: effect.screens for effect in (group.effect for group in groups)}
        return {name: float(np.log(n * sum(g.effect.id == name for g in groups))) for name, n in counts.items()}

    def best_by_key(
        self,
        projection: Projection,
        without: Sequence[Group] = (),
        place: Group | None = None,
        above: float = -np.inf,
    ) -> dict[Key, tuple[float, Group]]:
        """For each effect and joint the best grid point and its log evidence.

        Args:
            projection, without: The model beside which they are evaluated, and its effects, which are no candidates.
            place: Restricts the candidates to those that act at a joint where this effect does; all if None.
            above: Candidates that surely have no greater log evidence may be left out [nats].
        """
        taken, n = {group.key for group in without} | self.excluded, self.evidence.layout.n
        here = set(range(n) if place is None else place.acts_on(n))
        groups = [
            one
            for one in self.evidence.layout.groups
            if one.key not in taken and (one.effect.rows == "all" or one.joint in here)
        ]
        return self._best_of(projection, groups, above)

    def _best_of(
        self, projection: Projection, groups: Sequence[Group], above: float = -np.inf
    ) -> dict[Key, tuple[float, Group]]:
        """The best grid points of some candidates; upper bounds of the gain rule out most points unsolved."""
        most = 0.5 * projection.most_gains(groups)
        best: dict[Key, tuple[float, Group]] = {}
        for k in np.argsort(-most, kind="stable"):
            group = groups[k]
            known = best.get(group.key)
            least = above if known is None else known[0]
            if group.prior is not None or most[k] - self.complexity_cost(group) > least:
                score = self.log_evidence_of(projection, group)
                if known is None or score > known[0]:
                    best[group.key] = (score, group)
        return best

    def log_evidence_beside(self, gram: Array, group: Group, others: Sequence[Group]) -> float:
        """Log evidence that an effect adds to a model of other effects."""
        columns = np.append(group.columns, len(gram) - 1)
        return self.log_evidence_of(project(gram, self.evidence, self.prior, others, columns), group)

    def is_absorbed(self, tuned: Projection, fixed: Projection, group: Group) -> bool:
        """Whether tuned inertias absorb an effect, so that it must be evaluated with the URDF's inertias fixed."""
        seen, fast = (float(view.visibility(group.columns).max()) for view in (tuned, fixed))
        hidden = seen < self.settings.absorbed_below and fast > self.settings.absorbed_ratio * seen
        return group.effect.inertia_like and hidden

    @cached_property
    def fixed(self) -> HeldOut:
        """Cross-validation scores with the URDF's inertias fixed."""
        return HeldOut(self.evidence, self.prior.tightened(self.settings.fixed_factor * self.prior.error.scale))

    def evaluate(
        self, gram: Array, tuned: Projection, chosen: Sequence[Group], short: Sequence[tuple[float, Group]]
    ) -> list[Evaluated]:
        """Evaluates candidates beside the chosen effects.

        Args:
            gram, tuned, chosen: Normal equations of the whole session, and the chosen effects with their model.
            short: The candidates with their log evidence.
        """
        seen = np.concatenate([*(group.columns for _, group in short), [len(gram) - 1]]).astype(int)
        fixed = project(gram, self.evidence, self.fixed.prior, chosen, seen)
        without: dict[bool, tuple[HeldOutScore, HeldOutScore]] = {}

        def evaluated(score: float, group: Group, absorbed: bool) -> Evaluated:
            scorer = self.fixed if absorbed else self.held_out
            if absorbed not in without:
                without[absorbed] = scorer.score(), scorer.score(chosen)
            first, before = without[absorbed]
            after = scorer.score([*chosen, group])
            criteria = self._criteria(group, score, absorbed, (first, before, after))
            if group.effect.event:
                beside = project(gram, self.evidence, self.prior, [*chosen, group])
                criteria = replace(criteria, gap_fall=self._event_share(tuned, beside, group))
            return Evaluated(group, criteria, before, after, absorbed)

        found = []
        for score, group in short:
            item = evaluated(score, group, self.is_absorbed(tuned, fixed, group))
            if group.effect.inertia_like and not (item.absorbed or item.criteria.passed):
                # Tuned inertias imitate it on held-out runs, too: what counts is how far they would have to be tuned.
                item = evaluated(score, group, True)
            found.append(item)
        return found

    def _event_share(self, without: Projection, beside: Projection, group: Group) -> float:
        """Share of the excess of an event's blocks over usual blocks that it explains, at the joint where most.

        It is 0 where one usual block in ten has as much excess: residuals of real arms are uneven.
        """
        best = (0.0, 0.0)
        left = (squares_left(self.evidence, model) for model in (without, beside))
        for j, (before, after, place) in enumerate(zip(*left, self.evidence.layout.places, strict=True)):
            at = np.array([place[int(column)] for column in group.columns if int(column) in place], dtype=int)
            power = np.trace(self.evidence.free[j].part(at), axis1=1, axis2=2)
            acts = power > LEAST_ACTIVE_SHARE * power.max(initial=0.0)
            if not acts.any() or acts.all():
                continue
            usual, high = np.quantile(before[~acts], [0.5, 0.9])
            closed, excess = float((before - after)[acts].sum()), float((before[acts] - usual).sum())
            if before[acts].mean() > high:
                best = max(best, (closed, closed / max(excess, 1e-300)))
        return best[1]

    def _criteria(
        self, group: Group, score: float, absorbed: bool, scores: tuple[HeldOutScore, HeldOutScore, HeldOutScore]
    ) -> AcceptanceCriteria:
        """Acceptance criteria from held-out scores of the baseline alone, without the candidate, and with it."""
        floor = self.evidence.floor
        joints = group.acts_on(self.evidence.layout.n)
        start, old, new = (one.rms[joints] for one in scores)
        fall = scores[2].fall_from(scores[1])[joints]
        closed = old**2 - new**2
        first = _reducible(start, floor[joints])
        gap = closed / _reducible(old, floor[joints])
        most = int(np.argmax(fall))
        settings = self.settings
        # The URDF's prior counts against an absorbed effect already, and so does that of its size.
        least = settings.least_nats if group.prior is None or not absorbed else settings.unlikely_nats
        return AcceptanceCriteria(
            log_score=scores[2].gain_over(scores[1], joints),
            closed=scores[2].closed_over(scores[1], joints),
            rms_fall=float(fall[most]),
            gap_fall=float(gap[most]),
            initial_gap_share=float(closed[most] / first[most]),
            log_evidence=score,
            absorbed=absorbed,
            required_log_evidence=settings.event_nats if group.effect.event else least,
            event=group.effect.event,
            settings=settings,
        )


def _reducible(rms: Array, floor: Array) -> Array:
    """Mean square above the noise, at least a thousandth of the whole [N² m²]."""
    return np.asarray(np.maximum(np.maximum(rms**2 - floor**2, 1e-3 * rms**2), 1e-300))
