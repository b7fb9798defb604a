"""Tables and keys of a scene file, each with its meaning: the reader refuses others, the reference is made of them."""

from __future__ import annotations

import math
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from plan.errors import SceneError

# SceneTable -> key -> what it says; units stand in the names. "" is the top of the file.
KEYS: dict[str, dict[str, str]] = {
    "": {
        "robot": 'Needed. URDF path (from the file on) or name: "tm5-900", "panda".',
        "task": "Needed. What the arm is to do.",
        "limits": "Limits other than the robot's.",
        "obstacle": "A list, [[obstacle]]: shapes in the base frame.",
        "attached": "A list, [[attached]]: shapes that the arm carries; keys of an obstacle, and link, touches.",
        "floor": "A floor.",
        "payload": "Mass that the arm carries.",
        "tool": "What the tool has to keep on its way.",
        "pass": "A list, [[pass]]: via points that must be passed, in this order.",
        "srdf": "File that names pairs of links to leave out of checks.",
        "trial": "A list, [[trial]]: taught motions with name, via_points_deg and times_s.",
    },
    "task": {
        "start_deg": "Needed. Angles at the start [deg], one a moving joint: as many joints move.",
        "goal_deg": "Angles at the end [deg]; needed unless goals_deg or goal_pose is given.",
        "goals_deg": "Rows of such angles, any of which will do [deg].",
        "goal_pose": "Where a frame is to end: a table with xyz_m, rpy_rad or quaternion_xyzw, frame (the last link); "
        "or several, [[task.goal_pose]], any of which will do.",
        "duration_s": "Duration [s]; needed for least energy, left out for least time.",
        "via_points": "Via points, at least. If left out: 2.",
        "wrist_deg": "Angles of the joints that stand still [deg]. If left out: zeros.",
        "clearance_m": "Distance to keep from everything [m]. If left out: 0.005.",
        "reach_deg": "How far a via angle may go from the initial one [deg]. If left out: 90.",
        "avoid_singular": "true: singular positions are fined. If left out: false.",
        "via_points_deg": "Via points to begin from, rows of angles [deg].",
        "times_s": "Their time stamps [s].",
    },
    "limits": {
        "lower_deg": "Least angle of each joint [deg], inside the robot's.",
        "upper_deg": "Largest angle of each joint [deg], inside the robot's.",
        "torque_Nm": "Largest torque of each joint [N m]. If left out: the robot's.",
        "speed_deg_s": "Largest speed of each joint [deg/s]. If left out: the robot's.",
        "acceleration_deg_s2": "Largest acceleration of each joint [deg/s²]. If left out: the maker's, where known.",
        "jerk_deg_s3": "Largest jerk of each joint [deg/s³]. If left out: the maker's, where known.",
        "makers": "false: the maker's published limits are not kept. If left out: true.",
    },
    "tool": {
        "frame": "The tool's frame. If left out: the arm's tip.",
        "speed_m_s": "Largest speed of its origin [m/s].",
        "straight": "true: it goes in a straight line; with six moving joints or more it turns evenly on the way.",
        "within_m": "How far it may be off that line [m]. If left out: 0.001.",
        "within_deg": "How far it may be off that turn [deg]. If left out: 0.5.",
        "cone": "A list, [[tool.cone]]: where its axes may point.",
    },
    "tool.cone": {
        "axis": "Axis of the tool's frame. If left out: [0, 0, 1].",
        "towards": "A direction in the base frame. If left out: [0, 0, -1].",
        "allowed_deg": "The axis stays within this angle of it [deg]; this or keep_out_deg is needed.",
        "keep_out_deg": "The axis stays outside this angle of it [deg].",
    },
    "pass": {
        "deg": "Angles of the moving joints [deg]; these or xyz_m are needed.",
        "within_deg": "How far each joint may be off when it passes [deg]. If left out: 0.1.",
        "xyz_m": "Place of the tool in the base frame [m].",
        "within_m": "How far each coordinate may be off when it passes [m]. If left out: 0.001.",
    },
    "floor": {"height_m": "Its height above the base [m]. If left out: 0."},
    "payload": {
        "mass_kg": "Needed. Mass [kg].",
        "com_m": "Its centre in the frame of link [m]. If left out: the frame's origin.",
        "link": "That frame. If left out: the arm's tip.",
    },
}


