"""What the URDF says beside what the recordings say, in words and as a table: `identified` of a
diagnosis's record.

A number is said to differ where the URDF's lies outside of its interval with the URDF's tolerance.
It is worth a sentence where, besides, even the least difference within that interval makes more
torque than the joint's noise floor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ident.errors import join_words, plural
from ident.laws.carried import TABLE
from ident.records import JsonRecord, JsonTable
from ident.show.report.words import DASH, fixed, sentence, significant
from ident.units import DAMPING, INERTIA, TORQUE, unit_for

# Keys of a joint's figures with the words and units for them.
LOSSES = {
    "viscous_Nms_rad": ("damping", DAMPING),
    "coulomb_Nm": ("dry friction", TORQUE),
    "armature_kgm2": ("rotor", INERTIA),
}
# What a simulator takes as zero where the URDF says nothing.
STATED = ("viscous_Nms_rad", "coulomb_Nm")
READINGS = {"offset_Nm": ("torque offset", TORQUE), "torque_gain": ("torque gain", "")}
# An interval this many times as wide with the URDF's tolerance is shown beside the other.
MUCH_WIDER = 1.5
# Joints that a sentence names; of more it says how many.
MOST_NAMED = 3
# Effects that are friction: of those alone damping and dry friction can't be told apart.
FRICTION = {
    effect for effect, row in TABLE["effects"].items() if row.get("as_change", {}).get("friction")
}
# Effects that are bodies which can be taken off.
LOADS = {
    effect for effect, row in TABLE["effects"].items() if "taken_off" in row.get("as_change", {})
}
# What stands in place of damping or dry friction that only a named law of friction beside it tells.
IN_LAW = "in the named law"
# What words and marks of the table mean, each where one of its cells has it.
MEANS_IN_LAW = f"{IN_LAW}: not told apart from the friction that is named there"
MEANS_FROM_ZERO = "from 0 on: may be none; friction and rotors are never below 0"
# Of a session with a load, which is found as a point: what turns with it looks like a larger rotor.
MEANS_OF_LOAD = "how the load's mass is spread is not known: rotors near it may have some of it"
# A number's record: nominal and found, with its intervals.
Figure = JsonTable


@dataclass(frozen=True)
class Number:
    """A number of the arm as it is shown."""

    joint: str
    key: str  # as in the record
    name: str  # in words
    unit: str
    figure: Figure  # its record
    differs: bool  # whether the URDF says otherwise
    matters: bool  # whether that surely makes more torque than noise
    in_law: bool = False  # whether only a named law of friction beside it tells it

    @property
    def value(self) -> str:
        """The value that was found, to the digits that its interval leaves."""
        if self.in_law:
            return IN_LAW
        return with_interval(self.figure) if self.is_loss else with_error(self.figure)

    @property
    def is_loss(self) -> bool:
        """Whether it can't be negative: damping, dry friction, a rotor."""
        return self.key in LOSSES

    @property
    def from_zero(self) -> bool:
        """Whether zero is in its interval, which ends there."""
        low = self.figure["low"]
        return self.is_loss and not self.in_law and low is not None and low <= 0.0

    @property
    def short(self) -> str:
        """The value alone, to the same digits."""
        return self.value.partition(" ")[0]

    @property
    def nominal(self) -> str:
        """What the URDF says; a dash where it says nothing."""
        return plain(self.figure["nominal"])

    @property
    def tolerant(self) -> str:
        """Half the interval with the URDF's tolerance, where that is much wider; else empty."""
        given, tolerant = (half_width(self.figure, end) for end in ("", "_with_urdf"))
        if given is None or tolerant is None or tolerant <= MUCH_WIDER * given or self.in_law:
            return ""
        if self.is_loss and reaches_below_zero(self.figure, "_with_urdf"):
            return interval_in_words(self.figure, "_with_urdf")
        return f"± {one_digit(tolerant)}"


