"""Recordings that are given twice: held-out runs must not be copies of those that were fitted."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from ident.recordings.recording import Recording, Session, TelemetryIssue


class Repeats:
    """Takes note of the runs that pass, and of those that equal an earlier one to the last bit, time included."""

    def __init__(self) -> None:
        self._known: dict[bytes, str] = {}
        self._told: list[str] = []

    def take(self, session: Session) -> None:
        """One more session, or part of one, as it was read."""
        for run in session.runs:
            mark, name = fingerprint(run), f"{session.name}/{run.name}"
            if len(run) and mark in self._known:
                self._told.append(f"{name} is {self._known[mark]} once more")
            self._known.setdefault(mark, name)

    def issues(self) -> list[TelemetryIssue]:
        """What the runs so far come to."""
        if not self._told:
            return []
        more = f", and {len(self._told) - 1} more" if len(self._told) > 1 else ""
        return [TelemetryIssue("repeated_session", (), "fatal", self._told[0] + more, "give every recording once")]


def find_repeated(sessions: Sequence[Session]) -> list[TelemetryIssue]:
    """Tells runs that were given before."""
    repeats = Repeats()
    for session in sessions:
        repeats.take(session)
    return repeats.issues()


def fingerprint(run: Recording) -> bytes:
    """Hash of a run's time, positions and torques."""
    found = hashlib.blake2b(digest_size=16)
    for values in (run.time, run.position, run.effort):
        found.update(values.tobytes())
    return found.digest()
