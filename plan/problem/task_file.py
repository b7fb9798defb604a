"""Scene files: what the arm is to do, and what stands in its way."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.recordings.recording import Payload
from ident.safe_read import read_toml
from plan.errors import SceneError
from plan.geometry.boxes import Box
from plan.geometry.tool import Carried
from plan.problem.obstacle_tables import floor_box, read_shape
from plan.problem.pose import Pose, read_poses
from plan.problem.rules import WayRules, read_rules
from plan.problem.scene_keys import KEYS

DEFAULT_CLEARANCE = 0.005
DEFAULT_REACH_DEG = 90.0


@dataclass(frozen=True, eq=False)
class Trial:
    """One set of taught via points.

    Attributes:
        name: Its name.
        vias: Via points [rad].
        times: Their time stamps [s]; None if they are to be found.
    """

    name: str
    vias: Float[Array, "V n"]
    times: Float[Array, " V"] | None = None


@dataclass(frozen=True, eq=False)
class Task:
    """What a scene file says.

    Attributes:
        source: The file.
        robot: Name or URDF path.
        start, goal: Ends [rad]; the goal is the start until `pose` is brought to joint angles.
        duration: Duration of the motion [s]; where time is the objective it may be None, or is a first guess.
        via_points: Via points at least.
        wrist: Positions of the joints that do not move [rad]; zeros if None.
        clearance: Distance to keep [m].
        reach: How far a via angle may go from the initial one [rad].
        torque, speed: Limits other than the robot's [N m, rad/s]; None for the robot's.
        lower, upper: Position limits inside the robot's [rad]; None for the robot's.
        acceleration, jerk: Limits of acceleration [rad/s²] and jerk [rad/s³]; None for none.
        makers: Whether the maker's published limits of acceleration and jerk are kept where those are None.
        obstacles: Shapes in the base frame, the floor among them.
        attached: Shapes that the arm carries.
        payload: Mass that it carries, with its centre in the frame of `payload_link`.
        payload_link: That frame; the arm's tip frame if None.
        srdf: File that names pairs of links to leave out of checks.
        taught: Via points of the file itself.
        pose: Where a frame is to end, in place of the goal's angles.
        avoid_singular: Whether singular positions are fined.
        others: Further goals, any of which will do as well [rad].
        other_poses: Further poses likewise.
        way: What the motion has to keep on its way.
    """

    source: Path
    robot: str
    start: Float[Array, " n"]
    goal: Float[Array, " n"]
    duration: float | None = None
    via_points: int = 2
    wrist: Float[Array, " k"] | None = None
    clearance: float = DEFAULT_CLEARANCE
    reach: float = math.radians(DEFAULT_REACH_DEG)
    torque: Float[Array, " n"] | None = None
    speed: Float[Array, " n"] | None = None
    lower: Float[Array, " n"] | None = None
    upper: Float[Array, " n"] | None = None
    acceleration: Float[Array, " n"] | None = None
    jerk: Float[Array, " n"] | None = None
    makers: bool = True
    obstacles: tuple[Box, ...] = ()
    attached: tuple[Carried, ...] = ()
    payload: Payload | None = None
    payload_link: str | None = None
    srdf: Path | None = None
    taught: tuple[Trial, ...] = field(default_factory=tuple)
    pose: Pose | None = None
    avoid_singular: bool = False
    others: tuple[Float[Array, " n"], ...] = ()
    other_poses: tuple[Pose, ...] = ()
    way: WayRules = field(default_factory=WayRules)

    @property
    def n(self) -> int:
        """Number of joints that move."""
        return len(self.start)


def load_task(path: str | Path) -> Task:
    """Reads a scene file.

    Raises:
        SceneError: Not TOML, a key is missing, unknown or of the wrong kind.
    """
    file = Path(path)
    document = _read(file)
    reader = Reader(file)
    reader.known("", document)
    task = reader.table(document, "task")
    limits = document.get("limits", {})
    start = reader.numbers(task, "task.start_deg")
    count = len(start)
    poses = read_poses(reader, task)
    goals = [np.radians(start)] if poses else _goals(reader, task, count)
    taught = _taught(reader, task, count)
    via_points = len(taught[0].vias) if taught else reader.whole(task, "task.via_points", 2)
    return Task(
        source=file,
        robot=reader.text(document, "robot"),
        start=np.radians(start),
        goal=goals[0],
        duration=reader.number(task, "task.duration_s") if "duration_s" in task else None,
        via_points=via_points,
        wrist=None if "wrist_deg" not in task else np.radians(reader.numbers(task, "task.wrist_deg")),
        clearance=reader.number(task, "task.clearance_m", DEFAULT_CLEARANCE),
        reach=math.radians(reader.number(task, "task.reach_deg", DEFAULT_REACH_DEG, least=1e-3)),
        torque=None if "torque_Nm" not in limits else reader.positive(limits, "limits.torque_Nm", count),
        speed=reader.rates(limits, "limits.speed_deg_s", count),
        lower=reader.bounds(limits, count)[0],
        upper=reader.bounds(limits, count)[1],
        acceleration=reader.rates(limits, "limits.acceleration_deg_s2", count),
        jerk=reader.rates(limits, "limits.jerk_deg_s3", count),
        makers=reader.flag(limits, "limits.makers", True),
        obstacles=read_obstacles(reader, document),
        attached=_attached(reader, document),
        payload=_payload(reader, document),
        payload_link=_link(reader, document.get("payload", {})),
        srdf=None if "srdf" not in document else file.parent / reader.text(document, "srdf"),
        taught=taught,
        pose=poses[0] if poses else None,
        avoid_singular=reader.flag(task, "task.avoid_singular"),
        others=tuple(goals[1:]),
        other_poses=tuple(poses[1:]),
        way=read_rules(reader, document, count),
    )


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What stands round an arm that is only to be moved about, and what it may do there.

    Attributes:
        source: The file.
        robot: The robot that it names, if any.
        obstacles: Shapes in the base frame, the floor among them if the file has one.
        attached: What the arm carries.
        payload, payload_link: Mass that it carries, and the frame in which its centre is given.
        srdf: File that names pairs of links to leave out of checks.
        lower, upper, speed: Limits inside the robot's [rad, rad/s]; None for the robot's.
    """

    source: Path
    robot: str | None = None
    obstacles: tuple[Box, ...] = ()
    attached: tuple[Carried, ...] = ()
    payload: Payload | None = None
    payload_link: str | None = None
    srdf: Path | None = None
    lower: Float[Array, " n"] | None = None
    upper: Float[Array, " n"] | None = None
    speed: Float[Array, " n"] | None = None


