"""Likelihood of friction levels of stretches one after the other, of which a share gathers as a
random walk.

Levels s_r of stretches one after the other are seen with covariance V_r. A share w of their
variance τ² is a random walk's, the rest is each stretch's own:

    s_r = m_r + u_r + e_r,    m_r = m_{r-1} + N(0, q I),    u_r ~ N(0, (1 − w) τ² I),
    q = 6 w τ² / (R + 1)

so that R levels vary by τ² about their mean, whatever share of it walks. A Kalman filter, whose
first level is unknown, gives the likelihood of τ and w; without a walk (w = 0) it is the restricted
likelihood of a variance component.

Source: Durbin and Koopman 2012, chapters 2 and 5 (local level model, diffuse beginning).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float

# Variance of a level before anything is seen of it; levels are shares of the model's.
DIFFUSE = 1e4


def walk_likelihood(
    levels: Float[Array, "R 2"],
    noise: Float[Array, "R 2 2"],
    spreads: Float[Array, " k"],
    walk: Float[Array, " k"] | float,
) -> Float[Array, " k"]:
    """Log likelihoods of friction levels that vary by so much, up to a constant [nats].

    Args:
        levels: s_r, the stretches' viscous and Coulomb levels as shares of the model's.
        noise: V_r, their covariances by noise.
        spreads: Values of τ that are tried.
        walk: w, the share of the variance that walks: one for each spread, or the same for all.
    """
    variance = spreads**2
    step = walk * 6.0 / (len(levels) + 1.0) * variance
    independent = (1.0 - walk) * variance
    nothing = np.zeros(len(spreads))
    covariance = Symmetric(np.full(len(spreads), DIFFUSE), nothing, np.full(len(spreads), DIFFUSE))
    viscous = nothing
    coulomb = nothing
    nats = nothing
    for level, of_noise in zip(levels, noise, strict=True):
        seen = covariance.plus(
            independent + of_noise[0, 0], of_noise[0, 1], independent + of_noise[1, 1]
        )
        off_viscous = level[0] - viscous
        off_coulomb = level[1] - coulomb
        along_viscous, along_coulomb = seen.solve(off_viscous, off_coulomb)
        squares = off_viscous * along_viscous + off_coulomb * along_coulomb
        nats = nats - 0.5 * (np.log(seen.determinant) + squares)
        to_viscous, to_coulomb = covariance.times(along_viscous, along_coulomb)
        viscous = viscous + to_viscous
        coulomb = coulomb + to_coulomb
        covariance = covariance.after(seen).plus(step, 0.0, step)
    return nats


@dataclass(frozen=True, eq=False)
class Symmetric:
    """Symmetric matrices of two rows, one for each value that is tried."""

    first: Float[Array, " k"]
    between: Float[Array, " k"]
    second: Float[Array, " k"]

    @property
    def determinant(self) -> Float[Array, " k"]:
        """Of each matrix."""
        return self.first * self.second - self.between**2

    def plus(
        self,
        first: Float[Array, " k"] | float,
        between: Float[Array, " k"] | float,
        second: Float[Array, " k"] | float,
    ) -> Symmetric:
        """The sums with other matrices."""
        return Symmetric(self.first + first, self.between + between, self.second + second)

    def times(
        self, first: Float[Array, " k"], second: Float[Array, " k"]
    ) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
        """Both components of the products with vectors."""
        return (
            self.first * first + self.between * second,
            self.between * first + self.second * second,
        )

    def solve(
        self, first: Float[Array, " k"], second: Float[Array, " k"]
    ) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
        """Both components of the vectors whose products with the matrices are these."""
        return (
            (self.second * first - self.between * second) / self.determinant,
            (self.first * second - self.between * first) / self.determinant,
        )

    def after(self, seen: Symmetric) -> Symmetric:
        """P − P S⁻¹ P: what is left of covariances P once something of covariance S was seen."""
        first_of_first, second_of_first = seen.solve(self.first, self.between)
        first_of_second, second_of_second = seen.solve(self.between, self.second)
        taken_first, _ = self.times(first_of_first, second_of_first)
        taken_between, taken_second = self.times(first_of_second, second_of_second)
        return self.plus(-taken_first, -taken_between, -taken_second)
