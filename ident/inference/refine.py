"""Grid refinement: a second pass over the recordings with fine grids of the chosen effects alone.

The first pass has columns of every effect at every joint, so its grids are coarse. This one has
many points of few effects, with the noise and the variance components of the first; each effect in
turn takes its likeliest point beside the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ident.effects import optional
from ident.effects.base import SessionContext
from ident.inference.components import ModelSums
from ident.inference.infer import Inference, Inferred
from ident.inference.names import Names
from ident.inference.search import SetSearch, rest_of
from ident.inference.sums import SessionSums
from ident.regression.baseline import Baseline
from ident.regression.design import Group, layout_of
from ident.regression.discrepancy import KINDS
from ident.regression.dwells import HeldFriction
from ident.regression.gather import gather

# Rounds over the fine grids of all effects: a limit on work; two are mostly enough.
REFINE_ROUNDS = 3


def refine(inference: Inference, session: SessionContext, baseline: Baseline) -> Inference:
    """The sets of all starts at their likeliest points of fine grids, in the order of the starts.

    An effect has one fine grid, about its point in the likeliest set that has it.

    Args:
        inference: The sets on coarse grids, with their variance components.
        session, baseline: The runs, and the tuned model.
    """
    grids = []
    for key, reached in inference.candidates.items():
        group = reached.member(key)
        assert group is not None
        points = optional.refined(group.effect, session, group.joint, group.variant)
        grids.append((group.effect, group.joint, tuple(points)))
    rank = baseline.base.rank
    layout = layout_of(session, rank, grids, beside=(HeldFriction(),), flexible=KINDS)
    whitening = inference.best.model.sums.evidence.whitening
    gathered = gather(session, baseline, layout, whitening, rest=True)
    evidence = gathered.with_dwells()
    sums = SessionSums(evidence)
    names = Names.of(evidence, session)
    on_fine_grids = tuple(_refined(coarse, sums, names) for coarse in inference.reached)
    return Inference(on_fine_grids, inference.simplest)


def _refined(coarse: Inferred, sums: SessionSums, names: Names) -> Inferred:
    """One start's set on fine grids, with its variance components."""
    model = ModelSums(sums, names, coarse.model.baseline, coarse.model.components)
    search = SetSearch.of(model)
    chosen = _ascend(search, [_middle(names.groups, group) for group in coarse.chosen])
    # Beside fine grids an effect that stood for another's coarse point adds nothing any more.
    chosen = search.without_idle(chosen)
    reached = Inferred.of(model, search, _ascend(search, chosen))
    return replace(reached, simplest=coarse.simplest)


def _middle(points: Sequence[Group], group: Group) -> Group:
    """The middle of a name's fine grid, about which the coarse point lies."""
    of_name = [point for point in points if point.key == group.key]
    return of_name[len(of_name) // 2]


def _ascend(search: SetSearch, chosen: list[Group]) -> list[Group]:
    """Each effect of a set at its likeliest point beside the others, until none moves."""
    for _ in range(REFINE_ROUNDS):
        before = list(chosen)
        for k, group in enumerate(before):
            others = rest_of(chosen, chosen[k])
            better = search.best(others, {group.key})
            if better is not None:
                chosen[k] = better[1]
        if chosen == before:
            break
    return chosen
