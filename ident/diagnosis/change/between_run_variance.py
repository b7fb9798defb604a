"""Does a change stand out against what runs of one set differ by among themselves?

An effect of size one is what was found to have come with the later set. In each run r its size d_r about its set's mean
is estimated from what the model with the change leaves, with a variance v_r of its own by the noise. What the d_r of
one set differ by beyond that is a variance component of random effects,

    τ² = max(0, f (s² − 1)) / C,    s² = Σ (d − d̄)² / v / f,    f = Σ (R_s − 1),

and the change itself has the variance V = V_b + τ² (Σ_before w² + Σ_after w²), with V_b from blocks and w each run's
share of its set's information. With ν degrees of freedom for V, its k coefficients have the log likelihood ratio

    Λ = ½ (ν + k) log(1 + 1 / (ν V)),

against which stands what it costs to be one of so many, and as wide beforehand as N samples are less sure than V:

    log odds = Λ − ½ k log(N V₀ / V) − log(points of its grid) − log(effects),    V₀ by the noise model alone.

Three runs a set say little of s². But every other law has one of its own at the same joints, where the same model is
wrong: a scaled inverse chi² distribution of f₀ degrees of freedom about s₀² is fitted to all of them, and each s² is
drawn to it, (f₀ s₀² + f s²) / (f₀ + f).

Friction is not free from run to run: it is a random walk, as gears warm. What it goes from a run to the next,
x ~ N(0, q + v) with v by the noise of both, adds up, and a session of R runs that set out where the last one did has a
mean that is off by q R / 3. Five steps a set, in noise, leave q open by much: an estimate of zero says little. With a
scaled inverse chi² prior about what this arm's joints usually do, every q counts by how likely the steps are.

Source: DerSimonian and Laird 1986 (moment estimator of a variance component); Smyth 2004 (moderated variances, and how
their prior is fitted); Satterthwaite 1946 (degrees of freedom);
Gelman et al., Bayesian Data Analysis (scaled inverse chi²), for why the estimate alone is too sure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import digamma, logsumexp, polygamma
from scipy.stats import f as fisher
from scipy.stats import t as student

from ident.arrays import Array, Bool, Float, Int
from ident.diagnosis.change.friction_drift import SAME_DAY, DayToDay
from ident.diagnosis.change.paired_sums import PairedSums, Sides
from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.least_squares import Projection
from ident.diagnosis.regression.run_spread import excess_over_noise, residual_weights

# Degrees of freedom that a variance from runs has beside those of the runs: arms of one kind differ by little.
PRIOR_DOF = 2.0
# As many as other laws may lend: they are not independent of one another.
MOST_DOF = 20.0
# Points of the grid over q, and how far it goes to either side of what is usual, as a factor on q.
POINTS, REACH = 61, 1e4


@dataclass(frozen=True)
class Standing:
    """How a change stands against the runs' own differences.

    Attributes:
        p_value: For all changes asked.
        error: Standard deviation of its size, as a share of it.
        spread: Standard deviation from run to run of the effect, as a share of the change.
        widening: Factor on the half-widths of intervals that count the blocks' noise alone.
        daily: What of the error is there whatever the runs say, as one day differs from the next.
        of_the_runs: Whether the error is mostly what runs or days differ by, and not noise.
        nats: Log likelihood ratio against none.
        looser: Log of by how much its variance exceeds that of the noise model.
    """

    p_value: float
    error: float
    spread: float
    widening: float
    daily: float = 0.0
    of_the_runs: bool = False
    nats: float = 0.0
    looser: float = 0.0

    @property
    def of_the_day(self) -> bool:
        """Whether the error is mostly what days differ by."""
        return self.daily > np.sqrt(0.5) * self.error


def measure_standing(
    sums: PairedSums,
    sides: Sides,
    model: Projection,
    group: Group,
    beta: Float[Array, " k"],
    covariance: Float[Array, "k k"],
    asked: int,
    usual: UsualVariance,
    day: DayToDay = SAME_DAY,
) -> Standing:
    """Holds a change against the runs.

    Args:
        sums: The sums.
        sides: Which runs are of which set.
        model: The baseline with all named changes.
        group: The change.
        beta: Its scaled coefficients.
        covariance: Their covariance by blocks.
        asked: How many changes were asked for.
        usual: What runs differ by in other laws at the same joints.
        day: What it may differ by though nothing was done, as a share of it.
    """
    score, power = _by_block(sums, model, group, beta)
    sizes = _sizes_of_runs(score, power, sides)
    size, by_noise, seen = sizes.size, sizes.variance, sizes.seen
    spread, free, share = _component(sizes, sides, usual)
    # What the other columns leave of the change's own sums, from the model that holds it.
    at = np.flatnonzero(np.isin(model.inside, group.columns))
    along = np.linalg.inv(model.spread[np.ix_(at, at)]) @ beta
    if not float(beta @ along) > 0.0:  # of a size that is zero nothing is seen
        return Standing(1.0, np.inf, float(spread), 1.0, day.error, False, 0.0, 0.0)
    by_blocks = float(along @ covariance @ along) / float(beta @ along) ** 2
    by_runs = spread**2 * share
    of_sides = [np.flatnonzero((sides.later == side) & seen) for side in (False, True)]
    sets = [(size[here], by_noise[here], number) for here, number in zip(of_sides, day.sessions, strict=True)]
    wandering = estimate_random_walk(sets, day.step)
    # What is taken from a distribution, or is known whatever the runs say, has no degrees of freedom to count.
    of_runs = np.where(by_runs > wandering.variance, by_runs**2 / free, 0.0)
    estimated = by_blocks**2 / max(len(score) - 1.0, 1.0) + of_runs
    variance = by_blocks + np.maximum(by_runs, wandering.variance) + day.error**2
    dof = variance**2 / (estimated + 1e-300)
    k = len(beta)
    p_value = min(1.0, asked * float(wandering.weight @ fisher.sf(1.0 / (k * variance), k, dof)))
    peak = np.log(np.maximum(wandering.weight, 1e-300)) - 0.5 * k * np.log(variance)
    apart = peak - 0.5 * (dof + k) * np.log1p(1.0 / (np.maximum(dof, 1e-9) * variance))
    nats = float(logsumexp(peak) - logsumexp(apart))
    looser = float(np.log(max(np.sum(wandering.weight * variance) * float(beta @ along), 1.0)))
    reach = _quantile(variance, dof, wandering.weight) / 1.96
    error = float(np.sqrt(wandering.weight @ variance))
    widening = reach / float(np.sqrt(max(by_blocks, 1e-300)))
    return Standing(
        p_value, error, float(spread), max(1.0, widening), day.error, error**2 > 2.0 * by_blocks, nats, looser
    )


def _quantile(variance: Float[Array, " m"], dof: Float[Array, " m"], weight: Float[Array, " m"]) -> float:
    """Where 97.5 % of a mixture of Student's distributions lie below."""

    def above(x: float) -> float:
        return float(weight @ student.sf(x / np.sqrt(variance), dof)) - 0.025

    far = float(np.max(student.ppf(0.975, dof) * np.sqrt(variance)))
    return float(brentq(above, 0.0, far * (1.0 + 1e-9)))


