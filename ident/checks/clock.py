"""Time: does it increase, does it stop, does it tremble?

Measured velocity against the positions' derivative; the time base; commands that pose as measurements.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from ident.arrays import Array, Float
from ident.checks.angles import scale_angles
from ident.checks.effort import States, collect_states, fit_signed
from ident.checks.filtered_run import CLOCK as LIMIT
from ident.checks.filtered_run import compare_velocities
from ident.checks.report import Findings, issue_of
from ident.recordings.recording import Recording, Session, Severity, TelemetryIssue, cut_before
from ident.robot.arm import ArmModel


def mend_order(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops repeated and late rows, and parts runs where the clock restarts inside a file."""
    dropped, restarted, fatal = Findings(session), Findings(session), Findings(session)
    runs: list[Recording] = []
    for run in session.runs:
        (kept, late), steps = drop_late_rows(run), np.diff(run.time)
        restarts = np.flatnonzero(steps < 0)
        cells = np.column_stack([run.time[:, None], run.position, run.effort])
        repeated = int((cells[1:] == cells[:-1]).all(axis=1).sum())
        shortest = int(np.diff([0, *(restarts + 1), len(run)]).min())
        if not late:
            runs.append(run)
        elif late <= LIMIT.few_rows * len(run) or repeated == late:
            dropped.note(run, f"{late} of {len(run)} rows are repeated or late in time, dropped")
            runs.append(kept)
        elif 0 < len(restarts) <= LIMIT.most_restarts and shortest >= LIMIT.shortest_piece:
            restarted.note(run, f"time falls back {len(restarts)} times, first after {run.time[restarts[0]]:.3f} s")
            runs += [drop_late_rows(piece)[0] for piece in cut_before(run, restarts + 1)]
        else:
            fatal.note(run, f"{100.0 * np.mean(steps <= 0):.0f} % of the time steps are zero or negative")
            runs.append(kept)
    issues = dropped.issues("late") + restarted.issues("restarts") + fatal.issues("falls")
    return session.replace(runs=runs, common_clock=session.common_clock and not restarted.reported), issues


def drop_late_rows(run: Recording) -> tuple[Recording, int]:
    """The rows whose time is later than that of all rows before, and the number of others."""
    time = run.time
    # A single stamp far ahead would make all later rows late: it goes first.
    ahead = np.zeros(len(time), dtype=bool)
    ahead[:1] = (time[:1] > time[1:2]) & (time[:1] > time[2:3]) if len(time) > LIMIT.shortest_piece else False
    ahead[1:-1] = (time[1:-1] > time[2:]) & (time[2:] > time[:-2])
    peak = np.maximum.accumulate(np.where(ahead, -np.inf, time))
    keep = ~ahead & np.concatenate([[True], time[1:] > peak[:-1]])
    return (run if keep.all() else run.at(keep)), int((~keep).sum())


def _parted(run: Recording, limit: float, shortest_s: float = 0.0) -> tuple[Array, list[Recording]]:
    """Steps of time beyond a limit, and the pieces between them that are long enough for use; the run without any."""
    rows = np.flatnonzero(np.diff(run.time) > limit)
    pieces = [drop_late_rows(piece)[0] for piece in cut_before(run, rows + 1)]
    usable = [one for one in pieces if len(one) >= LIMIT.shortest_piece and one.duration >= shortest_s]
    return rows, usable if len(rows) else [run]


