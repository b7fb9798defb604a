"""Recordings of real arms in the native form, and their URDFs with a body more."""

from __future__ import annotations

import itertools
import re
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.model.link_inertia import ball_of, read_inertial, set_inertial
from ident.recordings.load import load_recording, load_session
from ident.recordings.recording import Recording
from ident.recordings.session_toml import NAME, SessionFile, load_session_file
from ident.records import JsonRecord, JsonTable
from ident.robot.arm import ArmModel
from ident.simulation.hardware import without_geometry

# Between runs whose clocks start anew each, so that they share one; and what is left as it is [s].
PAUSE = 5.0
LONGEST_PAUSE = 60.0


def with_body(urdf: str, joint: str, mass: float, place: Float[Array, " 3"], radius: float) -> str:
    """The URDF's text with a ball on the link that a joint moves; a negative mass [kg] takes it
    away.

    Its centre is given in the link's frame [m], as is its radius of gyration [m].
    """
    root = ET.fromstring(urdf)
    child = next(element for element in root.findall("joint") if element.get("name") == joint).find(
        "child"
    )
    link = next(
        element
        for element in root.findall("link")
        if child is not None and element.get("name") == child.get("link")
    )
    set_inertial(link, read_inertial(link) + ball_of(mass, place, radius))
    return ET.tostring(root, encoding="unicode")


# Recordings of real arms as sessions in the native form: those of `arms.toml`, and any folder that
# names its robot.


