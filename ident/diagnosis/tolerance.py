"""Prior predictive check of the tuned inertias: are they within the URDF's tolerance?

Tuned inertias absorb a load, a gain error or an encoder offset, so that no residual shows it; but
they then lie where a URDF within tolerance is unlikely. With δ̂ the estimated change of the base
parameters, prior N(0, Λ⁻¹) and posterior covariance Σ, an arm within tolerance has δ̂ ~ N(0, Λ⁻¹ −
Σ). Along the eigenvectors of I − Lᵀ Σ L (Λ = L Lᵀ) that gives independent standard normal
variables, of which the largest is tested (Bonferroni).

Misfit exceeds the noise model by the variance inflation k: a direction whose prior variance the
recordings reduce by the share w then has variance w (w + k (1 − w)) instead of w.

Source: Box 1980 (prior predictive check), in the coordinates of the tuned baseline.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import ndtr

from ident.arrays import Array, Float
from ident.records import Numbers, number
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection


@dataclass(frozen=True)
class ToleranceSettings(Numbers):
    """When tuned inertias exceed the URDF's tolerance."""

    least_informed: float = number(
        0.02,
        "1",
        "least share of a direction's prior variance that recordings must remove for it to be "
        "tested",
        "chosen: a seventh of a standard deviation",
    )
    most_likely: float = number(
        1e-06,
        "1",
        "p-value below which tuned inertias exceed the URDF's tolerance",
        "chosen: arms vary more than any normal law",
    )
    far_deviations: float = number(
        4.0,
        "1",
        "standard deviations above which a direction counts to the torque that tuning hides",
        "law: a chance of 6e-5",
    )


USUAL_TOLERANCE = ToleranceSettings()


@dataclass(frozen=True, eq=False)
class Tolerance:
    """Distance of the tuned inertias from the URDF, in units of its tolerance."""

    # Largest deviation over all directions, in standard deviations of an arm within tolerance.
    deviation: float
    p_value: float  # of the largest deviation, corrected for the number of directions
    # Root mean square torque at each joint by the directions that deviate far [N m].
    torque: Float[Array, " n"]
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
    covariance = projection.spread[:rank, :rank]
    # Share by which the recordings reduce the prior variance of each direction.
    left_open = root.T @ covariance @ root
    share, vectors = np.linalg.eigh(np.eye(rank) - left_open)
    known = share > settings.least_informed
    along = vectors.T @ (root.T @ projection.estimate[:rank])
    seen = np.maximum(share, settings.least_informed)
    std = np.sqrt(seen * (seen + inflation * (1.0 - seen)))
    distance = np.where(known, np.abs(along) / std, 0.0)
    far = np.where(distance > settings.far_deviations, along, 0.0)
    change = solve_triangular(root.T, vectors @ far, lower=False)
    base = np.arange(rank)
    squares = [change @ sums.part(base).sum(axis=0) @ change for sums in evidence.plain]
    samples = np.maximum(evidence.weights.sum(axis=0), 1.0)
    torque = np.sqrt(np.maximum(squares, 0.0) / samples)
    farthest = float(distance.max(initial=0.0))
    p_value = 2.0 * int(known.sum()) * float(ndtr(-farthest))
    return Tolerance(farthest, min(1.0, p_value), torque, settings.most_likely)
