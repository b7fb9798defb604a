"""A servo that rolls out, from recordings to files of simulators, with its error on runs held back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array
from ident.errors import RecordingError
from ident.files import atomic_folder
from ident.recordings.recording import Recording, Session
from ident.records import as_json
from ident.robot.arm import ArmModel
from ident.servos.roll_out import Drive, ServoModel, fit_servo

SCHEMA = "ident.servo_model/1"
KIND = "servo"
# Part of the runs, or of the only one's time, that is held back.
HELD_SHARE = 1 / 3
# Without a robot nobody knows what a joint carries: all is then in units of its inertia.
NO_INERTIA = 1.0
# Supply for which a file that asks for a motor's own numbers is written [V].
VOLTS = 7.4


@dataclass(frozen=True, eq=False)
class RolledOut:
    """A joint's model, and how far its free roll-outs are from runs that it was not fitted to."""

    joint: str
    model: ServoModel  # fitted to all runs
    held_error: float  # of the model of the others on the runs held back, mean absolute [rad]
    held: tuple[str, ...]  # names of those runs
    known_load: bool  # whether a robot said what the joint carries

    def to_dict(self) -> dict[str, Any]:
        """For servo.json."""
        error = {"mean_absolute_rad": self.held_error, "runs": list(self.held)}
        return {**asdict(self.model), "held_back": error, "load_known": self.known_load}


def drives_of(sessions: Sequence[Session], arm: ArmModel | None, joint: int) -> list[Drive]:
    """Runs of one joint as roll-outs need them.

    Args:
        sessions: The recordings; each has a gain of its own.
        arm: What the joints carry, with the recordings' joints; nobody knows if None.
        joint: Its number.
    """
    found = []
    for number, session in enumerate(sessions):
        for run in session.runs:
            assert run.position_command is not None
            cosine, sine, inertia = _carried(arm, run, joint)
            goal = np.array(run.position_command[:, joint], dtype=float)
            position = np.array(run.position[:, joint], dtype=float)
            driven = np.ones(len(goal), dtype=bool)
            time = np.array(run.time, dtype=float)
            name = f"{session.name}/{run.name}"
            found.append(Drive(name, number, time, goal, position, driven, inertia, cosine, sine))
    return found


def _carried(arm: ArmModel | None, run: Recording, joint: int) -> tuple[Array, Array, float]:
    """Gravity's torque by cosine and sine of the joint's own angle, and the inertia that it moves."""
    count = len(run.time)
    if arm is None:
        return np.zeros(count), np.zeros(count), NO_INERTIA
    q = np.array(run.position, dtype=float)
    parts = []
    for angle in (0.0, 0.5 * np.pi):
        q[:, joint] = angle
        parts.append(np.ascontiguousarray(arm.gravity(q)[:, joint]))
    still, unit = np.zeros_like(q), np.zeros_like(q)
    unit[:, joint] = 1.0
    inertia = arm.inverse_dynamics(q, still, unit)[:, joint] - arm.gravity(q)[:, joint]
    return parts[0], parts[1], float(np.median(inertia))


def _parted(drives: Sequence[Drive]) -> tuple[list[Drive], list[Drive]]:
    """Runs to fit to and runs held back; of the only run of a session the last part."""
    sessions = sorted({drive.session for drive in drives})
    train, held = [], []
    for session in sessions:
        own = [drive for drive in drives if drive.session == session]
        if len(own) > 1:
            count = max(1, round(HELD_SHARE * len(own)))
            train += own[:-count]
            held += own[-count:]
            continue
        cut = round((1.0 - HELD_SHARE) * len(own[0].time))
        train.append(_slice(own[0], slice(0, cut), "first"))
        held.append(_slice(own[0], slice(cut, None), "last"))
    return train, held


def _slice(drive: Drive, part: slice, name: str) -> Drive:
    channels = ("time", "goal", "position", "driven", "cosine", "sine")
    cut = {channel: np.ascontiguousarray(getattr(drive, channel)[part]) for channel in channels}
    return Drive(f"{drive.name} ({name} part)", drive.session, inertia=drive.inertia, **cut)