def load_surroundings(path: str | Path, joints: int) -> Surroundings:
    """Reads a scene file for an arm of so many joints; its task, if it has one, is left aside.

    Raises:
        SceneError: As `load_task`.
    """
    file = Path(path)
    document, reader = _read(file), Reader(file)
    reader.known("", document)
    limits = document.get("limits", {})
    low, high = reader.bounds(limits, joints)
    return Surroundings(
        source=file,
        robot=None if "robot" not in document else reader.text(document, "robot"),
        obstacles=read_obstacles(reader, document),
        attached=_attached(reader, document),
        payload=_payload(reader, document),
        payload_link=_link(reader, document.get("payload", {})),
        srdf=None if "srdf" not in document else file.parent / reader.text(document, "srdf"),
        lower=low,
        upper=high,
        speed=reader.rates(limits, "limits.speed_deg_s", joints),
    )


def load_trials(path: str | Path, joints: int) -> list[Trial]:
    """Reads a file of taught via points: `[[trial]]` tables with `via_points_deg`, and `name`, `times_s` if known.

    Raises:
        SceneError: Not such a file.
    """
    file = Path(path)
    document, reader = _read(file), Reader(file)
    entries = document.get("trial")
    if not isinstance(entries, list) or not entries:
        raise SceneError(file, "it has no [[trial]] table", "give one [[trial]] with via_points_deg a taught motion")
    return [_trial(reader, entry, f"trial {i}", joints) for i, entry in enumerate(entries, start=1)]


