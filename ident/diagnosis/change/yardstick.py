"""Does a change stand out against what runs of one set differ by among themselves?

An effect of size one is what was found to have come with the later set. In each run r its size d_r about its set's mean
is estimated from what the model with the change leaves, with variance v_r by the noise; of what the d_r of one set
differ by, the part beyond noise is a variance component,

    τ² = max(0, Σ (d − d̄)² / v − Σ (R_s − 1)) / C,

and the change itself has the variance V_b + τ² (Σ_before w² + Σ_after w²), with V_b from blocks and w each run's share
of its set's information. A change is told where F = 1 / (k V) is beyond chance for its k columns, all changes asked.

Friction is not as free from run to run: it wanders (`wandering`). Nobody can tell from a few runs whether it wanders or
jumps; so it is taken to wander, and means of sessions to be free. How far is a distribution, over which chances are
taken.

Source: DerSimonian and Laird 1986 (moment estimator of a variance component); Satterthwaite 1946 (degrees of freedom).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import f as fisher
from scipy.stats import t as student

from ident.arrays import Array, Float, Int
from ident.diagnosis.change.friction_doubt import SAME_DAY, AnotherDay
from ident.diagnosis.change.switched import Sides, Switched
from ident.diagnosis.change.wandering import PRIOR_DOF, estimate_wandering
from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.least_squares import Projection
from ident.diagnosis.regression.run_spread import excess_over_noise, residual_weights


@dataclass(frozen=True)
class Standing:
    """How a change stands against the runs' own differences.

    Attributes:
        p_value: For all changes asked.
        error: Standard deviation of its size, as a share of it.
        spread: Standard deviation from run to run of the effect, as a share of the change.
        widening: Factor on the half-widths of intervals that count the blocks' noise alone.
        daily: What of the error is there whatever the runs say, as one day differs from the next.
    """

    p_value: float
    error: float
    spread: float
    widening: float
    daily: float = 0.0

    @property
    def of_the_day(self) -> bool:
        """Whether the error is mostly what days differ by."""
        return self.daily > np.sqrt(0.5) * self.error


def measure_standing(
    switched: Switched,
    sides: Sides,
    model: Projection,
    group: Group,
    beta: Float[Array, " k"],
    covariance: Float[Array, "k k"],
    asked: int,
    day: AnotherDay = SAME_DAY,
) -> Standing:
    """Holds a change against the runs.

    Args:
        switched: The sums.
        sides: Which runs are of which set.
        model: The baseline with all named changes.
        group: The change.
        beta: Its scaled coefficients.
        covariance: Their covariance by blocks.
        asked: How many changes were asked for.
        day: What it may differ by though nothing was done, as a share of it.
    """
    score, power = _by_block(switched, model, group, beta)
    runs = len(sides.later)
    total, count = np.zeros((2, runs))
    np.add.at(total, sides.run_of_block, score)
    np.add.at(count, sides.run_of_block, power)
    seen = count > 1e-9 * count.max(initial=1e-300)
    size = np.where(seen, total / np.where(seen, count, 1.0), 0.0)
    noise = _noise(score - size[sides.run_of_block] * power, power)
    by_noise = noise / np.where(seen, count, 1.0)
    spread, free, share = _component(size, by_noise, count, sides, seen)
    along = _information(switched, model, group, beta) @ beta
    by_blocks = float(along @ covariance @ along) / max(float(beta @ along), 1e-300) ** 2
    by_runs = max(spread**2 * share, _between_runs(size, count, sides, seen) - by_blocks)
    of_sides = [np.flatnonzero((sides.later == side) & seen) for side in (False, True)]
    sets = [(size[here], by_noise[here], number) for here, number in zip(of_sides, day.sessions, strict=True)]
    wandering = estimate_wandering(sets, day.step)
    # What is taken from a distribution, or is known whatever the runs say, has no degrees of freedom to count.
    of_runs = np.where(by_runs > wandering.variance, by_runs**2 / (free + PRIOR_DOF), 0.0)
    estimated = by_blocks**2 / max(len(score) - 1.0, 1.0) + of_runs
    variance = by_blocks + np.maximum(by_runs, wandering.variance) + day.error**2
    dof = variance**2 / (estimated + 1e-300)
    k = len(beta)
    p_value = min(1.0, asked * float(wandering.weight @ fisher.sf(1.0 / (k * variance), k, dof)))
    reach = _quantile(variance, dof, wandering.weight) / 1.96
    error = float(np.sqrt(wandering.weight @ variance))
    widening = reach / float(np.sqrt(max(by_blocks, 1e-300)))
    return Standing(p_value, error, float(spread), max(1.0, widening), day.error)


def _quantile(variance: Float[Array, " m"], dof: Float[Array, " m"], weight: Float[Array, " m"]) -> float:
    """Where 97.5 % of a mixture of Student's distributions lie below."""

    def above(x: float) -> float:
        return float(weight @ student.sf(x / np.sqrt(variance), dof)) - 0.025

    far = float(np.max(student.ppf(0.975, dof) * np.sqrt(variance)))
    return float(brentq(above, 0.0, far * (1.0 + 1e-9)))


