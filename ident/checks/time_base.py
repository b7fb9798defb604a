"""The unit and the rate of time, by velocities, by the model's inertia and by limits of speed."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from ident.checks.effort import States, collect_states, fit_signed
from ident.checks.filtered_run import clock_factor, compare_velocities
from ident.checks.report import Findings, issue_of
from ident.checks.sampling import usual_interval
from ident.checks.settings import CLOCK as LIMIT
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel

DEGREES = math.degrees(1.0)  # a radian

# Stretches of which one is left out at a time, where a ratio of inertia has to be sure.
STRETCHES = 8


def mend_time_unit(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Converts time in whole nanoseconds or microseconds, as drivers stamp it, to seconds.

    Returns:
        The session, its clock from 0 [s], and an issue that tells it; as it was, and none, for any
        other time.
    """
    times = [run.time for run in session.runs if len(run) > 1]
    interval = usual_interval(session)
    whole = all(np.array_equal(time, np.floor(time)) for time in times)
    if interval < LIMIT.least_ticks or not whole:
        return session, []
    are_micro = interval < 2e5 and times[0].max() < 1e17
    unit = 1e-6 if are_micro else 1e-9
    name = "microseconds" if are_micro else "nanoseconds"
    start = times[0][0]
    runs = [run.replace(time=(run.time - start) * unit) for run in session.runs]
    issue = issue_of("whole_ticks", session, unit=name, interval=interval)
    return session.replace(runs=runs), [issue]


