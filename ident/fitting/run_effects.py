"""How much a joint's friction varies, known from all joints of an arm: variances of one law.

Of a few runs a joint's own variance is hardly known: of four, one joint in twenty shows a third of its spread, and a
joint whose friction drowns in noise shows none. So the variances of all joints' viscous and Coulomb friction are taken
for draws of one scaled inverse chi-squared law with ν degrees of freedom about s². Both are averaged over what the
joints leave possible, so that an arm whose joints are alike lends much and one whose joints differ lends little. What
is usual for arms counts as one joint more.

Source: Smyth 2004 (moderated variances); Gelman et al., Bayesian Data Analysis, 3rd ed. (scaled inverse chi-squared).

Friction that varies from run to run: a random change of each joint's viscous and Coulomb friction, run by run.

The torque of run g at a joint is y = X θ + X D u_g + e with D = diag(viscous, Coulomb) on those two columns and
u_g ~ N(0, Λ): relative changes of friction that no function of the state removes. Λ is found for all joints together
(see `shared_variance`) from how much of each change the data tell; the weights V⁻¹ = (σ² I + X D Λ Dᵀ Xᵀ)⁻¹ of a run
need only its sums, by Woodbury's identity.

Source: Laird and Ware 1982 (random effects); MacKay 1992 (variances by the number of well-determined changes).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
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


def share_variance(
    squares: Float[Array, "w v"], dof: Float[Array, " v"], surprise: Float[Array, " w"] | float = 0.0
) -> Float[Array, "w k"]:
    """How likely each hypothesis of what variances stand for and pair of ν and s² is; all add up to one.

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
    reported = (len(dof) * log + gained.sum(axis=0)) - np.einsum("wvk,vk->wk", left, 0.5 * (NU + dof[:, None]))
    reported = reported - np.broadcast_to(surprise, len(reported))[:, None]
    likely = np.exp(reported - reported.max())
    return np.asarray(likely / likely.sum())


def lent_freedom(weights: Float[Array, "w k"]) -> float:
    """Degrees of freedom that the law lends to a variance."""
    return float(1.0 / (weights.sum(axis=0) @ (1.0 / NU)))


def moderate(
    weights: Float[Array, "w k"],
    squares: Float[Array, "w v"],
    dof: Float[Array, " v"],
    factor: Float[Array, " w"] | float = 1.0,
) -> Float[Array, " v"]:
    """Variances by their own squares and the law's.

    Args:
        weights: Of hypotheses and laws, see `share_variance`.
        squares: Sum of squares of each variance under each hypothesis.
        dof: Degrees of freedom of each sum.
        factor: Of the variance under each hypothesis.
    """
    weights = weights * np.broadcast_to(factor, len(weights))[:, None]
    total = NU + dof[:, None]
    own = (weights.sum(axis=0) * NU * SQUARED / total).sum(axis=1)
    return np.asarray(own + np.einsum("wv,wv->v", squares, (weights @ (1.0 / total).T)))


# Steps towards the variances at each pass of the weights.
STEPS = 10

# A run counts for how friction wanders if its data take away this share of what is unknown of it; and it takes so many.
LEAST_KNOWN, LEAST_WALK = 0.5, 2
# Variance that a walk gathers over the session, in variances of the independent changes: none, or of any order between
# what is not seen and what hides the rest. Before the data, none is as likely as all others together: with no more than
# the others' share each, intervals of Coulomb friction that never wandered were 1.5 times too wide, and held all of it.
WALKS = np.array([0.0, *np.geomspace(0.03, 30.0, 19)])
SURPRISE = -np.log(np.where(WALKS > 0.0, 0.5 / (len(WALKS) - 1), 0.5))
TINY = 1e-30


@dataclass(frozen=True, eq=False)
class RunSums:
    """Sums of one joint's rows by run: XᵀX and Xᵀy, shapes (g, p, p) and (g, p)."""

    information: Float[Array, "g p p"]
    score: Float[Array, "g p"]


