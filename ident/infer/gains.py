"""Signs and gains of torque columns: what gravity, inertia and friction of the robot explain."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ident.checks.arrangement import hang_by_current
from ident.checks.effort import States, fit_signed
from ident.checks.scales import fit_scale_everywhere
from ident.checks.settings import USUAL_EFFORT
from ident.infer.guess import Reason, Signals
from ident.infer.settings import UNITS as LIMIT
from ident.recordings.session_toml import EFFORT_UNITS, effort_unit_near
from ident.robot.arm import ArmModel

GAINS = "drive_gain_Nm_per_A"
# A unit at the end of a column's name by which what it holds is no torque in N m, nor a current in
# A.
OTHER_UNIT = re.compile(r"(?:[\[( _.])(mA|%|pct|percent|prozent)[\])]?$", re.IGNORECASE)
MILLI = "ma"  # of a current, in lower case
# How names of columns write the units of torques, in lower case and without marks between.
WRITTEN = {unit.lower(): unit for unit in EFFORT_UNITS} | {
    "nmm": "mNm",
    "kgcm": "kgfcm",
    "kgm": "kgfm",
    "ozin": "ozfin",
    "lbin": "lbfin",
    "inlb": "lbfin",
    "lbft": "lbfft",
    "ftlb": "lbfft",
}
# Other joints' gains that a joint's is compared with, at the least.
FEWEST_NEIGHBOURS = 3
FEWEST_OF_UNIT = 2  # joints that have a unit in common
# Standard deviation of a normal distribution over its median distance from the median.
MAD_TO_STD = 1.4826


def without_outliers(
    sizes: dict[str, float], swings: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, float]]:
    """Gains by joint that are like each other, and those that are not.

    Fewer than three say nothing of each other. The spread of the others, from the median of their
    distances to their median, is no less than what a sure gain may be off by. Joints that agree and
    bear more than half of the weight are no outliers, however many light ones differ: the motors of
    a base are larger than a wrist's.

    Args:
        sizes: Gravity in a column over the URDF's, by joint.
        swings: By how much the URDF's gravity changes along the recording [N m].
    """
    alike = dict(sizes)
    unlike = {}
    weight = sum(swings[joint] for joint in sizes)
    for joint, size in sizes.items():
        others = np.log([other for name, other in sizes.items() if name != joint])
        if len(others) < FEWEST_NEIGHBOURS:
            continue
        agreeing = []
        for name, other in sizes.items():
            if abs(np.log(other / size)) <= LIMIT.sure_gain:
                agreeing.append(name)
        agreeing_weight = sum(swings[name] for name in agreeing)
        if len(agreeing) > 1 and agreeing_weight > 0.5 * weight:
            continue
        middle = np.median(others)
        distance = float(np.median(np.abs(others - middle)))
        spread = max(MAD_TO_STD * distance, LIMIT.sure_gain)
        if abs(np.log(size) - middle) > LIMIT.unlike_neighbours * spread:
            unlike[joint] = alike.pop(joint)
    return alike, unlike


def common_scale(sizes: Mapping[str, float], swings: Mapping[str, float]) -> float:
    """The scale that joints share: their median, each with the weight of what gravity does there.

    A body at the flange that the URDF lacks is ten times a wrist's own weight, and little beside
    what a shoulder bears.

    Args:
        sizes: Gravity in a column over the URDF's, by joint; 1 where there is none.
        swings: By how much the URDF's gravity changes along the recording [N m].
    """
    if not sizes:
        return 1.0
    order = sorted(sizes, key=sizes.__getitem__)
    weights = np.cumsum([swings[joint] for joint in order])
    middle = int(np.searchsorted(weights, 0.5 * weights[-1]))
    return float(sizes[order[middle]])


def nearest_known(joint: str, joints: Sequence[str], sizes: Mapping[str, float]) -> str:
    """The joint along the chain nearest to this one whose gain is known; of two, the farther out.

    Motors are smaller from joint to joint towards the flange. Empty where no gain is known.
    """
    place = {name: number for number, name in enumerate(joints)}

    def how_far(name: str) -> tuple[int, int]:
        return abs(place[name] - place[joint]), -place[name]

    return min(sizes, key=how_far, default="")


def named_unit(column: str) -> str | None:
    """The unit of torque at the end of a column's name, one of `EFFORT_UNITS`; None without one."""
    words = re.findall("[a-z]+", column.lower())
    for start in range(max(len(words) - 3, 0), len(words)):
        unit = WRITTEN.get("".join(words[start:]))
        if unit is not None:
            return unit
    return None


