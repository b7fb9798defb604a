"""Is a name's size the same in all runs? A constant of the arm is; what stands in for something else often is not.

With x the torque of a name at its estimate, seen after the model beside it, and e what the whole model leaves, the size
in a fold f, as a share of the whole, is s_f = 1 + Σ_f x e / Σ_f x x, known to its own variance v_f = k_f / Σ_f x x.
k_f is how much more than noise the scores of its blocks vary: its own, drawn towards that of the middle fold, for it
has few blocks. Cochran's Q asks whether the s_f agree within their own errors; τ² of DerSimonian and Laird is by how
much they truly differ. A run that hardly moves says next to nothing, and weighs as little. Sizes are reported as the
random-effects model has them: each drawn to the mean as far as its own error lets it.

Source: Cochran 1954; DerSimonian and Laird 1986, both on combining experiments; Morris 1983 (drawing to the mean).
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

# A fold in which less than this share of the name's torque is seen has no say: its size there is anything.
LEAST_SEEN = 1e-6
# Blocks that the middle fold counts as in each fold's own variation (chosen: about as many as a fold has).
SHARED_BLOCKS = 8.0


@dataclass(frozen=True)
class Agreement:
    """By how much a name's size differs between runs."""

    spread: float  # standard deviation of the size beyond chance, as a share of the size
    p_value: float  # chance that a size which is the same everywhere would seem to differ so much
    least: float  # smallest and largest size, drawn to the mean by their errors, as a share
    most: float


def measure_agreement(search: Search, groups: Sequence[Group], slot: int, absorbed: bool = False) -> Agreement:
    """How well the folds of a session agree on the size of one of several names.

    Args:
        search: The session's sums and the belief about the URDF.
        groups: The names.
        slot: which of them is tested.
        absorbed: Whether tuned inertias hide it: then it is seen against the URDF fixed, as it was judged.
    """
    along, power = _scores(search, search.fixed.prior if absorbed else search.prior, groups, slot)
    folds = search.evidence.fold_of_block
    parts = [folds == fold for fold in np.unique(folds)]
    least = LEAST_SEEN * float(power.sum())
    parts = [part for part in parts if power[part].sum() > least]
    if len(parts) < 2:
        return Agreement(0.0, 1.0, 1.0, 1.0)
    seen = np.array([power[part].sum() for part in parts])
    size = np.array([along[part].sum() for part in parts]) / seen
    blocks = np.array([len(along[part]) for part in parts])
    # A fold's squared scores, what its own mean took away given back; those of noise where it has one block.
    square = [float(np.sum((along[p] - s * power[p]) ** 2)) for p, s in zip(parts, size, strict=True)]
    noise = [float(power[part].sum()) for part in parts]
    own = np.where(blocks < 2, noise, square * blocks / np.maximum(blocks - 1, 1))
    return compare_sizes(size, seen, own, blocks)


def compare_sizes(
    size: Float[Array, " f"], seen: Float[Array, " f"], scores: Float[Array, " f"], blocks: Float[Array, " f"]
) -> Agreement:
    """How well some folds' sizes agree, each known to its own error.

    Args:
        size: Of each fold, less that of the whole, as a share of it.
        seen: Information of the noise model about each.
        scores: Sum of the squared scores of each fold's blocks: `seen` where blocks vary as the noise model says.
        blocks: Number of its blocks.
    """
    shared = float(np.median(scores / seen))
    own = (blocks * scores / seen + SHARED_BLOCKS * shared) / (blocks + SHARED_BLOCKS)
    weight = seen / np.maximum(own, 1.0)
    mean = float(weight @ size / weight.sum())
    q, freedom = float(weight @ (size - mean) ** 2), len(size) - 1
    between = max(q - freedom, 0.0) / float(weight.sum() - np.sum(weight**2) / weight.sum())
    drawn = 1.0 + mean + (size - mean) * between / (between + 1.0 / weight)
    return Agreement(float(np.sqrt(between)), float(chdtrc(freedom, q)), float(drawn.min()), float(drawn.max()))


def _scores(
    search: Search, prior: Prior, groups: Sequence[Group], slot: int
) -> tuple[Float[Array, " B"], Float[Array, " B"]]:
    """For each block Σ x e and Σ x x of a name."""
    evidence, gram = search.evidence, search.evidence.gram()
    whole = project(gram, evidence, prior, groups)
    beside = project(gram, evidence, prior, [other for k, other in enumerate(groups) if k != slot])
    columns = groups[slot].columns
    torque = beside.left_of(columns) @ whole.estimate[whole.places(columns)]
    along, power = np.zeros((2, len(evidence.fold_of_block)))
    for j, local in enumerate(evidence.layout.local):
        seen = evidence.times(j, torque[local])
        along += seen @ whole.weights[local]
        power += seen @ torque[local]
    return along, np.maximum(power, 0.0)
