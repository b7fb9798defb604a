"""Stretches of runs whose clock goes at another speed than the rest's, by their measured velocity.

Behind a gap a clock may go on at half its speed. The positions' derivative is then off the measured
velocity by one factor at all joints, in those stretches alone. Where it is off everywhere, the
whole time base is (`ident.checks.time_base`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.checks.filtered_run import clock_factor
from ident.checks.report import issue_of
from ident.checks.settings import CLOCK as LIMIT
from ident.recordings.recording import Recording, Session, TelemetryIssue, cut_before


@dataclass(frozen=True, eq=False)
class Stretch:
    """What lies between two gaps of a run."""

    run: Recording
    factor: float | None  # measured velocity over the positions' derivative; None where it is open

    @property
    def is_off(self) -> bool:
        """Whether its clock goes at another speed than the velocities'."""
        return self.factor is not None and abs(self.factor - 1.0) > LIMIT.clock_off


def stretches_of(run: Recording) -> list[Stretch]:
    """The pieces of a run between its gaps, each with the factor by which its velocities are off
    (None where it can't be told).
    """
    pieces = [run]
    if len(run) >= LIMIT.shortest_piece:
        gaps = np.flatnonzero(np.diff(run.time) > LIMIT.gap_intervals * run.sample_interval)
        if len(gaps):
            pieces = list(cut_before(run, gaps + 1))
    sessions = [Session(piece.name, (piece,)) for piece in pieces]
    factors = [clock_factor(session) for session in sessions]
    return [Stretch(piece, factor) for piece, factor in zip(pieces, factors, strict=True)]


def check_run_clocks(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Finds stretches whose clock is off where others' is right.

    Returns:
        The session of all other stretches, for later checks, and the issue; as it was, and none,
        where no stretch is off or none is right.
    """
    stretches: list[Stretch] = []
    for run in session.runs:
        stretches += stretches_of(run)
    wrong = [stretch for stretch in stretches if stretch.is_off]
    right = [stretch for stretch in stretches if stretch.factor is not None and not stretch.is_off]
    if not wrong or not right:
        return session, []
    first = wrong[0]
    names = dict.fromkeys(stretch.run.name for stretch in wrong)
    rest = session.replace(runs=[stretch.run for stretch in stretches if not stretch.is_off])
    seen: dict[str, Any] = {"runs": ", ".join(names), "factor": first.factor}
    seen["start"] = float(first.run.time[0])
    return rest, [issue_of("stretch_clock", session, (), **seen)]
