"""Does a change stand out against what runs of one set differ by among themselves?

An effect of size one is what was found to have come with the later set. Its variance V is that by blocks, or what a law
gains by between sets that are none (`permuted_sets`), whichever is more. With ν degrees of freedom for V, its k
coefficients have the log likelihood ratio

    Λ = ½ (ν + k) log(1 + 1 / (ν V)),

against which stands what it costs to be one of so many, and as wide beforehand as N samples are less sure than V:

    log odds = Λ − ½ k log(N V₀ / V) − log(points of its grid) − log(effects),    V₀ by the noise model alone.

Friction is not free from run to run: it is a random walk, as gears warm. What it goes from a run to the next adds up:
a session of R runs that set out where the last one did has a mean that is off by R / 3 of such a step's variance.

Source: Satterthwaite 1946 (degrees of freedom).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import f as fisher
from scipy.stats import t as student

from ident.diagnosis.change.friction_drift import DayToDay
from ident.diagnosis.change.permuted_sets import NullVariance


@dataclass(frozen=True)
class Standing:
    """How a change stands against the runs' own differences.

    Attributes:
        p_value: For one change.
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
    daily: float
    of_the_runs: bool
    nats: float
    looser: float

    @property
    def of_the_day(self) -> bool:
        """Whether the error is mostly what days differ by."""
        return self.daily > np.sqrt(0.5) * self.error


def measure_standing(
    gain: float, k: int, blocks: tuple[float, float], null: NullVariance, day: DayToDay, counts: tuple[int, int]
) -> Standing:
    """Holds a change against the runs.

    Args:
        gain: Squares of whitened noise that it explains.
        k: Number of its coefficients.
        blocks: Variance of its size by blocks, as a share of its square, and their number.
        null: By how much more than by noise it gains between sets that are none.
        day: What it may differ by though nothing was done.
        counts: Runs of either set.
    """
    if not gain > 0.0:  # of a size that is zero nothing is seen
        return Standing(1.0, np.inf, 0.0, 1.0, day.error, False, 0.0, 0.0)
    by_blocks, by_runs, walk = blocks[0], max(0.0, null.ratio / gain - blocks[0]), day.walk(counts)
    # What is taken from a distribution, or is known whatever the runs say, has no degrees of freedom to count.
    estimated = by_blocks**2 / max(blocks[1] - 1.0, 1.0) + (by_runs**2 / null.freedom if by_runs > walk else 0.0)
    variance = by_blocks + max(by_runs, walk) + day.error**2
    dof = variance**2 / (estimated + 1e-300)
    error = float(np.sqrt(variance))
    return Standing(
        p_value=float(fisher.sf(1.0 / (k * variance), k, dof)),
        error=error,
        spread=float(np.sqrt(by_runs / sum(1.0 / count for count in counts))),
        widening=max(1.0, float(student.ppf(0.975, dof)) / 1.96 * error / float(np.sqrt(max(by_blocks, 1e-300)))),
        daily=day.error,
        of_the_runs=variance > 2.0 * by_blocks,
        nats=float(0.5 * (dof + k) * np.log1p(1.0 / (max(dof, 1e-9) * variance))),
        looser=float(np.log(max(variance * gain, 1.0))),
    )