def numbers_of(record: JsonTable) -> list[Number]:
    """All numbers of a diagnosis's joints, in the order of the joints."""
    identified = record.get("identified", {})
    gaps = record.get("gap", {})
    laws = [law for law in record.get("findings", ()) if law["effect"] in FRICTION]
    told = []
    for joint in record.get("joints", ()):
        gap = gaps.get(joint, {})
        has_law = any(joint in law["joints"] for law in laws)
        for key, (name, unit) in {**LOSSES, **READINGS}.items():
            figure = identified.get(joint, {}).get(key)
            if figure is None:
                continue
            shown = unit_for(unit, "unit" in gap or joint in record.get("slides", ()))
            differs = lies_outside(figure, 0.0 if key in STATED else None)
            change = sure_change(figure, 0.0 if key in STATED else None)
            matters = differs and change > gap.get("noise_floor_Nm", math.inf)
            unsure = figure["low"] is not None and figure["low"] <= 0.0
            in_law = has_law and key in STATED and unsure
            told.append(Number(joint, key, name, shown, figure, differs, matters, in_law))
    return told


def describe_marks(record: JsonTable) -> list[str]:
    """What the words in the table's cells mean, so far as a cell has them, and what load hides."""
    cells = [number for row in table_of(record) for number in row["cells"].values()]
    meanings = [MEANS_FROM_ZERO] * any(number.from_zero for number in cells)
    meanings += [MEANS_IN_LAW] * any(number.in_law for number in cells)
    has_load = any(finding["effect"] in LOADS for finding in record.get("findings", ()))
    has_rotor = any(number.key == "armature_kgm2" for number in cells)
    return meanings + [MEANS_OF_LOAD] * (has_load and has_rotor)


def lies_outside(figure: Figure, unstated: float | None = None) -> bool:
    """Whether the URDF's number lies outside of the interval with its tolerance.

    Args:
        figure: The number's record.
        unstated: What a simulator takes where the URDF says nothing; None where no simulator can
            know.
    """
    nominal, low, high = (figure[key] for key in ("nominal", "low_with_urdf", "high_with_urdf"))
    nominal = unstated if nominal is None else nominal
    if nominal is None or low is None or high is None:
        return False
    return not low <= nominal <= high


def sure_change(figure: Figure, unstated: float | None = None) -> float:
    """Torque that the difference from the URDF makes at least, anywhere in the interval with its
    tolerance [N m].

    Args:
        figure: The number's record.
        unstated: What a simulator takes where the URDF says nothing; None where no simulator can
            know.
    """
    nominal = unstated if figure["nominal"] is None else figure["nominal"]
    change = float(figure.get("change_rms_Nm", 0.0))
    if nominal is None or change == 0.0 or not lies_outside(figure, unstated):
        return 0.0
    ends = (figure["low_with_urdf"], figure["high_with_urdf"])
    least = min(abs(end - nominal) for end in ends)
    return change * least / abs(figure["value"] - nominal)


def half_width(figure: Figure, end: str = "") -> float | None:
    """How far an interval reaches from its value, to its farther end.

    Args:
        figure: A number's record with "value", "low" and "high".
        end: What the keys of the ends have behind "low" and "high".

    Returns:
        None where value or ends are unknown.
    """
    value = figure["value"]
    low = figure[f"low{end}"]
    high = figure[f"high{end}"]
    if value is None or low is None or high is None:
        return None
    return float(max(value - low, high - value))


def one_digit(size: float) -> str:
    """An error to one digit, to two where the first is a 1."""
    return fixed(size, _places(size)) if math.isfinite(size) else "∞"


def with_error(figure: Figure) -> str:
    """A value with its interval, given the URDF's other numbers: `12.00 ± 0.03`; a dash without
    number.
    """
    value = figure["value"]
    half = half_width(figure)
    if value is None:
        return DASH
    if half is None or not math.isfinite(half):
        return plain(value)
    return f"{fixed(value, _places(half))} ± {one_digit(half)}"


def with_interval(figure: Figure) -> str:
    """A number that can't be negative: as any, but where ± would reach below zero with its ends.

    `0.3 (0.18 to 2.0)`; the ends alone where the number is zero to their digits: `0 to 0.27`.
    """
    value = figure["value"]
    half = half_width(figure)
    if value is None or half is None or not math.isfinite(half) or not reaches_below_zero(figure):
        return with_error(figure)
    ends = interval_in_words(figure)
    text = fixed(value, _places(half))
    return ends if float(text) == 0.0 else f"{text} ({ends})"


