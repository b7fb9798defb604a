"""Which effects: forward by group, with swaps, each name held to its gates."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from ident.arrays import Array
from ident.diagnosis.selection.candidates import Candidates
from ident.diagnosis.selection.gates import Named, SearchResults, first_of_each_joint
from ident.effects.sensing import TorqueGainError
from ident.regression.design import Group
from ident.regression.least_squares import Projection, project


@dataclass(frozen=True, eq=False)
class Search(Candidates):
    """Searches one session's candidates: forward steps, swaps, and points of grids that other runs know, too."""

    def run(self, start: Sequence[Group] = (), known: Sequence[Named] = ()) -> SearchResults:
        """Forward steps until nothing passes.

        Args:
            start: Effects to begin with, as far as they pass and are not barred by now.
            known: Names among them that this search has tested; near one that is barred they are tested again.
        """
        gram = self.evidence.gram()
        gone = [group for group in start if group.key in self.barred]
        kept = [group for group in start if group.key not in self.barred]
        named = self.standing(kept, known, self._joints(*gone))
        ladder = [self.held_out.score([item.group for item in named[:k]]) for k in range(len(named) + 1)]
        refused = None
        while len(named) < self.settings.most_effects * self.evidence.layout.n:
            chosen = [item.group for item in named]
            step = self._forward(gram, chosen)
            if step is None:
                break
            if not step.gates.passed:
                refused = step
                break
            groups = self._polish(gram, [*chosen, step.group], self._joints(step.group))
            named = [
                # One that took another's place is judged itself.
                replace(item, group=group) if group.key == item.group.key else self.judged_beside(gram, groups, k)
                for k, (item, group) in enumerate(zip([*named, step], groups, strict=True))
            ]
            ladder.append(self.held_out.score(groups))
        return SearchResults(tuple(named), tuple(ladder), refused)

    def best_start(self) -> list[Group]:
        """Effects to begin with: those found step by step, or beside gains of the joints that these name no gain of.

        Gains of some joints are as good as other links and gains of all others; one name at a time never leaves the
        wrong set. The second is kept with more evidence and fewer names, or as many that foretell better beside the
        URDF as it is.
        """
        first = [item.group for item in self.run().named]
        gains = [one for one in self.evidence.layout.groups if one.effect.id == TorqueGainError.id and one not in first]
        others = [item.group for item in self.standing(gains)]
        if not others:
            return first
        second = [item.group for item in self.run(others).named]
        if len(second) > len(first) or self.evidence_of(second) <= self.evidence_of(first):
            return first
        better = len(second) < len(first) or self.fixed.score(second).gain_over(self.fixed.score(first))[0] > 0.0
        return second if better else first

    def evidence_of(self, groups: Sequence[Group]) -> float:
        """Log evidence of a model of some effects [nats]: what each adds to those before it."""
        gram = self.evidence.gram()
        return sum(self.score_beside(gram, group, groups[:k]) for k, group in enumerate(groups))

    def standing(
        self, start: Sequence[Group], known: Sequence[Named] = (), changed: set[int] | None = None
    ) -> list[Named]:
        """Effects at their best points beside each other, without those that do not pass, the weakest going first.

        Args:
            start: The effects.
            known: Names among them that have been tested; all are if None are given.
            changed: Joints where another name went: of known ones only those that act there are tested again.
        """
        named, gram = {item.group: item for item in known}, self.evidence.gram()
        groups = list(start)
        near = set(range(self.evidence.layout.n)) if changed is None or not known else set(changed)
        while groups and near:
            polished = self._polish(gram, groups, near)
            near |= self._joints(*(new for new, old in zip(polished, groups, strict=True) if new is not old))
            groups = polished
            for k, group in enumerate(groups):
                if group not in named or near & self._joints(group):
                    named[group] = self.judged_beside(gram, groups, k)
            failed = [group for group in groups if not named[group].gates.passed]
            weakest = sorted(failed, key=lambda group: named[group].gates.evidence)
            gone = first_of_each_joint([(group, self._joints(group)) for group in weakest])
            groups, near = [group for group in groups if group not in gone], self._joints(*gone)
        return [named[group] for group in groups]

    def _joints(self, *groups: Group) -> set[int]:
        """Where some effects act."""
        return {j for group in groups for j in group.acts_on(self.evidence.layout.n)}

    def only(self, found: SearchResults, kept: Sequence[int]) -> SearchResults:
        """The results with some of the names at the same inner parameters; the best of the others is refused."""
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

    def _forward(self, gram: Array, chosen: Sequence[Group]) -> Named | None:
        """The candidate of greatest evidence that passes; if none does, the greatest one."""
        projection = project(gram, self.evidence, self.prior, chosen)
        best = sorted(self.best_by_key(projection, chosen).values(), key=lambda pair: -pair[0])
        short = [(score, group) for score, group in best[: self.settings.shortlist] if score > 0.0]
        if not short:
            return None
        tried = self.judge(gram, projection, chosen, short)
        return next((item for item in tried if item.gates.passed), tried[0])

    def _polish(self, gram: Array, groups: Sequence[Group], changed: Collection[int]) -> list[Group]:
        """Each effect in turn is left out: its inner parameters are found anew, and a better name may take its place.

        A swap must have more evidence and do better on held-out runs by more than one standard error.

        Args:
            gram: Sums of the whole session.
            groups: The effects.
            changed: Joints where one of them is new or another went: what acts elsewhere stays as it is.
        """
        current, near = list(groups), set(changed)
        for _ in range(self.settings.polish_rounds):
            moved = set[int]()
            for i, old in enumerate(current):
                if not (near | moved) & self._joints(old):
                    continue
                others = current[:i] + current[i + 1 :]
                projection = project(gram, self.evidence, self.prior, others)
                best = self.best_by_key(projection, others, old)
                current[i] = best[old.key][1]
                rival = max(best.values(), key=lambda pair: pair[0])[1]
                if rival.key != old.key and self._beats(projection, others, rival, current[i]):
                    current[i] = rival
                if current[i] is not old:
                    moved |= self._joints(old, current[i])
            near = moved
            if not moved:
                break
        return current

    def _beats(self, projection: Projection, others: Sequence[Group], rival: Group, holder: Group) -> bool:
        """Whether a rival is better on held-out runs than the holder of a name by one error.

        A holder that tuning absorbs is not swapped: held-out runs can't judge it.
        """
        if holder.effect.event or rival.effect.event:
            return False
        if holder.effect.inertia_like and self.least_seen(projection, holder):
            return False
        old, new = self.held_out.score([*others, holder]), self.held_out.score([*others, rival])
        gain, error = new.gain_over(old)
        return gain > error
