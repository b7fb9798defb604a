"""Are the tuned inertias still those of the URDF's arm? What tuning absorbs, no residual tells.

A load, a scaled torque or a shifted encoder can vanish once every inertia may be tuned. What remains is that the tuned
numbers lie where no arm of this drawing lies. With δ the change of the base parameters, prior N(0, Λ⁻¹) and posterior
covariance Σ, an arm within tolerance has δ̂ ~ N(0, Λ⁻¹ − Σ). Along the eigenvectors of I − Lᵀ Σ L (Λ = L Lᵀ) that gives
independent standard normal figures, of which the largest is asked.

Recordings hold more misfit than the noise model knows. Where it is k times as much, a direction of which the recordings
tell the share w varies by w (w + k (1 − w)) instead of w.

Source: Box 1980 (prior predictive check), in the coordinates of the tuned baseline.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.stats import norm

from ident.arrays import Array, Float
from ident.diagnosis.regression.gram import Evidence
from ident.diagnosis.regression.least_squares import Prior, Projection

# Directions of which the recordings tell less than this share of the prior's variance say nothing.
LEAST_TOLD = 0.02
# Arms vary more than any normal law: only what is beyond doubt is told.
MOST_LIKELY = 1e-6
# Directions that lie farther out than this many standard deviations make up what was tuned away.
FAR = 4.0


@dataclass(frozen=True, eq=False)
class Tolerance:
    """How far out the tuned inertias lie.

    Attributes:
        deviation: Largest distance of a direction in standard deviations of an arm within tolerance.
        p_value: Of so large a distance, all directions looked at.
        torque: What the far directions amount to at each joint, root mean square [N m].
    """

    deviation: float
    p_value: float
    torque: Float[Array, " n"]

    @property
    def exceeded(self) -> bool:
        """Whether something else than the URDF's tolerance has been tuned away."""
        return self.p_value < MOST_LIKELY


def measure_tolerance(evidence: Evidence, prior: Prior, projection: Projection, spare: float = 1.0) -> Tolerance:
    """How far a solved model's inertias lie from the URDF's, against what its tolerance and the data allow.

    Args:
        evidence: Sums of the session.
        prior: The URDF's tolerance.
        projection: The model, solved with it.
        spare: How many times the modelled variance the misfit has.
    """
    rank = evidence.layout.rank
    root = np.linalg.cholesky(prior.base)
    share, vectors = np.linalg.eigh(np.eye(rank) - root.T @ projection.spread[:rank, :rank] @ root)
    told = share > LEAST_TOLD
    along = vectors.T @ (root.T @ projection.estimate[:rank])
    seen = np.maximum(share, LEAST_TOLD)
    distance = np.where(told, np.abs(along) / np.sqrt(seen * (seen + spare * (1.0 - seen))), 0.0)
    change = solve_triangular(root.T, vectors @ np.where(distance > FAR, along, 0.0), lower=False)
    squares = [change @ sums.sum(axis=0)[:rank, :rank] @ change for sums in evidence.plain]
    torque = np.sqrt(np.maximum(squares, 0.0) / np.maximum(evidence.weights.sum(axis=0), 1.0))
    farthest = float(distance.max(initial=0.0))
    return Tolerance(farthest, min(1.0, 2.0 * int(told.sum()) * float(norm.sf(farthest))), torque)
