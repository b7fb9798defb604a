"""session.toml: what a recording's own files don't say about it."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ident.errors import RecordingError
from ident.recordings.recording import Payload
from ident.untrusted_files import read_toml

NAME = "session.toml"
KEYS = (
    "angle_unit",
    "columns",
    "drive_gain_Nm_per_A",
    "effort_kind",
    "effort_sign",
    "payload",
    "robot",
    "sample_rate_hz",
    "time_unit",
)
# Seconds in what a file's time may be counted in.
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
EFFORT_KINDS = ("joint_torque", "gravity_compensated")


@dataclass(frozen=True)
class SessionFile:
    """The content of a session.toml; the default is that of a session without one.

    Attributes:
        path: The file, or None where there is none.
        columns: Foreign column name or 1-based number (as text) -> native name.
        drive_gain: Joint -> torque per current [N m/A].
        effort_sign: Joint -> +1 or -1, the factor on the recorded torque.
        payload: Known body at the flange.
        robot: Name or URDF path of the robot.
        sample_rate_hz: Sampling rate of tables without a time column [Hz].
        with_effort: Whether a torque is needed; without, the recording's effort is zero.
        time_factor: What recorded times are multiplied with to be seconds.
        angle_factor: What recorded angles and their derivatives are multiplied with to be radians.
        effort_kind: Whether gravity is in the effort, one of `EFFORT_KINDS`; None where the file says nothing.
        metadata: Everything else in the file.
    """

    path: Path | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    drive_gain: Mapping[str, float] = field(default_factory=dict)
    effort_sign: Mapping[str, float] = field(default_factory=dict)
    payload: Payload | None = None
    robot: str | None = None
    sample_rate_hz: float | None = None
    angle_factor: float = 1.0
    effort_kind: str | None = None
    time_factor: float = 1.0
    metadata: Mapping[str, Any] = field(default_factory=dict)
    with_effort: bool = True

    @property
    def where(self) -> str:
        """The file's name for messages."""
        return str(self.path) if self.path else NAME


def find_session_file(path: Path) -> Path | None:
    """The session.toml that belongs to a folder or a single file, if there is one."""
    folder = path if path.is_dir() else path.parent
    candidates = [folder / NAME] if path.is_dir() else [path.with_suffix(".toml"), folder / NAME]
    return next((candidate for candidate in candidates if candidate.exists() and not candidate.is_dir()), None)


def load_session_file(path: Path) -> SessionFile:
    """Reads and checks a session.toml.

    Raises:
        RecordingError: The file can't be read, or a key has a wrong value or looks misspelt.
    """
    data = _parse(path)
    for key in data:
        guess = difflib.get_close_matches(key, KEYS, n=1, cutoff=0.75)
        if key not in KEYS and guess:
            raise RecordingError(path, f"unknown key {key!r}", f"did you mean {guess[0]!r}?")
    gains = _numbers(data, "drive_gain_Nm_per_A", path)
    signs = _numbers(data, "effort_sign", path)
    for joint, sign in signs.items():
        if sign not in (1.0, -1.0):
            raise RecordingError(path, f"[effort_sign] {joint} = {sign:g}", "a sign is 1 or -1")
    return SessionFile(
        path=path,
        columns=_columns(data, path),
        drive_gain=gains,
        effort_sign=signs,
        payload=_payload(data, path),
        robot=_robot(data, path),
        sample_rate_hz=_rate(data, path),
        angle_factor=_angle_factor(data, path),
        effort_kind=_effort_kind(data, path),
        time_factor=_time_factor(data, path),
        metadata={key: value for key, value in data.items() if key not in KEYS},
    )


def _parse(path: Path) -> dict[str, Any]:
    return read_toml(path, "give a session.toml that can be read", RecordingError)


def _table(data: dict[str, Any], key: str, path: Path) -> dict[str, Any]:
    table = data.get(key, {})
    if not isinstance(table, dict):
        raise RecordingError(path, f"{key} is {table!r}", f"make it a table: [{key}]")
    return table


def _number(value: Any, where: Path, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise RecordingError(where, f"{key} = {value!r}", "give a finite number")
    return float(value)


def _numbers(data: dict[str, Any], key: str, path: Path) -> dict[str, float]:
    return {name: _number(value, path, f"[{key}] {name}") for name, value in _table(data, key, path).items()}


def _columns(data: dict[str, Any], path: Path) -> dict[str, str]:
    table = _table(data, "columns", path)
    for name, native in table.items():
        if not isinstance(native, str):
            raise RecordingError(
                path, f"[columns] {name} = {native!r}", 'write foreign = "native", such as 2 = "joint_1/position"'
            )
    seen: dict[str, str] = {}
    for name, native in table.items():
        if native in seen:
            raise RecordingError(
                path, f"[columns] gives {native!r} to both {seen[native]!r} and {name!r}", "name it once"
            )
        seen[native] = name
    return dict(table)


def _payload(data: dict[str, Any], path: Path) -> Payload | None:
    if "payload" not in data:
        return None
    table = _table(data, "payload", path)
    mass = _number(table.get("mass_kg"), path, "[payload] mass_kg")
    centre = table.get("com_m", [0.0, 0.0, 0.0])
    if mass < 0:
        raise RecordingError(path, f"[payload] mass_kg = {mass:g}", "a mass is not negative")
    if not isinstance(centre, list) or len(centre) != 3:
        raise RecordingError(path, f"[payload] com_m = {centre!r}", "give three numbers [m], frame of the last link")
    x, y, z = (_number(value, path, "[payload] com_m") for value in centre)
    return Payload(mass, (x, y, z))


def _robot(data: dict[str, Any], path: Path) -> str | None:
    robot = data.get("robot")
    if robot is not None and not isinstance(robot, str):
        raise RecordingError(path, f"robot = {robot!r}", "give a name or a URDF path in quotes")
    # A relative URDF path is relative to the file that names it.
    beside = path.parent / robot if robot else path
    return str(beside) if robot and robot.endswith((".urdf", ".xml")) and beside.is_file() else robot


def _rate(data: dict[str, Any], path: Path) -> float | None:
    if "sample_rate_hz" not in data:
        return None
    rate = _number(data["sample_rate_hz"], path, "sample_rate_hz")
    if rate <= 0:
        raise RecordingError(path, f"sample_rate_hz = {rate:g}", "give a positive rate [Hz]")
    return rate


def _angle_factor(data: dict[str, Any], path: Path) -> float:
    unit = data.get("angle_unit", "rad")
    if unit not in ("rad", "deg"):
        raise RecordingError(path, f"angle_unit = {unit!r}", 'write "rad" or "deg"')
    return math.radians(1.0) if unit == "deg" else 1.0


def _time_factor(data: dict[str, Any], path: Path) -> float:
    unit = data.get("time_unit", "s")
    if not isinstance(unit, str) or unit not in TIME_UNITS:
        raise RecordingError(path, f"time_unit = {unit!r}", f"write one of: {', '.join(TIME_UNITS)}")
    return TIME_UNITS[unit]


def _effort_kind(data: dict[str, Any], path: Path) -> str | None:
    kind = data.get("effort_kind")
    if kind is not None and kind not in EFFORT_KINDS:
        raise RecordingError(path, f"effort_kind = {kind!r}", f"write {' or '.join(map(repr, EFFORT_KINDS))}")
    return None if kind is None else str(kind)
