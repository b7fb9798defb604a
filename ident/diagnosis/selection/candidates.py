"""What each candidate shows beside others: its evidence, its held-out scores, and by these its gates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ident.arrays import Array
from ident.diagnosis.selection.gates import Gates, Named
from ident.diagnosis.selection.settings import USUAL_SELECTION, SelectionSettings
from ident.effects.intervals import SizePrior
from ident.regression.cross_validation import HeldOut, HeldOutScore
from ident.regression.design import Group, Key
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection, project
from ident.regression.run_spread import squares_left

# Share of an event's power in the block that has most of it, from which on it is in a block: filters' tails are not.
THERE = 1e-3


class FinerSums:
    """Sums of names' finer grids, and for whom they were made last: they hold those of fewer names, too.

    Names, friction's variation and the URDF's error are estimated beside each other until all hold: mostly the same
    names come back.
    """

    def __init__(self) -> None:
        self._groups: tuple[Group, ...] = ()
        self._evidence: Evidence | None = None

    def of(self, groups: Sequence[Group], gathered: Callable[[], Evidence]) -> Evidence:
        """The sums of names at their points of the coarse grid, friction the same in all runs.

        Args:
            groups: The names.
            gathered: Makes the sums, where they are not those of last time.
        """
        if self._evidence is None or not set(groups) <= set(self._groups):
            self._groups, self._evidence = tuple(groups), None  # the old ones go before new ones come
            self._evidence = gathered()
        return self._evidence


@dataclass(frozen=True, eq=False)
class Candidates:
    """All effects of a session that may get a name, each at all its inner parameters."""

    evidence: Evidence  # sums of the session
    prior: Prior  # the URDF's tolerance
    held_out: HeldOut  # scores on runs left out
    seed: int = 0  # of what is drawn
    barred: frozenset[Key] = frozenset()  # candidates that can't be it, whatever they explain
    absurd: frozenset[Key] = frozenset()  # those of them whose parameters no arm has
    # Those of them that another name's law includes: no second name, but perhaps the right one.
    redundant: frozenset[Key] = frozenset()
    settings: SelectionSettings = USUAL_SELECTION  # what candidates are held to
    finer: FinerSums = field(default_factory=FinerSums)  # sums of finer grids, made for the names of this session last

    def judged_beside(self, gram: Array, groups: Sequence[Group], slot: int) -> Named:
        """What one of several effects shows beside all the others.

        Args:
            gram: Sums of the whole session.
            groups: The effects.
            slot: Which of them is judged.
        """
        others = [other for k, other in enumerate(groups) if k != slot]
        projection = project(gram, self.evidence, self.prior, others)
        return self.judge(gram, projection, others, [(self.score_of(projection, groups[slot]), groups[slot])])[0]

    def score_of(self, projection: Projection, group: Group) -> float:
        """Log evidence that a group adds: half the fall of the misfit, less what its freedom and its grid cost.

        Columns that make a group what it is must earn their own place; until they do, they alone count.
        """
        gain, scaled = self.gain_of(projection, group)
        if group.prior is not None:
            known = projection.rest(group.columns)
            return 0.5 * gain - self.cost_of_size(group, group.prior, scaled, known) - self._choices[group.effect.id]
        column = self._cost_of_column(group)
        essential = group.effect.essential(group.variant)
        if essential:
            own = gain - projection.gain_without(group, essential)
            if 0.5 * own - len(essential) * column < self.settings.essential_nats:
                gain = own
        return 0.5 * gain - self.cost_of(group)

    def gain_of(self, projection: Projection, group: Group) -> tuple[float, Array]:
        """Fall of the misfit by a group, and its scaled coefficients; none where its point of the grid isn't theirs."""
        gain, scaled = projection.gain(group)
        holds = group.effect.stands_for(group.variant, scaled / self.evidence.scale[group.columns])
        return gain if holds else 0.0, scaled

    def cost_of(self, group: Group) -> float:
        """What a group's freedom and its grid cost [nats]."""
        return len(group.columns) * self._cost_of_column(group) + self._choices[group.effect.id]

    def cost_of_size(self, group: Group, prior: SizePrior, scaled: Array, known: Array) -> float:
        """What coefficients cost of whose size something is known [nats].

        Args:
            group: The group.
            prior: What is known.
            scaled: Its scaled coefficients.
            known: What the recordings say about these, beside the model.
        """
        scale = self.evidence.scale[group.columns]
        return prior.cost(scaled / scale, scale[:, None] * known * scale)

    @cached_property
    def inertial_nats(self) -> float:
        """What a name of the inertias' kind needs, its size counted [nats]."""
        kinds = {group.key for group in self.evidence.layout.groups if group.effect.inertia_like}
        return float(np.log(self.settings.inertial_odds * len(kinds)))

    def _cost_of_column(self, group: Group) -> float:
        counts = self.evidence.samples
        seen = counts[group.joint] if group.effect.rows == "own" else counts.sum()
        return 0.5 * float(np.log(max(seen, 10.0)))

    @cached_property
    def _choices(self) -> dict[str, float]:
        """For each effect the log of all its points and places: effects are as likely as each other beforehand."""
        groups = self.evidence.layout.groups
        counts = {effect.id: effect.screens for effect in (group.effect for group in groups)}
        return {name: float(np.log(n * sum(g.effect.id == name for g in groups))) for name, n in counts.items()}

    def best_by_key(
        self, projection: Projection, without: Sequence[Group] = (), place: Group | None = None
    ) -> dict[Key, tuple[float, Group]]:
        """For each effect and joint its best inner parameters and their log evidence.

        Args:
            projection: The model beside which they stand.
            without: Effects of that model.
            place: Only what acts at a joint where this effect does; all if None.
        """
        taken, n = {group.key for group in without} | self.barred, self.evidence.layout.n
        here = set(range(n) if place is None else place.acts_on(n))
        groups = [one for one in self.evidence.layout.groups if one.key not in taken and here & set(one.acts_on(n))]
        return self._best_of(projection, groups)

    def best_absurd(self, projection: Projection) -> dict[Key, tuple[float, Group]]:
        """The best inner parameters of what has parameters that no arm has."""
        return self._best_of(projection, [group for group in self.evidence.layout.groups if group.key in self.absurd])

    def _best_of(self, projection: Projection, groups: Sequence[Group]) -> dict[Key, tuple[float, Group]]:
        """Most points of a grid are ruled out by what they could gain at most, which is found for all at once."""
        most = 0.5 * projection.most_gains(groups)
        best: dict[Key, tuple[float, Group]] = {}
        for k in np.argsort(-most, kind="stable"):
            group = groups[k]
            known = best.get(group.key)
            if known is None or group.prior is not None or most[k] - self.cost_of(group) > known[0]:
                score = self.score_of(projection, group)
                if known is None or score > known[0]:
                    best[group.key] = (score, group)
        return best

    def score_beside(self, gram: Array, group: Group, others: Sequence[Group]) -> float:
        """Log evidence that a group adds to a model of others."""
        return self.score_of(project(gram, self.evidence, self.prior, others), group)

    def is_absorbed(self, tuned: Projection, fixed: Projection, group: Group) -> bool:
        """Whether tuning the inertias hides a group, so that it is judged with the URDF fixed."""
        seen, fast = (float(view.visibility(group.columns).max()) for view in (tuned, fixed))
        hidden = seen < self.settings.absorbed_below and fast > self.settings.absorbed_ratio * seen
        return group.effect.inertia_like and hidden

    def least_seen(self, projection: Projection, group: Group) -> bool:
        """Whether the tuned baseline leaves next to nothing of a group."""
        return bool(projection.visibility(group.columns).max() < self.settings.absorbed_below)

    @cached_property
    def fixed(self) -> HeldOut:
        """Held-out scores with the URDF fixed."""
        return HeldOut(self.evidence, self.prior.tightened(self.settings.fixed_factor * self.prior.error.scale))

    def judge(
        self, gram: Array, tuned: Projection, chosen: Sequence[Group], short: Sequence[tuple[float, Group]]
    ) -> list[Named]:
        """What candidates, given with their evidence, show beside the chosen effects, of which `tuned` is the model."""
        fixed = project(gram, self.evidence, self.fixed.prior, chosen)
        without: dict[bool, tuple[HeldOutScore, HeldOutScore]] = {}

        def judged(score: float, group: Group, absorbed: bool) -> Named:
            scorer = self.fixed if absorbed else self.held_out
            if absorbed not in without:
                without[absorbed] = scorer.score(), scorer.score(chosen)
            first, before = without[absorbed]
            after = scorer.score([*chosen, group])
            gates = self._gates(group, score, absorbed, (first, before, after))
            if group.effect.event:
                gates = replace(
                    gates,
                    gap_fall=self._event_fall(tuned, project(gram, self.evidence, self.prior, [*chosen, group]), group),
                )
            return Named(group, gates, before, after, absorbed)

        found = []
        for score, group in short:
            item = judged(score, group, self.is_absorbed(tuned, fixed, group))
            if group.effect.inertia_like and not (item.absorbed or item.gates.passed):
                # Tuned inertias make up for it on other runs, too; that they would have to go so far is what speaks.
                item = judged(score, group, True)
            found.append(item)
        return found

    def _event_fall(self, without: Projection, beside: Projection, group: Group) -> float:
        """Share that an event explains of what its blocks of time have beyond usual ones, at the joint where most.

        It is 0 where they have no more than one block in ten has anyway: what a model leaves of real arms is not even.
        """
        best = (0.0, 0.0)
        left = (squares_left(self.evidence, model) for model in (without, beside))
        for j, (before, after, place) in enumerate(zip(*left, self.evidence.layout.places, strict=True)):
            at = np.array([place[int(column)] for column in group.columns if int(column) in place], dtype=int)
            power = np.trace(self.evidence.free[j].part(at), axis1=1, axis2=2)
            acts = power > THERE * power.max(initial=0.0)
            if not acts.any() or acts.all():
                continue
            usual, high = np.quantile(before[~acts], [0.5, 0.9])
            closed, excess = float((before - after)[acts].sum()), float((before[acts] - usual).sum())
            if before[acts].mean() > high:
                best = max(best, (closed, closed / max(excess, 1e-300)))
        return best[1]

    def _gates(
        self,
        group: Group,
        score: float,
        absorbed: bool,
        scores: tuple[HeldOutScore, HeldOutScore, HeldOutScore],
    ) -> Gates:
        """Parameters of a candidate from held-out scores of the baseline alone, without and with it."""
        floor = self.evidence.floor
        joints = group.acts_on(self.evidence.layout.n)
        start, old, new = (one.rms[joints] for one in scores)
        fall = scores[2].fall_from(scores[1])[joints]
        closed = old**2 - new**2
        first = _reducible(start, floor[joints])
        gap = closed / _reducible(old, floor[joints])
        most = int(np.argmax(fall))
        held = self.settings
        # Where sizes are known, a belief about the URDF that is free to change has the last word (`inertial_nats`).
        least = held.least_nats if group.prior is None or not absorbed else held.unlikely_nats
        return Gates(
            log_score=scores[2].gain_over(scores[1], joints),
            closed=scores[2].closed_over(scores[1], joints),
            rms_fall=float(fall[most]),
            gap_fall=float(gap[most]),
            own_share=float(closed[most] / first[most]),
            evidence=score,
            absorbed=absorbed,
            least_nats=held.event_nats if group.effect.event else least,
            event=group.effect.event,
            settings=self.settings,
        )


def _reducible(rms: Array, floor: Array) -> Array:
    """Mean square above the noise, of which a model may close some; a little where there is none [N² m²]."""
    return np.asarray(np.maximum(np.maximum(rms**2 - floor**2, 1e-3 * rms**2), 1e-300))
