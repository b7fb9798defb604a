"""Stepwise selection of effects by log evidence and held-out error: forward steps, swaps, backward elimination.

In: the block sums of a session (`Evidence`), in which every candidate effect has columns at each point of its grid.
Out: the accepted effects with the acceptance criteria that they met, and the best candidate that was rejected. A
forward step adds the candidate of greatest log evidence that meets the criteria (`criteria`) beside those accepted
before; then each accepted effect is optimised over its grid again, and may be swapped for a better candidate.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from ident.arrays import Array
from ident.diagnosis.selection.candidates import Candidates
from ident.diagnosis.selection.criteria import Evaluated, SearchResults, first_of_each_joint
from ident.effects.sensing import TorqueGainError
from ident.regression.design import Group
from ident.regression.least_squares import Projection, project


@dataclass(frozen=True, eq=False)
class Search(Candidates):
    """Stepwise selection among the candidate effects of one session."""

    def run(self, start: Sequence[Group] = (), known: Sequence[Evaluated] = ()) -> SearchResults:
        """Forward selection until no further candidate meets the acceptance criteria.

        Args:
            start: Effects to begin with; those that are excluded or fail the criteria are left out.
            known: Those evaluated before; they are evaluated again only if they share a joint with an excluded one.
        """
        gram = self.evidence.gram()
        removed = [group for group in start if group.key in self.excluded]
        kept = [group for group in start if group.key not in self.excluded]
        accepted = self.backward_elimination(kept, known, self._joints(*removed))
        ladder = [self.held_out.score([item.group for item in accepted[:k]]) for k in range(len(accepted) + 1)]
        best_rejected = None
        while len(accepted) < self.settings.most_effects * self.evidence.layout.n:
            chosen = [item.group for item in accepted]
            step = self._forward(gram, chosen)
            if step is None:
                break
            if not step.criteria.passed:
                best_rejected = step
                break
            groups = self._reoptimise(gram, [*chosen, step.group], self._joints(step.group))
            accepted = [
                # A candidate that was swapped in has not been evaluated yet.
                replace(item, group=group) if group.key == item.group.key else self.evaluate_beside(gram, groups, k)
                for k, (item, group) in enumerate(zip([*accepted, step], groups, strict=True))
            ]
            ladder.append(self.held_out.score(groups))
        return SearchResults(tuple(accepted), tuple(ladder), best_rejected)

    def best_start(self) -> list[Group]:
        """The better of two starting models: forward selection from nothing, or from gain errors at the other joints.

        Gain errors of some joints explain about as much as other link inertias with gain errors of all other joints,
        and single steps do not lead from one of these local optima to the other. The second is taken if its log
        evidence is greater, and it has fewer effects, or as many and a held-out score with the URDF's inertias fixed
        that is not lower by one standard error. (Of one gain the image is a gain of every other joint.)
        """
        first = [item.group for item in self.run().accepted]
        gains = [one for one in self.evidence.layout.groups if one.effect.id == TorqueGainError.id and one not in first]
        others = [item.group for item in self.backward_elimination(gains)]
        if not others:
            return first
        second = [item.group for item in self.run(others).accepted]
        if len(second) > len(first) or self.model_log_evidence(second) <= self.model_log_evidence(first):
            return first
        if len(second) < len(first):
            return second
        gain, error = self.fixed.score(second).gain_over(self.fixed.score(first))
        return second if gain > -error else first

    def model_log_evidence(self, groups: Sequence[Group]) -> float:
        """Log evidence of a model of several effects [nats]: the sum of what each adds to those before it."""
        gram = self.evidence.gram()
        return sum(self.log_evidence_beside(gram, group, groups[:k]) for k, group in enumerate(groups))

    def backward_elimination(
        self, start: Sequence[Group], known: Sequence[Evaluated] = (), changed: set[int] | None = None
    ) -> list[Evaluated]:
        """Optimises effects jointly over their grids, and drops those that fail the criteria, the weakest first.

        Args:
            start, known: The effects, and those of them that were evaluated before (none: all are evaluated).
            changed: Joints where an effect was removed; known effects are evaluated again only if they act there.
        """
        accepted, gram = {item.group: item for item in known}, self.evidence.gram()
        groups = list(start)
        near = set(range(self.evidence.layout.n)) if changed is None or not known else set(changed)
        while groups and near:
            reoptimised = self._reoptimise(gram, groups, near)
            near |= self._joints(*(new for new, old in zip(reoptimised, groups, strict=True) if new is not old))
            groups = reoptimised
            for k, group in enumerate(groups):
                if group not in accepted or near & self._joints(group):
                    accepted[group] = self.evaluate_beside(gram, groups, k)
            failed = [group for group in groups if not accepted[group].criteria.passed]
            weakest = sorted(failed, key=lambda group: accepted[group].criteria.log_evidence)
            removed = first_of_each_joint([(group, self._joints(group)) for group in weakest])
            groups, near = [group for group in groups if group not in removed], self._joints(*removed)
        return [accepted[group] for group in groups]

    def _joints(self, *groups: Group) -> set[int]:
        """Indices of the joints where some effects act."""
        return {j for group in groups for j in group.acts_on(self.evidence.layout.n)}

    def only(self, found: SearchResults, kept: Sequence[int]) -> SearchResults:
        """The results reduced to some of the accepted effects, at the same grid points.

        The dropped effect of greatest log evidence becomes the best rejected candidate.
        """
        accepted: list[Evaluated] = []
        ladder = [found.ladder[0]]
        for k in kept:
            item = found.accepted[k]
            before = [one.group for one in accepted]
            scorer = self.fixed if item.absorbed else self.held_out
            after = scorer.score([*before, item.group])
            accepted.append(replace(item, before=scorer.score(before), after=after))
            ladder.append(self.held_out.score([*before, item.group]))
        dropped = [item for k, item in enumerate(found.accepted) if k not in kept]
        best_rejected = max(dropped, key=lambda item: item.criteria.log_evidence) if dropped else found.best_rejected
        return SearchResults(tuple(accepted), tuple(ladder), best_rejected)

    def _forward(self, gram: Array, chosen: Sequence[Group]) -> Evaluated | None:
        """Of the candidates of greatest log evidence the first that meets the criteria; if none does, the first."""
        projection = project(gram, self.evidence, self.prior, chosen)
        best = sorted(self.best_by_key(projection, chosen, above=0.0).values(), key=lambda pair: -pair[0])
        first = None
        for score, group in best[: self.settings.shortlist]:
            if score <= 0.0:
                break
            item = self.evaluate(gram, projection, chosen, [(score, group)])[0]
            if item.criteria.passed:
                return item
            first = first or item
        return first

    def _reoptimise(self, gram: Array, groups: Sequence[Group], changed: Collection[int]) -> list[Group]:
        """Coordinate ascent: each effect at its best grid point beside the others, or swapped for a better candidate.

        A swap needs greater log evidence, and held-out error that is lower by more than one standard error.

        Args:
            gram, groups: Normal equations of the whole session, and the effects.
            changed: Joints where an effect was added or removed; effects that act elsewhere stay as they are.
        """
        current, near = list(groups), set(changed)
        for _ in range(self.settings.polish_rounds):
            moved = set[int]()
            for i, old in enumerate(current):
                if not (near | moved) & self._joints(old):
                    continue
                others = current[:i] + current[i + 1 :]
                projection = project(gram, self.evidence, self.prior, others)
                score, current[i] = self.best_point(projection, old.key)
                rivals = self.best_by_key(projection, others, old, above=score).values()
                rival = max(rivals, key=lambda pair: pair[0], default=(score, old))[1]
                if rival.key != old.key and self._predicts_better(projection, others, rival, current[i]):
                    current[i] = rival
                if current[i] is not old:
                    moved |= self._joints(old, current[i])
            near = moved
            if not moved:
                break
        return current

    def _predicts_better(self, projection: Projection, others: Sequence[Group], rival: Group, incumbent: Group) -> bool:
        """Whether a rival predicts held-out runs better than an accepted effect by more than one standard error.

        Events, and effects that tuned inertias absorb, are never swapped: held-out runs cannot compare them.
        """
        if incumbent.effect.event or rival.effect.event:
            return False
        if incumbent.effect.inertia_like and self.is_hidden_by_tuning(projection, incumbent):
            return False
        old, new = self.held_out.score([*others, incumbent]), self.held_out.score([*others, rival])
        gain, error = new.gain_over(old)
        return gain > error