def _goals(reader: Reader, task: Mapping[str, Any], joints: int) -> list[Float[Array, " n"]]:
    """The goal, or the goals of which any will do [rad]."""
    if "goals_deg" not in task:
        return [np.radians(reader.numbers(task, "task.goal_deg", joints))]
    if "goal_deg" in task:
        raise SceneError(reader.file, "task has both goal_deg and goals_deg", "give one of them")
    rows = task["goals_deg"]
    if not isinstance(rows, list) or not rows:
        raise SceneError(reader.file, "task.goals_deg is not a list of rows", "give rows of joint angles in degrees")
    return [
        np.radians(reader.numbers({"row": row}, f"task.goals_deg {i}.row", joints)) for i, row in enumerate(rows, 1)
    ]


def _taught(reader: Reader, task: Mapping[str, Any], joints: int) -> tuple[Trial, ...]:
    return (_trial(reader, task, "task", joints),) if "via_points_deg" in task else ()


def _trial(reader: Reader, entry: Any, name: str, joints: int) -> Trial:
    if not isinstance(entry, dict) or "via_points_deg" not in entry:
        raise SceneError(reader.file, f"{name} has no via_points_deg", "give rows of joint angles in degrees")
    rows = entry["via_points_deg"]
    if not isinstance(rows, list) or not rows:
        raise SceneError(reader.file, f"{name}: via_points_deg is not a list of rows", "give rows of joint angles")
    vias = [reader.numbers({"row": row}, f"{name}.row", joints) for row in rows]
    times = None
    if "times_s" in entry:
        times = reader.positive(entry, f"{name}.times_s", len(rows))
        if np.any(np.diff(times) <= 0):
            raise SceneError(reader.file, f"{name}: times_s do not increase", "give one later stamp a via point")
    return Trial(str(entry.get("name", name)), np.radians(np.array(vias)), times)


def read_obstacles(reader: Reader, document: Mapping[str, Any]) -> tuple[Box, ...]:
    """The obstacles of a scene file, and its floor as one more."""
    found = [read_shape(reader, *item) for item in reader.tables(document, "obstacle", "obstacle")]
    if "floor" in document:
        found.append(floor_box(reader.number(document["floor"], "floor.height_m", 0.0, least=-10.0)))
    return tuple(found)


def _attached(reader: Reader, document: Mapping[str, Any]) -> tuple[Carried, ...]:
    """What the arm carries, the frame on which it hangs, and the links that it may touch."""
    return tuple(
        Carried(read_shape(reader, entry, key, {"touches", "link"}), _link(reader, entry), _names(reader, entry))
        for entry, key in reader.tables(document, "attached", "attached")
    )


def _link(reader: Reader, entry: Mapping[str, Any]) -> str | None:
    return reader.text(entry, "link") if "link" in entry else None


