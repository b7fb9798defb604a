"""How much a joint's friction varies, known from all joints of an arm: variances of one law.

Of a few runs a joint's own variance is hardly known: of four, one joint in twenty shows a third of its spread, and a
joint whose friction drowns in noise shows none. So the variances of all joints' viscous and Coulomb friction are taken
for draws of one scaled inverse chi-squared law with ν degrees of freedom about s². Both are averaged over what the
joints leave possible, so that an arm whose joints are alike lends much and one whose joints differ lends little. What
is usual for arms counts as one joint more.

Source: Smyth 2004 (moderated variances); Gelman et al., Bayesian Data Analysis, 3rd ed. (scaled inverse chi-squared).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import lgamma

import numpy as np

from ident.arrays import Array, Float

# What is usual: a warm UR10e repeats its friction to about a per cent. It counts as a joint seen in so many runs more,
# fewer than a session has: few runs then prove nothing to the contrary, and one run is not taken for perfect repeats.
USUAL_SPREAD, USUAL_RUNS = 0.01, 2
# Degrees of freedom of the law and its scale as a share of the friction, each as likely as any other before the data.
FREEDOMS = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
SCALES = np.geomspace(1e-4, 1.0, 33)
NU, SQUARED = (part.ravel() for part in np.meshgrid(FREEDOMS, SCALES**2, indexing="ij"))
LOG_GAMMA = np.array([lgamma(0.5 * nu) for nu in NU])


@dataclass(frozen=True, eq=False)
class SharedVariance:
    """What is known of the law, under each of w hypotheses of what the variances stand for.

    Attributes:
        weights: How likely each hypothesis and pair of ν and s² is, shape (w, k); they add up to one.
    """

    weights: Float[Array, "w k"]

    @property
    def freedom(self) -> float:
        """Degrees of freedom that the law lends to a variance."""
        return float(1.0 / (self.weights.sum(axis=0) @ (1.0 / NU)))

    def moderate(
        self, squares: Float[Array, "w v"], dof: Float[Array, " v"], factor: Float[Array, " w"] | float = 1.0
    ) -> Float[Array, " v"]:
        """Variances by their own squares and the law's.

        Args:
            squares: Sum of squares of each variance under each hypothesis.
            dof: Degrees of freedom of each sum.
            factor: Of the variance under each hypothesis.
        """
        weights = self.weights * np.broadcast_to(factor, len(self.weights))[:, None]
        total = NU + dof[:, None]
        own = (weights.sum(axis=0) * NU * SQUARED / total).sum(axis=1)
        return np.asarray(own + np.einsum("wv,wv->v", squares, (weights @ (1.0 / total).T)))


def share_variance(
    squares: Float[Array, "w v"], dof: Float[Array, " v"], surprise: Float[Array, " w"] | float = 0.0
) -> SharedVariance:
    """The law behind some variances.

    Args:
        squares: Sum of squares of each variance under each hypothesis.
        dof: Degrees of freedom of each sum; zero where nothing is known.
        surprise: What each hypothesis costs beside the variances [nats].
    """
    squares = np.concatenate([squares, np.full((len(squares), 1), USUAL_RUNS * USUAL_SPREAD**2)], axis=1)
    dof = np.append(dof, USUAL_RUNS)
    log = 0.5 * NU * np.log(0.5 * NU * SQUARED) - LOG_GAMMA
    gained = np.array([[lgamma(0.5 * (nu + d)) for nu in FREEDOMS] for d in dof.tolist()])
    gained = np.repeat(gained, len(SCALES), axis=1)
    left = np.log(0.5 * (NU * SQUARED + squares[..., None]))  # (w, v, k)
    told = (len(dof) * log + gained.sum(axis=0)) - np.einsum("wvk,vk->wk", left, 0.5 * (NU + dof[:, None]))
    told = told - np.broadcast_to(surprise, len(told))[:, None]
    likely = np.exp(told - told.max())
    return SharedVariance(likely / likely.sum())
