"""Faults as they occur in real logs, put into healthy recordings."""

from collections.abc import Callable

import numpy as np

from ident.checks.inspection import inspect_sessions
from ident.checks.report import TelemetryReport
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel

Column = Callable[[np.ndarray], np.ndarray]


def inspect(session: Session, arm: ArmModel | None = None) -> TelemetryReport:
    return inspect_sessions([session], arm)[0]


def spoil(session: Session, change: Callable[[Recording], Recording], run: int | None = None) -> Session:
    """Changes one run, or all."""
    return session.replace(runs=[change(r) if run in (None, k) else r for k, r in enumerate(session.runs)])


def spoil_column(session: Session, channel: str, joint: int, change: Column, run: int | None = None) -> Session:
    """Changes one joint's channel in one run, or in all."""

    def changed(recording: Recording) -> Recording:
        values = np.array(getattr(recording, channel))
        values[:, joint] = change(values[:, joint])
        return recording.replace(**{channel: values})

    return spoil(session, changed, run)


def freeze_rows(values: np.ndarray, first: int, last: int) -> np.ndarray:
    """Repeats the first row's value up to the last."""
    frozen = np.array(values)
    frozen[first : last + 1] = values[first]
    return frozen


def without_velocity(session: Session) -> Session:
    return spoil(session, lambda run: run.replace(velocity=None))


def changed(session: Session, channel: str, change: object) -> Session:
    """A session whose one channel is worked on, columns by joint."""
    assert callable(change)
    return session.replace(runs=[run.replace(**{channel: change(getattr(run, channel))}) for run in session.runs])
