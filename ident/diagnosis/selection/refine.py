"""Figures between the points of the grid: the named effects once more, each on a finer grid around what was found.

The search needs every effect at every joint and so can afford a few points of each inner grid. Once the names are known
a second pass over the recordings asks only for them, at many points, with the noise that the first pass found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.diagnosis.regression.baseline import Baseline
from ident.diagnosis.regression.cross_validation import HeldOut
from ident.diagnosis.regression.design import Group, layout_of
from ident.diagnosis.regression.dwells import HeldFriction
from ident.diagnosis.regression.gram import Evidence, gather
from ident.diagnosis.regression.least_squares import Prior, project
from ident.diagnosis.selection.search import Search
from ident.effects.base import SessionContext, Variant


@dataclass(frozen=True, eq=False)
class Refined:
    """The named effects at their best points of the finer grid, and the sums that hold this grid alone."""

    search: Search
    groups: tuple[Group, ...]


def refine(search: Search, session: SessionContext, baseline: Baseline, groups: Sequence[Group]) -> Refined:
    """Second pass for named effects.

    Args:
        search: Of the first pass; it keeps the sums of the second, should the same names be asked for again.
        session: The runs.
        baseline: The tuned model.
        groups: The named effects at their points of the coarse grid.
    """

    def gathered() -> Evidence:
        grids = [(group.effect, group.joint, _finer(session, group)) for group in groups]
        layout = layout_of(session, baseline.base.rank, grids, beside=(HeldFriction(),))
        return gather(session, baseline, layout, search.evidence.whitening, rest=True).with_dwells()

    evidence = search.finer.of(groups, gathered).with_run_spread(search.evidence.spread)
    evidence = evidence.with_dispersion(search.evidence.dispersion)
    prior = Prior.believing(evidence, baseline, search.prior.error)
    fine = Search(evidence, prior, HeldOut(evidence, prior), search.seed, settings=search.settings)
    return Refined(fine, _best(fine, [group.key for group in groups]))


def find_needless(fine: Refined) -> int | None:
    """The number of a name for which the others' laws leave nothing once they are told between points of their grids.

    A point near a law's true figures leaves a little of it, of the law's own shape: that must get no name of its own.

    Args:
        fine: The names on their finer grids.

    Returns:
        Of the names for which nothing speaks any more, the one of least evidence; None where there is none.
    """
    search, keys = fine.search, [group.key for group in fine.groups]
    if len(keys) < 2:
        return None
    gram = search.evidence.gram()
    left = [
        search.score_beside(gram, group, _best(search, [key for key in keys if key != group.key]))
        for group in fine.groups
    ]
    weakest = int(np.argmin(left))
    return weakest if left[weakest] <= 0.0 else None


def _finer(session: SessionContext, group: Group) -> tuple[Variant, ...]:
    """A finer grid around a named effect's point of the coarse one."""
    return tuple(group.effect.refined(group.effect.asked(session), group.joint, group.variant))


def _best(fine: Search, keys: Sequence[tuple[str, int, int | None]]) -> tuple[Group, ...]:
    """Each effect's best point beside the others' best points."""
    gram = fine.evidence.gram()
    mates = {key: [group for group in fine.evidence.layout.groups if group.key == key] for key in keys}
    best = {key: mates[key][len(mates[key]) // 2] for key in keys}
    for _ in range(fine.settings.refine_rounds):
        before = dict(best)
        for key in keys:
            others = [best[other] for other in keys if other != key]
            projection = project(gram, fine.evidence, fine.prior, others)
            first = mates[key][int(np.argmax([fine.gain_of(projection, group)[0] for group in mates[key]]))]
            best[key] = fine.steadier(projection, others, first)
        if best == before:
            break
    return tuple(best[key] for key in keys)
