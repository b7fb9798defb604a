"""Where a cycle stops, for how long, and what the arm grips or releases there."""

from __future__ import annotations

from dataclasses import dataclass

from ident.arrays import Array, Float
from plan.problem.scene_keys import SceneTable

GRIP = "grip"
RELEASE = "release"


@dataclass(frozen=True, eq=False)
class Stop:
    """One place at which the arm comes to rest."""

    q: Float[Array, " n"]  # where [rad]
    dwell: float  # how long it stands there [s]
    does: str  # `grip`, `release`, or nothing


def read_stops(top: SceneTable) -> tuple[Stop, ...]:
    """The tables `[[leg]]` of a scene file.

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
        stops.append(Stop(table["deg"], table["dwell_s"], does))
    return tuple(stops)


def holds_at_first(stops: tuple[Stop, ...]) -> bool:
    """Whether the arm carries its load before the first stop: unless it grips it first."""
    done = [stop.does for stop in stops if stop.does]
    return not done or done[0] == RELEASE