def reaches_below_zero(figure: Figure, end: str = "") -> bool:
    """Whether a number less half its interval is negative."""
    half = half_width(figure, end)
    return half is not None and figure["value"] - half < 0.0


def interval_in_words(figure: Figure, end: str = "") -> str:
    """An interval of what can't be negative, by its ends: "1 to 2", or "1 or more" where it is
    open.

    Args:
        figure: With the keys low and high, or those that a suffix makes of them.
        end: The suffix: none, or `_with_urdf`.
    """
    low = max(figure[f"low{end}"], 0.0)
    high = figure[f"high{end}"]
    return (
        f"{significant(low)} to {significant(high)}"
        if math.isfinite(high)
        else f"{significant(low)} or more"
    )


def _places(error: float) -> int:
    """Decimals of a value with such an error."""
    if error <= 0.0:
        return 3
    exponent = math.floor(math.log10(error))
    first = error / 10.0**exponent
    return max(0, -exponent + (1 if first < 2.0 else 0))


def plain(value: float | None) -> str:
    """A number of a URDF, without zeros behind it; a dash where it says nothing."""
    if value is None:
        return DASH
    text = significant(value, 4)
    return text.rstrip("0").rstrip(".") if "." in text and "e" not in text else text


def wrong_friction(record: JsonTable) -> list[Number]:
    """The URDF's damping and dry friction that differ by more torque than noise."""
    return [number for number in numbers_of(record) if number.key in STATED and number.matters]


def is_mostly_friction(record: JsonTable) -> bool:
    """Whether the URDF's friction makes more torque error than all that is left beyond noise.

    What is left counts as it is where tuning hides nothing: with the URDF's inertias, if that is
    more.
    """
    changes = [number.figure["change_rms_Nm"] ** 2 for number in wrong_friction(record)]
    rest = 0.0
    for gap in record.get("gap", {}).values():
        left = max(gap["rms_Nm"], gap.get("fixed_rms_Nm", 0.0))
        rest += left**2 - gap["noise_floor_Nm"] ** 2
    return bool(changes) and sum(changes) > rest


def describe_most(record: JsonTable, joint: str) -> str:
    """That friction is most of what the URDF errs by, in a sentence.

    Args:
        record: The diagnosis, in which some of the URDF's friction is wrong.
        joint: The joint whose number is an example, where its are wrong.
    """
    wrong = wrong_friction(record)
    factor = common_factor(record, wrong)
    if factor:
        where = _where(record, sorted({number.joint for number in wrong}))
        what = f"friction is {factor} times what your URDF says {where}"
    elif states_friction(record):
        what = f"your URDF's friction is off in {plural(len(wrong), 'number')}"
    else:
        what = "your URDF states no friction"
    at_joint = [number for number in wrong if number.joint == joint]
    if not at_joint:
        return f"Most of the error: {what}."
    worst = max(at_joint, key=lambda number: sure_change(number.figure, 0.0))
    said = f" (URDF: {worst.nominal})" if worst.figure["nominal"] else ""
    return f"Most of the error: {what}; {joint} has {worst.name} {worst.value} {worst.unit}{said}."