@dataclass(frozen=True, eq=False)
class RunEffect:
    """What one joint's friction does from run to run."""

    columns: Float[Array, "p 2"]  # D, shape (p, 2)
    spread: Float[Array, " 2"]  # standard deviations of the relative changes, (viscous, Coulomb)
    noise: float  # σ², what one row is worth [N² m²]
    gain: Float[Array, "g 2 2"]  # for each run the matrix K of V⁻¹ = (I − X D K Dᵀ Xᵀ) / σ², shape (g, 2, 2)
    change: Float[Array, "g 2"]  # most probable relative change in each run, shape (g, 2)
    # Degrees of freedom of the two spreads.
    dof: Float[Array, " 2"] = field(default_factory=lambda: np.full(2, float(USUAL_RUNS)))

    @property
    def known(self) -> Float[Array, "g 2"]:
        """Share of the spread's variance that each run's data take away: 0 where a run says nothing of the joint."""
        left = self.noise * np.diagonal(self.gain, axis1=1, axis2=2)
        return 1.0 - np.divide(left, self.spread**2, out=np.ones_like(left), where=self.spread > 0.0)

    def weigh(self, sums: RunSums) -> tuple[Float[Array, "p p"], Float[Array, " p"]]:
        """Xᵀ V⁻¹ X and Xᵀ V⁻¹ y over all runs."""
        through = sums.information @ self.columns
        # Summed over the runs within one product of matrices.
        flat = through.transpose(1, 0, 2).reshape(len(self.columns), -1)
        gained = (through @ self.gain).transpose(1, 0, 2).reshape(flat.shape)
        information = sums.information.sum(axis=0) - gained @ flat.T
        score = sums.score.sum(axis=0) - gained @ (sums.score @ self.columns).ravel()
        return information / self.noise, score / self.noise

    def covariance_of_run(
        self, known: Float[Array, "p p"], information: Float[Array, "g p p"]
    ) -> Float[Array, "g p p"]:
        """Covariance of a joint's parameters θ + D u_g in each run, by that of θ and by what the run says of u_g.

        Args:
            known: Covariance of θ.
            information: Each run's XᵀX.
        """
        gain = self.columns @ self.gain @ self.columns.T
        kept = np.eye(len(self.columns)) - gain @ information
        return np.asarray(kept @ known @ kept.swapaxes(1, 2) + self.noise * gain)

    def covariance_of_scores(self, sums: RunSums) -> Float[Array, "p p"]:
        """Covariance of Xᵀ V⁻¹ y that comes from the runs' changes."""
        through = sums.information @ self.columns
        weighted = through - through @ self.gain @ (self.columns.T @ through)
        weighted = weighted * (self.spread / self.noise)
        return np.einsum("gpe,gqe->pq", weighted, weighted)


def fit_run_effects(
    sums: Sequence[RunSums],
    estimates: Float[Array, "n p"],
    friction: tuple[int, int],
    noise: Float[Array, " n"],
    spread: Float[Array, "n 2"],
) -> list[RunEffect]:
    """Finds each joint's spread from run to run.

    Args:
        sums: Of the joints.
        estimates: Each joint's present figures.
        friction: Positions of viscous and Coulomb friction among them.
        noise: σ² of each joint [N² m²].
        spread: Present spreads.
    """
    columns = np.zeros((*estimates.shape, 2))
    for e, position in enumerate(friction):
        columns[:, position, e] = estimates[:, position]
    through = [one.information @ own for one, own in zip(sums, columns, strict=True)]
    inner = np.stack([own.T @ part for own, part in zip(columns, through, strict=True)]) / noise[:, None, None, None]
    left = [one.score @ own for one, own in zip(sums, columns, strict=True)]
    met = [values @ part for values, part in zip(estimates, through, strict=True)]
    score = (np.stack(left) - np.stack(met)) / noise[:, None, None]
    runs = inner.shape[1]
    dof = np.full(spread.shape, float(USUAL_RUNS))
    if runs > 1:
        for _ in range(STEPS):
            covariance = _posterior(inner, spread)
            change = (covariance @ score[..., None])[..., 0]
            left = np.diagonal(covariance, axis1=-2, axis2=-1).sum(axis=1)
            reported = runs - np.divide(left, spread**2, out=np.full_like(left, runs), where=spread > 0.0)
            reported = np.maximum(reported, 0.0) * (runs - 1) / runs  # the mean over the runs is no change
            squares = (change**2).sum(axis=1).reshape(1, -1)
            shared = share_variance(squares, reported.ravel())
            spread = np.sqrt(moderate(shared, squares, reported.ravel())).reshape(spread.shape)
            dof = reported + lent_freedom(shared)
    covariance = _posterior(inner, spread)
    change = (covariance @ score[..., None])[..., 0]
    return [
        RunEffect(columns[j], spread[j], float(noise[j]), covariance[j] / noise[j], change[j], dof[j])
        for j in range(len(sums))
    ]


