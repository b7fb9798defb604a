"""Are the tuned inertias still those of the URDF's arm? What tuning absorbs, no residual shows.

A load, a scaled torque or a shifted encoder can vanish once every inertia may be tuned. What remains is that the tuned
numbers lie where no arm of this drawing lies. With δ the change of the base parameters, prior N(0, Λ⁻¹) and posterior
covariance Σ, an arm within tolerance has δ̂ ~ N(0, Λ⁻¹ − Σ). Along the eigenvectors of I − Lᵀ Σ L (Λ = L Lᵀ) that gives
independent standard normal numbers, of which the largest is tested.

Recordings hold more misfit than the noise model knows. Where it is k times as much, a direction of which the recordings
show the share w varies by w (w + k (1 − w)) instead of w.

Source: Box 1980 (prior predictive check), in the coordinates of the tuned baseline.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import ndtr

from ident.arrays import Array, Float
from ident.diagnosis.selection.settings import USUAL_SELECTION, SelectionSettings
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection


@dataclass(frozen=True, eq=False)
class Tolerance:
    """How far out the tuned inertias lie."""

    deviation: float  # largest distance of a direction in standard deviations of an arm within tolerance
    p_value: float  # of so large a distance, all directions looked at
    torque: Float[Array, " n"]  # what the far directions amount to at each joint, root mean square [N m]
    most_likely: float = USUAL_SELECTION.most_likely  # chance below which it is more than tolerance

    @property
    def exceeded(self) -> bool:
        """Whether something else than the URDF's tolerance has been tuned away."""
        return self.p_value < self.most_likely


def measure_tolerance(
    evidence: Evidence,
    prior: Prior,
    projection: Projection,
    inflation: float = 1.0,
    settings: SelectionSettings = USUAL_SELECTION,
) -> Tolerance:
    """How far a solved model's inertias lie from the URDF's, against what its tolerance and the data allow.

    Args:
        evidence: Sums of the session.
        prior: The URDF's tolerance.
        projection: The model, solved with it.
        inflation: How many times the modelled variance the misfit has.
        settings: What counts as known, far and unlikely.
    """
    rank = evidence.layout.rank
    root = np.linalg.cholesky(prior.base)
    share, vectors = np.linalg.eigh(np.eye(rank) - root.T @ projection.spread[:rank, :rank] @ root)
    known = share > settings.least_informed
    along = vectors.T @ (root.T @ projection.estimate[:rank])
    seen = np.maximum(share, settings.least_informed)
    distance = np.where(known, np.abs(along) / np.sqrt(seen * (seen + inflation * (1.0 - seen))), 0.0)
    change = solve_triangular(root.T, vectors @ np.where(distance > settings.far_deviations, along, 0.0), lower=False)
    squares = [change @ sums.part(np.arange(rank)).sum(axis=0) @ change for sums in evidence.plain]
    torque = np.sqrt(np.maximum(squares, 0.0) / np.maximum(evidence.weights.sum(axis=0), 1.0))
    farthest = float(distance.max(initial=0.0))
    return Tolerance(farthest, min(1.0, 2.0 * int(known.sum()) * float(ndtr(-farthest))), torque, settings.most_likely)
