"""A plain method on the same evidence: forward selection by BIC, which takes samples for independent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.gram import Evidence
from ident.diagnosis.regression.least_squares import Prior, project

Name = tuple[str, str]
"""Effect and joint; the joint is empty for an effect of the whole arm."""
MOST_NAMES = 3


def name_by_rivals(evidence: Evidence, prior: Prior, joints: Sequence[str]) -> dict[str, list[Name]]:
    """What the plain method names, the first the most."""
    gram = plain_gram(evidence)
    samples = float(sum(evidence.weights.sum(axis=0)))
    chosen = forward_by_bic(gram, evidence, prior, samples)
    names = [(one.effect.id, joints[one.joint] if one.effect.scope == "joint" else "") for one in chosen]
    return {"bic_forward": names}


def plain_gram(evidence: Evidence) -> Float[Array, "P P"]:
    """Sums of all joints without whitening, each joint in units of its noise."""
    total = np.zeros((evidence.layout.size + 1, evidence.layout.size + 1))
    for local, sums, level in zip(evidence.layout.local, evidence.plain, evidence.whitening.level, strict=True):
        total[np.ix_(local, local)] += sums.over() / max(float(level), 1e-9) ** 2
    return total


def forward_by_bic(gram: Float[Array, "P P"], evidence: Evidence, prior: Prior, samples: float) -> list[Group]:
    """The candidate that lowers BIC most, again and again, until none lowers it."""
    chosen: list[Group] = []
    while len(chosen) < MOST_NAMES:
        projection = project(gram, evidence, prior, chosen)
        variance = max(projection.misfit / samples, 1e-12)
        taken = {group.key for group in chosen}
        best, best_fall = None, 0.0
        for group in evidence.layout.groups:
            if group.key in taken:
                continue
            fall = projection.gain(group)[0] / variance - len(group.columns) * np.log(samples)
            if fall > best_fall:
                best, best_fall = group, fall
        if best is None:
            break
        chosen.append(best)
    return chosen