def _posterior(inner: Float[Array, "n g 2 2"], spread: Float[Array, "n 2"]) -> Float[Array, "n g 2 2"]:
    """(Λ⁻¹ + H)⁻¹ for each joint and run, also where a spread is zero."""
    size = spread[:, None, :, None] * spread[:, None, None, :]
    # The inverse of two by two, written out: this runs some thousand times a fit.
    scaled = inner * size
    a, b, d = 1.0 + scaled[..., 0, 0], scaled[..., 0, 1], 1.0 + scaled[..., 1, 1]
    inverse = np.empty_like(inner)
    inverse[..., 0, 0], inverse[..., 0, 1], inverse[..., 1, 0], inverse[..., 1, 1] = d, -b, -b, a
    return np.asarray(size * inverse / (a * d - b * b)[..., None, None])


def wandering(effects: Sequence[RunEffect]) -> tuple[Float[Array, "n 2"], Float[Array, "n 2"]]:
    """How far each joint's mean friction lies from what it was before the runs, as friction wanders from run to run.

    Changes that are independent from run to run fade in the mean; those of friction that wanders don't, and no weight
    of the runs brings them back. The cosine transform of g runs' changes tells the two apart: independent changes of
    variance ν have the same power in each of its terms, a walk of step variance q has q / (2 sin(π k / 2g))² in the
    k-th. The ratio of the two is one for all joints of an arm; it is averaged over what the changes leave possible, as
    the likeliest ratio is often zero where the walk is merely small. The mean of a walk lies at a variance of
    q (g + 1) (2 g + 1) / (6 g) from its start. Joints of whose changes nothing is known wander as the others do.

    Args:
        effects: Of all joints, runs in the order of their time.

    Returns:
        Variance of the relative distance for (viscous, Coulomb), and its degrees of freedom.

    Source: Patterson and Thompson 1971 (restricted likelihood); Ahmed, Natarajan and Rao 1974 (cosine transform).
    """
    shape = len(effects), 2
    squares, dof, surprise = np.zeros((len(WALKS), *shape)), np.zeros(shape), SURPRISE.copy()
    for j, effect in enumerate(effects):
        for e, (change, known) in enumerate(zip(effect.change.T, effect.known.T, strict=True)):
            reported = known >= LEAST_KNOWN
            runs = int(reported.sum())
            if runs >= LEAST_WALK:
                # A change that is determined by half shows half of its variance.
                k = np.arange(1, runs)
                waves = np.sqrt(2.0 / runs) * np.cos(np.pi * np.outer(k, np.arange(runs) + 0.5) / runs)
                power = np.maximum((waves @ (change[reported] / np.sqrt(known[reported]))) ** 2, TINY)
                gain = 0.25 / np.sin(0.5 * np.pi * k / runs) ** 2  # power of a walk of step variance one
                spread = 1.0 + WALKS[:, None] / runs * gain
                squares[:, j, e] = np.sum(power / spread, axis=1)
                surprise += 0.5 * np.log(spread).sum(axis=1)
                dof[j, e] = runs - 1
    if not dof.any():
        return np.zeros(shape), np.ones(shape)
    flat: Float[Array, "w v"] = squares.reshape(len(WALKS), -1)
    shared = share_variance(flat, dof.ravel(), surprise)
    runs = len(effects[0].change)
    factor = WALKS * (runs + 1) * (2 * runs + 1) / (6 * runs**2)
    return moderate(shared, flat, dof.ravel(), factor).reshape(shape), dof + lent_freedom(shared)
