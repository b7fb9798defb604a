"""Time: does it increase, does it stop, does it tremble?"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.checks.report import Findings
from ident.recordings.recording import Recording, Session, Severity, TelemetryIssue, cut_before

# Rows dropped for their time: a hiccup of the logger up to here, another clock beyond.
FEW_ROWS = 0.01
MOST_RESTARTS = 20
# A gap is longer than any jitter (five intervals) and too long to be bridged (an arm's motion changes in 50 ms).
GAP_INTERVALS, GAP_S = 5.0, 0.05
SHORTEST_PIECE_S, SHORTEST_PIECE = 0.5, 30
# A leap of the clock is no pause: longer than this many intervals, and than this many times the whole run.
JUMP_INTERVALS, JUMP_RUNS = 1e5, 10.0
# Spread of the intervals (1st to 99th percentile) in medians, from which sampling is told to be uneven.
JITTER = 0.1
# Positions that fit an even clock so much better (mean square) show that only the stamps tremble; stamps that are
# farther off than this many intervals show that samples are missing.
EVEN_CLOCK_GAIN, EVEN_CLOCK_OFF = 4.0, 2.0


def mend_order(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops repeated and late rows, and parts runs where the clock restarts inside a file."""
    dropped, restarted, fatal = Findings(session), Findings(session), Findings(session)
    runs: list[Recording] = []
    for run in session.runs:
        kept, late = drop_late_rows(run)
        steps = np.diff(run.time)
        restarts = np.flatnonzero(steps < 0)
        cells = np.column_stack([run.time[:, None], run.position, run.effort])
        repeated = int((cells[1:] == cells[:-1]).all(axis=1).sum())
        shortest = int(np.diff([0, *(restarts + 1), len(run)]).min())
        if not late:
            runs.append(run)
        elif late <= FEW_ROWS * len(run) or repeated == late:
            dropped.note(run, f"{late} of {len(run)} rows are repeated or late in time, dropped")
            runs.append(kept)
        elif 0 < len(restarts) <= MOST_RESTARTS and shortest >= SHORTEST_PIECE:
            first = run.time[restarts[0]]
            restarted.note(run, f"time falls back {len(restarts)} times, first after {first:.3f} s")
            runs += _cut(run, restarts + 1)
        else:
            fatal.note(run, f"{np.mean(steps <= 0):.0%} of the time steps are zero or negative")
            runs.append(kept)
    name, parted = "time_not_increasing", "; parted there, the pieces are taken as independent"
    issues = dropped.issues(name, "note", "", "none needed")
    issues += restarted.issues(name, "warning", parted, "record each run to a file of its own")
    remedy = "log the time of measurement in full resolution, or give sample_rate_hz in session.toml without a time"
    issues += fatal.issues(name, "fatal", "", remedy)
    return session.replace(runs=runs, common_clock=session.common_clock and not restarted.told), issues


def drop_late_rows(run: Recording) -> tuple[Recording, int]:
    """The rows whose time is later than that of all rows before, and the number of others."""
    time = run.time
    # A single stamp far ahead would make all later rows late: it goes first.
    ahead = np.zeros(len(time), dtype=bool)
    ahead[:1] = (time[:1] > time[1:2]) & (time[:1] > time[2:3]) if len(time) > SHORTEST_PIECE else False
    ahead[1:-1] = (time[1:-1] > time[2:]) & (time[2:] > time[:-2])
    peak = np.maximum.accumulate(np.where(ahead, -np.inf, time))
    keep = ~ahead & np.concatenate([[True], time[1:] > peak[:-1]])
    return (run if keep.all() else run.at(keep)), int((~keep).sum())


def _cut(run: Recording, rows: Array) -> list[Recording]:
    return [drop_late_rows(piece)[0] for piece in cut_before(run, rows)]


