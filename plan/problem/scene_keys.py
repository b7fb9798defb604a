"""Tables and keys of a scene file.

`scene_keys.toml` says what each means and may hold; all else is refused here.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Bool, Float, freeze
from ident.errors import InputError
from ident.robot.rotations import rpy_to_matrix
from plan.problem.scene_key import Keys, SceneKey, read_keys

# Tables of a scene file, and their keys.
KEYS = read_keys(Path(__file__).with_suffix(".toml"))
# The largest of what is a whole number.
MOST_WHOLE = 20
# A quaternion whose length is farther from one than this is a slip of the pen, not rounding.
ROUNDED = 0.01


def as_given(value: float, slides: bool, digits: int = 1) -> str:
    """A joint's position [rad or m] in words, as a scene file has it.

    Args:
        value: The position.
        slides: Whether the joint slides: in m, with two more decimals; else in degrees.
        digits: Decimals of degrees.
    """
    return f"{value:.{digits + 2}f} m" if slides else f"{math.degrees(value):.{digits}f} deg"


class SceneTable:
    """One table of a scene file; what is wrong in it is named with the file and the key.

    Args:
        file: The file.
        name: What the table is called in messages; nothing for the top of the file.
        entry: Its keys and values.
        keys: Keys that it may have; those of `KEYS` under its name if None.
        joints: Whether each joint that moves slides, where that is known: its numbers are metres,
            not degrees.
    """

    def __init__(
        self,
        file: Path,
        name: str,
        entry: Any,
        keys: Keys | None = None,
        joints: Bool[Array, " n"] | None = None,
    ) -> None:
        if not isinstance(entry, dict):
            raise InputError(file, f"{name} is not a table", f"write [{name}] and its keys")
        self.file = file
        self.name = name
        self.entry = entry
        self.joints = joints
        self.keys = KEYS[name] if keys is None else keys
        unknown = sorted(set(entry) - set(self.keys))
        if unknown:
            what = f"{name or 'file'}: unknown key {unknown[0]!r}"
            raise InputError(file, what, f"keys are: {', '.join(sorted(self.keys))}")
        for key in entry:
            for other in self.keys[key].without:
                if other in entry:
                    raise InputError(file, f"{name} has both {other} and {key}", "give one of them")

    def __contains__(self, key: str) -> bool:
        return key in self.entry

    def __getitem__(self, key: str) -> Any:
        """A key's value in SI units; its default, or None, where it is left out."""
        known = self.keys[key]
        value = self.entry.get(key, known.default)
        if value is None:
            return self.need(key) if known.needed else None
        return self._checked(key, value, known)

    def need(self, key: str) -> Any:
        """A key's value, which may not be left out here.

        Raises:
            InputError: It is left out.
        """
        if key in self:
            return self[key]
        remedy = "add it"
        if self.keys[key].kind == "text":
            remedy = f'add {key} = "…"'
        elif key.endswith("_m"):
            remedy = "add it, in metres"
        raise self.fault(key, "is missing", remedy)

    def one_of(self, *keys: str) -> str:
        """The key that is given, of some that exclude each other.

        Args:
            keys: Names in their order; where more than one is given, the first of them is returned.

        Raises:
            InputError: None is given.
        """
        given = [key for key in keys if key in self]
        if not given:
            what = f"{self.name} has neither {' nor '.join(keys)}"
            raise InputError(self.file, what, "give one of them")
        return given[0]

    def path(self, key: str) -> str:
        """A key as messages name it."""
        return f"{self.name}.{key}" if self.name else key

    def fault(self, key: str, what: str, remedy: str) -> InputError:
        """An error that says what is wrong with a key; it is for the caller to raise.

        Args:
            key: The key in this table.
            what: Goes on from the key's name: "is missing".
            remedy: What to do about it.
        """
        return InputError(self.file, f"{self.path(key)} {what}", remedy)

    def table(self, key: str) -> SceneTable:
        """A table in this one, empty where it is not there."""
        return SceneTable(self.file, self.path(key), self.entry.get(key, {}), joints=self.joints)

    def items(self, key: str) -> list[tuple[str, dict[str, Any]]]:
        """The tables of a list, each with what it is called in messages.

        Returns:
            Pairs of "NAME NUMBER", from 1, and the table; empty where the key is left out.

        Raises:
            InputError: It is no list of tables.
        """
        tables = self.entry.get(key, [])
        name = self.path(key)
        if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
            remedy = f"write [[{name}]], with two brackets"
            raise InputError(self.file, f"{name} is not a list of tables", remedy)
        return [(f"{name} {number}", table) for number, table in enumerate(tables, start=1)]

    def tables(self, key: str) -> list[SceneTable]:
        """The tables of a list; each refuses keys that a scene file does not know."""
        keys = KEYS[self.path(key)]
        return [
            SceneTable(self.file, name, entry, keys, self.joints) for name, entry in self.items(key)
        ]

    def _checked(self, key: str, value: Any, known: SceneKey) -> Any:
        """A value of the kind that the key asks for, in SI units."""
        if known.kind == "number":
            return self._number(key, value, known)
        if known.kind == "angle":
            return math.radians(self._number(key, value, known))
        if known.kind in ("numbers", "angles", "rows"):
            return self._several(key, value, known)
        if known.kind in ("direction", "turn", "quaternion"):
            return self._turned(key, self._numbers(key, value, self._count(known)), known.kind)
        if known.kind == "scale":
            return self._numbers(key, value if isinstance(value, list) else [value] * 3, 3, True)
        if known.kind == "text" and (not isinstance(value, str) or not value):
            raise self.fault(key, "is missing", f'add {key} = "…"')
        if known.kind == "flag" and not isinstance(value, bool):
            raise self.fault(key, f"is {value!r}", "give true or false")
        if known.kind == "whole":
            is_whole = isinstance(value, int) and not isinstance(value, bool)
            if not is_whole or not 1 <= value <= MOST_WHOLE:
                what = f"is {value!r}, not a whole number from 1 to {MOST_WHOLE}"
                raise self.fault(key, what, "give one")
        return value

    def _count(self, known: SceneKey) -> int | None:
        """How many numbers a key holds; None where that is not known."""
        if known.count == "joints":
            return None if self.joints is None else len(self.joints)
        return None if known.count is None else int(known.count)

    def _several(self, key: str, value: object, known: SceneKey) -> Any:
        """Several numbers, angles, or rows of angles, one a joint."""
        count = self._count(known)
        slides = np.zeros(1, dtype=bool)
        if known.count == "joints" and self.joints is not None:
            slides = self.joints
        if known.kind == "rows":
            if not isinstance(value, list) or not value:
                remedy = "give rows of joint angles in degrees"
                raise self.fault(key, "is not a list of rows", remedy)
            rows = []
            for number, row in enumerate(value, start=1):
                values = self._numbers(f"{key} {number}", row, count)
                rows.append(np.where(slides, values, np.radians(values)))
            return rows
        values = self._numbers(key, value, count, known.positive)
        largest = np.abs(values).max()
        if largest > known.most:
            raise self.fault(key, f"has {largest:.3g}, beyond {known.most:g}", "give metres")
        if known.kind == "angles":
            return np.where(slides, values, np.radians(values))
        return values

    def _number(self, key: str, value: object, known: SceneKey) -> float:
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            is_too_low = value == known.least if known.above else False
            if known.least <= value <= known.most and not is_too_low:
                return float(value)
        top = "or more" if known.most == math.inf else f"to {known.most:g}"
        wanted = "above zero" if known.above else f"of {known.least:g} {top}"
        raise self.fault(key, f"is {value!r}, not a number {wanted}", "give a number")

    def _turned(self, key: str, values: Float[Array, " k"], kind: str) -> Array:
        """A unit vector, or a rotation matrix."""
        length = float(np.linalg.norm(values))
        if kind == "turn":
            return freeze(rpy_to_matrix(values))
        if kind == "quaternion":
            if abs(length - 1.0) > ROUNDED:
                remedy = "give x, y, z, w of a unit quaternion"
                raise self.fault(key, f"has length {length:.3g}, not 1", remedy)
            return freeze(pin.Quaternion(values / length).toRotationMatrix())
        if length < 1e-6:
            what = f"is {values.tolist()}, no direction"
            raise self.fault(key, what, "give a vector that is not nought")
        return freeze(values / length)

    def _numbers(
        self, key: str, given: Any, count: int | None, positive: bool = False
    ) -> Float[Array, " k"]:
        """Numbers of a list: as many as asked for, if so all above zero."""
        try:
            values = np.array(given, dtype=float)
        except (TypeError, ValueError):
            values = np.array(np.nan)
        if values.ndim != 1 or len(values) == 0 or not np.isfinite(values).all():
            raise self.fault(key, f"is {given!r}, not a list of numbers", "give a list of numbers")
        if count is not None and len(values) != count:
            raise self.fault(key, f"has {len(values)} numbers, not {count}", f"give {count}")
        if positive and np.any(values <= 0):
            remedy = "give lengths" if key.endswith("_m") else "give positive numbers"
            raise self.fault(key, f"{values.tolist()} is not above zero throughout", remedy)
        return values