def _by_block(
    switched: Switched, model: Projection, group: Group, beta: Float[Array, " k"]
) -> tuple[Float[Array, " B"], Float[Array, " B"]]:
    """In each block the product of the effect, of the change's size and in all runs, with what is left; its square."""
    evidence, columns = switched.evidence, switched.in_all_runs(group)
    weights = residual_weights(evidence, model)
    blocks = len(evidence.fold_of_block)
    score, power = np.zeros((2, blocks))
    for j in group.acts_on(evidence.layout.n):
        local = evidence.layout.local[j]
        at = np.array([evidence.layout.places[j][int(column)] for column in columns])
        own = np.zeros(len(local))
        own[at] = beta
        seen = evidence.times(j, own)
        score += seen @ weights[local]
        power += seen @ own
    return score, np.maximum(power, 0.0)


def _noise(left: Float[Array, " B"], power: Float[Array, " B"]) -> float:
    """By how much blocks of one run vary more than whitened noise would."""
    return max(1.0, float(left @ left) / max(float(power.sum()), 1e-300))


def _component(
    size: Float[Array, " R"],
    variance: Float[Array, " R"],
    power: Float[Array, " R"],
    sides: Sides,
    seen: Array,
) -> tuple[float, float, float]:
    """Spread from run to run, its degrees of freedom, and what share of its square the change's variance holds."""
    excess, free, scale, share = 0.0, 0, 0.0, 0.0
    for side in (False, True):
        here: Int[Array, " r"] = np.flatnonzero((sides.later == side) & seen)
        if not len(here):
            continue
        beyond, unit = excess_over_noise(size[here], variance[here])
        excess, scale = excess + beyond, scale + unit
        free += len(here) - 1
        share += float(np.sum(power[here] ** 2) / np.sum(power[here]) ** 2)
    return float(np.sqrt(max(0.0, excess) / scale)) if scale > 0.0 else 0.0, float(free), share


def _between_runs(size: Float[Array, " R"], power: Float[Array, " R"], sides: Sides, seen: Array) -> float:
    """Variance of the difference of both sets' means by how runs differ, noise and all.

    Noise that lasts longer than a block, as a torque reading's slow part does, is alike in a run's blocks: they count
    it as known, and only whole runs tell how large it is. Where it is short, both agree.
    """
    found = 0.0
    for side in (False, True):
        here: Int[Array, " r"] = np.flatnonzero((sides.later == side) & seen)
        if len(here) < 2:
            continue
        share = power[here] / power[here].sum()
        apart = share * (size[here] - share @ size[here])
        found += float(np.sum(apart**2)) * len(here) / (len(here) - 1)
    return found


def _information(switched: Switched, model: Projection, group: Group, beta: Float[Array, " k"]) -> Float[Array, "k k"]:
    """What the other columns leave of the change's own sums, from the model that holds it."""
    at = np.flatnonzero(np.isin(model.inside, group.columns))
    return np.asarray(np.linalg.inv(model.spread[np.ix_(at, at)]))