def _names(reader: Reader, entry: Mapping[str, Any]) -> tuple[str, ...]:
    """Links that what is carried may touch."""
    names = entry.get("touches", [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise SceneError(reader.file, f"touches is {names!r}, not a list of links", 'give touches = ["link", …]')
    return tuple(names)


def _payload(reader: Reader, document: Mapping[str, Any]) -> Payload | None:
    table = document.get("payload")
    if table is None:
        return None
    com = reader.numbers(table, "payload.com_m", 3, np.zeros(3))
    return Payload(reader.number(table, "payload.mass_kg"), (float(com[0]), float(com[1]), float(com[2])))


def _read(file: Path) -> dict[str, Any]:
    return read_toml(file, "give a scene file (TOML)", SceneError)


@dataclass(frozen=True)
class Reader:
    """Reads keys with a message that names file and key."""

    file: Path

    def known(self, table: str, entry: Mapping[str, Any], name: str = "") -> None:
        unknown = sorted(set(entry) - set(KEYS[table]))
        if unknown:
            place = f"{name or table or 'file'}: "
            raise SceneError(
                self.file, f"{place}unknown key {unknown[0]!r}", f"keys are: {', '.join(sorted(KEYS[table]))}"
            )
        for inner in ("task", "limits", "floor", "payload", "tool"):
            if table == "" and inner in entry:
                if not isinstance(entry[inner], dict):
                    raise SceneError(self.file, f"{inner} is not a table", f"write [{inner}] and its keys")
                self.known(inner, entry[inner])

    def only(self, entry: Mapping[str, Any], keys: set[str], name: str) -> None:
        """Raises SceneError for a key that is not among some."""
        unknown = sorted(set(entry) - keys)
        if unknown:
            raise SceneError(self.file, f"{name}: unknown key {unknown[0]!r}", f"keys are: {', '.join(sorted(keys))}")

    def table(self, entry: Mapping[str, Any], key: str) -> dict[str, Any]:
        found = entry.get(key)
        if not isinstance(found, dict):
            raise SceneError(self.file, f"it has no [{key}] table", "add one")
        return found

    def tables(self, entry: Mapping[str, Any], key: str, name: str) -> list[tuple[Any, str]]:
        """The tables of a list, each with what it is called in messages."""
        found = entry.get(key, [])
        if not isinstance(found, list) or not all(isinstance(one, dict) for one in found):
            raise SceneError(self.file, f"{name} is not a list of tables", f"write [[{name}]], with two brackets")
        return [(one, f"{name} {i}") for i, one in enumerate(found, start=1)]

    def text(self, entry: Mapping[str, Any], key: str) -> str:
        found = entry.get(key)
        if not isinstance(found, str) or not found:
            raise SceneError(self.file, f"{key} is missing", f'add {key} = "…"')
        return found

    def number(self, entry: Mapping[str, Any], key: str, default: float | None = None, least: float = 0.0) -> float:
        found = entry.get(key.rsplit(".", 1)[-1], default)
        if isinstance(found, bool) or not isinstance(found, int | float) or not math.isfinite(found) or found < least:
            raise SceneError(self.file, f"{key} is {found!r}, not a number of {least:g} or more", "give a number")
        return float(found)

    def whole(self, entry: Mapping[str, Any], key: str, default: int) -> int:
        found = entry.get(key.rsplit(".", 1)[-1], default)
        if isinstance(found, bool) or not isinstance(found, int) or not 1 <= found <= 20:
            raise SceneError(self.file, f"{key} is {found!r}, not a whole number from 1 to 20", "give one")
        return found

    def flag(self, entry: Mapping[str, Any], key: str, default: bool = False) -> bool:
        """True or false; the default where the key is not there."""
        found = entry.get(key.rsplit(".", 1)[-1], default)
        if not isinstance(found, bool):
            raise SceneError(self.file, f"{key} is {found!r}", "give true or false")
        return found

    def numbers(
        self, entry: Mapping[str, Any], key: str, count: int | None = None, default: Array | None = None
    ) -> Float[Array, " k"]:
        found = entry.get(key.rsplit(".", 1)[-1], default)
        if found is None:
            raise SceneError(self.file, f"{key} is missing", "add it")
        try:
            values = np.array(found, dtype=float)
        except (TypeError, ValueError):
            values = np.array(np.nan)
        if values.ndim != 1 or len(values) == 0 or not np.isfinite(values).all():
            raise SceneError(self.file, f"{key} is {found!r}, not a list of numbers", "give a list of numbers")
        if count is not None and len(values) != count:
            raise SceneError(self.file, f"{key} has {len(values)} numbers, not {count}", f"give {count}")
        return values

    def positive(self, entry: Mapping[str, Any], key: str, count: int) -> Float[Array, " k"]:
        values = self.numbers(entry, key, count)
        if np.any(values <= 0):
            raise SceneError(
                self.file, f"{key} {values.tolist()} is not above zero throughout", "give positive numbers"
            )
        return values

    def rates(self, entry: Mapping[str, Any], key: str, count: int) -> Float[Array, " k"] | None:
        """Positive numbers in degrees, as radians; None where the key is not there."""
        return None if key.rsplit(".", 1)[-1] not in entry else np.radians(self.positive(entry, key, count))

    def bounds(
        self, limits: Mapping[str, Any], count: int
    ) -> tuple[Float[Array, " k"] | None, Float[Array, " k"] | None]:
        """Lower and upper position limits [rad]; None where they are not there."""
        low, high = (
            None if key not in limits else np.radians(self.numbers(limits, f"limits.{key}", count))
            for key in ("lower_deg", "upper_deg")
        )
        if low is not None and high is not None and np.any(low >= high):
            j = int(np.flatnonzero(low >= high)[0])
            what = f"limits.lower_deg {np.degrees(low[j]):g} is not below limits.upper_deg {np.degrees(high[j]):g}"
            raise SceneError(self.file, what, "correct one of them")
        return low, high
