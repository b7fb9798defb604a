"""Where a cycle stops, for how long, and what the arm grips or releases there."""

from __future__ import annotations

from dataclasses import dataclass

from ident.arrays import Array, Float
from plan.problem.poses import read_poses
from plan.problem.rules import Pose
from plan.problem.scene_keys import SceneTable

GRIP = "grip"
RELEASE = "release"


@dataclass(frozen=True, eq=False)
class Stop:
    """One place at which the arm comes to rest."""

    # Where [rad]; that of the cycle's start until one of several is chosen, or a pose is reached.
    q: Float[Array, " n"]
    dwell: float  # how long it stands there [s]
    does: str  # `grip`, `release`, or nothing
    choices: tuple[Float[Array, " n"], ...] = ()  # positions of which any will do [rad]
    poses: tuple[Pose, ...] = ()  # poses of a frame, of which any will do

    @property
    def is_chosen(self) -> bool:
        """Whether there is no choice, or none any more."""
        return not self.choices and not self.poses


def read_stops(top: SceneTable, start: Float[Array, " n"]) -> tuple[Stop, ...]:
    """The tables `[[leg]]` of a scene file.

    Args:
        top: The file.
        start: Where the cycle begins [rad].

    Raises:
        InputError: A key is missing, unknown or of the wrong kind, or a deed stands twice in a row.
    """
    stops: list[Stop] = []
    last = ""
    for table in top.tables("leg"):
        does = table["does"] or ""
        if does not in ("", GRIP, RELEASE):
            raise table.fault("does", f"is {does!r}", f"give {GRIP} or {RELEASE}, or leave it out")
        if does and "payload" not in top and "attached" not in top:
            remedy = "add [payload], [[attached]], or both"
            raise table.fault("does", f"is {does!r}, and the file does not say of what", remedy)
        if does and does == last:
            raise table.fault("does", f"is {does!r} twice in a row", "correct one of them")
        last = does or last
        given = table.one_of("deg", "any_deg", "pose")
        q = table["deg"] if given == "deg" else start
        choices = tuple(table["any_deg"] or ())
        poses = tuple(read_poses(table, "pose"))
        stops.append(Stop(q, table["dwell_s"], does, choices, poses))
    return tuple(stops)


def holds_at_first(stops: tuple[Stop, ...]) -> bool:
    """Whether the arm carries its load before the first stop: unless it grips it first."""
    done = [stop.does for stop in stops if stop.does]
    return not done or done[0] == RELEASE
