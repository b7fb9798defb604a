"""One estimate of all that is linear: base parameters, rotor inertia, friction, offsets, laws.

What is said of the parameters is the covariance of the regression's model, as much wider as blocks
of time vary more than it says.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float, Int
from ident.fitting.fit_sums import FitSums
from ident.model.intervals import limits
from ident.regression.design import LOSS_PARAMETERS
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection, project
from ident.regression.run_spread import estimate_run_spread, squares_left, worth_of_rows

# Weights are found anew so many times at the most.
PASSES = 3
# Robust weights: blocks whose residual is beyond this many medians of all blocks' lose their pull
# (Huber's k).
HUBER_KNEE = 1.345
# An estimate this near to zero, in standard deviations, lies on its bound.
ON_BOUND = 1e-3


@dataclass(frozen=True, eq=False)
class JointEstimate:
    """All parameters: r changes of base parameters, three losses a joint, offsets if any, laws."""

    values: Float[Array, " m"]  # the parameters, shape (m,)
    # Mean products of the errors of the values of least variance, shape (m, m).
    covariance: Float[Array, "m m"]
    dof: Float[Array, " m"]  # degrees of freedom behind each standard deviation
    # Weighted normal equations of the data alone, without prior.
    information: Float[Array, "m m"]
    score: Float[Array, " m"]
    # Root mean square of what is left of each joint's torque, not whitened [N m].
    noise: Float[Array, " n"]
    spread: Float[Array, " n"]  # relative spread of each joint's friction from run to run
    rank: int  # number r of base parameters
    offset: bool  # whether each joint has an offset
    # The values of least variance where these may be others.
    efficient: Float[Array, " m"] | None = None

    @property
    def std(self) -> Float[Array, " m"]:
        """Standard deviation of each value, in its own unit."""
        return np.sqrt(np.diag(self.covariance))

    def shift(self, values: Float[Array, " m"]) -> Float[Array, " m"]:
        """How far values that are reported lie beside those of least variance.

        Zero where the estimate is the one of least variance itself, and where a value is held at
        zero for one below: what bounds change is no doubt.
        """
        if self.efficient is None:
            return np.zeros(len(values))
        shift = np.asarray(values - self.efficient)
        held = (np.abs(values) <= ON_BOUND * self.std) & (shift > 0.0)
        return np.where(held, 0.0, shift)

    def about(self, values: Float[Array, " m"]) -> Float[Array, "m m"]:
        """Mean products of the errors of values that are reported."""
        return self.covariance + np.diag(self.shift(values) ** 2)

    def limits(self, values: Float[Array, " m"]) -> Float[Array, "m 2"]:
        """Ends of 95 % intervals of values that are reported."""
        return limits(values, self.shift(values), self.std, self.dof)

    @property
    def per_joint(self) -> int:
        """Number of loss parameters a joint."""
        return LOSS_PARAMETERS + self.offset

    @property
    def first_law(self) -> int:
        """Where laws' coefficients begin."""
        return self.rank + len(self.noise) * self.per_joint

    def index(self, joint: int) -> Int[Array, " p"]:
        """Positions of a joint's rotor inertia, viscous and Coulomb friction, and offset."""
        losses = self.rank + LOSS_PARAMETERS * joint + np.arange(LOSS_PARAMETERS)
        if not self.offset:
            return losses
        first_offset = self.rank + LOSS_PARAMETERS * len(self.noise)
        return np.append(losses, first_offset + joint)

    def believing(self, prior: Float[Array, "r r"]) -> JointEstimate:
        """The estimate with a URDF as far off as these recordings find it.

        Intervals are those of its values, and reach as far as what is reported.

        Args:
            prior: Information on the base parameters that lies in such a URDF.
        """
        information = np.array(self.information)
        information[: self.rank, : self.rank] += prior
        size = np.sqrt(np.diag(information))
        scale = np.outer(size, size)
        covariance = np.linalg.inv(information / scale) / scale
        values = covariance @ self.score
        return replace(self, values=values, covariance=covariance, efficient=values)

    def without_inertias(self, prior: Float[Array, "r r"]) -> JointEstimate:
        """The losses' estimate with the inertias held at the URDF's.

        Args:
            prior: Information on the base parameters: how far the URDF may be off.
        """
        rank = self.rank
        inverse = np.linalg.inv(self.information[rank:, rank:])
        values = np.concatenate([np.zeros(rank), inverse @ self.score[rank:]])
        through = inverse @ self.information[rank:, :rank]
        off = np.linalg.inv(prior)
        covariance = np.zeros_like(self.covariance)
        covariance[:rank, :rank] = off
        covariance[rank:, rank:] = inverse + through @ off @ through.T
        return replace(self, values=values, covariance=covariance)


