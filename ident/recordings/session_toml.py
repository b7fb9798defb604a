"""session.toml: what a recording's own files don't say about it."""

from __future__ import annotations

import difflib
import math
import os
import tomllib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ident.errors import RecordingError
from ident.recordings.recording import Payload
from ident.records import JsonRecord, JsonTable
from ident.safe_read import read_toml, urdf_from

NAME = "session.toml"
# Beside the drive gains that nobody measured.
GUESSED = "guessed"
# Units that files may be in, in s and rad.
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ANGLE_UNITS = {"rad": 1.0, "deg": math.radians(1.0)}
# Of single joints' positions; "read as degrees" undoes `angle_unit`.
JOINT_UNITS = {**ANGLE_UNITS, "turns": math.tau}
CURRENT_UNITS = {"A": 1.0, "mA": 1e-3}
# Of torques, in N m.
EFFORT_UNITS = {
    "Nm": 1.0,
    "mNm": 1e-3,
    "Ncm": 1e-2,
    "kNm": 1e3,
    "kgfcm": 0.0980665,
    "kgfm": 9.80665,
    "ozfin": 0.00706155,
    "lbfin": 0.1129848,
    "lbfft": 1.3558179,
}
# Of these those by which no usual gain of a motor's current [N m/A] is mistaken.
DECIMAL_EFFORT_UNITS = ("mNm", "Ncm", "kNm")
EFFORT_KINDS = ("joint_torque", "gravity_compensated")
# Keys that go with the session as they are: for people, and for `watch`.
FREE = ("date", "notes", "origin")

# By key what the reference shows of it: `unit`, `default`, `meaning`, and a line of the file as an
# `example`.
KEYS = tomllib.loads(Path(__file__).with_name("session_keys.toml").read_text(encoding="utf-8"))


def effort_unit_near(multiples: Iterable[float], share: float) -> str | None:
    """The unit of torque in which columns at such multiples of the torque in N m would be.

    One of `DECIMAL_EFFORT_UNITS`; None where they are in none of them.

    Args:
        multiples: What columns are of the torque in N m, say 100 for N cm.
        share: By how much a multiple may be off, as a logarithm.
    """
    logs = np.log(np.array(list(multiples)))
    for unit in DECIMAL_EFFORT_UNITS:
        if np.abs(logs + np.log(EFFORT_UNITS[unit])).max(initial=0.0) <= share:
            return unit
    return None


@dataclass(frozen=True)
class SessionFile:
    """The content of a session.toml; the default is that of a session without one."""

    path: Path | None = None  # the file, or None where there is none
    # Foreign column name or 1-based number (as text) -> native name.
    columns: Mapping[str, str] = field(default_factory=dict)
    # joint -> torque per current [N m/A]
    drive_gain: Mapping[str, float] = field(default_factory=dict)
    # Joint -> +1 or -1, the factor on the recorded torque.
    effort_sign: Mapping[str, float] = field(default_factory=dict)
    payload: Payload | None = None  # known body at the flange
    robot: str | None = None  # name or URDF path of the robot
    sample_rate_hz: float | None = None  # sampling rate of tables without a time column [Hz]
    # what makes radians of recorded angles; radians where nothing is written
    angle_factor: float | None = None
    # What is taken off recorded positions before; counts have their zero in the middle of a turn.
    angle_zero: float = 0.0
    # Joint that slides -> what its positions and their derivatives are multiplied with to be
    # metres, instead.
    slides: Mapping[str, float] = field(default_factory=dict)
    # Joint -> -1 where its axis turns the other way than the URDF's: of position, its derivatives
    # and torque.
    direction: Mapping[str, float] = field(default_factory=dict)
    # Joint -> the URDF's angle where the recorded one, its direction and unit applied, is zero [rad
    # or m].
    zeros: Mapping[str, float] = field(default_factory=dict)
    # Joint -> what its positions and their derivatives are multiplied with to be radians, instead.
    units: Mapping[str, float] = field(default_factory=dict)
    # Whether gravity is in the effort, one of `EFFORT_KINDS`; None where the file says nothing.
    effort_kind: str | None = None
    # LeRobot's calibration of the arm, by which shares of each joint's range are angles; None where
    # none is given.
    lerobot_calibration: Path | None = None
    current_factor: float = 1.0  # what recorded currents are multiplied with to be amperes
    effort_factor: float = 1.0  # what recorded efforts are multiplied with to be N m
    time_factor: float = 1.0  # what recorded times are multiplied with to be seconds
    # Joint -> the joint under whose name its columns stand.
    order: Mapping[str, str] = field(default_factory=dict)
    # The same of efforts and currents, where they stand elsewhere than the other columns.
    effort_order: Mapping[str, str] = field(default_factory=dict)
    # what of `FREE` the file has, and own keys
    metadata: JsonTable = field(default_factory=dict)
    with_effort: bool = True  # whether a torque is needed; without, the recording's effort is zero
    # gravity in the base's frame [m/s²]; None for the URDF's
    gravity: tuple[float, float, float] | None = None
    guessed: bool = False  # whether the drive gains are nobody's measurement

    @property
    def where(self) -> str:
        """The file for messages: its path, or `session.toml` where there is none."""
        return str(self.path) if self.path else NAME


