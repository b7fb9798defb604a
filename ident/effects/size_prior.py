"""How large an effect's coefficients are beforehand, and what they cost for it: an Occam factor.

What a name of the inertias' kind explains, a URDF that is a little wrong explains nearly as well; so it matters whether
its figures are usual. A last link of twice its own weight is hardly an error of the URDF: it is a link that carries
something. With p the density of the coefficients beforehand, ĉ their estimate and J what recordings tell about the k of
them, beside an expected deviation s of each,

    log p(y | name) − log p(y) ≈ ½ gain − cost,
    cost = ½ (ĉ − c)ᵀ J (ĉ − c) + ½ log|J + s⁻²| − ½ k log 2π − log p(c),    c = (J + s⁻²)⁻¹ J ĉ:

directions of which the recordings say nothing are where they are expected.

Source: MacKay 1992 (Laplace's approximation of the evidence).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from ident.arrays import Array, Float

# Arms that are several times as far off as usual are rare, but there are some.
FREEDOM = 10


@dataclass(frozen=True, eq=False)
class SizePrior:
    """What is known of an effect's coefficients beforehand.

    Attributes:
        deviation: Expected size of each, of what the recordings say nothing about.
        log_density: Log density of all of them together.
    """

    deviation: Float[Array, " k"]
    log_density: Callable[[Float[Array, " k"]], float]

    @classmethod
    def about_zero(cls, deviation: Float[Array, " k"]) -> SizePrior:
        """Student's t of a few degrees of freedom about zero for each coefficient."""
        half = 0.5 * (FREEDOM + 1)
        constant = gammaln(half) - gammaln(0.5 * FREEDOM) - 0.5 * np.log(FREEDOM * np.pi)

        def log_density(coefficients: Float[Array, " k"]) -> float:
            spread = half * np.log1p((coefficients / deviation) ** 2 / FREEDOM)
            return float(np.sum(constant - spread - np.log(deviation)))

        return cls(deviation, log_density)

    def cost(self, coefficients: Float[Array, " k"], information: Float[Array, "k k"]) -> float:
        """What coefficients cost the evidence for a name [nats].

        Args:
            coefficients: Their estimate.
            information: What the recordings tell about them; directions that encoder noise fills may be negative.
        """
        width = self.deviation
        values, vectors = np.linalg.eigh(width[:, None] * (0.5 * (information + information.T)) * width)
        values = np.maximum(values, 0.0)
        free = vectors.T @ (coefficients / width)
        held = free * values / (1.0 + values)
        misfit = 0.5 * float(values @ (free - held) ** 2)
        sharper = 0.5 * float(np.sum(np.log1p(values))) - float(np.sum(np.log(width)))
        usual = self.log_density(width * (vectors @ held))
        return misfit + sharper - 0.5 * len(width) * float(np.log(2 * np.pi)) - usual