def check_stated_rate(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Holds the rate that session.toml states against the time column, which is what is used.

    A column in another unit of time is told by `mend_time_base`.

    Returns:
        The session as it was, and an issue where a rate is stated.
    """
    contradicted = Findings(session)
    stated = None
    for run in session.runs:
        if run.stated_rate_hz is None or len(run) < LIMIT.shortest_piece:
            continue
        stated = run.stated_rate_hz
        rate = 1.0 / run.sample_interval if run.sample_interval > 0.0 else np.inf
        if run.sample_interval > LIMIT.slowest_interval_s:
            continue
        if abs(stated / rate - 1.0) > LIMIT.clock_off:
            contradicted.note(run, f"{rate:.4g} Hz")
    if stated is None:
        return session, []
    if contradicted.reported:
        return session, contradicted.issues("rate_contradicted", stated=stated)
    rate = 1.0 / usual_interval(session)
    return session, [issue_of("rate_beside_time", session, stated=stated, rate=rate)]


def _rate_of_clock(session: Session) -> float | None:
    """How many times too fast time runs, by measured velocities; None where it runs as it should.

    All joints have to say so by one factor, and not by that of degrees, which are no clock.
    """
    factor = clock_factor(session)
    if factor is None or abs(factor - 1.0) <= LIMIT.clock_off:
        return None
    from_degrees = min(abs(factor / DEGREES - 1.0), abs(factor * DEGREES - 1.0))
    return None if from_degrees < LIMIT.clock_spread else factor


def _unit_of(interval: float) -> float:
    """Unit of time [s] in which an interval is one between 0.2 ms and 0.2 s: ms, us or ns."""
    if interval < 200.0:
        return 1e-3
    return 1e-6 if interval < 2e5 else 1e-9


def mend_time_base(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Finds time that runs at another rate.

    Returns:
        The session with a corrected clock, for the checks that follow, and a fatal issue; as it
        was, and none, where the rate is right.
    """
    rate = _rate_of_clock(session)
    if rate is not None:
        words = f"measured velocity is {rate:.4g} times the positions' derivative"
        return _tell_factor(session, rate, words)
    interval = usual_interval(session)
    words = f"the median interval is {interval:.4g} s"
    if interval > LIMIT.slowest_interval_s:
        return _tell_factor(session, 1.0 / _unit_of(interval), words)
    if 0.0 < interval < LIMIT.fastest_interval_s:
        return session, [issue_of("clock_fast", session, reason=words, rate=1.0 / interval)]
    return session, []


def _tell_factor(
    session: Session, factor: float, reason: str
) -> tuple[Session, list[TelemetryIssue]]:
    """The session with its time divided by the factor, and the issue."""
    runs = [run.replace(time=run.time / factor) for run in session.runs]
    scaled = session.replace(runs=runs)
    rate = 1.0 / usual_interval(scaled)
    unit = 1.0 / factor
    return scaled, [issue_of("clock_rate", session, reason=reason, rate=rate, unit=unit)]


def check_clock(session: Session, arm: ArmModel) -> list[TelemetryIssue]:
    """Time base by the model: inertial torque against gravity's, speeds against the URDF's limits.

    Where speeds exceed their limits, either the clock or the limits are wrong. A measured velocity
    confirms the clock; without one, inertia tells which of both leaves it nearer to the model's.

    Returns:
        One issue at the most.
    """
    states = collect_states(session, arm)
    if states is None:
        return []
    top_speed = np.percentile(np.abs(states.dq), 99, axis=0)
    excess = top_speed / arm.known_limits.speed
    worst = int(np.argmax(excess))
    beyond = np.flatnonzero(excess > LIMIT.over_limit)
    if compare_velocities(session) is not None:
        if not len(beyond):
            return []
        return [issue_of("speed_limits", session, beyond, worst, excess=excess)]
    ratio = _inertia_ratio(states)
    if len(beyond):
        # A clock that makes all so much too fast makes the model's inertia too large by the square.
        slower = (ratio or 1.0) * float(excess.max()) ** 2
        confirmed = ratio is not None and abs(math.log(ratio)) < abs(math.log(slower))
        key = "speed_limits" if confirmed else "clock_by_speed"
        return [issue_of(key, session, beyond, worst, excess=excess)]
    if ratio is None or LIMIT.inertia_low < ratio < LIMIT.inertia_high:
        return []
    return [issue_of("clock_by_inertia", session, ratio=ratio, stretch=math.sqrt(ratio))]


def is_clock_wrong(session: Session, arm: ArmModel) -> bool:
    """Whether inertia says that the clock is wrong.

    Only joints are asked whose torque follows the model as it stands.
    """
    states = collect_states(session, arm)
    if states is None or _inertia_ratio(states) is None:
        return False
    return any(issue.severity == "fatal" for issue in check_clock(session, arm))


def _inertia_ratio(states: States) -> float | None:
    """Inertial torque over the model's where gravity's is one: the median of the joints that tell.

    None where no loaded joint surely tells it.
    """
    loaded = states.gravity.std(axis=0) > LIMIT.loaded_Nm
    ratios = []
    for joint in np.flatnonzero(states.heavy & states.moving & loaded):
        ratio = _sure_ratio(states, int(joint))
        if ratio is not None:
            ratios.append(ratio)
    return float(np.median(ratios)) if ratios else None


def _sure_ratio(states: States, joint: int) -> float | None:
    """a_i / a_g of one joint if every leave-one-piece-out fit is on the same side of the limits."""
    count = len(states.q)
    edges = np.linspace(0, count, STRETCHES + 1).astype(int)
    ratios = []
    for start, end in pairwise(edges):
        rows = np.r_[0:start, end:count]
        fit = fit_signed(states, joint, 1.0, rows)
        if fit.gravity <= 0.0 or fit.explained < 0.8:
            return None
        ratios.append(fit.inertia / fit.gravity)
    if min(ratios) <= 0.0:
        return None
    inside = {LIMIT.inertia_low < ratio < LIMIT.inertia_high for ratio in ratios}
    # Inertia that vanishes against gravity says nothing about time.
    ratio = float(np.median(ratios))
    inertial = ratio * states.inertial[:, joint].std()
    is_visible = inertial > LIMIT.visible_inertia * states.gravity[:, joint].std()
    return ratio if is_visible and len(inside) == 1 else None