def mend_clock_jumps(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Parts runs where the clock leaps: an even grid over such a leap would be longer than any recording.

    A clock that is set while recording goes from seconds since power-on, or zero, to seconds since 1970.
    """
    found = Findings(session)
    for run in session.runs:
        steps = np.diff(run.time)
        usual = float(np.median(steps)) if len(steps) else 0.0
        jumps = np.flatnonzero(steps > max(JUMP_INTERVALS * usual, JUMP_RUNS * usual * len(run)))
        if not len(jumps) or usual <= 0.0:
            found.runs.append(run)
            continue
        pieces = [piece for piece in _cut(run, jumps + 1) if len(piece) >= SHORTEST_PIECE]
        lost = len(run) - sum(map(len, pieces))
        left = f", {lost} rows in pieces too short for use are dropped" if lost else ""
        found.note(run, f"the clock leaps {steps[jumps[0]]:.3g} s on after row {jumps[0] + 1}{left}")
        found.runs += pieces
    few = sum(map(len, found.runs)) >= (1.0 - FEW_ROWS) * session.samples
    severity: Severity = "fatal" if not found.runs else "note" if few else "warning"
    issues = found.issues("clock_jump", severity, "", "set the clock before recording")
    return (found.left() if found.runs else session), issues


def split_at_gaps(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Parts runs where samples are missing for longer than motion can be interpolated."""
    found = Findings(session)
    for run in session.runs:
        steps = np.diff(run.time)
        limit = max(GAP_INTERVALS * float(np.median(steps)), GAP_S) if len(steps) else np.inf
        gaps = np.flatnonzero(steps > limit)
        if not len(gaps):
            found.runs.append(run)
            continue
        pieces = [p for p in _cut(run, gaps + 1) if p.duration >= SHORTEST_PIECE_S and len(p) >= SHORTEST_PIECE]
        lost = 1.0 - sum(map(len, pieces)) / len(run)
        longest = gaps[np.argmax(steps[gaps])]
        what = f"{len(gaps)} gaps, the longest {steps[longest]:.3f} s after {run.time[longest]:.3f} s; parted there"
        found.note(run, what + (f", {lost:.0%} of the samples in pieces too short for use" if lost > 0 else ""))
        found.runs += pieces
    if not found.runs:
        return session, found.issues("time_gap", "fatal", "; nothing long enough is left", "record without pauses")
    few = sum(map(len, found.runs)) >= 0.9 * session.samples
    return found.left(), found.issues(
        "time_gap", "note" if few else "warning", "", "none needed; look for lost messages"
    )


def mend_jitter(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Tells uneven sampling; where only the stamps are uneven and not the sampling, evens them out."""
    told, mended, runs = Findings(session), Findings(session), list[Recording]()
    worst: dict[str, float] = {}
    for run in session.runs:
        steps = np.diff(run.time)
        low, middle, high = np.percentile(steps, [1, 50, 99]) if len(steps) >= SHORTEST_PIECE else (0.0, 0.0, 0.0)
        if high - low > JITTER * middle:
            what = f"intervals of {steps.min() * 1e3:.1f} to {steps.max() * 1e3:.1f} ms, median {middle * 1e3:.1f} ms"
            even, worst[run.name] = even_clock(run), float(steps.max())
            (told if even is None else mended).note(run, what)
            run = run if even is None else run.replace(time=even)
        runs.append(run)
    for one in (told, mended):
        one.told.sort(key=lambda seen: worst[seen[0]], reverse=True)
    issues = told.issues("jitter", "note", "; the stamps are used as they are", "none needed")
    evened = "; positions fit an even clock better, which replaces the stamps"
    return session.replace(runs=runs), issues + mended.issues("jitter", "note", evened, "stamp samples when measured")


def even_clock(run: Recording) -> Float[Array, " T"] | None:
    """An even clock that fits the positions better than the stamps do, if there is one.

    A receiver stamps even samples unevenly; then positions are smooth over the sample's number and not over time.
    """
    numbers = np.arange(len(run))
    slope, start = np.polyfit(numbers, run.time, 1)
    even = start + slope * numbers
    if np.abs(run.time - even).max() > EVEN_CLOCK_OFF * slope:
        return None  # samples are missing: the number does not tell the time
    moving = run.position.std(axis=0) > 1e-3
    if not moving.any():
        return None
    q = run.position[:, moving] / run.position[:, moving].std(axis=0)
    return even if roughness(run.time, q) > EVEN_CLOCK_GAIN * roughness(even, q) else None


def roughness(time: Float[Array, " T"], q: Float[Array, "T n"]) -> float:
    """Mean square distance of samples from the cubic through their four neighbours."""
    offsets = [time[i : len(time) - 4 + i] - time[2:-2] for i in (0, 1, 3, 4)]
    estimate = np.zeros_like(q[2:-2])
    for i, row in zip(range(4), (0, 1, 3, 4), strict=True):
        others = [offsets[k] for k in range(4) if k != i]
        weight = np.prod([-other / (offsets[i] - other) for other in others], axis=0)
        estimate += weight[:, None] * q[row : len(q) - 4 + row]
    return float(np.mean((q[2:-2] - estimate) ** 2))
