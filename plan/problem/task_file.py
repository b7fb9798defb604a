"""Scene files: what the arm is to do, and what stands in its way."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.recordings.recording import Payload
from ident.safe_read import read_toml
from plan.errors import SceneError
from plan.geometry.boxes import Box
from plan.geometry.tool import Carried
from plan.problem.obstacle_tables import read_attached, read_obstacles
from plan.problem.pose import Pose, read_poses
from plan.problem.rules import WayRules, read_rules
from plan.problem.scene_keys import SceneTable

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
class Surroundings:
    """What stands round an arm, what it carries, and how far and fast it may move there.

    Attributes:
        source: The file.
        robot: Name or URDF path of the robot that it names, if any.
        obstacles: Shapes in the base frame, the floor among them if the file has one.
        attached: Shapes that the arm carries.
        payload: Mass that it carries, with its centre in the frame of `payload_link`.
        payload_link: That frame; the arm's tip frame if None.
        srdf: File that names pairs of links to leave out of checks.
        lower, upper: Position limits inside the robot's [rad]; None for the robot's.
        speed: Speed limits other than the robot's [rad/s]; None for the robot's.
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Task(Surroundings):
    """What a scene file says.

    Attributes:
        robot: Name or URDF path.
        start, goal: Ends [rad]; the goal is the start until `pose` is brought to joint angles.
        duration: Duration of the motion [s]; where time is the objective it may be None, or is a first guess.
        via_points: Via points at least.
        wrist: Positions of the joints that do not move [rad]; zeros if None.
        clearance: Distance to keep [m].
        reach: How far a via angle may go from the initial one [rad].
        torque: Limits other than the robot's [N m]; None for the robot's.
        acceleration, jerk: Limits of acceleration [rad/s²] and jerk [rad/s³]; None for none.
        makers: Whether the maker's published limits of acceleration and jerk are kept where those are None.
        taught: Via points of the file itself.
        pose: Where a frame is to end, in place of the goal's angles.
        avoid_singular: Whether singular positions are fined.
        others: Further goals, any of which will do as well [rad].
        other_poses: Further poses likewise.
        way: What the motion has to keep on its way.
    """

    robot: str
    start: Float[Array, " n"]
    goal: Float[Array, " n"]
    duration: float | None = None
    via_points: int = 2
    wrist: Float[Array, " k"] | None = None
    clearance: float = DEFAULT_CLEARANCE
    reach: float = math.radians(DEFAULT_REACH_DEG)
    torque: Float[Array, " n"] | None = None
    acceleration: Float[Array, " n"] | None = None
    jerk: Float[Array, " n"] | None = None
    makers: bool = True
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
    top = _read(Path(path))
    task, limits = top.table("task", needed=True), top.table("limits")
    start = np.radians(task.numbers("start_deg"))
    count, poses = len(start), read_poses(task)
    goals = [start] if poses else _goals(task, count)
    taught = (_trial(task, count),) if "via_points_deg" in task else ()
    around = vars(_surroundings(top, count)) | {"robot": top.text("robot")}
    return Task(
        **around,
        start=start,
        goal=goals[0],
        duration=task.number("duration_s") if "duration_s" in task else None,
        via_points=len(taught[0].vias) if taught else task.whole("via_points", 2),
        wrist=task.angles("wrist_deg"),
        clearance=task.number("clearance_m", DEFAULT_CLEARANCE),
        reach=math.radians(task.number("reach_deg", DEFAULT_REACH_DEG, least=1e-3)),
        torque=limits.numbers("torque_Nm", count, positive=True) if "torque_Nm" in limits else None,
        acceleration=limits.angles("acceleration_deg_s2", count, positive=True),
        jerk=limits.angles("jerk_deg_s3", count, positive=True),
        makers=limits.flag("makers", True),
        taught=taught,
        pose=poses[0] if poses else None,
        avoid_singular=task.flag("avoid_singular"),
        others=tuple(goals[1:]),
        other_poses=tuple(poses[1:]),
        way=read_rules(top, count),
    )


def load_surroundings(path: str | Path, joints: int) -> Surroundings:
    """Reads a scene file for an arm of so many joints; its task, if it has one, is left aside.

    Raises:
        SceneError: As `load_task`.
    """
    top = _read(Path(path))
    top.table("task")
    top.table("tool")
    return _surroundings(top, joints)


def load_trials(path: str | Path, joints: int) -> list[Trial]:
    """Reads a file of taught via points: `[[trial]]` tables with `via_points_deg`, and `name`, `times_s` if known.

    Raises:
        SceneError: Not such a file.
    """
    document = read_toml(Path(path), "give a scene file (TOML)", SceneError)
    top = SceneTable(Path(path), "", document, document)
    entries = document.get("trial")
    if not isinstance(entries, list) or not entries:
        remedy = "give one [[trial]] with via_points_deg a taught motion"
        raise SceneError(top.file, "it has no [[trial]] table", remedy)
    return [_trial(SceneTable(top.file, name, entry, entry), joints) for name, entry in top.items("trial")]


def _read(file: Path) -> SceneTable:
    """The top of a scene file."""
    return SceneTable(file, "", read_toml(file, "give a scene file (TOML)", SceneError))


def _surroundings(top: SceneTable, joints: int) -> Surroundings:
    """What a scene file says beside its task."""
    limits, payload, mass = top.table("limits"), top.table("payload"), None
    low, high = limits.angles("lower_deg", joints), limits.angles("upper_deg", joints)
    if low is not None and high is not None and np.any(low >= high):
        j = int(np.flatnonzero(low >= high)[0])
        what = f"{np.degrees(low[j]):g} is not below limits.upper_deg {np.degrees(high[j]):g}"
        raise limits.fault("lower_deg", what, "correct one of them")
    if "payload" in top:
        x, y, z = payload.numbers("com_m", 3, np.zeros(3)).tolist()
        mass = Payload(payload.number("mass_kg"), (x, y, z))
    return Surroundings(
        source=top.file,
        robot=top.text("robot") if "robot" in top else None,
        obstacles=read_obstacles(top),
        attached=read_attached(top),
        payload=mass,
        payload_link=payload.text("link") if "link" in payload else None,
        srdf=top.file.parent / top.text("srdf") if "srdf" in top else None,
        lower=low,
        upper=high,
        speed=limits.angles("speed_deg_s", joints, positive=True),
    )


def _goals(task: SceneTable, joints: int) -> list[Float[Array, " n"]]:
    """The goal, or the goals of which any will do [rad]."""
    if "goals_deg" not in task:
        return [np.radians(task.numbers("goal_deg", joints))]
    if "goal_deg" in task:
        raise SceneError(task.file, "task has both goal_deg and goals_deg", "give one of them")
    return [np.radians(row) for row in task.rows("goals_deg", joints)]


def _trial(table: SceneTable, joints: int) -> Trial:
    if "via_points_deg" not in table:
        raise SceneError(table.file, f"{table.name} has no via_points_deg", "give rows of joint angles in degrees")
    vias, times = np.radians(table.rows("via_points_deg", joints)), None
    if "times_s" in table:
        times = table.numbers("times_s", len(vias), positive=True)
        if np.any(np.diff(times) <= 0):
            raise SceneError(table.file, f"{table.name}: times_s do not increase", "give one later stamp a via point")
    return Trial(str(table.entry.get("name", table.name)), vias, times)
