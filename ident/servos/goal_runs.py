"""Runs of arms that log goal and position only: read, looked through and smoothed."""

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
from ident.servos.settings import SERVO as LIMIT


@dataclass(frozen=True, eq=False)
class GoalRun:
    """One run of a position-only arm."""

    motion: Motion  # its smoothed states; `tau` is the measured position here
    time: Float[Array, " T"]  # times of the goals [s]
    goal: Float[Array, "T n"]  # goals [rad], shape (T, n), each held until the next one
    hold: float  # how long a goal is held, the log's interval [s]

    def goal_at(self, j: int, delay: float) -> Float[Array, " t"]:
        """The goal [rad] that a joint followed at each of the t instants of the motion's grid.

        A goal that is held until the next one is, at frequencies far below the log's, the straight
        line between goals half an interval late.

        Args:
            j: Index of the joint.
            delay: By how much later it followed a goal than it was given [s].
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
    runs = [_with_numbers(run, where) for run in session.runs]
    session = session.replace(runs=tuple(runs))
    for run in runs:
        if run.position_command is None:
            lacking = [issue.joints for issue in run.issues if "position_command" in issue.evidence]
            joint = next((joints[0] for joints in lacking if joints), run.joints[0])
            column = f"{joint}/position_command"
            what = f"{run.name} logs no goal of {joint}: there is no column {column}"
            remedy = "log the goal of every joint; where it is called otherwise, map it in "
            remedy += f'session.toml: [columns] "its name" = "{joint}/position_command"'
            raise RecordingError(where, what, remedy)
        # A goal that is the position itself was written by a logger that had none.
        travel = np.ptp(run.position, axis=0)
        apart = np.abs(run.position_command - run.position).max(axis=0)
        same = apart <= LIMIT.same * np.maximum(travel, 1e-9)
        if (same & (travel > 0.0)).any():
            joint = run.joints[int(np.argmax(same & (travel > 0.0)))]
            what = f"{run.name}: the goal of {joint} is its position, sample for sample"
            raise RecordingError(where, what, "log the goal that was sent, not the position read")
    return session


def _with_numbers(run: Recording, where: str) -> Recording:
    """The rows of a run in which goal and position of every joint are numbers.

    Raises:
        RecordingError: Hardly any are.
    """
    if run.position_command is None:
        return run
    sound = np.isfinite(run.position) & np.isfinite(run.position_command)
    worst = int(np.argmin(sound.mean(axis=0))) if len(run) else 0
    if not len(run) or sound[:, worst].mean() < LIMIT.least_sound:
        what = f"{run.name}: goal or position of {run.joints[worst]} is no number in most rows"
        raise RecordingError(where, what, "log both as numbers in every row")
    whole = sound.all(axis=1)
    return run if whole.all() else run.at(whole)


def runs_of(sessions: Sequence[Session], cutoff: float | None = None) -> tuple[GoalRun, ...]:
    """All runs of some sessions that are long enough, smoothed.

    Raises:
        RecordingError: A session has none.
    """
    least = USUAL_MOTION.least_duration_s
    goal_runs = []
    for session in sessions:
        long = [
            run for run in session.runs if run.duration >= least and len(run) >= LIMIT.least_samples
        ]
        if not long:
            longest = max((run.duration for run in session.runs), default=0.0)
            needed = f"{least:g} s and {LIMIT.least_samples:g} samples are needed"
            what = f"its longest run lasts {longest:.2g} s: {needed}"
            raise RecordingError(str(session.path or session.name), what, "record longer motions")
        # Noise of positions is found as for other arms; the measured position stands where they
        # have the torque.
        as_log = [run.replace(effort=run.position) for run in long]
        levels = session_noise(session.replace(runs=as_log))
        for run in as_log:
            assert run.position_command is not None
            motion = prepare_run(run, levels, session.payload, cutoff)
            goal_runs.append(GoalRun(motion, run.time, run.position_command, run.sample_interval))
    return tuple(goal_runs)