def roll_out_servos(sessions: Sequence[Session], arm: ArmModel | None) -> tuple[RolledOut, ...]:
    """The model of every joint.

    Raises:
        RecordingError: A run is too short to be rolled out.
    """
    found = []
    for joint, name in enumerate(sessions[0].joints):
        drives = drives_of(sessions, arm, joint)
        for drive in drives:
            if len(drive.time) < 10:
                raise RecordingError(drive.name, "too short to be rolled out", "record a second or more")
        train, held = _parted(drives)
        error = fit_servo(train).error(held)
        model = fit_servo(drives)
        found.append(RolledOut(name, model, error, tuple(drive.name for drive in held), arm is not None))
    return tuple(found)


def write_servos(folder: Path, servos: Sequence[RolledOut], sessions: Sequence[str]) -> Path:
    """Writes servo.json, servo.xml (MuJoCo), bam_JOINT.json and mjlab.py, whole or not at all.

    Args:
        folder: Where to.
        servos: The joints.
        sessions: Names of the sessions, each with a stiffness of its own; simulators get the last one's.
    """
    record = {"schema": SCHEMA, "sessions": list(sessions), "joints": {one.joint: one.to_dict() for one in servos}}
    with atomic_folder(folder, KIND) as part:
        (part / "servo.json").write_text(as_json(record), encoding="utf-8")
        (part / "servo.xml").write_text(as_mujoco(servos), encoding="utf-8")
        (part / "mjlab.py").write_text(as_mjlab(servos), encoding="utf-8")
        for one in servos:
            (part / f"bam_{one.joint}.json").write_text(as_json(as_bam(one)), encoding="utf-8")
    return folder


def as_mujoco(servos: Sequence[RolledOut]) -> str:
    """Position actuators, and what the joints themselves need, as an MJCF that includes into a model with the joints.

    Friction that grows with the load has no word there: frictionloss is that of the unloaded servo.
    """
    lines = ["<mujoco>", "  <actuator>"]
    for one in servos:
        shared = one.model.shared
        limit = shared["limit_Nm"]
        lines.append(
            f'    <position name="{one.joint}" joint="{one.joint}" kp="{one.model.stiffness[-1]:.6g}" '
            f'kv="{shared["back_emf_Nms_rad"]:.6g}" forcelimited="true" forcerange="{-limit:.6g} {limit:.6g}"/>'
        )
    lines.append("  </actuator>")
    for one in servos:
        shared = one.model.shared
        lines.append(
            f'  <!-- joint {one.joint}: armature="{shared["inertia_kgm2"]:.6g}" '
            f'damping="{shared["viscous_Nms_rad"]:.6g}" frictionloss="{shared["friction_Nm"]:.6g}"; delay '
            f"{shared['delay_s']:.6g} s, half the dead band {shared['dead_band_rad']:.6g} rad; friction grows by "
            f"{shared['load_friction']:.6g} of the load, which MJCF has no word for -->"
        )
    return "\n".join([*lines, "</mujoco>", ""])


def as_mjlab(servos: Sequence[RolledOut]) -> str:
    """Actuators for mjlab, as keywords of its position actuator."""
    rows = []
    for one in servos:
        shared = one.model.shared
        rows.append(
            f"    {one.joint!r}: dict(stiffness={one.model.stiffness[-1]:.6g}, "
            f"damping={shared['back_emf_Nms_rad']:.6g}, effort_limit={shared['limit_Nm']:.6g}, "
            f"armature={shared['inertia_kgm2']:.6g}, frictionloss={shared['friction_Nm']:.6g}),"
        )
    return "\n".join(["# Keywords of a position actuator, by joint.", "ACTUATORS = {", *rows, "}", ""])


def as_bam(one: RolledOut) -> dict[str, Any]:
    """The file of BAM's model m3, for a supply of `VOLTS`: kt² / R is the back-EMF, kt V / R the limit."""
    shared = one.model.shared
    constant = shared["back_emf_Nms_rad"] * VOLTS / shared["limit_Nm"]
    return {
        "model": "m3",
        "actuator": one.joint,
        "volts": VOLTS,
        "kt": constant,
        "R": constant * VOLTS / shared["limit_Nm"],
        "armature": shared["inertia_kgm2"],
        "q_offset": one.model.offset,
        "friction_base": shared["friction_Nm"],
        "load_friction_base": shared["load_friction"],
        "friction_viscous": shared["viscous_Nms_rad"],
    }
