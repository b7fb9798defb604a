"""Friction that varies from run to run: a random change of each joint's viscous and Coulomb friction, run by run.

The torque of run g at a joint is y = X θ + X D u_g + e with D = diag(viscous, Coulomb) on those two columns and
u_g ~ N(0, Λ): relative changes of friction that no function of the state removes. Λ is found joint by joint by
restricted maximum likelihood (expectation-maximisation); the weights V⁻¹ = (σ² I + X D Λ Dᵀ Xᵀ)⁻¹ of a run need only
its sums, by Woodbury's identity.

Source: Laird and Ware 1982 (random effects by EM).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float

# Steps of the expectation-maximisation at each pass of the weights.
EM_STEPS = 20
# Spread that the search starts from: arms of the same batch repeat their friction to about a per cent.
FIRST_SPREAD = 0.01


@dataclass(frozen=True, eq=False)
class RunSums:
    """Sums of one joint's rows by run: XᵀX and Xᵀy, shapes (g, p, p) and (g, p)."""

    information: Float[Array, "g p p"]
    score: Float[Array, "g p"]


@dataclass(frozen=True, eq=False)
class RunEffect:
    """What one joint's friction does from run to run.

    Attributes:
        columns: D, shape (p, 2).
        spread: Standard deviations of the relative changes, (viscous, Coulomb).
        noise: σ², what one row is worth [N² m²].
        gain: For each run the matrix K of V⁻¹ = (I − X D K Dᵀ Xᵀ) / σ², shape (g, 2, 2).
        change: Most probable relative change in each run, shape (g, 2).
    """

    columns: Float[Array, "p 2"]
    spread: Float[Array, " 2"]
    noise: float
    gain: Float[Array, "g 2 2"]
    change: Float[Array, "g 2"]

    def weigh(self, sums: RunSums) -> tuple[Float[Array, "p p"], Float[Array, " p"]]:
        """Xᵀ V⁻¹ X and Xᵀ V⁻¹ y over all runs."""
        through = sums.information @ self.columns
        information = sums.information - through @ self.gain @ through.transpose(0, 2, 1)
        score = sums.score - np.einsum("gpe,gef,gf->gp", through, self.gain, sums.score @ self.columns)
        return information.sum(axis=0) / self.noise, score.sum(axis=0) / self.noise

    def weigh_scores(self, scores: Float[Array, "b p"], sums: RunSums, run: Array) -> Float[Array, "b p"]:
        """Xᵀ V⁻¹ e of blocks from their Xᵀ e."""
        through = sums.information @ self.columns @ self.gain
        return (scores - np.einsum("bpe,be->bp", through[run], scores @ self.columns)) / self.noise

    def covariance_of_scores(self, sums: RunSums) -> Float[Array, "p p"]:
        """Covariance of Xᵀ V⁻¹ y that comes from the runs' changes."""
        through = sums.information @ self.columns
        weighted = through - through @ self.gain @ (self.columns.T @ through)
        weighted = weighted * (self.spread / self.noise)
        return np.einsum("gpe,gqe->pq", weighted, weighted)


def fit_run_effect(
    sums: RunSums, estimate: Float[Array, " p"], friction: tuple[int, int], noise: float, spread: Float[Array, " 2"]
) -> RunEffect:
    """Finds a joint's spread from run to run.

    Args:
        sums: Of the joint.
        estimate: Its present figures.
        friction: Positions of viscous and Coulomb friction among them.
        noise: σ² [N² m²].
        spread: Present spread; zeros for recordings of one run, which can't tell.
    """
    columns = np.zeros((len(estimate), 2))
    for e, position in enumerate(friction):
        columns[position, e] = estimate[position]
    inner = columns.T @ sums.information @ columns / noise
    score = (sums.score - sums.information @ estimate) @ columns / noise
    runs = len(inner)
    if runs > 1 and spread.any():
        for _ in range(EM_STEPS):
            covariance = _posterior(inner, spread)
            change = np.einsum("gef,gf->ge", covariance, score)
            second = change**2 + np.diagonal(covariance, axis1=1, axis2=2)
            spread = np.sqrt(second.sum(axis=0) / (runs - 1))
    covariance = _posterior(inner, spread)
    return RunEffect(columns, spread, noise, covariance / noise, np.einsum("gef,gf->ge", covariance, score))


def _posterior(inner: Float[Array, "g 2 2"], spread: Float[Array, " 2"]) -> Float[Array, "g 2 2"]:
    """(Λ⁻¹ + H)⁻¹ for each run, also where a spread is zero."""
    scaled = np.eye(2) + spread[:, None] * inner * spread
    return spread[:, None] * np.linalg.inv(scaled) * spread
