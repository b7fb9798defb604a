"""Time: does it increase, does it stop, does it tremble?

Measured velocity against the positions' derivative; the time base; commands that pose as
measurements.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Float
from ident.checks.angles import scale_angles
from ident.checks.effort import States, collect_states, fit_signed
from ident.checks.filtered_run import CLOCK as LIMIT
from ident.checks.filtered_run import clock_factor, compare_velocities
from ident.checks.report import Findings, issue_of
from ident.recordings.recording import Recording, Session, Severity, TelemetryIssue, cut_before
from ident.robot.arm import ArmModel

DEGREES = math.degrees(1.0)  # a radian
# Neighbours of a sample through which a cubic goes, as rows of five.
NEIGHBOURS = (0, 1, 3, 4)
# Stretches of which one is left out at a time, where a ratio of inertia has to be sure.
STRETCHES = 8


class Order(NamedTuple):
    """Where a run's time does not increase."""

    repeated: int  # rows that repeat the one before, time included
    restarts: Array  # rows before which time falls back
    shortest: int  # rows of the shortest piece between these

    @classmethod
    def of(cls, run: Recording) -> Order:
        """Looks at all rows of a run."""
        restarts = np.flatnonzero(np.diff(run.time) < 0)
        cells = np.column_stack([run.time[:, None], run.position, run.effort])
        repeated = (cells[1:] == cells[:-1]).all(axis=1)
        edges = [0, *(restarts + 1), len(run)]
        return cls(int(repeated.sum()), restarts, int(np.diff(edges).min()))

    @property
    def is_restarted(self) -> bool:
        """Whether the clock restarted a few times, with pieces of use between."""
        few = 0 < len(self.restarts) <= LIMIT.most_restarts
        return few and self.shortest >= LIMIT.shortest_piece