def _by_block(
    sums: PairedSums, model: Projection, group: Group, beta: Float[Array, " k"]
) -> tuple[Float[Array, " B"], Float[Array, " B"]]:
    """In each block the product of the effect, of the change's size and in all runs, with what is left; its square."""
    evidence, columns = sums.evidence, sums.in_all_runs(group)
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


@dataclass(frozen=True, eq=False)
class _RunSizes:
    """A change's size in each run about what the model has it be, as a share of it.

    Attributes:
        size: In each run.
        variance: Of each by noise, which blocks of one run show.
        power: Information about each.
        seen: Of which runs there is any.
    """

    size: Float[Array, " R"]
    variance: Float[Array, " R"]
    power: Float[Array, " R"]
    seen: Bool[Array, " R"]

    def between(self, sides: Sides) -> tuple[float, int, float]:
        """Squares of the sizes about their set's mean over their variances, degrees of freedom, and C."""
        squares, free, scale = 0.0, 0, 0.0
        for side in (False, True):
            here = np.flatnonzero((sides.later == side) & self.seen)
            if len(here):
                beyond, unit = excess_over_noise(self.size[here], self.variance[here])
                squares, free, scale = squares + beyond + len(here) - 1, free + len(here) - 1, scale + unit
        return squares, free, scale


def _sizes_of_runs(score: Float[Array, " B"], power: Float[Array, " B"], sides: Sides) -> _RunSizes:
    total, count = np.zeros((2, len(sides.later)))
    np.add.at(total, sides.run_of_block, score)
    np.add.at(count, sides.run_of_block, power)
    seen = count > 1e-9 * count.max(initial=1e-300)
    size = np.where(seen, total / np.where(seen, count, 1.0), 0.0)
    left = score - size[sides.run_of_block] * power
    # By how much blocks of one run vary more than whitened noise would.
    noise = max(1.0, float(left @ left) / max(float(power.sum()), 1e-300))
    return _RunSizes(size, noise / np.where(seen, count, 1.0), count, seen)