@dataclass(frozen=True, eq=False)
class Source:
    """Recordings of one arm."""

    name: str  # of the session
    arm: str  # of the physical arm: sessions of one arm have it in common
    urdf: str  # text of its URDF, without shapes
    runs: tuple[Recording, ...]  # what was recorded; the clock goes on from run to run
    weight: float = 1.0  # how often it is drawn, beside the other sessions of its arm

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, the same in every run."""
        return self.runs[0].joints


def known_recordings() -> dict[str, JsonRecord]:
    """The table of public recordings, by session (`arms.toml`)."""
    text = Path(__file__).with_name("arms.toml").read_text(encoding="utf-8")
    return dict(tomllib.loads(text))


def recorded_causes() -> dict[str, JsonRecord]:
    """The table of public recordings with a cause that was measured, by session
    (`recorded.toml`).
    """
    text = Path(__file__).with_name("recorded.toml").read_text(encoding="utf-8")
    return dict(tomllib.loads(text))


def kept_back_arms() -> tuple[str, ...]:
    """Arms whose recordings stay closed until a release."""
    return tuple(
        sorted(
            {entry["arm"] for entry in known_recordings().values() if entry.get("kept_back", False)}
        )
    )


def load_sources(
    folder: Path, kept_back: bool = False, arms: Collection[str] = ()
) -> tuple[Source, ...]:
    """Recordings of real arms below a folder.

    Args:
        folder: Where to search; sessions that no table lists are taken if their `session.toml`
            names a robot.
        kept_back: The arms that stay closed until a release, in place of all others.
        arms: Only these physical arms; all if none is given.

    Raises:
        InputError: There are none.
    """
    known = known_recordings()
    sources: list[Source] = []
    for name, entry in known.items():
        wanted = entry.get("kept_back", False) == kept_back and (not arms or entry["arm"] in arms)
        if wanted and (folder / entry["folder"]).is_dir():
            sources.append(load_known(name, entry, folder))
    listed = {(folder / entry["folder"]).resolve() for entry in known.values()}
    for path in () if kept_back else sorted(folder.rglob(NAME)):
        place = path.parent
        if place.resolve() in listed or (arms and place.name not in arms):
            continue
        if load_session_file(path).robot:
            session = load_session(place)
            parts = place.resolve().relative_to(folder.resolve()).parts
            sources.append(
                _source("_".join(parts) or place.name, place.name, str(session.robot), session.runs)
            )
    if not sources:
        raise InputError(
            folder,
            f"no folder below it has a {NAME} with robot = …",
            "add one beside the recordings",
        )
    return tuple(sources)


@cache
def measured_causes(arm: str) -> dict[str, list[str]]:
    """What others measured of an arm whose recordings are public: joints by effect
    (`measured.toml`).
    """
    return dict(
        tomllib.loads(Path(__file__).with_name("measured.toml").read_text(encoding="utf-8")).get(
            arm, {}
        )
    )


def load_known(name: str, entry: JsonTable, folder: Path) -> Source:
    """A session of one of the tables, below the folder of all recordings."""
    place = folder / entry["folder"]
    robot = entry.get("robot", "")
    if "number_files" in entry:
        # Files that hold one number a line, row by row.
        joints = tuple(entry["joints"])
        read = {
            channel: np.loadtxt(place / file) for channel, file in entry["number_files"].items()
        }
        position, velocity, effort = (
            read[key].reshape(-1, len(joints)) for key in ("position", "velocity", "effort")
        )
        runs = [Recording(name, joints, read["time"], position, effort, velocity)]
    elif "arrays" in entry:
        runs = [_load_arrays(path, entry) for path in sorted(place.glob("*.npz"))]
    else:
        settings = _settings_of(entry, place)
        files = [path for path in sorted(place.iterdir()) if path.suffix in (".csv", ".parquet")]
        wanted = entry.get("runs", [""])
        runs = []
        for path in files:
            if any(word in path.name for word in wanted):
                runs.append(load_recording(path, settings))
        robot = robot or str(settings.robot)
    runs = [_shortened(run, entry) for run in runs]
    if "parts" in entry:
        runs = cut(runs[0], entry["parts"])
    beside = folder / robot
    source = _source(name, entry["arm"], str(beside) if beside.is_file() else robot, runs)
    return replace(source, weight=float(entry.get("weight", 1.0)))


def _load_arrays(path: Path, entry: JsonTable) -> Recording:
    """A run whose channels are arrays of all joints in an archive."""
    with np.load(path, allow_pickle=False) as archive:
        read = {
            channel: np.asarray(archive[name], dtype=float)
            for channel, name in entry["arrays"].items()
        }
    joints = tuple(entry["joints"])
    return Recording(
        path.stem, joints, read["time"], read["position"], read["effort"], read["velocity"]
    )


def _shortened(run: Recording, entry: JsonTable) -> Recording:
    """What of a run the table asks for, with the sign of the torque that it states."""
    count = int(
        np.searchsorted(run.time, run.time[0] + entry.get("longest_s", np.inf), side="right")
    )
    rows = run.at(slice(0, count, entry.get("every", 1)), run.name)
    return rows.replace(effort=entry.get("effort_sign", 1) * rows.effort)


def _settings_of(entry: JsonTable, place: Path) -> SessionFile:
    if "joints" not in entry:
        return load_session_file(place / NAME) if (place / NAME).is_file() else SessionFile()
    joints = entry["joints"]
    columns = {}
    if "headers" in entry:
        letters = {"position": "q", "velocity": "dq", "effort": "effort"}
        columns = {
            f"{x}_{h}": f"{j}/{c}"
            for c, x in letters.items()
            for j, h in zip(joints, entry["headers"], strict=True)
        }
        columns["t"] = "time"
    else:
        columns = {
            str(k + i): f"{j}/{c}"
            for c, k in entry["first_column"].items()
            for i, j in enumerate(joints)
        }
        columns["1"] = "time"
    return SessionFile(
        columns=columns, drive_gain=dict(zip(joints, entry.get("gains", ()), strict=False))
    )


def _source(name: str, arm: str, robot: str, runs: Sequence[Recording]) -> Source:
    model = ArmModel.load(robot).keeping(runs[0].joints)
    ordered = []
    for run in runs:
        known = [joint for joint in model.joint_names if joint in run.joints]
        ordered.append(run.select(known))
    # The runs with position, velocity and torque alone, one after the other in time.
    recordings: list[Recording] = []
    for i, run in enumerate(ordered):
        rows = np.concatenate([[True], np.diff(run.time) > 0.0])
        time = run.time[rows]
        gap = time[0] - ordered[i - 1].time[-1] if i else 0.0
        start = (
            recordings[-1].time[-1] + (gap if 0.0 < gap < LONGEST_PAUSE else PAUSE)
            if recordings
            else 0.0
        )
        velocity = None if run.velocity is None else run.velocity[rows]
        channels = run.position[rows], run.effort[rows], velocity
        recordings.append(
            Recording(re.sub(r"\W", "_", run.name), run.joints, time - time[0] + start, *channels)
        )
    return Source(name, arm, without_geometry(model.urdf), tuple(recordings))


def cut(run: Recording, parts: int) -> list[Recording]:
    """One long run in consecutive parts of equal length."""
    edges: Array = np.linspace(0, len(run), parts + 1).astype(int)
    return [
        run.at(slice(a, b), f"{run.name}_{i}") for i, (a, b) in enumerate(itertools.pairwise(edges))
    ]
