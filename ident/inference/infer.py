"""From sums to likely sets of effects with their variance components, from several starts.

Sets and variances are each likeliest given the other, in turn, until the log evidence rises no
more. That has several maxima, so there are three sets:

    simplest  what explains most first, beside noise as large as what the set leaves (`simple`)
    settled   from there: sets and variances in turn, so that laws come before discrepancies
    flexible  from the discrepancies and the URDF's error of the baseline alone: laws come last

What foretells nothing on parts of the session that a fit never saw leaves the last two (`unseen`);
the simplest has room for it in its noise. The greatest log evidence counts; what stands in the
other sets stays as a candidate, and a name that depends on the start is less sure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.effects.base import SessionContext
from ident.inference.components import ModelSums
from ident.inference.names import Names
from ident.inference.revision import evidence_of, revise
from ident.inference.search import SetSearch
from ident.inference.simple import SimplestSet, explain_simply
from ident.inference.sums import SessionSums
from ident.inference.unseen import without_unforetelling
from ident.inference.variances import Components
from ident.regression.baseline import Baseline
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group, Key
from ident.regression.gram import Evidence

# Rounds of sets and variances from each start: a limit on work.
MOST_ROUNDS = 4
# Rise of the log evidence below which the rounds end [nats].
SETTLED = 1.0


@dataclass(frozen=True, eq=False)
class Inferred:
    """A set of effects and the variance components beside it, each likeliest given the other."""

    model: ModelSums
    search: SetSearch
    chosen: tuple[Group, ...]
    log_evidence: float  # of the session [nats]
    simplest: bool = False  # whether it is the simplest set that explains

    @classmethod
    def of(cls, model: ModelSums, search: SetSearch, chosen: Sequence[Group]) -> Inferred:
        """A set of effects with its log evidence.

        Args:
            model: Sums with the variance components.
            search: The sums after this model's baseline.
            chosen: The effects.
        """
        nats = model.log_evidence(()) + search.nats(chosen)
        return cls(model, search, tuple(chosen), nats)

    @classmethod
    def of_simplest(cls, simplest: SimplestSet) -> Inferred:
        """The simplest set, with the variance components of its model."""
        reached = cls.of(simplest.model, simplest.search, simplest.chosen)
        return replace(reached, simplest=True)

    def member(self, key: Key) -> Group | None:
        """The set's effect of this key (effect id and place); None if there is none."""
        return next((group for group in self.chosen if group.key == key), None)


@dataclass(frozen=True, eq=False)
class Inference:
    """What was reached from each start, the likeliest first.

    Attributes:
        reached: Sets with their variances.
        simplest: How the simplest set came about.
    """

    reached: tuple[Inferred, ...]
    simplest: SimplestSet

    @property
    def best(self) -> Inferred:
        """The likeliest of the sets that were reached."""
        return self.reached[0]

    @property
    def candidates(self) -> dict[Key, Inferred]:
        """All effects that any start leads to, by key, with the likeliest set that has each."""
        likeliest: dict[Key, Inferred] = {}
        for reached in self.reached:
            for group in reached.chosen:
                likeliest.setdefault(group.key, reached)
        return likeliest


def infer(evidence: Evidence, baseline: Baseline, session: SessionContext) -> Inference:
    """The likeliest sets of effects of a session.

    Args:
        evidence: Block sums with discrepancies' columns.
        baseline, session: The tuned model, and the runs.
    """
    sums = SessionSums(evidence)
    names = Names.of(evidence, session)
    usual = Components.usual(sums)
    steady = ModelSums(sums, names, baseline, without_spread(usual, sums))
    simplest = explain_simply(steady)
    beside = revise(simplest.model, simplest.chosen, warm=False)
    plain = ModelSums(sums, names, baseline, usual)
    alone = revise(plain, (), warm=False)
    reached = [
        Inferred.of_simplest(simplest),
        foretelling(settle(ModelSums(sums, names, baseline, beside), simplest.chosen)),
        foretelling(settle(ModelSums(sums, names, baseline, alone))),
    ]
    return Inference(tuple(sorted(reached, key=lambda start: -start.log_evidence)), simplest)


def without_spread(components: Components, sums: SessionSums) -> Components:
    """Components whose friction varies from run to run as little as it usually does."""
    usual = sums.evidence.settings.usual_spread
    steady = np.full_like(components.friction, usual)
    return replace(components, friction=steady, walk=np.zeros_like(steady))


def settle(model: ModelSums, start: Sequence[Group] = ()) -> Inferred:
    """Finds sets and variance components in turn until the log evidence grows no more.

    Args:
        model: Sums with the variance components to begin with.
        start: The set to begin with; none if empty.

    Returns:
        The set of greatest log evidence, with its components.
    """
    chosen = list(start)
    best: Inferred | None = None
    for _ in range(MOST_ROUNDS):
        search = SetSearch.of(model)
        chosen = search.run(chosen)
        reached = Inferred.of(model, search, chosen)
        if best is not None and reached.log_evidence < best.log_evidence + SETTLED:
            return max(best, reached, key=lambda candidate: candidate.log_evidence)
        best = reached
        components = revise(model, chosen)
        model = ModelSums(model.sums, model.names, model.baseline, components)
    assert best is not None
    return best


def foretelling(reached: Inferred) -> Inferred:
    """A set without what foretells nothing on parts that a fit never saw.

    Variances become those that are likeliest beside what stays; and beside them each effect that
    stays is at its best point once more, or gives way to what is better in its place: one that
    shared its torque with an effect that left may be another law's now.
    """
    prior = reached.model.prior()
    scorer = HeldOut(evidence_of(reached.model), prior, expected=reached.chosen)
    chosen = without_unforetelling(scorer, reached.chosen)
    if len(chosen) == len(reached.chosen):
        return reached
    before = reached.model
    model = ModelSums(before.sums, before.names, before.baseline, revise(before, chosen))
    search = SetSearch.of(model)
    return Inferred.of(model, search, search.settled(chosen))
