"""The motion and torque of a run as the checks see them.

Evenly sampled, low-passed without phase, thinned out.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.checks.settings import CLOCK
from ident.checks.settings import FILTER as LIMIT
from ident.motion.filter import design_lowpass, filter_both_ways
from ident.recordings.recording import Recording, Session

# Samples by which both ends are extended: three times the filter's own.
PADDING = 3 * (LIMIT.filter_order + 1)
# Half a dozen checks ask for the same motion of a run, which never changes: it is kept for as long
# as the run is.
_KEPT: WeakKeyDictionary[Recording, FilteredRun] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class FilteredRun:
    """Low-passed motion of a run on an even grid, shapes (T, n)."""

    q: Float[Array, "T n"]  # position and its derivatives [rad, rad/s, rad/s²]
    dq: Float[Array, "T n"]
    ddq: Float[Array, "T n"]
    tau: Float[Array, "T n"]  # measured torque through the same filter [N m]
    # Measured velocity through the same filter [rad/s]; None where there is none.
    dq_measured: Float[Array, "T n"] | None
    interval: float  # time between states [s]


def filter_run(run: Recording) -> FilteredRun | None:
    """Brings a run to an even grid, low-passes it without phase and thins it out.

    Its cells must be finite.

    Returns:
        The motion without the filter's transients, or None where the run is too short to have any.
    """
    if run in _KEPT:
        return _KEPT[run]
    if len(run) < LIMIT.least_samples or run.duration <= 0.0:
        return None
    interval = run.sample_interval
    if not interval > 0.0 or run.duration > LIMIT.most_grid * interval * len(run):
        return None  # the clock leaps or falls: nothing even lies over it
    cutoff = min(LIMIT.cutoff_hz, 0.2 / interval)  # lower where the sampling is too slow for it
    grid = np.arange(run.time[0], run.time[-1], interval)
    edge = int(LIMIT.edge_periods / cutoff / interval)
    step = max(1, int(1.0 / (LIMIT.samples_per_period * cutoff * interval)))
    if len(grid) < 2 * edge + 8 * step or len(grid) < LIMIT.least_samples:
        return None
    sections = design_lowpass(LIMIT.filter_order, cutoff, 1.0 / interval)

    def smooth(values: Float[Array, "T n"]) -> Float[Array, "T n"]:
        even = np.column_stack([np.interp(grid, run.time, column) for column in values.T])
        return filter_both_ways(sections, even, PADDING)

    q = smooth(run.position)
    dq = np.gradient(q, interval, axis=0)
    ddq = np.gradient(dq, interval, axis=0)
    keep = slice(edge, len(grid) - edge, step)
    measured = None if run.velocity is None else smooth(run.velocity)[keep]
    effort = smooth(run.effort)
    _KEPT[run] = FilteredRun(
        q[keep],
        dq[keep],
        ddq[keep],
        effort[keep],
        measured,
        step * interval,
    )
    return _KEPT[run]


def compare_velocities(
    session: Session,
) -> tuple[Bool[Array, " n"], Float[Array, " n"], Float[Array, " n"]] | None:
    """Fits the measured velocity by slope · derivative of position, over all runs.

    Returns:
        By joint: whether it moves, the slope, and the correlation of both. None where no velocity
        was measured.
    """
    filtered = [filter_run(run) for run in session.runs]
    of_positions = []
    of_sensors = []
    for motion in filtered:
        if motion is not None and motion.dq_measured is not None:
            of_positions.append(motion.dq)
            of_sensors.append(motion.dq_measured)
    if not of_positions:
        return None
    derived = np.concatenate(of_positions)
    measured = np.concatenate(of_sensors)
    xx = (derived**2).mean(axis=0)
    xy = (derived * measured).mean(axis=0)
    yy = (measured**2).mean(axis=0)
    # A wrong time base scales the derivative, so moving is determined by either of the two.
    moving = np.maximum(np.sqrt(xx), np.sqrt(yy)) > LIMIT.moving_rad_s
    slope = xy / np.maximum(xx, 1e-300)
    correlation = xy / np.sqrt(np.maximum(xx * yy, 1e-300))
    return moving, slope, correlation


def clock_factor(session: Session) -> float | None:
    """By what factor all measured velocities are off the positions' derivative.

    Returns:
        The median over the moving joints. None where there is no velocity, fewer than two joints
        move, their factors differ, or their velocities are noise.
    """
    compared = compare_velocities(session)
    if compared is None:
        return None
    moving, slope, correlation = compared
    slopes = slope[moving]
    # One joint alone may have a velocity of another meaning.
    if len(slopes) < 2 or (correlation[moving] < CLOCK.clock_correlation).any():
        return None
    middle = float(np.median(slopes))
    if middle <= 0.0 or np.abs(slopes / middle - 1.0).max() > CLOCK.clock_spread:
        return None
    return middle