class SceneTable:
    """One table of a scene file; what is wrong in it is named with the file and the key.

    Args:
        file: The file.
        name: What the table is called in messages; nothing for the top of the file.
        entry: Its keys and values.
        keys: Keys that it may have; those of `KEYS` under its name if None.
    """

    def __init__(self, file: Path, name: str, entry: Any, keys: Collection[str] | None = None) -> None:
        if not isinstance(entry, dict):
            raise SceneError(file, f"{name} is not a table", f"write [{name}] and its keys")
        self.file, self.name, self.entry = file, name, entry
        keys = KEYS[name] if keys is None else keys
        unknown = sorted(set(entry) - set(keys))
        if unknown:
            what = f"{name or 'file'}: unknown key {unknown[0]!r}"
            raise SceneError(file, what, f"keys are: {', '.join(sorted(keys))}")

    def __contains__(self, key: str) -> bool:
        return key in self.entry

    def path(self, key: str) -> str:
        """A key as messages name it."""
        return f"{self.name}.{key}" if self.name else key

    def fault(self, key: str, what: str, remedy: str) -> SceneError:
        """What is wrong with a key."""
        return SceneError(self.file, f"{self.path(key)} {what}", remedy)

    def table(self, key: str, needed: bool = False) -> SceneTable:
        """A table in this one, empty where it is not there."""
        if needed and key not in self:
            raise SceneError(self.file, f"it has no [{self.path(key)}] table", "add one")
        return SceneTable(self.file, self.path(key), self.entry.get(key, {}))

    def items(self, key: str) -> list[tuple[str, dict[str, Any]]]:
        """The tables of a list, each with what it is called in messages."""
        found, name = self.entry.get(key, []), self.path(key)
        if not isinstance(found, list) or not all(isinstance(one, dict) for one in found):
            raise SceneError(self.file, f"{name} is not a list of tables", f"write [[{name}]], with two brackets")
        return [(f"{name} {number}", one) for number, one in enumerate(found, start=1)]

    def tables(self, key: str, keys: Collection[str] | None = None) -> list[SceneTable]:
        """The same as tables whose keys are known."""
        known = KEYS[self.path(key)] if keys is None else keys
        return [SceneTable(self.file, name, entry, known) for name, entry in self.items(key)]

    def given(self, key: str, default: Any = None) -> Any:
        """A key's value as it stands there; the default, if there is one, where it does not."""
        if key not in self and default is None:
            raise self.fault(key, "is missing", "add it, in metres" if key.endswith("_m") else "add it")
        return self.entry.get(key, default)

    def text(self, key: str) -> str:
        """A text that is not empty."""
        found = self.entry.get(key)
        if not isinstance(found, str) or not found:
            raise self.fault(key, "is missing", f'add {key} = "…"')
        return found

    def flag(self, key: str, default: bool = False) -> bool:
        """True or false."""
        found = self.entry.get(key, default)
        if not isinstance(found, bool):
            raise self.fault(key, f"is {found!r}", "give true or false")
        return found

    def number(self, key: str, default: float | None = None, least: float = 0.0, above: bool = False) -> float:
        """A number that is not below the least one, or above it."""
        found, wanted = self.given(key, default), f"above {'zero' if least == 0.0 else f'{least:g}'}"
        right = not isinstance(found, bool) and isinstance(found, int | float) and math.isfinite(found)
        if not right or found < least or (above and found == least):
            wanted = f"a number {wanted}" if above else f"a number of {least:g} or more"
            raise self.fault(key, f"is {found!r}, not {wanted}", "give a number")
        return float(found)

    def whole(self, key: str, default: int) -> int:
        """A whole number from 1 to 20."""
        found = self.entry.get(key, default)
        if isinstance(found, bool) or not isinstance(found, int) or not 1 <= found <= 20:
            raise self.fault(key, f"is {found!r}, not a whole number from 1 to 20", "give one")
        return found

    def numbers(
        self, key: str, count: int | None = None, default: Any = None, positive: bool = False
    ) -> Float[Array, " k"]:
        """A list of numbers, as many as are wanted."""
        return self._numbers(key, self.given(key, default), count, positive)

    def rows(self, key: str, count: int) -> list[Float[Array, " k"]]:
        """Rows of so many numbers each."""
        found = self.given(key)
        if not isinstance(found, list) or not found:
            raise self.fault(key, "is not a list of rows", "give rows of joint angles in degrees")
        return [self._numbers(f"{key} {number}", row, count) for number, row in enumerate(found, start=1)]

    def _numbers(self, key: str, found: Any, count: int | None, positive: bool = False) -> Float[Array, " k"]:
        try:
            values = np.array(found, dtype=float)
        except (TypeError, ValueError):
            values = np.array(np.nan)
        if values.ndim != 1 or len(values) == 0 or not np.isfinite(values).all():
            raise self.fault(key, f"is {found!r}, not a list of numbers", "give a list of numbers")
        if count is not None and len(values) != count:
            raise self.fault(key, f"has {len(values)} numbers, not {count}", f"give {count}")
        if positive and np.any(values <= 0):
            remedy = "give lengths" if key.endswith("_m") else "give positive numbers"
            raise self.fault(key, f"{values.tolist()} is not above zero throughout", remedy)
        return values

    def angles(self, key: str, count: int | None = None, positive: bool = False) -> Float[Array, " k"] | None:
        """Degrees as radians; None where the key is not there."""
        return np.radians(self.numbers(key, count, positive=positive)) if key in self else None