def mend_clock_jumps(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Parts runs where the clock leaps: an even grid over such a leap would be longer than any recording.

    A clock that is set while recording goes from seconds since power-on, or zero, to seconds since 1970.
    """
    found = Findings(session)
    for run in session.runs:
        usual = run.sample_interval if len(run) > 1 else 0.0
        leap = usual * max(LIMIT.jump_intervals, LIMIT.jump_runs * len(run)) if usual > 0.0 else np.inf
        jumps, pieces = _parted(run, leap)
        found.runs += pieces
        if len(jumps):
            step, lost = np.diff(run.time)[jumps[0]], len(run) - sum(map(len, pieces))
            left = f", {lost} rows in pieces too short for use are dropped" if lost else ""
            found.note(run, f"the clock leaps {step:.3g} s on after row {jumps[0] + 1}{left}")
    few = sum(map(len, found.runs)) >= (1.0 - LIMIT.few_rows) * session.samples
    severity: Severity = "fatal" if not found.runs else "note" if few else "warning"
    return (found.left() if found.runs else session), found.issues("leap", severity)


def split_at_gaps(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Parts runs where samples are missing for longer than motion can be interpolated."""
    found = Findings(session)
    for run in session.runs:
        limit = max(LIMIT.gap_intervals * run.sample_interval, LIMIT.gap_s) if len(run) > 1 else np.inf
        gaps, pieces = _parted(run, limit, LIMIT.shortest_piece_s)
        found.runs += pieces
        if len(gaps):
            steps, lost = np.diff(run.time)[gaps], 1.0 - sum(map(len, pieces)) / len(run)
            where = f"the longest {steps.max():.3f} s after {run.time[gaps[np.argmax(steps)]]:.3f} s; parted there"
            short = f", {100.0 * lost:.0f} % of the samples in pieces too short for use" if lost > 0 else ""
            found.note(run, f"{len(gaps)} gaps, {where}{short}")
    if not found.runs:
        return session, found.issues("pauses")
    severity: Severity = "note" if sum(map(len, found.runs)) >= 0.9 * session.samples else "warning"
    return found.left(), found.issues("gap", severity)


def mend_jitter(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Tells uneven sampling; where only the stamps are uneven and not the sampling, evens them out."""
    reported, mended, runs = Findings(session), Findings(session), list[Recording]()
    worst: dict[str, float] = {}
    for run in session.runs:
        steps = np.diff(run.time)
        low, middle, high = np.percentile(steps, [1, 50, 99]) if len(steps) >= LIMIT.shortest_piece else (0.0, 0.0, 0.0)
        if high - low > LIMIT.jitter * middle:
            what = f"intervals of {steps.min() * 1e3:.1f} to {steps.max() * 1e3:.1f} ms, median {middle * 1e3:.1f} ms"
            even, worst[run.name] = even_clock(run), float(steps.max())
            (reported if even is None else mended).note(run, what)
            run = run if even is None else run.replace(time=even)
        runs.append(run)
    for one in (reported, mended):
        one.reported.sort(key=lambda seen: worst[seen[0]], reverse=True)
    return session.replace(runs=runs), reported.issues("jitter") + mended.issues("evened")


def even_clock(run: Recording) -> Float[Array, " T"] | None:
    """An even clock that fits the positions better than the stamps do, if there is one.

    A receiver stamps even samples unevenly; then positions are smooth over the sample's number and not over time.
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
    return even if roughness(run.time, q) > LIMIT.even_clock_gain * roughness(even, q) else None


def roughness(time: Float[Array, " T"], q: Float[Array, "T n"]) -> float:
    """Mean square distance of samples from the cubic through their four neighbours."""
    offsets = [time[i : len(time) - 4 + i] - time[2:-2] for i in (0, 1, 3, 4)]
    estimate = np.zeros_like(q[2:-2])
    for i, row in zip(range(4), (0, 1, 3, 4), strict=True):
        others = [offsets[k] for k in range(4) if k != i]
        weight = np.prod([-other / (offsets[i] - other) for other in others], axis=0)
        estimate += weight[:, None] * q[row : len(q) - 4 + row]
    return float(np.mean((q[2:-2] - estimate) ** 2))


def mend_time_unit(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Accepts time in whole nanoseconds or microseconds, as drivers stamp it, and tells."""
    times = [run.time for run in session.runs if len(run) > 1]
    interval = float(np.median([run.sample_interval for run in session.runs if len(run) > 1] or [0.0]))
    if interval < LIMIT.least_ticks or not all(np.array_equal(time, np.floor(time)) for time in times):
        return session, []
    unit, name = (1e-6, "microseconds") if interval < 2e5 and times[0].max() < 1e17 else (1e-9, "nanoseconds")
    scaled = session.replace(runs=[run.replace(time=(run.time - times[0][0]) * unit) for run in session.runs])
    return scaled, [issue_of("whole_ticks", session, unit=name, interval=interval)]


def mend_time_base(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Finds time that runs at another rate. The session is corrected for the checks that follow; a fit is refused."""
    interval = float(np.median([run.sample_interval for run in session.runs if len(run) > 1] or [0.0]))
    found = compare_velocities(session)
    if found is not None and found[0].any():
        moving, slope, correlation = found
        slopes, degrees = slope[moving], math.degrees(1.0)
        middle = float(np.median(slopes))
        if (correlation[moving] >= LIMIT.clock_correlation).all() and len(slopes) >= 2 and middle > 0.0:
            # By one factor, all of them, and not that of degrees, which are no clock.
            alike = np.abs(slopes / middle - 1.0).max() <= LIMIT.clock_spread
            in_degrees = min(abs(middle / degrees - 1.0), abs(middle * degrees - 1.0)) < LIMIT.clock_spread
            if abs(middle - 1.0) > LIMIT.clock_off and alike and not in_degrees:
                return _tell_factor(session, middle, "measured velocity is {:.4g} times the positions' derivative")
    if interval > LIMIT.slowest_interval_s or 0.0 < interval < LIMIT.fastest_interval_s:
        # An interval between 0.2 ms and 0.2 s, in ms, us or ns.
        unit = 1e-3 if interval < 200.0 else 1e-6 if interval < 2e5 else 1e-9
        factor = 1.0 / unit if interval > LIMIT.slowest_interval_s else 1.0
        return _tell_factor(session, factor, f"the median interval is {interval:.4g} s")
    return session, []


def _tell_factor(session: Session, factor: float, reason: str) -> tuple[Session, list[TelemetryIssue]]:
    """The session with its time divided by the factor, and the issue."""
    scaled = session.replace(runs=[run.replace(time=run.time / factor) for run in session.runs])
    rate = 1.0 / float(np.median([run.sample_interval for run in scaled.runs if len(run) > 1]))
    return scaled, [issue_of("clock_rate", session, reason=reason.format(factor), rate=rate)]


def check_clock(session: Session, arm: ArmModel) -> list[TelemetryIssue]:
    """Time base by the model: inertial torque on heavy joints against gravity's; the speeds against the URDF's limits.

    Where speeds exceed their limits, either the clock or the limits are wrong. A measured velocity confirms the clock;
    without one, inertia tells which of both leaves it nearer to the model's.
    """
    states = collect_states(session, arm)
    if states is None:
        return []
    excess = np.percentile(np.abs(states.dq), 99, axis=0) / arm.known_limits.speed
    worst = int(np.argmax(excess))
    beyond = np.flatnonzero(excess > LIMIT.over_limit)
    if compare_velocities(session) is not None:
        return [issue_of("speed_limits", session, beyond, worst, excess=excess)] if len(beyond) else []
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
    interval = float(np.median([run.sample_interval for run in session.runs if len(run) > 1] or [0.0]))
    if interval * LIMIT.slow_hz <= 1.0 + LIMIT.jitter:
        return []
    # The checks' filter passes a fifth of the rate.
    return [issue_of("slow_sampling", session, rate=1.0 / interval, band=0.2 / interval, interval=1e3 * interval)]


def is_clock_wrong(session: Session, arm: ArmModel) -> bool:
    """Whether inertia, of joints whose torque follows the model as it stands, says that the clock is wrong."""
    states = collect_states(session, arm)
    if states is None or _inertia_ratio(states) is None:
        return False
    return any(issue.severity == "fatal" for issue in check_clock(session, arm))


def _inertia_ratio(states: States) -> float | None:
    """Inertial torque over the model's where gravity's is one, the median of the loaded joints that surely tell it."""
    loaded = states.heavy & states.moving & (states.gravity.std(axis=0) > LIMIT.loaded_Nm)
    ratios = [ratio for j in np.flatnonzero(loaded) if (ratio := _sure_ratio(states, int(j))) is not None]
    return float(np.median(ratios)) if ratios else None


def _sure_ratio(states: States, joint: int) -> float | None:
    """a_i / a_g of one joint if every leave-one-piece-out fit is on the same side of the limits."""
    edges = np.linspace(0, len(states.q), 9).astype(int)
    ratios = []
    for start, end in pairwise(edges):
        rows = np.r_[0:start, end : len(states.q)]
        fit = fit_signed(states, joint, 1.0, rows)
        if fit.gravity <= 0.0 or fit.explained < 0.8:
            return None
        ratios.append(fit.inertia / fit.gravity)
    inside = [LIMIT.inertia_low < ratio < LIMIT.inertia_high for ratio in ratios]
    # Inertia that vanishes against gravity says nothing about time.
    ratio = float(np.median(ratios))
    visible = ratio * states.inertial[:, joint].std() > LIMIT.visible_inertia * states.gravity[:, joint].std()
    return ratio if visible and len(set(inside)) == 1 and min(ratios) > 0.0 else None


def mend_velocity(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Finds velocities that are not the positions' derivative; converts degrees, drops what can't be explained."""
    found, degrees = compare_velocities(session), math.degrees(1.0)
    if found is None:
        return session, []
    moving, slope, correlation = found
    in_degrees = moving & (np.abs(slope / degrees - 1.0) < LIMIT.clock_spread) & (correlation > LIMIT.clock_correlation)
    if moving.any() and in_degrees[moving].all():
        runs = [one if one.velocity is None else one.replace(velocity=one.velocity / degrees) for one in session.runs]
        return session.replace(runs=runs), [issue_of("velocity_degrees", session, in_degrees)]
    position_degrees = (np.abs(slope * degrees - 1.0) < LIMIT.clock_spread) & (correlation > 0.95)
    if moving.any() and position_degrees[moving].all():
        converted = scale_angles(session, 1.0 / degrees, np.ones(len(session.joints), dtype=bool), False)
        return converted, [issue_of("position_degrees", session, moving)]
    bad = moving & ((correlation < LIMIT.correlation) | (slope < LIMIT.slope_low) | (slope > LIMIT.slope_high))
    if not bad.any():
        return session, []
    worst = int(np.argmin(np.where(bad, correlation, np.inf)))
    issue = issue_of("velocity", session, bad, worst, slope=slope, correlation=correlation)
    return session.replace(runs=[run.replace(velocity=None) for run in session.runs]), [issue]
