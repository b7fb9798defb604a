"""From sums to likely sets of effects with their variance components, from four starts.

Sets and variances are each likeliest given the other, in turn, until the log evidence rises no
more. That has several maxima, so it starts in two ways, and in two more with the variances held:

    plain     no discrepancies yet, so that laws come first
    flexible  the discrepancies and the URDF's error of the baseline alone, so that laws come last
    trusting  the same, but a URDF as sure as URDFs usually are: where all its numbers may be off
              by half, a body that is not in it shows nowhere
    steady    the same, but friction as steady as it usually is, and no discrepancy that is a
              function of time: where friction may have any level at any time, a law of its drift
              shows nowhere

What foretells nothing on parts of the session that a fit never saw leaves each set (`unseen`). The
greatest log evidence counts; what stands in the other sets stays as a candidate, and a name that
depends on the start is less sure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.effects.base import SessionContext
from ident.inference.components import Components, ModelSums, revise
from ident.inference.names import Names
from ident.inference.search import SetSearch
from ident.inference.sums import SessionSums
from ident.inference.unseen import without_unforetelling
from ident.regression.baseline import Baseline, UrdfError
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group, Key
from ident.regression.discrepancy import BLOCKS
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
    held: bool = False  # whether its variances were held, not made likeliest beside the set

    @classmethod
    def of(
        cls, model: ModelSums, search: SetSearch, chosen: Sequence[Group], held: bool = False
    ) -> Inferred:
        """A set with its log evidence."""
        nats = model.log_evidence(()) + search.nats(chosen)
        return cls(model, search, tuple(chosen), nats, held)

    def member(self, key: Key) -> Group | None:
        """The set's effect of this key; None if there is none."""
        return next((group for group in self.chosen if group.key == key), None)


@dataclass(frozen=True, eq=False)
class Inference:
    """What was reached from each start, the likeliest first."""

    reached: tuple[Inferred, ...]

    @property
    def best(self) -> Inferred:
        """The likeliest."""
        return self.reached[0]

    @property
    def candidates(self) -> dict[Key, Inferred]:
        """All effects that any start leads to, with the likeliest set that has each."""
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
    sums, names = SessionSums(evidence), Names.of(evidence, session)
    plain = ModelSums(sums, names, baseline, Components.usual(sums))
    flexible = ModelSums(sums, names, baseline, revise(plain, (), warm=False))
    steady = ModelSums(sums, names, baseline, steady_friction(flexible))
    reached = [
        foretelling(settle(plain)),
        foretelling(settle(flexible)),
        foretelling(find_held(trusting_urdf(flexible))),
        foretelling(find_held(steady)),
    ]
    return Inference(tuple(sorted(reached, key=lambda one: -one.log_evidence)))


def trusting_urdf(model: ModelSums) -> ModelSums:
    """A model with a URDF that is as sure as URDFs usually are."""
    return model.with_urdf(UrdfError())


def steady_friction(model: ModelSums) -> Components:
    """A model's components with friction that varies as little as it usually does, and no drift."""
    components = model.components
    usual = model.sums.evidence.settings.usual_spread
    discrepancy = components.discrepancy.copy()
    discrepancy[:, BLOCKS.index("time")] = 0.0
    friction = np.minimum(components.friction, usual)
    return replace(components, friction=friction, discrepancy=discrepancy)


def find_held(model: ModelSums) -> Inferred:
    """The set that is likeliest with a model's variances held as they are."""
    search = SetSearch.of(model)
    return Inferred.of(model, search, search.run(), held=True)


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


def foretelling(reached: Inferred) -> Inferred:
    """A set without what foretells nothing on parts that a fit never saw.

    Variances that are not held become those that are likeliest beside what stays.
    """
    prior = reached.model.prior()
    scorer = HeldOut(evidence_of(reached.model), prior, expected=reached.chosen)
    chosen = without_unforetelling(scorer, reached.chosen)
    if len(chosen) == len(reached.chosen):
        return reached
    if reached.held:
        return Inferred.of(reached.model, reached.search, chosen, held=True)
    before = reached.model
    model = ModelSums(before.sums, before.names, before.baseline, revise(before, chosen))
    return Inferred.of(model, SetSearch.of(model), chosen)


def evidence_of(model: ModelSums) -> Evidence:
    """A model's sums with its friction spread and dispersion."""
    components = model.components
    spread = model.sums.evidence.with_run_spread(components.friction)
    return spread.with_dispersion(components.dispersion)
