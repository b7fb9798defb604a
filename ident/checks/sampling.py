"""How evenly and how often samples come: stamps that tremble, and slow recordings."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.checks.report import Findings, issue_of
from ident.checks.settings import CLOCK as LIMIT
from ident.recordings.recording import Recording, Session, TelemetryIssue

# Neighbours of a sample through which a cubic goes, as rows of five.
NEIGHBOURS = (0, 1, 3, 4)


def _is_uneven(steps: Float[Array, " T"]) -> bool:
    """Whether a run's steps of time differ by more than a usual clock's do."""
    if len(steps) < LIMIT.shortest_piece:
        return False
    low, middle, high = np.percentile(steps, [1, 50, 99])
    return bool(high - low > LIMIT.jitter * middle)


def mend_jitter(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Tells uneven sampling; where only the stamps are uneven, evens them out.

    Returns:
        The session, and the issues: uneven samples, and stamps that were evened.
    """
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
    """An even clock [s] that fits the positions better than the stamps do; None if there is none.

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
    last = len(time) - 4
    offsets = [time[row : last + row] - time[middle] for row in NEIGHBOURS]
    estimate = np.zeros_like(q[middle])
    for row, offset in zip(NEIGHBOURS, offsets, strict=True):
        # Lagrange's weight of this neighbour in the middle.
        factors = [-other / (offset - other) for other in offsets if other is not offset]
        weight = np.prod(factors, axis=0)
        near = q[row : len(q) - 4 + row]
        estimate += weight[:, None] * near
    return float(np.mean((q[middle] - estimate) ** 2))


def usual_interval(session: Session) -> float:
    """Median over the runs of the time between samples [s]; 0 where no run has two samples."""
    intervals = [run.sample_interval for run in session.runs if len(run) > 1]
    return float(np.median(intervals or [0.0]))


def check_rate(session: Session) -> list[TelemetryIssue]:
    """Tells what slow sampling leaves out: one issue, or none where sampling is fast enough."""
    interval = usual_interval(session)
    if interval * LIMIT.slow_hz <= 1.0 + LIMIT.jitter:
        return []
    # The checks' filter passes a fifth of the rate.
    band = 0.2 / interval
    milliseconds = 1e3 * interval
    rate = 1.0 / interval
    return [issue_of("slow_sampling", session, rate=rate, band=band, interval=milliseconds)]
