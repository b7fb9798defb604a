"""Grid refinement of accepted effects: a second pass over the recordings with fine grids around their grid points.

The search needs columns of every effect at every joint, so its grids are coarse. This pass has columns of the accepted
effects alone, at many points, with the noise model of the first pass; each effect in turn takes the point of greatest
likelihood beside the others (coordinate ascent).
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
    """The accepted effects at their best points of the fine grids."""

    search: Search  # over the sums of the fine grids alone
    groups: tuple[Group, ...]  # the effects at their best points


def refine(search: Search, session: SessionContext, baseline: Baseline, groups: Sequence[Group]) -> Refined:
    """Finds the accepted effects' best points on fine grids.

    Args:
        search, groups: Search on the coarse grids, which caches the fine ones' sums, and the effects at coarse points.
        session, baseline: The runs, and the tuned model.
    """

    def gather_fine_sums() -> Evidence:
        points = [group.effect.refined(session, group.joint, group.variant) for group in groups]
        grids = [(group.effect, group.joint, tuple(finer)) for group, finer in zip(groups, points, strict=True)]
        layout = layout_of(session, baseline.base.rank, grids, beside=(HeldFriction(),))
        return gather(session, baseline, layout, search.evidence.whitening, rest=True).with_dwells()

    evidence = search.fine_grid_sums.of(groups, gather_fine_sums).with_run_spread(search.evidence.spread)
    evidence = evidence.with_dispersion(search.evidence.dispersion)
    prior = Prior.believing(evidence, baseline, search.prior.error)
    fine = Search(evidence, prior, HeldOut(evidence, prior), search.seed, settings=search.settings)
    grid_points: dict[Key, list[Group]] = {}
    for one in evidence.layout.groups:
        grid_points.setdefault(one.key, []).append(one)
    middle = {group.key: grid_points[group.key][len(grid_points[group.key]) // 2] for group in groups}
    return Refined(fine, _best(fine, middle, list(middle)))


def find_redundant(fine: Refined) -> int | None:
    """Index of an effect that adds no log evidence once the others lie on their fine grids, the weakest one, or None.

    A coarse grid point near a law's true parameters leaves a small residual of the law's own shape, which another
    effect then explains.
    """
    search, groups = fine.search, fine.groups
    if len(groups) < 2:
        return None
    n, gram = search.evidence.layout.n, search.evidence.gram()
    left = []
    for group in groups:
        others = {other.key: other for other in groups if other is not group}
        near = [key for key, other in others.items() if set(group.acts_on(n)) & set(other.acts_on(n))]
        left.append(search.log_evidence_beside(gram, group, _best(search, others, near)))
    weakest = int(np.argmin(left))
    return weakest if left[weakest] <= 0.0 else None


def _best(fine: Search, start: Mapping[Key, Group], keys: Sequence[Key]) -> tuple[Group, ...]:
    """Coordinate ascent over fine grids, from the points `start`, of the effects whose keys are given."""
    gram, best = fine.evidence.gram(), dict(start)
    points = {key: [group for group in fine.evidence.layout.groups if group.key == key] for key in keys}
    for _ in range(fine.settings.refine_rounds):
        before = dict(best)
        for key in keys:
            others = [best[other] for other in start if other != key]
            projection = project(gram, fine.evidence, fine.prior, others)
            best[key] = points[key][int(np.argmax([fine.gain_of(projection, group)[0] for group in points[key]]))]
        if best == before:
            break
    return tuple(best.values())
