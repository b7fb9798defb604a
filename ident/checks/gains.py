"""Torques that are a current times a gain that nobody measured."""

from __future__ import annotations

import numpy as np

from ident.checks.report import issue_of
from ident.recordings.recording import Session, TelemetryIssue


def check_gains(session: Session) -> list[TelemetryIssue]:
    """Tells torques that are a current times a gain that nobody measured.

    Every size that follows from them is as wrong.

    Returns:
        One issue, or none where no gain is guessed.
    """
    if not session.guessed_gains:
        return []
    gains = ", ".join(f"{joint} {gain:.3g}" for joint, gain in session.guessed_gains.items())
    return [issue_of("guessed", session, session.guessed_gains, gains=gains)]


class Gains:
    """Reads sessions of one arm with the first one's guesses of its drive gains.

    Another guess is no other arm.
    """

    def __init__(self, first: Session | None = None) -> None:
        self._first = first
        self._issues: list[TelemetryIssue] = []

    def in_first_unit(self, session: Session) -> Session:
        """A session with torques in the units of the first session's guessed gains.

        Returned as it is where nothing is guessed or the guesses agree.
        """
        guessed = session.guessed_gains
        if not guessed:
            return session
        if self._first is None:
            self._first = session.replace(runs=())
        first = self._first
        gains = {name: first.guessed_gains.get(name, gain) for name, gain in guessed.items()}
        differ = [name for name, gain in guessed.items() if not np.isclose(gain, gains[name])]
        if not differ:
            return session
        evidence = (
            f"{first.name} and {session.name} have different guesses for {', '.join(differ)}: "
            "read with the first"
        )
        remedy = "give both sessions the same drive gains"
        issue = TelemetryIssue("guessed_gains", tuple(differ), "warning", evidence, remedy)
        self._issues.append(issue)
        factor = np.ones(len(session.joints))
        for joint, name in enumerate(session.joints):
            if name in differ:
                factor[joint] = gains[name] / guessed[name]
        runs = []
        for run in session.runs:
            is_made_of_current = run.current is not None
            runs.append(run.replace(effort=factor * run.effort) if is_made_of_current else run)
        return session.replace(runs=runs, guessed_gains=gains)

    def issues(self) -> list[TelemetryIssue]:
        """The issues of the sessions whose guesses differ from the first one's, one each."""
        return self._issues