def shown_unit(sizes: Mapping[str, float]) -> str | None:
    """The unit of torque in which all joints' columns are the model's, as surely as a gain is.

    None where there is none; one joint says nothing.

    Args:
        sizes: Gravity in a column over the URDF's, by joint.
    """
    if len(sizes) < FEWEST_OF_UNIT:
        return None
    return effort_unit_near(sizes.values(), LIMIT.sure_gain)


class SignFit(NamedTuple):
    """What the model says of the sign of a joint's torque."""

    sign: int  # 1 or -1; 1 where it is not clear
    explained: float  # share of the torque that the likelier sign explains
    clear: bool  # whether that is clearly more than the other does


class Column(NamedTuple):
    """A torque column against gravity of the URDF."""

    fit: SignFit
    size: float | None  # gravity in the column over the URDF's; None where it does not show
    swing: float  # by how much the URDF's gravity changes along the recording [N m]


def torque_settings(
    signals: Signals, arm: ArmModel, states: States | None, joints: tuple[str, ...], nominal: str
) -> tuple[str, dict[str, Any], list[Reason]]:
    """Sign and scale of each joint's torque.

    By what gravity, inertia and friction of the model explain. No gain follows from inertia: what a
    motor feels beside the URDF's links is its own rotor.

    Returns:
        `effort` where the columns are N m, else `current`; keys and tables of session.toml; and
            why, joint by joint.
    """
    name = signals.columns[nominal][0]
    unit = named_unit(name) if nominal == "effort" else None
    if states is None:
        why = "too short a run to tell; 1 stands for a figure that nobody has given"
        if nominal != "current":
            stated, reasons = _unit_settings(unit, "the columns' names say so")
            return nominal, {**stated}, reasons
        return nominal, {GAINS: dict.fromkeys(joints, 1.0)}, [Reason("effort", nominal, why)]
    if nominal == "current":
        states = hang_by_current(states, arm.keeping(joints))
    columns = {joint: _column_of(states, j) for j, joint in enumerate(joints)}
    fits = {joint: column.fit for joint, column in columns.items()}
    swings = {joint: column.swing for joint, column in columns.items()}
    shown = {joint: column.size for joint, column in columns.items() if column.size is not None}
    sizes, unlike = without_outliers(shown, swings)
    scale = common_scale(sizes, swings)
    other = next(iter(OTHER_UNIT.findall(name)), "")
    why = "the columns' names say so"
    if unit is None and nominal == "effort" and not other and not is_of_torque(scale):
        unit = shown_unit(shown)
        seen = ", ".join(f"{joint} {1.0 / size:.3g}" for joint, size in shown.items())
        why = f"gravity of the URDF over what the columns show of it: {seen}"
    factor = EFFORT_UNITS[unit or "Nm"]
    is_torque = not other and is_of_torque(factor * scale)
    channel = nominal if nominal == "current" or is_torque else "current"
    of_unit, of_reasons = _unit_settings(unit if is_torque else None, why)
    reasons = [*of_reasons, *_reasons_of_signs(fits)]
    gains: dict[str, float] = {}
    if channel == "current":
        known = KnownGains(joints, sizes, unlike, scale, other)
        limits = {}
        if other and other.lower() != MILLI:
            limits = dict(zip(arm.joint_names, arm.known_limits.effort, strict=True))
        for joint in fits:
            gain, why = known.guess(joint, limits.get(joint, np.inf))
            gains[joint] = gain
            reasons.append(Reason(f"{GAINS}.{joint}", f"{gain:g}", why))
    signs = {joint: fit.sign for joint, fit in fits.items() if fit.sign < 0}
    settings: dict[str, Any] = {**of_unit, GAINS: gains, "effort_sign": signs}
    if gains and other.lower() == MILLI:
        settings["current_unit"] = "mA"
        reasons.append(Reason("current_unit", "mA", "the columns' names say so"))
    return channel, {key: value for key, value in settings.items() if value}, reasons


