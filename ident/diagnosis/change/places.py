"""Where else a change may sit: places at which it explains these recordings as well, by Vuong's test.

A body on one link and one on the next pull alike at every joint below them; what tells them apart is what they do at
the joint between, and their inertia. Two models of as many columns, neither part of the other, are compared by what
each leaves of every block, d their difference: Σ d / (√B std d) is a standard normal if both are as far from the truth,
whatever the truth and however far. Log evidence takes the model's own errors for noise: of small differences it is too
sure.

Source: Vuong 1989 (likelihood ratio tests for model selection and non-nested hypotheses).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.change.readings import BODIES
from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.gram import Evidence
from ident.diagnosis.regression.least_squares import Projection, project
from ident.diagnosis.regression.run_spread import residual_weights
from ident.diagnosis.selection.search import Search

# Two places are told apart by more than so many standard deviations.
APART = 2.0


def open_places(search: Search, groups: Sequence[Group], slot: int) -> tuple[Group, ...]:
    """Places at which a change explains as much, nearest first: the same effect elsewhere, for bodies any body.

    Args:
        search: The search that gave the names.
        groups: All names.
        slot: Which of them is asked about.
    """
    own, evidence, gram = groups[slot], search.evidence, search.evidence.gram()
    others = [group for k, group in enumerate(groups) if k != slot]
    beside = project(gram, evidence, search.prior, others)
    best = search.best_by_key(beside, others)
    left = squares_by_block(evidence, project(gram, evidence, search.prior, groups))
    found = []
    for score, rival in best.values():
        if rival.key == own.key or score <= 0.0 or not _alike(own, rival):
            continue
        there = squares_by_block(evidence, project(gram, evidence, search.prior, [*others, rival]))
        if not told_apart(there - left):
            found.append((score, rival))
    return tuple(rival for _, rival in sorted(found, key=lambda pair: -pair[0]))


def squares_by_block(evidence: Evidence, model: Projection) -> Float[Array, " B"]:
    """What a model leaves of each block, in squares of the noise."""
    weights = residual_weights(evidence, model)
    left = np.zeros(len(evidence.fold_of_block))
    for j, local in enumerate(evidence.layout.local):
        left += evidence.times(j, weights[local]) @ weights[local]
    return left


def told_apart(difference: Float[Array, " B"]) -> bool:
    """Whether one model leaves more than another beyond what blocks differ by."""
    blocks = len(difference)
    return bool(difference.sum() > APART * np.sqrt(blocks) * difference.std(ddof=1))


def _alike(own: Group, rival: Group) -> bool:
    bodies = own.effect.id in BODIES and rival.effect.id in BODIES
    return bodies or (rival.effect.id == own.effect.id and rival.joint != own.joint)