def settings_of(path: Path, session_file: str | Path | None = None) -> SessionFile:
    """The settings of a folder or a single file.

    Args:
        path: The recordings.
        session_file: The file of the settings; if None, the session.toml in the folder, or
            `<stem>.toml` or session.toml beside a file.

    Returns:
        The settings of a session without a session.toml where there is none.

    Raises:
        RecordingError: As `load_session_file`.
    """
    places = [path / NAME] if path.is_dir() else [path.with_suffix(".toml"), path.parent / NAME]
    files = (
        [Path(session_file)]
        if session_file
        # A dead link or a folder is told, not passed over: its settings would be missed.
        else [place for place in places if os.path.lexists(place)]
    )
    return load_session_file(files[0]) if files else SessionFile()


def load_session_file(path: Path) -> SessionFile:
    """Reads and checks a session.toml.

    Raises:
        RecordingError: The file can't be read, or a key looks misspelt or has a wrong value.
    """
    data = read_toml(path, "give a session.toml that can be read", RecordingError)
    keys = _Keys(path, data)
    keys.require_known([key for key in data if difflib.get_close_matches(key, KEYS, n=1)], KEYS)
    guessed = keys.table("drive_gain_Nm_per_A").pop(GUESSED, False)
    if not isinstance(guessed, bool):
        raise RecordingError(
            path, f"[drive_gain_Nm_per_A] {GUESSED} = {guessed!r}", "write true or false"
        )
    gains = keys.numbers("drive_gain_Nm_per_A")
    signs = keys.numbers("effort_sign")
    direction = keys.numbers("direction")
    for key, given in (("effort_sign", signs), ("direction", direction)):
        for joint, sign in given.items():
            if sign not in (1.0, -1.0):
                raise RecordingError(path, f"[{key}] {joint} = {sign:g}", "a sign is 1 or -1")
    counts = keys.positive("counts_per_turn", "number")
    if counts is not None and "angle_unit" in data:
        raise RecordingError(
            path, "both counts_per_turn and angle_unit", "angles have one unit: keep one of them"
        )
    angles = keys.one_of("angle_unit", tuple(ANGLE_UNITS), 'write "rad" or "deg"')
    current = keys.one_of("current_unit", tuple(CURRENT_UNITS), 'write "A" or "mA"')
    effort = keys.one_of(
        "effort_unit", tuple(EFFORT_UNITS), f"write one of {', '.join(EFFORT_UNITS)}"
    )
    kind = keys.one_of("effort_kind", EFFORT_KINDS, f"write {' or '.join(map(repr, EFFORT_KINDS))}")
    robot = data.get("robot")
    if robot is not None and not isinstance(robot, str):
        raise RecordingError(path, f"robot = {robot!r}", "give a name or a URDF path in quotes")
    calibration = data.get("lerobot_calibration")
    if calibration is not None and not isinstance(calibration, str):
        raise RecordingError(
            path, f"lerobot_calibration = {calibration!r}", "give the JSON file's path in quotes"
        )
    return SessionFile(
        path=path,
        columns=keys.columns(),
        drive_gain=gains,
        effort_sign=signs,
        payload=keys.payload(),
        robot=None if robot is None else urdf_from(path, robot),
        sample_rate_hz=keys.positive("sample_rate_hz", "rate [Hz]"),
        angle_factor=math.tau / counts if counts else ANGLE_UNITS[angles] if angles else None,
        angle_zero=0.0 if counts is None else counts / 2.0,
        slides=keys.numbers("slide_scale"),
        direction=direction,
        zeros=keys.numbers("zero_rad"),
        units=keys.joint_units(),
        effort_kind=kind,
        lerobot_calibration=None if calibration is None else path.parent / calibration,
        current_factor=CURRENT_UNITS[current or "A"],
        effort_factor=EFFORT_UNITS[effort or "Nm"],
        time_factor=keys.time_unit(),
        order=keys.names("order"),
        effort_order=keys.names("effort_order"),
        gravity=keys.three(data["gravity_mps2"], "gravity_mps2", "base")
        if "gravity_mps2" in data
        else None,
        guessed=guessed,
        metadata={key: value for key, value in data.items() if key in FREE or key not in KEYS},
    )


