"""Scene files: what the arm is to do, what stands in its way, and what it carries."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from ident.arrays import Array, Bool, Float, freeze
from ident.errors import InputError
from ident.recordings.recording import Payload
from ident.safe_read import read_toml, urdf_from
from plan.geometry.clouds import read_cloud
from plan.geometry.obstacle_files import read_mesh
from plan.geometry.solids import Box, Kind, Solid
from plan.geometry.tool import Carried
from plan.problem.driveless import is_the_driven
from plan.problem.poses import read_poses
from plan.problem.rules import Cone, Pose, ViaPoint, WayRules
from plan.problem.scene_keys import KEYS, SceneTable
from plan.problem.stops import Stop, read_stops

SHAPES = tuple(name.removeprefix("obstacle: ") for name in KEYS if name.startswith("obstacle: "))
# Keys by which a shape is known where it is not named.
TELLING = {"file": "mesh", "cloud": "cloud"}
# A floor is a box so wide that no arm reaches its edge, and so thick that none reaches its bottom:
# half lengths [m].
FLOOR_HALF = (50.0, 50.0, 1.0)
NO_RULES = WayRules()


def read_obstacles(top: SceneTable) -> tuple[Box, ...]:
    """The obstacles of a scene file, and its floor as one more.

    Raises:
        InputError: A key is missing, unknown or of the wrong kind, or a mesh can't be used.
    """
    obstacles = []
    for name, entry in top.items("obstacle"):
        obstacles.append(_shape(_shape_table(top.file, name, entry)))
    if "floor" in top:
        obstacles.append(floor_box(top.table("floor")["height_m"]))
    return tuple(obstacles)


def read_attached(top: SceneTable) -> tuple[Carried, ...]:
    """What the arm carries, the frame on which it hangs, and the links that it may touch."""
    attached = []
    for name, entry in top.items("attached"):
        table = _shape_table(top.file, name, entry, carried=True)
        touches = table.entry.get("touches", [])
        if not isinstance(touches, list) or not all(isinstance(name, str) for name in touches):
            what = f"touches is {touches!r}, not a list of links"
            raise InputError(top.file, what, 'give touches = ["link", …]')
        attached.append(Carried(_shape(table, carried=True), table["link"], tuple(touches)))
    return tuple(attached)


def floor_box(height: float) -> Box:
    """The floor at a height above the base's origin [m]."""
    centre = np.array([0.0, 0.0, height - FLOOR_HALF[2]])
    return Box("floor", 0, np.eye(3), centre, Solid.simple("box", *FLOOR_HALF))


def _shape_table(file: Path, name: str, entry: dict[str, Any], carried: bool = False) -> SceneTable:
    """A shape's table, its kind found out and its keys looked at."""
    told = [shape for word, shape in TELLING.items() if word in entry]
    kind = entry.get("shape", told[0] if told else "box")
    if kind not in SHAPES:
        raise InputError(file, f"{name}: shape is {kind!r}", f"use one of: {', '.join(SHAPES)}")
    keys = {**KEYS["obstacle"], **KEYS[f"obstacle: {kind}"]}
    if carried:
        keys |= KEYS["attached"]
    table = SceneTable(file, name, {**entry, "shape": kind}, keys)
    if kind == "cloud" and carried:
        remedy = "give another shape, or a mesh, of which the hull counts"
        raise InputError(file, f"{name}: a cloud can't be carried", remedy)
    return table


