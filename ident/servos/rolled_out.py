"""Servos that roll out, and how far they are from runs held back: by our steps and by MuJoCo's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ident.arrays import Array
from ident.errors import RecordingError
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from ident.servos.in_mujoco import mujoco_error
from ident.servos.roll_out import Drive, ServoModel, fit_servo

# Part of the runs, or of the only one's time, that is held back.
HELD_SHARE = 1 / 3
# Without a robot nobody knows what a joint carries: all is then in units of its inertia.
NO_INERTIA = 1.0


@dataclass(frozen=True, eq=False)
class RolledOut:
    """A joint's model, and how far its free roll-outs are from runs that it was not fitted to."""

    joint: str
    model: ServoModel  # fitted to all runs
    held_error: float  # of the model of the others on the runs held back, mean absolute [rad]
    held: tuple[str, ...]  # names of those runs
    known_load: bool  # whether a robot said what the joint carries
    goal_error: float = float("nan")  # there, of one who takes the goal for the position [rad]
    mujoco_error: float = float("nan")  # there, of a MuJoCo file of the model of the others [rad]

    def to_dict(self) -> dict[str, Any]:
        """Its record in servo.json.

        Returns:
            The model's fields, "held_back" (its errors [rad] on runs that no fit saw, null where
            not measured) and "load_known".
        """
        error = {
            "mean_absolute_rad": self.held_error,
            "goal_as_position_rad": _finite(self.goal_error),
            "mujoco_rad": _finite(self.mujoco_error),
            "runs": list(self.held),
        }
        return {**asdict(self.model), "held_back": error, "load_known": self.known_load}


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def drives_of(sessions: Sequence[Session], arm: ArmModel | None, joint: int) -> list[Drive]:
    """Runs of one joint as roll-outs need them.

    Args:
        sessions: The recordings; each has a gain of its own.
        arm: What the joints carry, with the recordings' joints; nobody knows if None.
        joint: Its number.
    """
    told = []
    for number, session in enumerate(sessions):
        for run in session.runs:
            assert run.position_command is not None
            cosine, sine, inertia = _carried(arm, run, joint)
            goal = np.array(run.position_command[:, joint], dtype=float)
            position = np.array(run.position[:, joint], dtype=float)
            driven = np.ones(len(goal), dtype=bool)
            time = np.array(run.time, dtype=float)
            name = f"{session.name}/{run.name}"
            told.append(Drive(name, number, time, goal, position, driven, inertia, cosine, sine))
    return told


def _carried(arm: ArmModel | None, run: Recording, joint: int) -> tuple[Array, Array, float]:
    """Gravity's torque by cosine and sine of the joint's angle, and the inertia that it moves."""
    count = len(run.time)
    if arm is None:
        return np.zeros(count), np.zeros(count), NO_INERTIA
    q = np.array(run.position, dtype=float)
    parts = []
    for angle in (0.0, 0.5 * np.pi):
        q[:, joint] = angle
        parts.append(np.ascontiguousarray(arm.gravity(q)[:, joint]))
    still = np.zeros_like(q)
    unit = np.zeros_like(q)
    unit[:, joint] = 1.0
    gravity = arm.gravity(q)[:, joint]
    inertia = arm.inverse_dynamics(q, still, unit)[:, joint] - gravity
    return parts[0], parts[1], float(np.median(inertia))


def _parted(drives: Sequence[Drive]) -> tuple[list[Drive], list[Drive]]:
    """Runs to fit to and runs held back; of the only run of a session the last part."""
    sessions = sorted({drive.session for drive in drives})
    train = []
    held = []
    for session in sessions:
        of_session = [drive for drive in drives if drive.session == session]
        if len(of_session) > 1:
            count = max(1, round(HELD_SHARE * len(of_session)))
            train += of_session[:-count]
            held += of_session[-count:]
            continue
        cut = round((1.0 - HELD_SHARE) * len(of_session[0].time))
        train.append(_slice(of_session[0], slice(0, cut), "first"))
        held.append(_slice(of_session[0], slice(cut, None), "last"))
    return train, held


def _slice(drive: Drive, rows: slice, name: str) -> Drive:
    channels = ("time", "goal", "position", "driven", "cosine", "sine")
    cut = {channel: np.ascontiguousarray(getattr(drive, channel)[rows]) for channel in channels}
    return Drive(f"{drive.name} ({name} part)", drive.session, inertia=drive.inertia, **cut)


def roll_out_servos(sessions: Sequence[Session], arm: ArmModel | None) -> tuple[RolledOut, ...]:
    """The model of every joint.

    Raises:
        RecordingError: A run is too short to be rolled out.
    """
    pieces = []
    for joint, name in enumerate(sessions[0].joints):
        drives = drives_of(sessions, arm, joint)
        for drive in drives:
            if len(drive.time) < 10:
                raise RecordingError(
                    drive.name, "too short to be rolled out", "record a second or more"
                )
        train, held = _parted(drives)
        trained = fit_servo(train)
        model = fit_servo(drives)
        names = tuple(drive.name for drive in held)
        follows = [float(np.mean(np.abs(drive.goal - drive.position))) for drive in held]
        goal_error = float(np.mean(follows))
        in_mujoco = mujoco_error(name, trained, held)
        error = trained.error(held)
        pieces.append(RolledOut(name, model, error, names, arm is not None, goal_error, in_mujoco))
    return tuple(pieces)