def mend_order(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops repeated and late rows, and parts runs where the clock restarts inside a file."""
    dropped = Findings(session)
    restarted = Findings(session)
    fatal = Findings(session)
    runs: list[Recording] = []
    for run in session.runs:
        in_order, late = drop_late_rows(run)
        order = Order.of(run)
        if not late:
            runs.append(run)
        elif late <= LIMIT.few_rows * len(run) or order.repeated == late:
            words = f"{late} of {len(run)} rows are repeated or late in time, dropped"
            dropped.note(run, words)
            runs.append(in_order)
        elif order.is_restarted:
            first = run.time[order.restarts[0]]
            words = f"time falls back {len(order.restarts)} times, first after {first:.3f} s"
            restarted.note(run, words)
            pieces = cut_before(run, order.restarts + 1)
            runs += [drop_late_rows(piece)[0] for piece in pieces]
        else:
            percent = 100.0 * np.mean(np.diff(run.time) <= 0)
            fatal.note(run, f"{percent:.0f} % of the time steps are zero or negative")
            runs.append(in_order)
    issues = dropped.issues("late") + restarted.issues("restarts") + fatal.issues("falls")
    common_clock = session.common_clock and not restarted.reported
    return session.replace(runs=runs, common_clock=common_clock), issues


def drop_late_rows(run: Recording) -> tuple[Recording, int]:
    """The rows whose time is later than that of all rows before, and the number of others."""
    time = run.time
    # A single stamp far ahead would make all later rows late: it goes first.
    ahead = np.zeros(len(time), dtype=bool)
    if len(time) > LIMIT.shortest_piece:
        ahead[:1] = (time[:1] > time[1:2]) & (time[:1] > time[2:3])
    ahead[1:-1] = (time[1:-1] > time[2:]) & (time[2:] > time[:-2])
    peak = np.maximum.accumulate(np.where(ahead, -np.inf, time))
    later = np.concatenate([[True], time[1:] > peak[:-1]])
    keep = ~ahead & later
    dropped = int((~keep).sum())
    return (run.at(keep) if dropped else run), dropped


def _parted(run: Recording, limit: float, shortest_s: float = 0.0) -> tuple[Array, list[Recording]]:
    """Rows before steps of time beyond a limit, and the pieces between that are of use.

    Args:
        run: The run, which comes back whole where there is no such step.
        limit: Longest step [s].
        shortest_s: Least duration of a piece [s].
    """
    rows = np.flatnonzero(np.diff(run.time) > limit)
    if not len(rows):
        return rows, [run]
    usable = []
    for piece in cut_before(run, rows + 1):
        in_order, _ = drop_late_rows(piece)
        if len(in_order) >= LIMIT.shortest_piece and in_order.duration >= shortest_s:
            usable.append(in_order)
    return rows, usable


def _samples(runs: list[Recording]) -> int:
    """Samples of some runs together."""
    return sum(len(run) for run in runs)


def _longest_usual_step(run: Recording) -> float:
    """The longest step of time that is no leap of the clock [s]."""
    usual = run.sample_interval if len(run) > 1 else 0.0
    if usual <= 0.0:
        return np.inf
    return usual * max(LIMIT.jump_intervals, LIMIT.jump_runs * len(run))


def mend_clock_jumps(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Parts runs where the clock leaps.

    An even grid over such a leap would be longer than any recording. A clock that is set while
    recording goes from seconds since power-on, or zero, to seconds since 1970.
    """
    findings = Findings(session)
    for run in session.runs:
        jumps, pieces = _parted(run, _longest_usual_step(run))
        findings.runs += pieces
        if not len(jumps):
            continue
        row = jumps[0]
        words = f"the clock leaps {np.diff(run.time)[row]:.3g} s on after row {row + 1}"
        lost = len(run) - _samples(pieces)
        if lost:
            words += f", {lost} rows in pieces too short for use are dropped"
        findings.note(run, words)
    if not findings.runs:
        return session, findings.issues("leap", "fatal")
    few_lost = _samples(findings.runs) >= (1.0 - LIMIT.few_rows) * session.samples
    severity: Severity = "note" if few_lost else "warning"
    return findings.left(), findings.issues("leap", severity)


def _longest_bridged_step(run: Recording) -> float:
    """The longest step over which motion can be interpolated [s]."""
    if len(run) <= 1:
        return np.inf
    return max(LIMIT.gap_intervals * run.sample_interval, LIMIT.gap_s)


def split_at_gaps(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Parts runs where samples are missing for longer than motion can be interpolated."""
    findings = Findings(session)
    for run in session.runs:
        gaps, pieces = _parted(run, _longest_bridged_step(run), LIMIT.shortest_piece_s)
        findings.runs += pieces
        if not len(gaps):
            continue
        steps = np.diff(run.time)[gaps]
        start = run.time[gaps[np.argmax(steps)]]
        words = (
            f"{len(gaps)} gaps, the longest {steps.max():.3f} s after {start:.3f} s; parted there"
        )
        lost = 1.0 - _samples(pieces) / len(run)
        if lost > 0:
            percent = 100.0 * lost
            words += f", {percent:.0f} % of the samples in pieces too short for use"
        findings.note(run, words)
    if not findings.runs:
        return session, findings.issues("pauses")
    few_lost = _samples(findings.runs) >= 0.9 * session.samples
    severity: Severity = "note" if few_lost else "warning"
    return findings.left(), findings.issues("gap", severity)


def _is_uneven(steps: Float[Array, " T"]) -> bool:
    """Whether a run's steps of time differ by more than a usual clock's do."""
    if len(steps) < LIMIT.shortest_piece:
        return False
    low, middle, high = np.percentile(steps, [1, 50, 99])
    return bool(high - low > LIMIT.jitter * middle)


def mend_jitter(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Tells uneven sampling; where only the stamps are uneven, evens them out."""
    reported = Findings(session)
    mended = Findings(session)
    runs: list[Recording] = []
    longest: dict[str, float] = {}
    for run in session.runs:
        steps = np.diff(run.time)
        if not _is_uneven(steps):
            runs.append(run)
            continue
        shortest_ms = steps.min() * 1e3
        longest_ms = steps.max() * 1e3
        middle_ms = np.percentile(steps, 50) * 1e3
        words = f"intervals of {shortest_ms:.1f} to {longest_ms:.1f} ms, median {middle_ms:.1f} ms"
        longest[run.name] = float(steps.max())
        even = even_clock(run)
        if even is None:
            reported.note(run, words)
            runs.append(run)
        else:
            mended.note(run, words)
            runs.append(run.replace(time=even))
    for findings in (reported, mended):
        findings.reported.sort(key=lambda noted: longest[noted[0]], reverse=True)
    return session.replace(runs=runs), reported.issues("jitter") + mended.issues("evened")


def even_clock(run: Recording) -> Float[Array, " T"] | None:
    """An even clock [s] that fits the positions better than the stamps do, if there is one.

    A receiver stamps even samples unevenly; then positions are smooth over the sample's number and
    not over time.
    """
    numbers = np.arange(len(run))
    slope, start = np.polyfit(numbers, run.time, 1)
    even = start + slope * numbers
    if np.abs(run.time - even).max() > LIMIT.even_clock_off * slope:
        return None  # samples are missing: the number does not tell the time
    moving = run.position.std(axis=0) > 1e-3
    if not moving.any():
        return None
    q = run.position[:, moving] / run.position[:, moving].std(axis=0)
    is_better = roughness(run.time, q) > LIMIT.even_clock_gain * roughness(even, q)
    return even if is_better else None


def roughness(time: Float[Array, " T"], q: Float[Array, "T n"]) -> float:
    """Mean square distance of samples from the cubic through their four neighbours.

    Args:
        time: Stamps of the samples.
        q: The samples; the result is in the square of their unit.
    """
    middle = slice(2, -2)
    offsets = [time[row : len(time) - 4 + row] - time[middle] for row in NEIGHBOURS]
    estimate = np.zeros_like(q[middle])
    for row, offset in zip(NEIGHBOURS, offsets, strict=True):
        # Lagrange's weight of this neighbour in the middle.
        factors = [-other / (offset - other) for other in offsets if other is not offset]
        weight = np.prod(factors, axis=0)
        estimate += weight[:, None] * q[row : len(q) - 4 + row]
    return float(np.mean((q[middle] - estimate) ** 2))


def _usual_interval(session: Session) -> float:
    """Median over the runs of the time between samples [s]; 0 where no run has two samples."""
    intervals = [run.sample_interval for run in session.runs if len(run) > 1]
    return float(np.median(intervals or [0.0]))


def mend_time_unit(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Accepts time in whole nanoseconds or microseconds, as drivers stamp it, and tells."""
    times = [run.time for run in session.runs if len(run) > 1]
    interval = _usual_interval(session)
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
    rate = 1.0 / _usual_interval(session)
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

    The session is corrected for the checks that follow; a fit is refused.
    """
    rate = _rate_of_clock(session)
    if rate is not None:
        words = f"measured velocity is {rate:.4g} times the positions' derivative"
        return _tell_factor(session, rate, words)
    interval = _usual_interval(session)
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
    rate = 1.0 / _usual_interval(scaled)
    unit = 1.0 / factor
    return scaled, [issue_of("clock_rate", session, reason=reason, rate=rate, unit=unit)]


def check_clock(session: Session, arm: ArmModel) -> list[TelemetryIssue]:
    """Time base by the model: inertial torque against gravity's, speeds against the URDF's limits.

    Where speeds exceed their limits, either the clock or the limits are wrong. A measured velocity
    confirms the clock; without one, inertia tells which of both leaves it nearer to the model's.
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


def check_rate(session: Session) -> list[TelemetryIssue]:
    """Tells what slow sampling leaves out."""
    interval = _usual_interval(session)
    if interval * LIMIT.slow_hz <= 1.0 + LIMIT.jitter:
        return []
    # The checks' filter passes a fifth of the rate.
    band = 0.2 / interval
    milliseconds = 1e3 * interval
    rate = 1.0 / interval
    return [issue_of("slow_sampling", session, rate=rate, band=band, interval=milliseconds)]


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