def _shape(table: SceneTable, carried: bool = False) -> Box:
    """A shape and its place.

    Of a mesh that is carried the hull: the arm's own bodies are convex.
    """
    kind = table["shape"]
    middle = np.zeros(3)
    folder = table.file.parent
    if kind == "box":
        solid = Solid.simple("box", *(table["size_m"] / 2))
    elif kind == "mesh":
        file = folder / table.need("file")
        solid, middle = read_mesh(file, table["scale"], table["hull"] or carried)
    elif kind == "cloud":
        solid, middle = read_cloud(folder / table.need("cloud"), table["radius_m"], table["scale"])
    else:
        lengths = () if kind == "sphere" else (table["length_m"] / 2,)
        solid = Solid.simple(cast("Kind", kind), table["radius_m"], *lengths)
    rotation = table["rpy_rad"]
    # What was scanned is given in the base frame, where nothing else is said.
    centre = np.zeros(3) if kind == "cloud" and "xyz_m" not in table else table.need("xyz_m")
    return Box(
        str(table.entry.get("name", table.name)), 0, rotation, centre + rotation @ middle, solid
    )


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What stands round an arm, what it carries, and how far and fast it may move there."""

    source: Path  # the file
    robot: str | None = None  # name or URDF path of the robot that it names, if any
    # Shapes in the base frame, the floor among them if the file has one.
    obstacles: tuple[Box, ...] = ()
    attached: tuple[Carried, ...] = ()  # shapes that the arm carries
    # Mass that it carries, with its centre in the frame of `payload_link`.
    payload: Payload | None = None
    payload_link: str | None = None  # that frame; the arm's tip frame if None
    srdf: Path | None = None  # file that names pairs of links to leave out of checks
    # Position limits inside the robot's [rad]; None for the robot's.
    lower: Float[Array, " n"] | None = None
    upper: Float[Array, " n"] | None = None
    # Speed limits other than the robot's [rad/s]; None for the robot's.
    speed: Float[Array, " n"] | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Task(Surroundings):
    """What a scene file says."""

    robot: str  # name or URDF path
    # Ends [rad]; the goal is the start until `pose` is brought to joint angles.
    start: Float[Array, " n"]
    goal: Float[Array, " n"]
    # Duration of the motion [s]; where time is the objective it may be None, or is a first guess.
    duration: float | None = None
    # Where the duration of least energy is to be found, the longest [s].
    longest: float | None = None
    standby: float = 0.0  # power that the cell takes all the while [W]
    via_points: int = 2  # via points at least
    # Positions of the joints that do not move [rad]; zeros if None.
    wrist: Float[Array, " k"] | None = None
    clearance: float = 0.005  # distance to keep [m]
    reach: float = math.pi / 2  # how far a via angle may go from the initial one [rad]
    # Limits other than the robot's [N m]; None for the robot's.
    torque: Float[Array, " n"] | None = None
    # Limits of acceleration [rad/s²] and jerk [rad/s³]; None for none.
    acceleration: Float[Array, " n"] | None = None
    jerk: Float[Array, " n"] | None = None
    # Whether the maker's published limits of acceleration and jerk are kept where those are None.
    makers: bool = True
    # Via points of the file itself, from which the search begins [rad].
    taught: Float[Array, "V n"] | None = None
    # Their time stamps [s]; None if they are to be found.
    taught_times: Float[Array, " V"] | None = None
    pose: Pose | None = None  # where a frame is to end, in place of the goal's angles
    others: tuple[Float[Array, " n"], ...] = ()  # further goals, any of which will do as well [rad]
    other_poses: tuple[Pose, ...] = ()  # further poses likewise
    way: WayRules = NO_RULES  # what the motion has to keep on its way
    stops: tuple[Stop, ...] = ()  # where a cycle stops on its way; none for a single motion
    # By which the file names start and goal, for messages.
    keys: tuple[str, str] = ("start_deg", "goal_deg")
    # Joints without a drive, where they stand [rad or m].
    held: Mapping[str, float] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """Number of joints that move."""
        return len(self.start)


def load_task(path: str | Path) -> Task:
    """Reads a scene file.

    Raises:
        InputError: Not TOML, a key is missing, unknown or of the wrong kind.
    """
    top = _read(Path(path))
    if "task" not in top:
        raise InputError(top.file, "it has no [task] table", "add one")
    robot = urdf_from(top.file, top.need("robot"))
    named = top.table("task")
    if "start_state" not in named:
        named["start_deg"]
    keys = []
    for ends in (
        ("start_deg", "start_state"),
        ("goal_deg", "goals_deg", "goal_pose", "goal_state"),
    ):
        stated = [key for key in ends if key in named]
        keys.append(stated[0] if stated else ends[0])
    top.table("limits")
    from ident.robot.arm import ArmModel  # heavy: a slip in the tables above is reported before

    arm = ArmModel.load(robot)
    if "srdf" in top or {"group", "start_state", "goal_state"} & set(named.entry):
        from plan.problem.srdf_groups import give_states

        give_states(top, arm)
    given = len(top.table("task")["start_deg"])
    sliding = (
        arm.sliding_joints[arm.n - given :] if is_the_driven(given, arm) else arm.sliding_joints
    )
    slides = np.append(sliding, np.zeros(given, dtype=bool))
    top.joints = slides[:given]
    task = top.table("task")
    limits = top.table("limits")
    start = task["start_deg"]
    wrist = task["wrist_deg"]
    if wrist is not None:
        wrist = np.where(slides[given:][: len(wrist)], np.degrees(wrist), wrist)
    poses = read_poses(task, "goal_pose")
    goals = [start] if poses else task["goals_deg"] or [task.need("goal_deg")]
    taught = times = None
    if "via_points_deg" in task:
        taught = np.array(task["via_points_deg"])
        times = task["times_s"]
        if times is not None and len(times) != len(taught):
            raise task.fault(
                "times_s", f"has {len(times)} numbers, not {len(taught)}", f"give {len(taught)}"
            )
        if times is not None and np.any(np.diff(times) <= 0):
            raise InputError(
                task.file,
                f"{task.name}: times_s do not increase",
                "give one later stamp a via point",
            )
    return Task(
        **vars(_surroundings(top)) | {"robot": robot},
        start=start,
        goal=goals[0],
        duration=task["duration_s"],
        longest=task["at_most_s"],
        standby=task["standby_W"],
        via_points=task["via_points"] if taught is None else len(taught),
        wrist=wrist,
        clearance=task["clearance_m"],
        reach=task["reach_deg"],
        torque=limits["torque_Nm"],
        acceleration=limits["acceleration_deg_s2"],
        jerk=limits["jerk_deg_s3"],
        makers=limits["makers"],
        taught=taught,
        taught_times=times,
        pose=poses[0] if poses else None,
        others=tuple(goals[1:]),
        other_poses=tuple(poses[1:]),
        way=read_rules(top),
        stops=read_stops(top, start),
        keys=(keys[0], keys[1]),
    )


def load_surroundings(path: str | Path, joints: Bool[Array, " n"]) -> Surroundings:
    """Reads a scene file for an arm of whose joints each slides or turns.

    Its task, if it has one, is left aside.

    Raises:
        InputError: As `load_task`.
    """
    top = _read(Path(path), joints)
    top.table("task")
    top.table("tool")
    return _surroundings(top)


def _read(file: Path, joints: Bool[Array, " n"] | None = None) -> SceneTable:
    """The top of a scene file."""
    return SceneTable(file, "", read_toml(file, "give a scene file (TOML)"), joints=joints)


def _surroundings(top: SceneTable) -> Surroundings:
    """What a scene file says beside its task."""
    limits = top.table("limits")
    payload = top.table("payload")
    mass = None
    low = limits["lower_deg"]
    high = limits["upper_deg"]
    if low is not None and high is not None and np.any(low >= high):
        j = int(np.flatnonzero(low >= high)[0])
        lower = limits.entry["lower_deg"][j]
        upper = limits.entry["upper_deg"][j]
        what = f"{lower:g} is not below limits.upper_deg {upper:g}"
        raise limits.fault("lower_deg", what, "correct one of them")
    if "payload" in top:
        x, y, z = payload["com_m"].tolist()
        mass = Payload(payload["mass_kg"], (x, y, z))
    return Surroundings(
        source=top.file,
        robot=None if "robot" not in top else urdf_from(top.file, top["robot"]),
        obstacles=read_obstacles(top),
        attached=read_attached(top),
        payload=mass,
        payload_link=payload["link"],
        srdf=top.file.parent / top["srdf"] if "srdf" in top else None,
        lower=low,
        upper=high,
        speed=limits["speed_deg_s"],
    )


def read_rules(top: SceneTable) -> WayRules:
    """The tables `[tool]`, `[[tool.cone]]` and `[[pass]]` of a scene file.

    Raises:
        InputError: A key is missing, unknown or of the wrong kind.
    """
    tool = top.table("tool")
    for key in ("within_m", "within_deg"):
        if key in tool and not tool["straight"]:
            raise tool.fault(key, "has nothing to be off from", "add straight = true, or drop it")
    return WayRules(
        frame=tool["frame"],
        speed=tool["speed_m_s"],
        straight=tool["within_m"] if tool["straight"] else None,
        turning=tool["within_deg"],
        cones=tuple(
            Cone(table["axis"], table["towards"], table[given], given == "allowed_deg")
            for table in tool.tables("cone")
            for given in [table.one_of("allowed_deg", "keep_out_deg")]
        ),
        vias=tuple(
            ViaPoint(
                freeze(table[kind]),
                kind == "xyz_m",
                table["within_m" if kind == "xyz_m" else "within_deg"],
            )
            for table in top.tables("pass")
            for kind in [table.one_of("deg", "xyz_m")]
        ),
    )
