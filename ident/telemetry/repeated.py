"""Recordings that are given twice: held-out runs must not be copies of those that were fitted."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from ident.recordings.recording import Recording, Session, TelemetryIssue


def find_repeated(sessions: Sequence[Session]) -> list[TelemetryIssue]:
    """Tells runs that equal an earlier one to the last bit, time included."""
    known: dict[bytes, str] = {}
    told = []
    for session in sessions:
        for run in session.runs:
            mark, name = fingerprint(run), f"{session.name}/{run.name}"
            if len(run) and mark in known:
                told.append(f"{name} is {known[mark]} once more")
            known.setdefault(mark, name)
    if not told:
        return []
    more = f", and {len(told) - 1} more" if len(told) > 1 else ""
    return [TelemetryIssue("repeated_session", (), "fatal", told[0] + more, "give every recording once")]


def fingerprint(run: Recording) -> bytes:
    """Hash of a run's time, positions and torques."""
    found = hashlib.blake2b(digest_size=16)
    for values in (run.time, run.position, run.effort):
        found.update(values.tobytes())
    return found.digest()
