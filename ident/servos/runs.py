"""Recordings of goal and position, made ready: smoothed, on an even grid, with the goal that stood at each instant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.motion.motion import Motion, prepare_run, session_noise
from ident.motion.settings import USUAL_MOTION
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session

# Runs shorter than this in samples have no spectrum to speak of.
LEAST_SAMPLES = 30
# Share of the position's own spread by which a goal must differ from it to be one.
SAME = 1e-6


@dataclass(frozen=True, eq=False)
class GoalRun:
    """One run of a position-only arm.

    Attributes:
        motion: Its smoothed states; what the log says (`tau` elsewhere) is the measured position here.
        time: Times of the goals [s].
        goal: Goals [rad], shape (T, n), each held until the next one.
        hold: How long a goal is held, the log's interval [s].
    """

    motion: Motion
    time: Float[Array, " T"]
    goal: Float[Array, "T n"]
    hold: float

    def goal_at(self, j: int, delay: float) -> Float[Array, " t"]:
        """The goal that a joint followed at each instant of the grid, so much later than it was given.

        A goal that is held until the next one is, at frequencies far below the log's, the straight line between goals
        half an interval late.
        """
        late = delay + 0.5 * self.hold
        return np.interp(self.motion.time - late, self.time, self.goal[:, j])


def load_goals(path: str | Path | Session) -> Session:
    """Reads a session that needs no torque.

    Raises:
        RecordingError: It can't be read, or logs no goal.
    """
    session = path if isinstance(path, Session) else load_session(path, with_effort=False)
    where = str(session.path or session.name)
    for run in session.runs:
        if run.position_command is None:
            what = f"{run.name} has no goal: no column <joint>/position_command of every joint"
            raise RecordingError(where, what, "log the goal that each servo is given, or map it in [columns]")
        _require_goal(run, where)
    return session


def _require_goal(run: Recording, where: str) -> None:
    """A goal that is the position itself was written by a logger that had none."""
    assert run.position_command is not None
    apart = np.abs(run.position_command - run.position).max(axis=0)
    same = (apart <= SAME * np.maximum(np.ptp(run.position, axis=0), 1e-9)) & (np.ptp(run.position, axis=0) > 0.0)
    if same.any():
        name = run.joints[int(np.argmax(same))]
        what = f"{run.name}: the goal of {name} is its position, sample for sample"
        raise RecordingError(where, what, "log the goal that was sent, not the position that was read")


def prepare_goals(session: Session, cutoff: float | None = None) -> tuple[GoalRun, ...]:
    """Smooths all runs that are long enough.

    Raises:
        RecordingError: None is.
    """
    least = USUAL_MOTION.least_duration_s
    long = [run for run in session.runs if run.duration >= least and len(run) >= LEAST_SAMPLES]
    if not long:
        what = f"no run lasts {least:g} s and {LEAST_SAMPLES} samples"
        raise RecordingError(str(session.path or session.name), what, "record longer motions")
    # Noise of positions is found as for other arms; the measured position stands where they have the torque.
    as_log = [run.replace(effort=run.position) for run in long]
    levels = session_noise(session.replace(runs=as_log))
    found = []
    for run in as_log:
        assert run.position_command is not None
        motion = prepare_run(run, levels, session.payload, cutoff)
        found.append(GoalRun(motion, run.time, run.position_command, run.sample_interval))
    return tuple(found)


def runs_of(sources: Sequence[Session], cutoff: float | None = None) -> tuple[GoalRun, ...]:
    """All runs of all sessions."""
    return tuple(run for session in sources for run in prepare_goals(session, cutoff))
