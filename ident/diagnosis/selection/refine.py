"""Parameters between the points of the grid: the named effects once more, each on a finer grid around what was found.

The search needs every effect at every joint and so can afford a few points of each inner grid. Once the names are known
a second pass over the recordings asks only for them, at many points, with the noise that the first pass found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.diagnosis.selection.search import Search
from ident.effects.base import SessionContext
from ident.regression.baseline import Baseline
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group, Key, layout_of
from ident.regression.dwells import HeldFriction
from ident.regression.gram import Evidence, gather
from ident.regression.least_squares import Prior, project


@dataclass(frozen=True, eq=False)
class Refined:
    """The named effects at their best points of the finer grid, and the sums that hold this grid alone."""

    search: Search
    groups: tuple[Group, ...]


def refine(search: Search, session: SessionContext, baseline: Baseline, groups: Sequence[Group]) -> Refined:
    """Second pass for named effects.

    Args:
        search: Of the first pass; it keeps the sums of the second, should the same names come again.
        session: The runs.
        baseline: The tuned model.
        groups: The named effects at their points of the coarse grid.
    """

    def gathered() -> Evidence:
        points = [group.effect.refined(session, group.joint, group.variant) for group in groups]
        grids = [(group.effect, group.joint, tuple(finer)) for group, finer in zip(groups, points, strict=True)]
        layout = layout_of(session, baseline.base.rank, grids, beside=(HeldFriction(),))
        return gather(session, baseline, layout, search.evidence.whitening, rest=True).with_dwells()

    evidence = search.finer.of(groups, gathered).with_run_spread(search.evidence.spread)
    evidence = evidence.with_dispersion(search.evidence.dispersion)
    prior = Prior.believing(evidence, baseline, search.prior.error)
    fine = Search(evidence, prior, HeldOut(evidence, prior), search.seed, settings=search.settings)
    points: dict[Key, list[Group]] = {}
    for one in evidence.layout.groups:
        points.setdefault(one.key, []).append(one)
    middle = {group.key: points[group.key][len(points[group.key]) // 2] for group in groups}
    return Refined(fine, _best(fine, middle, list(middle)))


def find_needless(fine: Refined) -> int | None:
    """The number of a name for which the others' laws leave nothing once they lie between points of their grids.

    A point near a law's true parameters leaves a little of it, of the law's own shape: that must get no name of its
    own.

    Args:
        fine: The names on their finer grids.

    Returns:
        Of the names for which nothing speaks any more, the one of least evidence; None where there is none.
    """
    search, groups = fine.search, fine.groups
    if len(groups) < 2:
        return None
    n, gram = search.evidence.layout.n, search.evidence.gram()
    left = []
    for group in groups:
        others = {other.key: other for other in groups if other is not group}
        near = [key for key, other in others.items() if set(group.acts_on(n)) & set(other.acts_on(n))]
        left.append(search.score_beside(gram, group, _best(search, others, near)))
    weakest = int(np.argmin(left))
    return weakest if left[weakest] <= 0.0 else None


def _best(fine: Search, start: Mapping[Key, Group], keys: Sequence[Key]) -> tuple[Group, ...]:
    """Effects at their best points beside each other.

    Args:
        fine: Sums of their finer grids.
        start: The effects at the points to begin with, by their keys.
        keys: Those that may move.
    """
    gram, best = fine.evidence.gram(), dict(start)
    mates = {key: [group for group in fine.evidence.layout.groups if group.key == key] for key in keys}
    for _ in range(fine.settings.refine_rounds):
        before = dict(best)
        for key in keys:
            others = [best[other] for other in start if other != key]
            projection = project(gram, fine.evidence, fine.prior, others)
            best[key] = mates[key][int(np.argmax([fine.gain_of(projection, group)[0] for group in mates[key]]))]
        if best == before:
            break
    return tuple(best.values())
