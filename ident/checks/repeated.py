"""Recordings that are given twice: held-out runs must not be copies of those that were fitted."""

from __future__ import annotations

import hashlib

from ident.checks.report import TelemetryReport
from ident.recordings.recording import Session, TelemetryIssue


class Repeats:
    """Takes note of the runs that pass, and of those that equal an earlier one to the last bit, time included."""

    def __init__(self) -> None:
        self._known: dict[bytes, str] = {}
        self._told: list[str] = []

    def take(self, session: Session, report: TelemetryReport) -> None:
        """One more session, or part of one, as it was read."""
        for run in session.runs:
            found = hashlib.blake2b(digest_size=16)
            for values in (run.time, run.position, run.effort):
                found.update(values.tobytes())
            mark, name = found.digest(), f"{session.name}/{run.name}"
            if len(run) and mark in self._known:
                self._told.append(f"{name} is {self._known[mark]} once more")
            self._known.setdefault(mark, name)

    def issues(self) -> list[TelemetryIssue]:
        """What the runs so far come to."""
        if not self._told:
            return []
        more = f", and {len(self._told) - 1} more" if len(self._told) > 1 else ""
        return [TelemetryIssue("repeated_session", (), "fatal", self._told[0] + more, "give every recording once")]
