"""Tables and keys of a scene file.

`scene_keys.toml` says what each means and may hold; all else is refused here.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Bool, Float, freeze
from ident.errors import InputError
from ident.robot.rotations import rpy_to_matrix

# A quaternion whose length is farther from one than this is a slip of the pen, not rounding.
ROUNDED = 0.01


@dataclass(frozen=True)
class SceneKey:
    """A key of a scene file."""

    says: str  # its meaning, for people
    # What it holds: one number or several, degrees that become radians (`angle`; `angles`, `rows`
    # of them, one a joint; of joints that slide metres), one number for three (`scale`), a unit
    # vector (`direction`), a rotation matrix (`turn`, `quaternion`), `text`, a `flag`, a `whole`
    # number; what is `any` is looked at by whoever reads it.
    kind: str = "any"
    default: Any = None  # its value where it is left out; None for none
    needed: bool = False  # whether it may not be left out
    least: float = 0.0  # of a number the least, or, if `above`, what it has to lie above
    above: bool = False
    most: float = math.inf  # the largest that a number, or the modulus of any of several, may be
    count: int | str | None = None  # how many numbers; `joints` for as many as joints move
    positive: bool = False  # whether all of several numbers have to lie above zero
    without: tuple[str, ...] = ()  # keys that may not stand beside it


Keys = Mapping[str, SceneKey]
KEYS: dict[str, Keys] = {
    table: {
        name: SceneKey(**row | {"without": tuple(row.get("without", ()))})
        for name, row in rows.items()
    }
    for table, rows in tomllib.loads(
        Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
    ).items()
}


def as_given(value: float, slides: bool, digits: int = 1) -> str:
    """A joint's position [rad or m] in words, as a scene file has it."""
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
        found = self.entry.get(key, known.default)
        if found is None:
            return self.need(key) if known.needed else None
        return self._checked(key, found, known)

    def need(self, key: str) -> Any:
        """A key's value, which may not be left out here."""
        if key in self:
            return self[key]
        text = (
            f'add {key} = "…"'
            if self.keys[key].kind == "text"
            else "add it, in metres" * key.endswith("_m")
        )
        raise self.fault(key, "is missing", text or "add it")

    def one_of(self, *keys: str) -> str:
        """The key that is given, of some that exclude each other."""
        given = [key for key in keys if key in self]
        if not given:
            raise InputError(
                self.file, f"{self.name} has neither {' nor '.join(keys)}", "give one of them"
            )
        return given[0]

    def path(self, key: str) -> str:
        """A key as messages name it."""
        return f"{self.name}.{key}" if self.name else key

    def fault(self, key: str, what: str, remedy: str) -> InputError:
        """What is wrong with a key."""
        return InputError(self.file, f"{self.path(key)} {what}", remedy)

    def table(self, key: str) -> SceneTable:
        """A table in this one, empty where it is not there."""
        return SceneTable(self.file, self.path(key), self.entry.get(key, {}), joints=self.joints)

    def items(self, key: str) -> list[tuple[str, dict[str, Any]]]:
        """The tables of a list, each with what it is called in messages."""
        found = self.entry.get(key, [])
        name = self.path(key)
        if not isinstance(found, list) or not all(isinstance(one, dict) for one in found):
            raise InputError(
                self.file, f"{name} is not a list of tables", f"write [[{name}]], with two brackets"
            )
        return [(f"{name} {number}", one) for number, one in enumerate(found, start=1)]

    def tables(self, key: str) -> list[SceneTable]:
        """The tables of a list; each refuses keys that a scene file does not know."""
        keys = KEYS[self.path(key)]
        return [
            SceneTable(self.file, name, entry, keys, self.joints) for name, entry in self.items(key)
        ]

    def _checked(self, key: str, found: Any, known: SceneKey) -> Any:
        """A value of the kind that the key asks for."""
        count = known.count
        slides = np.zeros(1, dtype=bool)
        if count == "joints":
            count = None if self.joints is None else len(self.joints)
            slides = slides if self.joints is None else self.joints
        if known.kind in ("number", "angle"):
            value = self._number(key, found, known)
            return math.radians(value) if known.kind == "angle" else value
        if known.kind in ("numbers", "angles"):
            values = self._numbers(key, found, count, known.positive)
            if np.abs(values).max() > known.most:
                raise self.fault(
                    key, f"has {np.abs(values).max():.3g}, beyond {known.most:g}", "give metres"
                )
            return (
                np.where(slides, values, np.radians(values)) if known.kind == "angles" else values
            )
        if known.kind in ("direction", "turn", "quaternion"):
            return self._turned(key, self._numbers(key, found, count), known.kind)
        if known.kind == "scale":
            return self._numbers(key, found if isinstance(found, list) else [found] * 3, 3, True)
        if known.kind == "rows":
            if not isinstance(found, list) or not found:
                raise self.fault(
                    key, "is not a list of rows", "give rows of joint angles in degrees"
                )
            rows = [self._numbers(f"{key} {k}", row, count) for k, row in enumerate(found, start=1)]
            return [np.where(slides, row, np.radians(row)) for row in rows]
        if known.kind == "text" and (not isinstance(found, str) or not found):
            raise self.fault(key, "is missing", f'add {key} = "…"')
        if known.kind == "flag" and not isinstance(found, bool):
            raise self.fault(key, f"is {found!r}", "give true or false")
        whole = isinstance(found, int) and not isinstance(found, bool) and 1 <= found <= 20
        if known.kind == "whole" and not whole:
            raise self.fault(key, f"is {found!r}, not a whole number from 1 to 20", "give one")
        return found

    def _number(self, key: str, found: Any, known: SceneKey) -> float:
        right = (
            not isinstance(found, bool) and isinstance(found, int | float) and math.isfinite(found)
        )
        if (
            not right
            or not known.least <= found <= known.most
            or (known.above and found == known.least)
        ):
            top = "or more" if known.most == math.inf else f"to {known.most:g}"
            wanted = "above zero" if known.above else f"of {known.least:g} {top}"
            raise self.fault(key, f"is {found!r}, not a number {wanted}", "give a number")
        return float(found)

    def _turned(self, key: str, values: Float[Array, " k"], kind: str) -> Array:
        """A unit vector, or a rotation matrix."""
        length = float(np.linalg.norm(values))
        if kind == "turn":
            return freeze(rpy_to_matrix(values))
        if kind == "quaternion":
            if abs(length - 1.0) > ROUNDED:
                raise self.fault(
                    key, f"has length {length:.3g}, not 1", "give x, y, z, w of a unit quaternion"
                )
            return freeze(pin.Quaternion(values / length).toRotationMatrix())
        if length < 1e-6:
            raise self.fault(
                key, f"is {values.tolist()}, no direction", "give a vector that is not nought"
            )
        return freeze(values / length)

    def _numbers(
        self, key: str, found: Any, count: Any, positive: bool = False
    ) -> Float[Array, " k"]:
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
