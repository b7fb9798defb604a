"""From sums to the likeliest set of effects with its variance components, from two starts.

Sets and variances are each likeliest given the other, in turn, until the log evidence rises no
more. That has several maxima: a discrepancy that is there first leaves nothing to a law, and a law
that is there first may stand for what only a discrepancy explains. One start has no discrepancies,
the other has those of the baseline alone; the greater log evidence counts, and what the other says
stays, for a name that depends on the start is less sure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ident.effects.base import SessionContext
from ident.inference.components import Components, ModelSums, revise
from ident.inference.names import Names
from ident.inference.search import SetSearch
from ident.inference.sums import SessionSums
from ident.regression.baseline import Baseline
from ident.regression.design import Group
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

    @classmethod
    def of(cls, model: ModelSums, search: SetSearch, chosen: Sequence[Group]) -> Inferred:
        """A set with its log evidence."""
        return cls(model, search, tuple(chosen), model.log_evidence(()) + search.nats(chosen))


@dataclass(frozen=True, eq=False)
class Inference:
    """What was reached from each start, the likeliest first."""

    reached: tuple[Inferred, ...]

    @property
    def best(self) -> Inferred:
        """The likeliest."""
        return self.reached[0]


def infer(evidence: Evidence, baseline: Baseline, session: SessionContext) -> Inference:
    """The likeliest sets of effects of a session.

    Args:
        evidence: Block sums with discrepancies' columns.
        baseline, session: The tuned model, and the runs.
    """
    sums, names = SessionSums(evidence), Names.of(evidence, session)
    usual = ModelSums(sums, names, baseline, Components.usual(sums))
    flexible = ModelSums(sums, names, baseline, revise(usual, (), warm=False))
    reached = [settle(usual), settle(flexible)]
    return Inference(tuple(sorted(reached, key=lambda one: -one.log_evidence)))


def settle(model: ModelSums) -> Inferred:
    """Sets and variances in turn, from a model's variances on."""
    chosen: list[Group] = []
    best: Inferred | None = None
    for _ in range(MOST_ROUNDS):
        search = SetSearch.of(model)
        chosen = search.run(chosen)
        reached = Inferred.of(model, search, chosen)
        if best is not None and reached.log_evidence < best.log_evidence + SETTLED:
            return max(best, reached, key=lambda one: one.log_evidence)
        best = reached
        components = revise(model, chosen)
        model = ModelSums(model.sums, model.names, model.baseline, components)
    assert best is not None
    return best
