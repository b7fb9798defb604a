"""Measured velocity against the positions' derivative."""

from __future__ import annotations

import numpy as np

from ident.checks.angles import scale_angles
from ident.checks.filtered_run import compare_velocities
from ident.checks.report import issue_of
from ident.checks.settings import CLOCK as LIMIT
from ident.checks.time_base import DEGREES
from ident.recordings.recording import Recording, Session, TelemetryIssue


def mend_velocity(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Finds velocities that are not the positions' derivative.

    Converts degrees, and drops what can't be explained.
    """
    compared = compare_velocities(session)
    if compared is None:
        return session, []
    moving, slope, correlation = compared
    by_degrees = np.abs(slope / DEGREES - 1.0) < LIMIT.clock_spread
    in_degrees = moving & by_degrees & (correlation > LIMIT.clock_correlation)
    if moving.any() and in_degrees[moving].all():
        runs = [_with_velocity_in_radians(run) for run in session.runs]
        issue = issue_of("velocity_degrees", session, in_degrees)
        return session.replace(runs=runs), [issue]
    of_degrees = np.abs(slope * DEGREES - 1.0) < LIMIT.clock_spread
    position_degrees = of_degrees & (correlation > 0.95)
    if moving.any() and position_degrees[moving].all():
        every = np.ones(len(session.joints), dtype=bool)
        converted = scale_angles(session, 1.0 / DEGREES, every, False)
        return converted, [issue_of("position_degrees", session, moving)]
    off = (slope < LIMIT.slope_low) | (slope > LIMIT.slope_high)
    bad = moving & ((correlation < LIMIT.correlation) | off)
    if not bad.any():
        return session, []
    worst = int(np.argmin(np.where(bad, correlation, np.inf)))
    issue = issue_of("velocity", session, bad, worst, slope=slope, correlation=correlation)
    runs = [run.replace(velocity=None) for run in session.runs]
    return session.replace(runs=runs), [issue]


def _with_velocity_in_radians(run: Recording) -> Recording:
    """A run whose velocity, if it has any, was in degrees a second."""
    if run.velocity is None:
        return run
    return run.replace(velocity=run.velocity / DEGREES)
