"""Rows in time: repeated and late ones are dropped, runs are parted where time leaps or stops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ident.arrays import Array
from ident.checks.report import Findings
from ident.checks.settings import CLOCK as LIMIT
from ident.recordings.recording import Recording, Session, Severity, TelemetryIssue, cut_before


class Order(NamedTuple):
    """Where a run's time does not increase."""

    repeated: int  # rows that repeat the one before, time included
    restarts: Array  # rows before which time falls back
    shortest: int  # rows of the shortest piece between these

    @classmethod
    def of(cls, run: Recording) -> Order:
        """Looks at all rows of a run: how many repeat the row before, and where the time falls."""
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
    """Drops repeated and late rows, and parts runs where the clock restarts inside a file.

    Returns:
        The session, without a common clock where one restarted, and the issues; a fatal one where
        the time falls too often.
    """
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
        before_second = time[:1] > time[1:2]
        before_third = time[:1] > time[2:3]
        ahead[:1] = before_second & before_third
    before_next = time[1:-1] > time[2:]
    in_order_without = time[2:] > time[:-2]
    ahead[1:-1] = before_next & in_order_without
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

    Returns:
        The session of the pieces, and the issue; as it was with a fatal issue where no piece is
        left, and as it was without one where no clock leaps.
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
    """Parts runs where samples are missing for longer than motion can be interpolated.

    Returns:
        The session of the pieces that are long enough, and the issue; as it was where there is no
        gap or no piece is left.
    """
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