def describe_numbers(record: JsonTable, brief: bool = False) -> str:
    """What is wrong with the URDF's friction, in a sentence; empty where nothing is that matters.

    Args:
        record: The diagnosis.
        brief: Whether the number that matters most is all that is given in full.
    """
    wrong = wrong_friction(record)
    if not wrong:
        return ""
    stated = [number for number in wrong if number.figure["nominal"]]
    worst = max(wrong, key=lambda number: sure_change(number.figure, 0.0))
    there = [worst] if brief else [number for number in wrong if number.joint == worst.joint]
    if not stated:
        sizes = join_words([f"{number.name} {number.value} {number.unit}" for number in there])
        return f"Your URDF states no friction; {worst.joint} has {sizes}."
    parts = [
        f"{number.name} {number.value} {number.unit} (URDF: {number.nominal})" for number in there
    ]
    factor = common_factor(record, wrong)
    if factor:
        where = _where(record, sorted({number.joint for number in wrong}))
        example = f"{worst.joint} has {parts[there.index(worst)]}"
        return f"Friction is {factor} times what your URDF says {where}: {example}."
    example = f"{worst.joint} has {join_words(parts)}"
    others = len(wrong) - len(there)
    if brief and others:
        return f"Your URDF's friction is off: {example}, and {plural(others, 'more number')}."
    more = (
        f" So {'is one more number' if others == 1 else f'are {others} more numbers'}."
        if others
        else ""
    )
    return f"Your URDF's friction is off: {example}.{more}"


def states_friction(record: JsonTable) -> bool:
    """Whether the URDF states friction, and not as the arm has it."""
    return any(number.figure["nominal"] for number in wrong_friction(record))


def common_factor(record: JsonTable, wrong: Sequence[Number]) -> str:
    """The factor by which all of a URDF's friction is off, if it is the same everywhere to the
    digits shown.

    Returns:
        The factor as text; "" where there is none, or a single number only.
    """
    joints = {number.joint for number in wrong}
    friction = [
        number for number in numbers_of(record) if number.joint in joints and number.key in STATED
    ]
    friction = [number for number in friction if number.figure["nominal"]]
    ratios = {
        significant(number.figure["value"] / number.figure["nominal"])
        for number in friction
        if number.figure["value"] is not None
    }
    return ratios.pop() if len(ratios) == 1 and len(friction) > 1 else ""


def _where(record: JsonTable, joints: Sequence[str]) -> str:
    moved = [joint for joint in record["joints"] if joint in record.get("gap", {})]
    if len(joints) == len(moved) > 1:
        return "at every joint"
    if len(joints) <= MOST_NAMED:
        return f"at {join_words(list(joints))}"
    return f"at {len(joints)} of {len(moved)} joints"


def describe_readings(record: JsonTable) -> list[str]:
    """Offsets and gains that are not those of a true reading and make more torque than noise, a
    line each kind.
    """
    lines = []
    for key, (name, _) in READINGS.items():
        wrong = [number for number in numbers_of(record) if number.key == key and number.matters]
        if wrong:
            sizes = ", ".join(_with_tolerance(number) for number in wrong)
            lines.append(f"{sentence(name)}, each as if it alone were wrong: {sizes}")
    return lines


def _with_tolerance(number: Number) -> str:
    """A joint's number with its interval, and that with the URDF's tolerance where it is much
    wider.
    """
    wider = f" ({number.tolerant})" if number.tolerant else ""
    return f"{number.joint} {number.value}{wider} {number.unit}".rstrip()


def describe_links(record: JsonTable) -> list[str]:
    """Links whose mass is known and differs from the URDF's by more than its tolerance, a line
    each.
    """
    lines = []
    for name, link in record.get("identified", {}).get("links", {}).items():
        mass = link["mass_kg"]
        if link["beyond_tolerance"] and mass["value"] is not None and lies_outside(mass):
            lines.append(f"{name}: {with_error(mass)} kg, not {plain(mass['nominal'])}")
    return lines


def table_of(record: JsonTable) -> list[JsonRecord]:
    """A row for each joint of which anything is known: its numbers by their keys.

    Returns:
        Rows of "joint", "cells" (a `Number` by its key) and "known" (true).
    """
    rows: dict[str, JsonRecord] = {}
    for number in numbers_of(record):
        row = rows.setdefault(number.joint, {"joint": number.joint, "cells": {}, "known": False})
        row["cells"][number.key] = number
        row["known"] = row["known"] or number.figure["value"] is not None
    return [row for row in rows.values() if row["known"]]


def units_in(record: JsonTable, key: str) -> str:
    """The unit of a column, of joints that turn and of joints that slide."""
    units = [number.unit for number in numbers_of(record) if number.key == key]
    return "; ".join(dict.fromkeys(units))