def is_of_torque(scale: float) -> bool:
    """Whether columns at such a multiple of the model's torque are one."""
    return USUAL_EFFORT.scale_low < scale < USUAL_EFFORT.scale_high


def _unit_settings(unit: str | None, why: str) -> tuple[dict[str, str], list[Reason]]:
    """The key of a unit of torque and its reason; none of N m, which needs no word."""
    if unit is None or EFFORT_UNITS[unit] == 1.0:
        return {}, []
    return {"effort_unit": unit}, [Reason("effort_unit", unit, why)]


def _column_of(states: States, j: int) -> Column:
    """Sign and size of a joint's torque column."""
    gravity = states.gravity[:, j]
    swing = float(np.ptp(gravity))
    sides = {sign: fit_signed(states, j, float(sign)) for sign in (1, -1)}
    best = max(sides, key=lambda sign: sides[sign].explained)
    explained = sides[best].explained
    least = max(USUAL_EFFORT.follows, sides[-best].explained + LIMIT.clearly_more)
    clear = bool(states.alive[j] and explained > least)
    fit = SignFit(best if clear else 1, explained, clear)
    size, error, _ = fit_scale_everywhere(states, j)
    changes = np.ptp(gravity) > 1e-6 * np.abs(gravity).max()  # a slide's may not
    is_trusted = clear and changes and explained > LIMIT.trusted
    if is_trusted and error < LIMIT.sure_gain * best * size:
        return Column(fit, best * size, swing)
    return Column(fit, None, swing)


def _reasons_of_signs(fits: Mapping[str, SignFit]) -> list[Reason]:
    """One reason for all joints that are sure to point the right way, one for each other joint."""
    reasons = []
    upright = [joint for joint, fit in fits.items() if fit.clear and fit.sign > 0]
    if upright:
        share = 100.0 * min(fits[joint].explained for joint in upright)
        of_all = len(upright) == len(fits) > 1
        whose = "each joint" if of_all else ", ".join(upright)
        why = f"gravity, inertia and friction explain at least {share:.0f} % of {whose}"
        reasons.append(Reason("effort_sign", "+1", why))
    for joint, fit in fits.items():
        share = 100.0 * max(fit.explained, 0.0)
        why = f"gravity, inertia and friction explain {share:.0f} % with this sign"
        if not fit.clear:
            why = f"{why}: not sure, taken as it stands"
            reasons.append(Reason(f"effort_sign.{joint}", "+1", why))
        elif fit.sign < 0:
            reasons.append(Reason(f"effort_sign.{joint}", "-1", why))
    return reasons


class KnownGains(NamedTuple):
    """What is known of the gains of a log's torque columns."""

    joints: tuple[str, ...]  # along the chain
    sizes: Mapping[str, float]  # gravity in a column over the URDF's, where it shows
    unlike: Mapping[str, float]  # the same of joints that are unlike the others
    scale: float  # what the joints share
    other: str  # another unit that the columns' names tell; empty for none

    def guess(self, joint: str, limit: float) -> tuple[float, str]:
        """A joint's gain, and why.

        Args:
            joint: Its name.
            limit: The URDF's limit of its effort, where the columns are shares of it [N m].
        """
        nearest = nearest_known(joint, self.joints, self.sizes)
        size = self.sizes.get(nearest, self.scale)
        among = "1 stands for a figure that nobody has given"
        if nearest:
            among = f"that of {nearest}, the nearest where it does"
        why = f"gravity hardly shows here; {among}"
        if joint in self.sizes:
            why = "gravity of the URDF over what the column shows of it"
        if joint in self.unlike:
            by_gravity = f"gravity would give {1.0 / self.unlike[joint]:.3g}"
            among = f"that of {nearest}, the nearest that is like the others"
            why = f"{by_gravity}, too far off the other joints to be a guess; {among}"
        if np.isfinite(limit):
            size = 100.0 / limit
            why = "a hundred are the URDF's limit"
        gain = 1.0 / size
        if self.other.lower() == MILLI:
            gain *= 1000.0
        elif self.other:
            why += f"; for one {self.other}, in which its name says that it is"
        return float(f"{gain:.3g}"), f"{why}; a data sheet is better"
