"""Plain ways to name an effect, on the same evidence: what the diagnosis is compared with.

All of them take the samples for independent, as such methods do: forward selection by BIC, the lasso with its penalty
chosen by BIC, and the largest correlation with what the tuned baseline leaves.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from scipy.stats import norm
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import lars_path_gram

from ident.arrays import Array, Float
from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.gram import Evidence
from ident.diagnosis.regression.least_squares import Prior, Projection, project

Name = tuple[str, str]
"""Effect and joint; the joint is empty for an effect of the whole arm."""
MOST_NAMES = 3
LASSO_STEPS = 40


def name_by_rivals(evidence: Evidence, prior: Prior, joints: Sequence[str]) -> dict[str, list[Name]]:
    """What each plain method names, the first the most."""
    gram = plain_gram(evidence)
    projection = project(gram, evidence, prior)
    samples = float(sum(evidence.weights.sum(axis=0)))
    found = {
        "bic_forward": forward_by_bic(gram, evidence, prior, samples),
        "lasso": lasso(projection, [group for group in evidence.layout.groups if not group.borrows], samples),
        "correlation": largest_correlation(projection, evidence.layout.groups, samples),
    }
    return {method: [_name(group, joints) for group in groups] for method, groups in found.items()}


def _name(group: Group, joints: Sequence[str]) -> Name:
    return group.effect.id, joints[group.joint] if group.effect.scope == "joint" else ""


def plain_gram(evidence: Evidence) -> Float[Array, "P P"]:
    """Sums of all joints without whitening, each joint in units of its noise."""
    total = np.zeros((evidence.layout.size + 1, evidence.layout.size + 1))
    for local, sums, level in zip(evidence.layout.local, evidence.plain, evidence.whitening.level, strict=True):
        total[np.ix_(local, local)] += sums.sum(axis=0) / max(float(level), 1e-9) ** 2
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


def lasso(projection: Projection, groups: Sequence[Group], samples: float) -> list[Group]:
    """Names of the columns that the lasso keeps, the largest standardised coefficients first."""
    columns = _visible(projection, groups)
    if len(columns) == 0:
        return []
    size = np.sqrt(np.diag(projection.rest)[columns])
    matrix = projection.rest[np.ix_(columns, columns)] / np.outer(size, size)
    target = projection.rest[columns, -1] / size
    with warnings.catch_warnings():  # neighbours on a grid are nearly the same column: it drops one, as it should
        warnings.simplefilter("ignore", ConvergenceWarning)
        _, _, path = lars_path_gram(
            target, matrix, n_samples=int(samples), method="lasso", max_iter=LASSO_STEPS, alpha_min=0.0
        )
    square = projection.misfit - 2.0 * target @ path + np.einsum("ik,ij,jk->k", path, matrix, path)
    freedom = (path != 0.0).sum(axis=0)
    bic = samples * np.log(np.maximum(square, 1e-12) / samples) + freedom * np.log(samples)
    weight = dict(zip(map(int, columns), np.abs(path[:, int(np.argmin(bic))]), strict=True))
    strength: dict[tuple[str, int, int | None], tuple[float, Group]] = {}
    for group in groups:
        own = sum(weight.get(int(c), 0.0) for c in group.columns)
        strength[group.key] = (strength.get(group.key, (0.0, group))[0] + own, group)
    ranked = sorted((pair for pair in strength.values() if pair[0] > 0.0), key=lambda pair: -pair[0])
    return [group for _, group in ranked[:MOST_NAMES]]


def largest_correlation(projection: Projection, groups: Sequence[Group], samples: float) -> list[Group]:
    """The effect of the one column that correlates most, if that is significant with independent samples."""
    columns = _visible(projection, groups)
    if len(columns) == 0:
        return []
    power = np.diag(projection.rest)[columns] * projection.misfit
    correlation = np.abs(projection.rest[columns, -1]) / np.sqrt(np.maximum(power, 1e-300))
    top = int(np.argmax(correlation))
    if correlation[top] * np.sqrt(samples) < norm.isf(0.025 / len(columns)):
        return []
    return [next(group for group in groups if columns[top] in group.columns)]


def _visible(projection: Projection, groups: Sequence[Group]) -> Array:
    """Candidate columns that the baseline does not absorb."""
    columns = np.concatenate([group.columns for group in groups]) if groups else np.zeros(0, dtype=int)
    there = np.diag(projection.total)[columns] > 0.0
    return columns[there & (projection.visibility(columns) > projection.settings.least_visible)]
