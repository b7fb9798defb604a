"""Which effects: forward by group, with swaps, each name held to three gates.

1. The sign-flip test over all candidates: family-wise error 5 %.
2. The log score on held-out runs gains more than one standard error.
3. The size matters: on held-out runs the torque error of a joint that the effect acts on falls by 2 % or more, and by
   10 % or more of what is left above the noise. What comes in bursts drowns in a mean over the session: there the
   evidence must make up for the 2 %.

An effect that acts like wrong inertias (a payload, another link's mass, a scaled torque) is no gap at all once every
inertia may be tuned: the tuned model explains it, by changes that are too large to be believed. Such an effect is
judged by the evidence, in which the URDF's tolerances count, and its size against the URDF held fast.

Whatever it is, an effect must close some share of the gap that there was before anything was named: less may be what is
left of a cause whose law is not quite the catalogue's. Beside a cause of eight times its size no other is named at the
same joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ident.arrays import Array
from ident.diagnosis.regression.cross_validation import HeldOut, HeldOutScore
from ident.diagnosis.regression.design import Group, Key
from ident.diagnosis.regression.gram import Evidence
from ident.diagnosis.regression.least_squares import Prior, Projection, project
from ident.diagnosis.selection.settings import USUAL_SELECTION, SelectionSettings
from ident.diagnosis.selection.sign_flips import block_scores, family_p_values, family_p_values_by_run


@dataclass(frozen=True, eq=False)
class Gates:
    """What an effect showed when it was asked for its name.

    Attributes:
        p_value: Family-wise, of the sign-flip test.
        log_score: Gain on held-out runs [nats], and its standard error.
        rms_fall: Largest share by which a joint's held-out error falls.
        gap_fall: The same as a share of the mean square above the noise that was left; of an event, that there was.
        share: Share of all joints' gap that it closes, each joint in units of its noise.
        own_share: Share of its joint's gap that it closes, of what there was before anything was named.
        evidence: Log evidence [nats]: with the shares the only gate of an absorbed effect, and one of an event.
        absorbed: Whether it is one.
        event: Whether it happened once.
        bursts: Whether it comes in bursts.
        settings: What it is held to.
    """

    p_value: float
    log_score: tuple[float, float]
    rms_fall: float
    gap_fall: float
    share: float
    own_share: float
    evidence: float
    absorbed: bool
    event: bool = False
    bursts: bool = False
    settings: SelectionSettings = USUAL_SELECTION

    @property
    def passed(self) -> bool:
        held = self.settings
        if self.event:
            strong = self.evidence >= held.event_nats and self.gap_fall >= held.event_gap_fall
            return strong and self.share >= held.least_share
        counts = self.share >= held.least_share and self.own_share >= held.least_own_share
        if self.absorbed:
            return self.evidence >= held.absorbed_nats and counts
        gain, error = self.log_score
        large = self.rms_fall >= held.least_rms_fall or (self.bursts and self.evidence >= held.burst_nats)
        large = large and self.gap_fall >= held.least_gap_fall and counts
        return self.p_value <= held.family_error and gain > error and large

    @property
    def beyond_chance(self) -> bool:
        """Whether chance alone would hardly have made it so good, passed or not."""
        held = self.settings
        nats = held.event_nats if self.event else held.unlikely_nats
        told = self.log_score[0] > 0.0 and self.rms_fall >= held.least_told_fall
        return self.passed or (self.p_value <= held.unlikely and self.evidence >= nats and told)


@dataclass(frozen=True, eq=False)
class Named:
    """An effect that was judged, at its best inner figures.

    Attributes:
        group: The effect.
        gates: How it did.
        before, after: Held-out scores without and with it, in the view in which it was judged.
        absorbed: Whether tuning the inertias hides it, so that it was judged with the URDF held fast.
    """

    group: Group
    gates: Gates
    before: HeldOutScore
    after: HeldOutScore
    absorbed: bool = False

    @property
    def shown(self) -> list[int]:
        """Joints at which it shows: its own, or those where the error falls by at least a third of the most."""
        if self.group.effect.rows == "own":
            return [self.group.joint]
        fall = 1.0 - self.after.rms / np.maximum(self.before.rms, 1e-12)
        return [int(j) for j in np.flatnonzero(fall >= max(fall.max() / 3, 1e-6))] or [int(np.argmax(fall))]


@dataclass(frozen=True, eq=False)
class SearchResults:
    """What the search found.

    Attributes:
        named: The effects, in the order in which they were found.
        ladder: Held-out scores of the baseline and after each named effect.
        refused: The best candidate that did not pass, or whose name a rival took, and what it showed.
    """

    named: tuple[Named, ...]
    ladder: tuple[HeldOutScore, ...]
    refused: Named | None

    @property
    def hint(self) -> Named | None:
        """The best candidate that got no name, if chance alone would hardly have made it so good."""
        return self.refused if self.refused and self.refused.gates.beyond_chance else None


@dataclass(frozen=True, eq=False)
class Search:
    """Searches one session's evidence.

    Attributes:
        evidence: Sums of the session.
        prior: The URDF's tolerance.
        held_out: Scores on runs left out.
        seed: Of the sign flips.
        barred: Candidates that can't be it, whatever they explain.
        absurd: Those of them whose figures no arm has.
        settings: What candidates are held to.
    """

    evidence: Evidence
    prior: Prior
    held_out: HeldOut
    seed: int = 0
    barred: frozenset[Key] = frozenset()
    absurd: frozenset[Key] = frozenset()
    settings: SelectionSettings = USUAL_SELECTION

    def run(self) -> SearchResults:
        """Forward steps until nothing passes."""
        gram = self.evidence.gram()
        named: list[Named] = []
        ladder = [self.held_out.score()]
        refused = None
        while len(named) < self.settings.most_effects:
            chosen = [item.group for item in named]
            step = self._forward(gram, chosen)
            if step is None:
                break
            if not step.gates.passed:
                refused = step
                break
            groups = self._polish(gram, [*chosen, step.group])
            named = [self._renamed(gram, item, k, groups) for k, item in enumerate([*named, step])]
            ladder.append(self.held_out.score(groups))
        return SearchResults(tuple(named), tuple(ladder), refused)

    def _renamed(self, gram: Array, item: Named, slot: int, groups: Sequence[Group]) -> Named:
        """A name at its new inner figures; one that took another's place is judged itself."""
        group = groups[slot]
        return replace(item, group=group) if group.key == item.group.key else self.judged_beside(gram, groups, slot)

    def judged_beside(self, gram: Array, groups: Sequence[Group], slot: int) -> Named:
        """What one of several effects shows beside all the others.

        Args:
            gram: Sums of the whole session.
            groups: The effects.
            slot: Which of them is judged.
        """
        others = [other for k, other in enumerate(groups) if k != slot]
        projection = project(gram, self.evidence, self.prior, others)
        return self._judge(gram, projection, others, [(self.score_of(projection, groups[slot]), groups[slot])])[0]

    def only(self, found: SearchResults, kept: Sequence[int]) -> SearchResults:
        """The results with some of the names, at the same inner figures; the best of the others counts as refused."""
        named: list[Named] = []
        ladder = [found.ladder[0]]
        for k in kept:
            item = found.named[k]
            before = [one.group for one in named]
            scorer = self.fixed if item.absorbed else self.held_out
            after = scorer.score([*before, item.group])
            named.append(replace(item, before=scorer.score(before), after=after))
            ladder.append(self.held_out.score([*before, item.group]))
        dropped = [item for k, item in enumerate(found.named) if k not in kept]
        refused = max(dropped, key=lambda item: item.gates.evidence) if dropped else found.refused
        return SearchResults(tuple(named), tuple(ladder), refused)

    def significant_keys(self, projection: Projection, groups: Sequence[Group]) -> set[Key]:
        """The names that pass the test of the whole family; those that tuning absorbs are not for it to judge."""
        p_values = self._p_values(projection, groups)
        hidden = {
            g.key for g in groups if g.effect.event or (g.effect.inertia_like and self._least_seen(projection, g))
        }
        return hidden | {key for key, value in p_values.items() if value <= self.settings.family_error}

    def helps(self, projection: Projection, others: Sequence[Group], group: Group) -> bool:
        """Whether a group beside others does better than they on held-out runs.

        Events can't be held out, and of what tuning absorbs held-out runs tell nothing.
        """
        if group.effect.event or (group.effect.inertia_like and self._least_seen(projection, group)):
            return True
        return self.held_out.score([*others, group]).gain_over(self.held_out.score(others))[0] > 0.0

    def score_of(self, projection: Projection, group: Group) -> float:
        """Log evidence that a group adds: half the fall of the misfit, less what its freedom and its grid cost.

        Columns that make a group what it is must earn their own place; until they do, they alone count.
        """
        gain, _ = projection.gain(group)
        column = 0.5 * float(np.log(self._samples(group)))
        essential = group.effect.essential(group.variant)
        if essential:
            own = gain - projection.gain_without(group, essential)
            if 0.5 * own - len(essential) * column < self.settings.essential_nats:
                gain = own
        return 0.5 * gain - len(group.columns) * column - self._choices[group.effect.id]

    @cached_property
    def _choices(self) -> dict[str, float]:
        """For each effect the log of all its points and places: effects are as likely as each other beforehand."""
        groups = self.evidence.layout.groups
        counts = {effect.id: effect.screens for effect in (group.effect for group in groups)}
        return {name: float(np.log(n * sum(g.effect.id == name for g in groups))) for name, n in counts.items()}

    def best_by_key(self, projection: Projection, without: Sequence[Group] = ()) -> dict[Key, tuple[float, Group]]:
        """For each effect and joint its best inner figures and their log evidence."""
        taken = {group.key for group in without} | self.barred
        best: dict[Key, tuple[float, Group]] = {}
        for group in self.evidence.layout.groups:
            if group.key in taken:
                continue
            score = self.score_of(projection, group)
            if group.key not in best or score > best[group.key][0]:
                best[group.key] = (score, group)
        return best

    def _least_seen(self, projection: Projection, group: Group) -> bool:
        """Whether the tuned baseline leaves next to nothing of a group."""
        return bool(projection.visibility(group.columns).max() < self.settings.absorbed_below)

    def _samples(self, group: Group) -> float:
        counts = self.evidence.samples
        return float(max(counts[group.joint] if group.effect.rows == "own" else counts.sum(), 10.0))

    @cached_property
    def fixed(self) -> HeldOut:
        """Held-out scores with the URDF held fast."""
        return HeldOut(self.evidence, self.prior.tightened(self.settings.fixed_factor / self.prior.factor))

    def _forward(self, gram: Array, chosen: Sequence[Group]) -> Named | None:
        """The candidate of greatest evidence that passes; if none does, the greatest one."""
        projection = project(gram, self.evidence, self.prior, chosen)
        best = sorted(self.best_by_key(projection, chosen).values(), key=lambda pair: -pair[0])
        short = [(score, group) for score, group in best[: self.settings.shortlist] if score > 0.0]
        if not short:
            return None
        tried = self._judge(gram, projection, chosen, short)
        for item in tried:
            if item.gates.passed:
                return item
            if item.gates.p_value <= self.settings.family_error:
                other = self.steadier(projection, chosen, item.group)
                if other is not item.group:
                    again = self._judge(gram, projection, chosen, [(self.score_of(projection, other), other)])[0]
                    if again.gates.passed:
                        return again
        return tried[0]

    def steadier(self, projection: Projection, others: Sequence[Group], group: Group) -> Group:
        """The best point of a group's grid that does better on runs left out; the group itself where none does.

        What lies beyond a knee is often that of one run. The point that explains it best then has no other run to learn
        its coefficient from, while a lower knee, nearly as good, has.

        Args:
            projection: The model beside which it stands.
            others: The effects of that model.
            group: The point of greatest evidence.
        """
        if group.effect.event or group.effect.inertia_like:  # held-out runs can't judge them
            return group
        mates = [mate for mate in self.evidence.layout.groups if mate.key == group.key and mate is not group]
        scores = sorted(((self.score_of(projection, mate), -k) for k, mate in enumerate(mates)), reverse=True)
        before = self.held_out.score(others)
        for mate in [group, *(mates[-k] for score, k in scores if score > 0.0)][: self.settings.steady_points]:
            gain, error = self.held_out.score([*others, mate]).gain_over(before)
            if gain > error:
                return mate
        return group

    def _judge(
        self, gram: Array, tuned: Projection, chosen: Sequence[Group], short: Sequence[tuple[float, Group]]
    ) -> list[Named]:
        """What candidates, given with their evidence, show beside the chosen effects, of which `tuned` is the model."""
        held_fast = project(gram, self.evidence, self.fixed.prior, chosen)
        p_values = self._p_values(tuned, [group for _, group in short])
        without: dict[bool, tuple[HeldOutScore, HeldOutScore]] = {}
        found = []
        for score, group in short:
            seen, fast = (float(p.visibility(group.columns).max()) for p in (tuned, held_fast))
            absorbed = (
                group.effect.inertia_like
                and seen < self.settings.absorbed_below
                and fast > self.settings.absorbed_ratio * seen
            )
            scorer = self.fixed if absorbed else self.held_out
            if absorbed not in without:
                without[absorbed] = scorer.score(), scorer.score(chosen)
            first, before = without[absorbed]
            after = scorer.score([*chosen, group])
            gates = self._gates(group, p_values[group.key], score, absorbed, (first, before, after))
            found.append(Named(group, gates, before, after, absorbed))
        return found

    def _p_values(self, projection: Projection, short: Sequence[Group]) -> dict[Key, float]:
        """Least family-wise p-value of each short-listed effect over its grid."""
        scores = block_scores(self.evidence, projection)
        folds = self.evidence.fold_of_block
        by_run = np.array([scores[folds == fold].sum(axis=0) for fold in np.unique(folds)])
        wanted = {group.key for group in short}
        quick = [g for g in self.evidence.layout.groups if not g.effect.by_run]
        slow = [g for g in self.evidence.layout.groups if g.effect.by_run]
        least: dict[Key, float] = {}
        rng = np.random.default_rng(self.seed)
        for group, value in zip(quick, family_p_values(scores, quick, rng, self.settings), strict=True):
            if group.key in wanted:
                least[group.key] = min(least.get(group.key, 1.0), float(value))
        if any(group.key in wanted for group in slow):
            found = family_p_values_by_run(by_run, projection.rest, slow, rng, self.settings)
            least.update({key: value for key, value in found.items() if key in wanted})
        return least

    def _gates(
        self,
        group: Group,
        p_value: float,
        score: float,
        absorbed: bool,
        scores: tuple[HeldOutScore, HeldOutScore, HeldOutScore],
    ) -> Gates:
        """Figures of a candidate from held-out scores of the baseline alone, without and with it."""
        floor = self.evidence.floor
        joints = group.acts_on(self.evidence.layout.n)
        start, old, new = (one.rms[joints] for one in scores)
        fall = 1.0 - new / np.maximum(old, 1e-12)
        closed = old**2 - new**2
        first = _reducible(start, floor[joints])
        gap = closed / (first if group.effect.event else _reducible(old, floor[joints]))
        most = int(np.argmax(fall))
        share = float(np.sum(closed / floor[joints] ** 2) / np.sum(_reducible(scores[0].rms, floor) / floor**2))
        if group.effect.event:
            p_value = float(np.exp(-max(score, 0.0)))  # bound of a likelihood ratio, screening paid for
        return Gates(
            p_value=p_value,
            log_score=scores[2].gain_over(scores[1]),
            rms_fall=float(fall[most]),
            gap_fall=float(gap[most]),
            share=share,
            own_share=float(closed[most] / first[most]),
            evidence=score,
            absorbed=absorbed,
            event=group.effect.event,
            bursts=group.effect.bursts,
            settings=self.settings,
        )

    def _polish(self, gram: Array, groups: Sequence[Group]) -> list[Group]:
        """Each effect in turn is left out: its inner figures are found anew, and a better name may take its place.

        A swap must have more evidence and do better on held-out runs by more than one standard error.
        """
        current = list(groups)
        for _ in range(self.settings.polish_rounds):
            before = list(current)
            for i in range(len(current)):
                others = current[:i] + current[i + 1 :]
                projection = project(gram, self.evidence, self.prior, others)
                best = self.best_by_key(projection, others)
                current[i] = self.steadier(projection, others, best[current[i].key][1])
                rival = max(best.values(), key=lambda pair: pair[0])[1]
                if rival.key != current[i].key and self._beats(projection, others, rival, current[i]):
                    current[i] = rival
            if current == before:
                break
        return current

    def _beats(self, projection: Projection, others: Sequence[Group], rival: Group, holder: Group) -> bool:
        """Whether a rival is significant, and better on held-out runs than the holder of a name by one error.

        A holder that tuning absorbs is not swapped: held-out runs can't judge it.
        """
        if holder.effect.event or rival.effect.event:
            return False
        if holder.effect.inertia_like and self._least_seen(projection, holder):
            return False
        if self._p_values(projection, [rival])[rival.key] > self.settings.family_error:
            return False
        old, new = self.held_out.score([*others, holder]), self.held_out.score([*others, rival])
        gain, error = new.gain_over(old)
        return gain > error


def _reducible(rms: Array, floor: Array) -> Array:
    """Mean square above the noise, of which a model may close some; a little where there is none [N² m²]."""
    return np.asarray(np.maximum(rms**2 - floor**2, 1e-3 * rms**2))