def estimate(sums: FitSums) -> JointEstimate:
    """All linear parameters of an arm with their covariance, from one pass over the runs."""
    evidence = weighted_evidence(sums)
    model = _solved(evidence, sums)
    inside = model.inside
    scale = evidence.scale[inside]
    gram = evidence.gram()
    return JointEstimate(
        values=model.estimate / scale,
        covariance=model.spread / np.outer(scale, scale),
        dof=_degrees_of_freedom(evidence, len(inside)),
        information=gram[np.ix_(inside, inside)] * np.outer(scale, scale),
        score=gram[inside, -1] * scale,
        noise=_plain_error(evidence, model.weights),
        spread=evidence.spread,
        rank=evidence.layout.rank,
        offset=sums.options.offset == "on",
    )


def estimates_left_out(
    sums: FitSums, part_of_block: Int[Array, " B"], parts: int
) -> list[Float[Array, " m"]]:
    """The parameters without each part of the blocks in turn, what rows are worth as of all.

    Args:
        sums: The pass over the runs.
        part_of_block: Part of each block of its sums.
        parts: How many there are.
    """
    evidence = weighted_evidence(sums)
    estimates = []
    for number in range(parts):
        others = (part_of_block != number).astype(float)
        model = _solved(evidence.weighted(np.tile(others[:, None], evidence.layout.n)), sums)
        estimates.append(model.estimate / evidence.scale[model.inside])
    return estimates


def weighted_evidence(sums: FitSums) -> Evidence:
    """The sums with friction's spread from run to run, what rows are worth, and robust weights."""
    given = sums.evidence
    n = sums.baseline.nominal.n
    evidence = given.with_run_spread(np.full(n, given.settings.wide_spread))
    for _ in range(PASSES):
        model = _solved(evidence, sums)
        spread = estimate_run_spread(evidence, model.weights)
        worth = worth_of_rows(evidence, model)
        weighted = given
        if sums.options.robust:
            weighted = given.weighted(_huber_weights(given, model))
        evidence = weighted.with_run_spread(spread).with_dispersion(worth)
    return evidence


def _degrees_of_freedom(evidence: Evidence, size: int) -> Float[Array, " m"]:
    """Degrees of freedom behind each of m parameters' standard deviations.

    Friction is known by as many repeats as there are runs, or stretches of long ones, all else by
    blocks.
    """
    layout = evidence.layout
    n = layout.n
    blocks = int(np.sum(evidence.rows.any(axis=1)))
    stretches = len(np.unique(evidence.friction.stretch))
    dof = np.full(size, max(1.0, blocks - size / n))
    first_loss = layout.rank + LOSS_PARAMETERS * np.arange(n)
    friction = first_loss[:, None] + np.arange(1, LOSS_PARAMETERS)
    dof[friction] = np.minimum(dof[friction], stretches - 1.0 + evidence.settings.usual_runs)
    return dof


def _plain_error(evidence: Evidence, weights: Float[Array, " P"]) -> Float[Array, " n"]:
    """Root mean square of what a model leaves of each joint's torque [N m]."""
    squares = np.zeros(evidence.layout.n)
    for j, local in enumerate(evidence.layout.local):
        local_weights = weights[local]
        rows = max(float(evidence.weights[:, j].sum()), 1.0)
        squares[j] = local_weights @ evidence.plain[j].over() @ local_weights / rows
    return np.sqrt(np.maximum(squares, 0.0))


def _solved(evidence: Evidence, sums: FitSums) -> Projection:
    """The model of losses, inertias near the URDF's, offsets and laws; bounds come afterwards."""
    prior = Prior.of(evidence, sums.baseline.prior)
    return project(evidence.gram(), evidence, prior, evidence.layout.groups, signed=False)


def _huber_weights(evidence: Evidence, model: Projection) -> Float[Array, "B n"]:
    """Weight of each block and joint: one, or less where a model leaves more than is usual.

    Args:
        evidence: Sums in which friction is the same in all runs.
        model: The model, with friction's own level of each run.
    """
    squares = np.maximum(squares_left(evidence, model).T, 0.0)
    mean = np.sqrt(squares / np.maximum(evidence.rows, 1e-9))
    mean = np.where(evidence.rows > 0.0, mean, np.nan)
    usual = np.nan_to_num(np.nanmedian(mean, axis=0), nan=1.0)
    return np.minimum(1.0, HUBER_KNEE * usual / np.maximum(np.nan_to_num(mean), 1e-12))
