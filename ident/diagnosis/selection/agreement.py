"""Heterogeneity test: whether an effect's size is the same in all folds, as a constant of the arm is (Cochran's Q).

With x the torque of the effect at its estimate, after the other effects, and e the residual of the whole model, its
relative size in fold f and the variance of that are

    s_f = 1 + Σ_f x e / Σ_f x x,    v_f = k_f / Σ_f x x.

k_f is the variance inflation of the fold's block scores, shrunk towards that of the median fold, for a fold has few
blocks. Of an effect that is estimated with the URDF's inertias fixed, the error of these, δ ~ N(0, P⁻¹), makes the
sizes differ as well: their covariance is V = diag(v) + G P⁻¹ Gᵀ with G_f = Σ_f x Y / Σ_f x x. Q tests whether the s_f
agree within their errors; τ² of DerSimonian and Laird is the variance between folds. Folds with little motion have
little weight. Reported sizes are shrunk towards the mean by the random-effects model.

Source: Cochran 1954; DerSimonian and Laird 1986 (combining experiments); Morris 1983 (shrinkage).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from ident.arrays import Array, Float
from ident.diagnosis.selection.search import Search
from ident.regression.design import Group
from ident.regression.least_squares import Prior, project

# A fold with less than this share of the effect's power does not determine its size and is left out.
LEAST_SEEN = 1e-6
# Weight, in blocks, of the median fold's variance inflation in that of each fold (chosen: about as many as a fold has).
SHARED_BLOCKS = 8.0


@dataclass(frozen=True)
class Agreement:
    """Heterogeneity of an effect's size between folds."""

    between_fold_std: float  # standard deviation between folds beyond estimation error, as a share of the size
    p_value: float  # of Cochran's Q, if the size is the same in all folds
    smallest: float  # smallest size of a fold, shrunk towards the mean, as a share
    largest: float  # largest size of a fold, shrunk towards the mean, as a share


def measure_agreement(search: Search, groups: Sequence[Group], slot: int, absorbed: bool = False) -> Agreement:
    """Tests whether the folds of a session agree on the size of one of several effects.

    Args:
        search, groups, slot: The search, all effects, and the index of the effect that is tested.
        absorbed: Whether tuned inertias absorb it, so that it is estimated with the URDF's inertias fixed.
    """
    along, power, reach = _scores(search, search.fixed.prior if absorbed else search.prior, groups, slot)
    folds = search.evidence.fold_of_block
    parts = [folds == fold for fold in np.unique(folds)]
    least = LEAST_SEEN * float(power.sum())
    parts = [part for part in parts if power[part].sum() > least]
    if len(parts) < 2:
        return Agreement(0.0, 1.0, 1.0, 1.0)
    information = np.array([power[part].sum() for part in parts])
    size = np.array([along[part].sum() for part in parts]) / information
    blocks = np.array([len(along[part]) for part in parts])
    # Squared scores about the fold's own mean, corrected for its degree of freedom; the noise's where it has one block.
    squares = [float(np.sum((along[p] - s * power[p]) ** 2)) for p, s in zip(parts, size, strict=True)]
    noise = [float(power[part].sum()) for part in parts]
    scores_squared = np.where(blocks < 2, noise, squares * blocks / np.maximum(blocks - 1, 1))
    shared = None
    if absorbed:
        felt = np.array([reach[part].sum(axis=0) for part in parts]) / information[:, None]
        shared = felt @ np.linalg.solve(search.prior.base, felt.T)
    return compare_sizes(size, information, scores_squared, blocks, shared)


def compare_sizes(
    size: Float[Array, " f"],
    information: Float[Array, " f"],
    scores: Float[Array, " f"],
    blocks: Float[Array, " f"],
    shared: Float[Array, "f f"] | None = None,
) -> Agreement:
    """Tests whether some folds' sizes agree, each known to its own error.

    Args:
        size: Size in each fold less that of the whole, as a share of it.
        information: Information about each by the noise model.
        scores: Sum of the squared scores of each fold's blocks; equal to `information` where the noise model holds.
        blocks: Number of blocks of each fold.
        shared: Covariance of the sizes by an error that all folds have in common; none if None.
    """
    usual = float(np.median(scores / information))
    inflation = (blocks * scores / information + SHARED_BLOCKS * usual) / (blocks + SHARED_BLOCKS)
    own = np.maximum(inflation, 1.0) / information
    covariance = np.diag(own) + (0.0 if shared is None else shared)
    weight = np.linalg.inv(covariance)
    apart, freedom = size - float(weight.sum(axis=0) @ size / weight.sum()), len(size) - 1
    q = float(apart @ weight @ apart)
    between = max(q - freedom, 0.0) / float(np.trace(weight) - np.sum(weight @ weight) / weight.sum())
    mean = float(np.average(size, weights=1.0 / own))
    shrunk = 1.0 + mean + between * np.linalg.solve(covariance + between * np.eye(len(size)), size - mean)
    return Agreement(float(np.sqrt(between)), float(chdtrc(freedom, q)), float(shrunk.min()), float(shrunk.max()))


def _scores(
    search: Search, prior: Prior, groups: Sequence[Group], slot: int
) -> tuple[Float[Array, " B"], Float[Array, " B"], Float[Array, "B r"]]:
    """For each block Σ x e and Σ x x of one effect, and Σ x Y of the base parameters."""
    evidence, gram = search.evidence, search.evidence.gram()
    whole = project(gram, evidence, prior, groups)
    beside = project(gram, evidence, prior, [other for k, other in enumerate(groups) if k != slot])
    columns = groups[slot].columns
    torque = beside.left_of(columns) @ whole.estimate[whole.places(columns)]
    along, power = np.zeros((2, len(evidence.fold_of_block)))
    reach = np.zeros((len(evidence.fold_of_block), evidence.layout.rank))
    for j, local in enumerate(evidence.layout.local):
        product = evidence.times(j, torque[local])
        along += product @ whole.weights[local]
        power += product @ torque[local]
        reach += product[:, : evidence.layout.rank]
    return along, np.maximum(power, 0.0), reach