class _Keys:
    """The keys of a file, each checked when it is asked for."""

    def __init__(self, path: Path, data: JsonRecord) -> None:
        self.path = path
        self.data = data

    def require_known(
        self, given: Collection[str], known: Collection[str], where: str = ""
    ) -> None:
        """Refuses a key that nobody reads, which would leave its setting as it is without a
        word.
        """
        for key in sorted(set(given) - set(known)):
            near = difflib.get_close_matches(key, known, n=1)
            remedy = (
                f"did you mean {near[0]!r}?" if near else f"keys are: {', '.join(sorted(known))}"
            )
            raise RecordingError(self.path, f"{where}unknown key {key!r}", remedy)

    def table(self, key: str) -> JsonRecord:
        table = self.data.get(key, {})
        if not isinstance(table, dict):
            raise RecordingError(self.path, f"{key} is {table!r}", f"make it a table: [{key}]")
        return table

    def number(self, value: object, key: str) -> float:
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
        ):
            raise RecordingError(self.path, f"{key} = {value!r}", "give a finite number")
        return float(value)

    def numbers(self, key: str) -> dict[str, float]:
        return {
            name: self.number(value, f"[{key}] {name}") for name, value in self.table(key).items()
        }

    def positive(self, key: str, what: str) -> float | None:
        figure = self.number(self.data[key], key) if key in self.data else None
        if figure is not None and figure <= 0:
            raise RecordingError(self.path, f"{key} = {figure:g}", f"give a positive {what}")
        return figure

    def three(self, values: object, key: str, frame: str) -> tuple[float, float, float]:
        """A vector in a frame."""
        if not isinstance(values, list) or len(values) != 3:
            raise RecordingError(
                self.path, f"{key} = {values!r}", f"give three numbers, frame of the {frame}"
            )
        x, y, z = (self.number(value, key) for value in values)
        return x, y, z

    def names(self, key: str) -> dict[str, str]:
        """Names by joint."""
        names = {}
        for joint, name in self.table(key).items():
            if not isinstance(name, str):
                remedy = "write the name of a joint in quotes"
                raise RecordingError(self.path, f"[{key}] {joint} = {name!r}", remedy)
            names[joint] = name
        return names

    def time_unit(self) -> float:
        """The unit of recorded times [s], by its name or its length."""
        unit = self.data.get("time_unit", "s")
        if not isinstance(unit, str):
            return self.positive("time_unit", "length of the unit [s]") or 1.0
        remedy = f"write one of: {', '.join(TIME_UNITS)}; or its length [s]"
        name = self.one_of("time_unit", tuple(TIME_UNITS), remedy)
        return TIME_UNITS[name or "s"]

    def joint_units(self) -> dict[str, float]:
        """Factors of single joints' positions by their units' names."""
        factors = {}
        for joint, name in self.table("unit").items():
            if not isinstance(name, str) or name not in JOINT_UNITS:
                known = ", ".join(JOINT_UNITS)
                raise RecordingError(
                    self.path, f"[unit] {joint} = {name!r}", f"write one of: {known}"
                )
            factors[joint] = JOINT_UNITS[name]
        return factors

    def one_of(self, key: str, known: Sequence[str], remedy: str) -> str | None:
        value = self.data.get(key)
        if value is not None and (not isinstance(value, str) or value not in known):
            raise RecordingError(self.path, f"{key} = {value!r}", remedy)
        return value

    def columns(self) -> dict[str, str]:
        seen: dict[str, str] = {}
        for name, native in (table := self.table("columns")).items():
            if not isinstance(native, str):
                remedy = 'write foreign = "native", such as 2 = "joint_1/position"'
                raise RecordingError(self.path, f"[columns] {name} = {native!r}", remedy)
            if (first := seen.setdefault(native, name)) != name:
                what = f"[columns] gives {native!r} to both {first!r} and {name!r}"
                raise RecordingError(self.path, what, "name it once")
        return dict(table)

    def payload(self) -> Payload | None:
        if "payload" not in self.data:
            return None
        table = self.table("payload")
        self.require_known(table, ("mass_kg", "com_m"), "[payload] ")
        mass = self.number(table.get("mass_kg"), "[payload] mass_kg")
        if mass < 0:
            raise RecordingError(
                self.path, f"[payload] mass_kg = {mass:g}", "a mass is not negative"
            )
        return Payload(
            mass, self.three(table.get("com_m", [0.0, 0.0, 0.0]), "[payload] com_m", "last link")
        )
