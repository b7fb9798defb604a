"""LeRobot data sets: folders whose meta/info.json names the columns, and whose Parquet files hold
lists.

Each episode is a run. Without `[columns]` a list of joints becomes the channel that its feature
stands for: `observation.state` is the position, `observation.velocity`, `observation.effort`, and
`action` the commanded position where its names are those of the state. Names of joints lose what
stands for the channel (`shoulder_pan.pos`).

Source: LeRobotDataset v2.1 and v3.0 (folders `meta/`, `data/chunk-000/`, keys `codebase_version`,
`fps`, `features` with `dtype`, `shape` and `names`; columns `timestamp`, `episode_index`); its
motors' calibration (`range_min`, `range_max`) and norm modes (−100…100, of a gripper 0…100).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.recordings.bad_cells import named_columns
from ident.recordings.columns import TIME, take_run
from ident.recordings.load import DATASET
from ident.recordings.parquet import column_numbers, load_columns
from ident.recordings.recording import Recording, TelemetryIssue
from ident.recordings.session_toml import ANGLE_UNITS, SessionFile
from ident.safe_read import read_json, unchanged

CHANNEL_OF = {
    "observation.state": "position",
    "observation.velocity": "velocity",
    "observation.effort": "effort",
    "observation.torque": "effort",
    "observation.current": "current",
    "action": "position_command",
}
ENDINGS = (".pos", ".vel", ".effort", ".torque", ".current", "_pos", "_vel")
# Two turns: no joint of an arm turns farther [rad].
MOST_RADIANS = 12.6
# Counts a turn of the servos that LeRobot calibrates (Feetech STS, Dynamixel XL).
COUNTS = 4096
# What it calls a gripper.
GRIPPER = "gripper"
# The ends of LeRobot's normalised range, and robots that log it (`robot_type` of meta/info.json).
NORMALISED = 100.0
SHARE_LOGGERS = ("so100", "so101", "so_100", "so_101", "koch", "omx", "lekiwi")
SHARES = (
    'write `lerobot_calibration = "FILE.json"` at the top of session.toml, the file that '
    "lerobot-calibrate wrote, or record with use_degrees; "
    'where they are degrees all the same, write `angle_unit = "deg"` there'
)
EPISODE = "episode_index"
CLOCK = "timestamp"
REMEDY = "give the folder of a LeRobot data set, with meta/ and data/ in it"


def data_files(path: Path) -> list[Path]:
    """The Parquet files below data/ of a data set, sorted by path.

    Raises:
        RecordingError: There are none.
    """
    files = sorted((path / "data").rglob("*.parquet"))
    if not files:
        raise RecordingError(path, "has no Parquet file below data/", REMEDY)
    return files


def read_dataset(path: Path, session_file: SessionFile) -> Iterator[Recording]:
    """The episodes of a data set, in order.

    Raises:
        RecordingError: No data files, columns that can't be read or mapped, no features.
    """
    labels = {name: _labels(feature) for name, feature in load_info(path)["features"].items()}
    notes: tuple[TelemetryIssue, ...] = ()
    for number, file in enumerate(data_files(path)):
        with unchanged(file, RecordingError):
            columns = load_columns(file, labels)
        states: list[str] = []
        if number == 0:
            states = [name for name in columns if name.startswith("observation.state.")]
        far = [
            np.nanmax(np.abs(column_numbers(columns[name], name, file)), initial=0.0)
            for name in states
        ]
        given = session_file.lerobot_calibration
        if given is None and session_file.angle_factor is None:
            require_angles(path, states, max(far, default=0.0))
        if (
            given is None
            and session_file.angle_factor is None
            and max(far, default=0.0) > MOST_RADIANS
        ):
            session_file = replace(session_file, angle_factor=ANGLE_UNITS["deg"])
            what = (
                f"{path.name}: angles reach beyond {MOST_RADIANS:g}: taken as degrees, as LeRobot "
                "logs its arms"
            )
            notes = (
                TelemetryIssue(
                    "units_degrees", (), "note", what, 'none needed; or write angle_unit = "rad"'
                ),
            )
        settings = session_file if session_file.columns else _usual_names(columns, session_file)
        if (
            CLOCK in columns
            and TIME not in settings.columns.values()
            and settings.sample_rate_hz is None
        ):
            settings = replace(settings, columns={CLOCK: TIME, **settings.columns})
        if given is not None:
            require_shares(given, path, max(far, default=0.0))
            settings = replace(settings, units=share_units(given, settings) | dict(settings.units))
        for run in _episodes(file, columns, settings):
            yield run.replace(issues=(*run.issues, *notes))
            notes = ()


def require_angles(path: Path, names: Sequence[str], far: float) -> None:
    """Passes if positions are not LeRobot's shares of each joint's calibrated range.

    Its robots of today log −100…100 of the range (a gripper 0…100) under names that end in `.pos`,
    where they are not told to use degrees; its older data sets have degrees, and other names.

    Args:
        path: The data set.
        names: Columns of its positions.
        far: The largest of them, without sign.

    Raises:
        RecordingError: They are shares.
    """
    robot = str(load_info(path).get("robot_type") or "").lower()
    known = any(kind in robot for kind in SHARE_LOGGERS)
    called = bool(names) and all(name.endswith(".pos") for name in names)
    if known and called and MOST_RADIANS < far <= NORMALISED:
        what = (
            f"{robot} logs shares of each joint's range, −{NORMALISED:g} to {NORMALISED:g}, not "
            "angles"
        )
        raise RecordingError(path / DATASET, what, SHARES)


def require_shares(calibration: Path, path: Path, far: float) -> None:
    """Passes if positions may be shares of a range.

    Args:
        calibration, path: LeRobot's calibration that makes angles of them, and the data set.
        far: The largest position, without sign.

    Raises:
        RecordingError: They are more than the whole range.
    """
    if far > NORMALISED:  # LeRobot keeps them within
        what = f"positions reach {far:.4g}: no shares of a range, as {calibration.name} asks for"
        raise RecordingError(path / DATASET, what, "take lerobot_calibration out of session.toml")


def share_units(calibration: Path, settings: SessionFile) -> dict[str, float]:
    """What makes radians of the shares of each joint that positions are mapped to.

    Args:
        calibration: LeRobot's calibration of the arm.
        settings: Their `columns` say which motor is which joint.

    Returns:
        By joint the angle of a share of one, where a whole range is 200 (of a gripper 100) [rad].

    Raises:
        RecordingError: The file is no calibration, or lacks a joint.
    """
    ranges = read_calibration(calibration)
    units = {}
    for column, native in settings.columns.items():
        joint, _, channel = native.partition("/")
        if channel != "position":
            continue
        motor = joint_name(column.rpartition("observation.state.")[2])
        if motor not in ranges:
            known = ", ".join(ranges)
            raise RecordingError(
                calibration, f"has no motor {motor!r}", f"it has {known}: give that of this arm"
            )
        # A gripper's share is 0 to 100 of its range, any other joint's −100 to 100.
        whole = NORMALISED if motor == GRIPPER else 2.0 * NORMALISED
        units[joint] = ranges[motor] / whole * math.tau / COUNTS
    return units


def read_calibration(path: Path) -> dict[str, float]:
    """Width of each motor's calibrated range [counts].

    Raises:
        RecordingError: It can't be read, or holds no ranges.
    """
    remedy = "give the JSON that lerobot-calibrate wrote: motor -> range_min, range_max"
    record = read_json(path, remedy, RecordingError)
    ranges = {}
    for motor, numbers in record.items():
        ends = [
            numbers.get(end) if isinstance(numbers, dict) else None
            for end in ("range_min", "range_max")
        ]
        low, high = (
            end if isinstance(end, int) and not isinstance(end, bool) else 0 for end in ends
        )
        if not 0 < high - low <= COUNTS:
            raise RecordingError(path, f"{motor} has no range of 1 to {COUNTS} counts", remedy)
        ranges[motor] = float(high - low)
    return ranges


def longest_episode(path: Path) -> tuple[dict[str, Float[Array, " T"]], float | None]:
    """The longest episode in the first file of a data set.

    Returns:
        All its columns of numbers by name, and the rate that the data set states [Hz] (None where
        it states none that can be used).

    Raises:
        RecordingError: No data files, no features, or positions that are shares of a range.
    """
    info = load_info(path)
    file = data_files(path)[0]
    table = load_columns(
        file, {name: _labels(feature) for name, feature in info["features"].items()}
    )
    columns = {name: column_numbers(values, name, file) for name, values in table.items()}
    episode = columns.pop(EPISODE, None)
    if episode is not None and len(episode):
        longest = max(set(episode), key=lambda candidate: int((episode == candidate).sum()))
        columns = {name: values[episode == longest] for name, values in columns.items()}
    state_columns = [name for name in columns if name.startswith("observation.state.")]
    far = [float(np.nanmax(np.abs(columns[name]), initial=0.0)) for name in state_columns]
    require_angles(path, state_columns, max(far, default=0.0))
    rate = info.get("fps")
    usable = isinstance(rate, int | float) and not isinstance(rate, bool) and rate > 0
    return columns, float(rate) if usable and rate else None


def load_info(path: Path) -> dict[str, Any]:
    """What meta/info.json says of a data set, its features by name among it.

    Raises:
        RecordingError: It names none.
    """
    info = read_json(path / DATASET, REMEDY, RecordingError)
    if not isinstance(info.get("features"), dict) or not info["features"]:
        raise RecordingError(path / DATASET, "names no features", REMEDY)
    return info


def _labels(feature: object) -> list[str]:
    """The names of a feature's numbers; they may stand in a list, in a list of lists, or under a
    word for the axis.
    """
    names = feature.get("names") if isinstance(feature, dict) else None
    if isinstance(names, dict) and len(names) == 1:
        names = next(iter(names.values()))
    if isinstance(names, list) and len(names) == 1 and isinstance(names[0], list):
        names = names[0]
    return [str(name) for name in names] if isinstance(names, list) else []


def joint_name(label: str) -> str:
    """The joint that a label speaks of: without such endings as `.pos`, and without `main_` or
    `follower_` before it.
    """
    for ending in ENDINGS:
        label = label.removesuffix(ending)
    return label.removeprefix("main_").removeprefix("follower_")


def _usual_names(columns: Mapping[str, object], session_file: SessionFile) -> SessionFile:
    """Settings with the columns that the usual features stand for."""
    chosen = {CLOCK: TIME} if CLOCK in columns else {}
    for feature, channel in CHANNEL_OF.items():
        columns_of_feature = [name for name in columns if name.startswith(f"{feature}.")]
        # A new file maps the numbers of a feature without names by itself: which joint each is
        # nobody knows here.
        if columns_of_feature and not columns_of_feature[0].removeprefix(f"{feature}.").isdecimal():
            chosen.update(
                {
                    name: f"{joint_name(name.removeprefix(f'{feature}.'))}/{channel}"
                    for name in columns_of_feature
                }
            )
    joints = {
        native.partition("/")[0] for native in chosen.values() if native.endswith("/position")
    }
    named = {
        name: native
        for name, native in chosen.items()
        if native == TIME or native.partition("/")[0] in joints
    }
    return replace(session_file, columns=named)


def _episodes(file: Path, columns: Mapping[str, Any], settings: SessionFile) -> Iterator[Recording]:
    names = list(columns)
    rows = len(next(iter(columns.values()))) if columns else 0
    episode = (
        column_numbers(columns[EPISODE], EPISODE, file) if EPISODE in columns else np.zeros(rows)
    )
    for start, end in pairwise([0, *(np.flatnonzero(np.diff(episode)) + 1), rows]):

        def load(
            chosen: Sequence[int], start: int = int(start), end: int = int(end)
        ) -> list[Float[Array, " T"]]:
            return [
                column_numbers(columns[names[i]].slice(start, end - start), names[i], file)
                for i in chosen
            ]

        number = int(np.nan_to_num(episode[start])) if rows else 0
        yield take_run(f"episode_{number:06d}", named_columns(names, load, file), settings, file)