def _component(sizes: _RunSizes, sides: Sides, usual: UsualVariance) -> tuple[float, float, float]:
    """Spread from run to run, its degrees of freedom, and what share of its square the change's variance holds."""
    squares, free, scale = sizes.between(sides)
    if scale <= 0.0:
        return 0.0, usual.freedom, 0.0
    ratio = (usual.freedom * usual.ratio + squares) / (usual.freedom + free)
    share = 0.0
    for side in (False, True):
        power = sizes.power[(sides.later == side) & sizes.seen]
        share += float(np.sum(power**2) / max(np.sum(power) ** 2, 1e-300))
    return float(np.sqrt(max(0.0, free * (ratio - 1.0)) / scale)), usual.freedom + free, share


@dataclass(frozen=True)
class UsualVariance:
    """What runs of one set differ by in the laws of some joints: mean squares over what noise alone would give.

    Attributes:
        ratio: Their scale, one where runs differ by noise alone.
        freedom: Degrees of freedom that it is worth beside a law's own mean square.
    """

    ratio: float
    freedom: float


def measure_usual_variance(sums: PairedSums, sides: Sides, model: Projection, joints: Sequence[int]) -> UsualVariance:
    """What runs of one set differ by in all laws that act at some joints.

    Args:
        sums: The sums.
        sides: Which runs are of which set.
        model: The baseline with all named changes.
        joints: Where.
    """
    evidence, weights = sums.evidence, residual_weights(sums.evidence, model)
    kinds = {group.key: group for group in reversed(evidence.layout.groups)}.values()
    found, freedom = [], []
    for j in joints:
        local, places = evidence.layout.local[j], evidence.layout.places[j]
        left = evidence.times(j, weights[local])
        for group in kinds:
            column = places.get(int(sums.in_all_runs(group)[0]))
            if column is None:
                continue
            alone = np.zeros(len(local))
            alone[column] = 1.0
            power = np.maximum(evidence.times(j, alone)[:, column], 0.0)
            if power.sum() > 0.0:
                squares, free, _ = _sizes_of_runs(left[:, column], power, sides).between(sides)
                if free > 0:
                    found.append(max(squares, 1e-3 * free) / free)
                    freedom.append(free)
    return _fit_scaled_f(np.array(found), np.array(freedom))


def _fit_scaled_f(squares: Float[Array, " k"], freedom: Int[Array, " k"]) -> UsualVariance:
    """Scale and degrees of freedom of a prior of variances, by the moments of their logarithms."""
    if len(squares) < 3:
        return UsualVariance(1.0, PRIOR_DOF)
    logs = np.log(squares) - digamma(freedom / 2.0) + np.log(freedom / 2.0)
    mean, beyond = float(logs.mean()), float(logs.var(ddof=1) - np.mean(polygamma(1, freedom / 2.0)))
    if beyond <= float(polygamma(1, 0.5 * MOST_DOF)):
        half = 0.5 * MOST_DOF
    else:
        half = float(brentq(lambda x: float(polygamma(1, x)) - beyond, 1e-3, 0.5 * MOST_DOF))
    return UsualVariance(float(np.exp(mean + digamma(half) - np.log(half))), 2.0 * half)


@dataclass(frozen=True)
class RandomWalk:
    """What the difference of both sets' means may be off by.

    Attributes:
        variance: Its variance at each of some points.
        weight: How likely each is; they sum to one.
    """

    variance: Float[Array, " m"]
    weight: Float[Array, " m"]


NO_WALK = RandomWalk(np.zeros(1), np.ones(1))


def estimate_random_walk(
    sets: Sequence[tuple[Float[Array, " R"], Float[Array, " R"], int]], usual: float
) -> RandomWalk:
    """How likely each size of the random walk of friction is.

    Args:
        sets: Of each set the sizes of the change in its runs, in their order, their variances by the noise, and the
            number of sessions that the runs come from.
        usual: Standard deviation of a step as this arm's joints have it; 0 for what does not wander.
    """
    if not usual > 1e-100:  # its square is a number
        return NO_WALK
    steps = np.concatenate([np.diff(size) ** 2 for size, _, _ in sets])
    noise = np.concatenate([variance[1:] + variance[:-1] for _, variance, _ in sets])
    share = sum(len(size) / count / 3.0 / count for size, _, count in sets if len(size))
    q = usual**2 * np.geomspace(1.0 / REACH, REACH, POINTS)
    logs = -0.5 * PRIOR_DOF * (np.log(q) + usual**2 / q)
    of_steps = np.add.outer(q, noise)
    logs -= 0.5 * np.sum(np.log(of_steps) + steps / of_steps, axis=1)
    weight: Array = np.exp(logs - logs.max())
    return RandomWalk(q * share, weight / weight.sum())
