"""Prior predictive check of the tuned inertias: does their change from the URDF exceed its tolerance?

Tuned inertias absorb a load, a gain error or an encoder offset, so that no residual shows it; but they then lie where a
URDF within tolerance is unlikely. With δ̂ the estimated change of the base parameters, prior N(0, Λ⁻¹) and posterior
covariance Σ, an arm within tolerance has δ̂ ~ N(0, Λ⁻¹ − Σ). Along the eigenvectors of I − Lᵀ Σ L (Λ = L Lᵀ) that gives
independent standard normal variables, of which the largest is tested (Bonferroni).

Misfit exceeds the noise model by the variance inflation k: a direction whose prior variance the recordings reduce by
the share w then has variance w (w + k (1 − w)) instead of w.

Source: Box 1980 (prior predictive check), in the coordinates of the tuned baseline.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import ndtr

from ident.arrays import Array, Float
from ident.records import Settings
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection


class ToleranceSettings(Settings, table="tolerance"):
    """When tuned inertias exceed the URDF's tolerance."""


USUAL_TOLERANCE = ToleranceSettings()


@dataclass(frozen=True, eq=False)
class Tolerance:
    """Distance of the tuned inertias from the URDF, in units of its tolerance."""

    deviation: float  # largest deviation over all directions, in standard deviations of an arm within tolerance
    p_value: float  # of the largest deviation, corrected for the number of directions
    torque: Float[Array, " n"]  # root mean square torque at each joint by the directions that deviate far [N m]
    threshold: float = USUAL_TOLERANCE.most_likely  # p-value below which the tolerance is exceeded

    @property
    def exceeded(self) -> bool:
        """Whether tuning absorbed more than the URDF's tolerance allows."""
        return self.p_value < self.threshold


def measure_tolerance(
    evidence: Evidence,
    prior: Prior,
    projection: Projection,
    inflation: float = 1.0,
    settings: ToleranceSettings = USUAL_TOLERANCE,
) -> Tolerance:
    """Tests a solved model's inertias against the URDF's tolerance.

    Args:
        evidence: Block sums of the session.
        prior: Prior of the inertias, the URDF's tolerance.
        projection, inflation: The model solved with it, and variance inflation.
        settings: Thresholds.
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
