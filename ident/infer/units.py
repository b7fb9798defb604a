"""Units, signs, gains and joint order of columns whose meaning is known.

By what the numbers and the robot say of them.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ident.checks.arrangement import hang_by_current
from ident.checks.conventions.find import find_conventions, is_changed
from ident.checks.conventions.reread import describe, reread, rivals
from ident.checks.conventions.words import in_words
from ident.checks.effort import States, collect_states, fit_signed
from ident.checks.filtered_run import USUAL_EFFORT, compare_velocities
from ident.checks.scales import fit_scale
from ident.infer.families import words_of
from ident.infer.guess import Reason, Signals
from ident.recordings.recording import Session
from ident.recordings.session_toml import ANGLE_UNITS, TIME_UNITS
from ident.records import read_group
from ident.robot.arm import ArmModel

LIMIT = read_group(__file__, "units")

# No joint of an arm turns farther than three turns to a side [rad].
FARTHEST_RAD = 6 * math.pi
GAINS = "drive_gain_Nm_per_A"
COUNTS = 4096  # of the encoders of Feetech's and Dynamixel's servos, a turn
# A unit at the end of a column's name by which what it holds is no torque in N m, nor a current in
# A.
OTHER_UNIT = re.compile(r"(?:[\[( _.])(mA|%|pct|percent|prozent)[\])]?$", re.IGNORECASE)
MILLI = "ma"  # of a current, in lower case
# Other joints' gains that a joint's is compared with, at the least.
FEWEST_NEIGHBOURS = 3
# Standard deviation of a normal distribution over its median distance from the median.
MAD_TO_STD = 1.4826
# Its name, its factor to SI, and why.
Unit = tuple[str | int, float, Reason | None]


def time_unit(signals: Signals) -> Unit:
    """The unit of time, by the column's name and by the step from sample to sample."""
    if signals.clock is None:
        return "s", 1.0, None
    step = float(np.median(np.diff(signals.time)))
    named = [unit for unit in TIME_UNITS if unit != "s" and unit in words_of(signals.clock)]
    fitting = [
        unit
        for unit, factor in TIME_UNITS.items()
        if LIMIT.fastest_s <= step * factor <= LIMIT.slowest_s
    ]
    unit = next(iter([*(one for one in named if one in fitting), *fitting]), "s")
    seen = f"the median step is {step:.6g}, so {1.0 / max(step * TIME_UNITS[unit], 1e-300):.4g} Hz"
    return unit, TIME_UNITS[unit], Reason("time_unit", unit, seen)


def angle_unit(signals: Signals, arm: ArmModel | None) -> Unit:
    """Radians or degrees, by the robot's limits, else by what no arm can do."""
    far = np.abs(signals.tables["position"]).max(axis=0)
    turning, reach = np.ones(len(far), dtype=bool), np.full(len(far), FARTHEST_RAD)
    if arm is not None:
        known = [arm.joint_names.index(joint) for joint in signals.joints]
        turning = ~arm.sliding_joints[known]
        reach = np.minimum(arm.known_limits.reach[known], FARTHEST_RAD)
    beyond = turning & (far > 1.1 * reach)
    largest = far[turning].max(initial=0.0)
    span = float(np.ptp(signals.tables["position"], axis=0)[turning].max()) if beyond.any() else 0.0
    if not beyond.any():
        within = "the robot's limits" if arm is not None else "three turns"
        seen = f"the largest angle is {largest:.3g}, within {within} in radians"
    elif span < LIMIT.least_span_deg and largest < FARTHEST_RAD:
        outside = ", ".join(
            name for name, far_off in zip(signals.joints, beyond, strict=True) if far_off
        )
        beyond_limits = f"{outside}: beyond the URDF's limits, then"
        seen = f"as degrees no joint turns by more than {span:.2g}; {beyond_limits}"
    else:
        j = int(np.argmax(np.where(beyond, far / reach, 0.0)))
        limit = f"its limit is {reach[j]:.3g} rad or {math.degrees(reach[j]):.4g} deg"
        seen = f"{signals.joints[j]} goes to {far[j]:.4g}; {limit}"
        if far[j] > math.degrees(FARTHEST_RAD) and not np.any(signals.tables["position"] % 1.0):
            return (
                COUNTS,
                math.tau / COUNTS,
                Reason("counts_per_turn", f"{COUNTS}", f"{seen}; whole numbers: counts"),
            )
        return "deg", ANGLE_UNITS["deg"], Reason("angle_unit", "deg", seen)
    return "rad", 1.0, Reason("angle_unit", "rad", seen)


def slide_scales(signals: Signals, arm: ArmModel | None) -> tuple[dict[str, float], list[Reason]]:
    """Of each joint that slides what its unit is in metres, and why.

    Millimetres where metres lie beyond its limits.
    """
    far = dict(zip(signals.joints, np.abs(signals.tables["position"]).max(axis=0), strict=True))
    rows = (
        []
        if arm is None
        else zip(arm.joint_names, arm.known_limits.reach, arm.sliding_joints, strict=True)
    )
    reach = {name: most for name, most, slides in rows if slides and name in far}
    scales = {name: 1e-3 if far[name] > 1.1 * most else 1.0 for name, most in reach.items()}
    seen = {
        name: f"it goes to {far[name]:.4g}; its limit is {most:.3g} m"
        for name, most in reach.items()
    }
    return scales, [
        Reason(f"slide_scale.{name}", f"{scales[name]:g}", why) for name, why in seen.items()
    ]


def check_velocity(signals: Signals) -> tuple[Signals, Reason | None, str | None]:
    """The signals without a velocity that is not their positions' derivative, and why.

    In the same unit.
    """
    if "velocity" not in signals.tables:
        return signals, None, None
    found = compare_velocities(
        Session("guess", (signals.run(np.zeros_like(signals.tables["position"])),))
    )
    if found is None or not found[0].any():
        return signals, None, None
    slope, match = (float(np.median(one[found[0]])) for one in found[1:])
    seen = f"{slope:.3g} times the positions' derivative, correlation {match:.3f}"
    if abs(slope - 1.0) < LIMIT.slope_off and match > LIMIT.same_signal:
        return signals, Reason("velocity", "in the positions' unit per second", seen), None
    columns = {name: own for name, own in signals.columns.items() if name != "velocity"}
    signals = replace(
        signals, columns=columns, tables={name: signals.tables[name] for name in columns}
    )
    return signals, None, f"not used: {seen}; position is differentiated instead"


def sample_rate(signals: Signals, stated: float | None) -> tuple[float | None, Reason | None]:
    """The rate of a table without time [Hz].

    As the file states it, else by velocity against position's steps.
    """
    if signals.clock is not None:
        return None, None
    if stated is not None:
        return stated, Reason(
            "sample_rate_hz", f"{stated:g}", "the data set states it, or the user does"
        )
    if "velocity" not in signals.tables:
        return None, None
    steps, speed = np.gradient(signals.tables["position"], axis=0), signals.tables["velocity"]
    power = (steps**2).sum(axis=0)
    slope = (speed * steps).sum(axis=0)[power > 0] / power[power > 0]
    rate = round(float(np.median(slope)), 1) if len(slope) else 0.0
    if not LIMIT.fastest_s <= 1.0 / max(rate, 1e-9) <= LIMIT.slowest_s:
        return None, None
    return rate, Reason(
        "sample_rate_hz", f"{rate:g}", "velocity is so many times the step from sample to sample"
    )


def states_of(signals: Signals, arm: ArmModel, joints: Sequence[str]) -> States | None:
    """The filtered motion with the torque's columns as they stand, its joints called so."""
    run = signals.run(signals.tables["effort" if "effort" in signals.tables else "current"], joints)
    present = [name for name in arm.joint_names if name in run.joints]
    return collect_states(Session("guess", (run.select(present),)), arm.keeping(run.joints))


class Reread(NamedTuple):
    """How columns are to be read beside their names, and why."""

    joints: tuple[str, ...]  # of the position's columns and all others but the torque's
    torques: tuple[str, ...]  # of the torque's columns
    settings: dict[str, Any]  # tables of session.toml
    states: States | None  # the motion and torque so read
    reasons: list[Reason]


def search_columns(signals: Signals, arm: ArmModel) -> Reread:
    """Order, directions, zeros and units of the columns by the search of all conventions.

    See `ident.checks.conventions`. Signs and gains of the torque are asked for after it.
    """
    same = Reread(signals.joints, signals.joints, {}, states_of(signals, arm, signals.joints), [])
    run = signals.run(signals.tables["effort" if "effort" in signals.tables else "current"])
    present = [name for name in arm.joint_names if name in run.joints]
    if not present:
        return same
    session, own = Session("guess", (run.select(present),)), arm.keeping(run.joints)
    found = find_conventions(session, own)
    if found is None or not is_changed(found):
        return same
    hypothesis = replace(found.best.hypothesis, effort_sign=(1,) * own.n)
    why = "; else ".join(
        in_words(scored, session.joints) for scored in (found.best, *rivals(found))
    )
    known = describe(hypothesis, session.joints)
    keys: tuple[str, ...] = ("direction", "zero_rad", "unit", "gravity_mps2")
    settings: dict[str, Any] = {key: known[key] for key in keys if key in known}
    joints = _moved(signals.joints, present, hypothesis.order)
    torques = _moved(signals.joints, present, hypothesis.effort_order)
    reasons = [Reason(key, json.dumps(value), why) for key, value in settings.items()]
    if joints != signals.joints or torques != signals.joints:
        reasons.append(Reason("joints", ", ".join(joints), why))
    turned = (
        own
        if isinstance(hypothesis.gravity, str)
        else own.with_gravity(np.array(hypothesis.gravity))
    )
    return Reread(
        joints, torques, settings, collect_states(reread(session, hypothesis), turned), reasons
    )


def _moved(
    joints: tuple[str, ...], present: Sequence[str], order: Sequence[int]
) -> tuple[str, ...]:
    """The joints' names, of which those that are the robot's stand where a hypothesis has them."""
    renamed = {present[column]: present[j] for j, column in enumerate(order)}
    return tuple(renamed.get(name, name) for name in joints)


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
    kept, unlike = dict(sizes), {}
    weight = sum(swings[joint] for joint in sizes)
    for joint, size in sizes.items():
        others = np.log([other for name, other in sizes.items() if name != joint])
        if len(others) < FEWEST_NEIGHBOURS:
            continue
        agreeing = [
            name for name, other in sizes.items() if abs(np.log(other / size)) <= LIMIT.sure_gain
        ]
        if len(agreeing) > 1 and sum(swings[name] for name in agreeing) > 0.5 * weight:
            continue
        middle = np.median(others)
        spread = max(MAD_TO_STD * float(np.median(np.abs(others - middle))), LIMIT.sure_gain)
        if abs(np.log(size) - middle) > LIMIT.unlike_neighbours * spread:
            unlike[joint] = kept.pop(joint)
    return kept, unlike


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
    at = {name: place for place, name in enumerate(joints)}
    return min(sizes, key=lambda name: (abs(at[name] - at[joint]), -at[name]), default="")


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
    if states is None:
        why = "too short a run to tell; 1 stands for a figure that nobody has given"
        if nominal != "current":
            return nominal, {}, []
        return nominal, {GAINS: dict.fromkeys(joints, 1.0)}, [Reason("effort", nominal, why)]
    states = hang_by_current(states, arm.keeping(joints)) if nominal == "current" else states
    fits: dict[str, tuple[int, float, bool]] = {}  # sign, share explained, whether that is clear
    sizes: dict[str, float] = {}  # gravity in the column over the URDF's, where it shows
    for j, joint in enumerate(joints):
        sides = {sign: fit_signed(states, j, float(sign)) for sign in (1, -1)}
        best = max(sides, key=lambda sign: sides[sign].explained)
        least = max(USUAL_EFFORT.follows, sides[-best].explained + LIMIT.clearly_more)
        clear = bool(states.alive[j] and sides[best].explained > least)
        fits[joint] = (best if clear else 1, sides[best].explained, clear)
        size, error, _ = fit_scale(states, j)
        changes = (
            np.ptp(states.gravity[:, j]) > 1e-6 * np.abs(states.gravity[:, j]).max()
        )  # a slide's may not
        if (
            clear
            and changes
            and sides[best].explained > LIMIT.trusted
            and error < LIMIT.sure_gain * best * size
        ):
            sizes[joint] = best * size
    swings = {joint: float(np.ptp(states.gravity[:, j])) for j, joint in enumerate(joints)}
    sizes, unlike = without_outliers(sizes, swings)
    scale = common_scale(sizes, swings)
    other = next(iter(OTHER_UNIT.findall(signals.columns[nominal][0])), "")
    is_torque = not other and USUAL_EFFORT.scale_low < scale < USUAL_EFFORT.scale_high
    channel = nominal if nominal == "current" or is_torque else "current"
    reasons = []
    # One reason for all joints that are sure to point the right way, one for each other joint.
    if upright := [joint for joint, (sign, _, clear) in fits.items() if clear and sign > 0]:
        share = 100.0 * min(fits[joint][1] for joint in upright)
        of_all = len(upright) == len(fits) > 1
        whose = "each joint" if of_all else ", ".join(upright)
        why = f"gravity, inertia and friction explain at least {share:.0f} % of {whose}"
        reasons.append(Reason("effort_sign", "+1", why))
    for joint, (sign, explained, clear) in fits.items():
        share = 100.0 * max(explained, 0.0)
        why = f"gravity, inertia and friction explain {share:.0f} % with this sign"
        if not clear:
            reasons.append(
                Reason(f"effort_sign.{joint}", "+1", f"{why}: not sure, taken as it stands")
            )
        elif sign < 0:
            reasons.append(Reason(f"effort_sign.{joint}", "-1", why))
    gains: dict[str, float] = {}
    limits = (
        dict(zip(arm.joint_names, arm.known_limits.effort, strict=True))
        if other and other.lower() != MILLI
        else {}
    )
    for joint in fits if channel == "current" else ():
        nearest = nearest_known(joint, joints, sizes)
        among = (
            f"that of {nearest}, the nearest where it does"
            if nearest
            else "1 stands for a figure that nobody has given"
        )
        why = "gravity of the URDF over what the column shows of it"
        why = why if joint in sizes else f"gravity hardly shows here; {among}"
        if joint in unlike:
            by_gravity = f"gravity would give {1.0 / unlike[joint]:.3g}"
            among = f"that of {nearest}, the nearest that is like the others"
            why = f"{by_gravity}, too far off the other joints to be a guess; {among}"
        size = sizes.get(nearest, scale)
        if np.isfinite(limits.get(joint, np.inf)):
            size, why = 100.0 / limits[joint], "a hundred are the URDF's limit"
        gain = 1.0 / size
        if other.lower() == MILLI:
            gain *= 1000.0
        elif other:
            why += f"; for one {other}, in which its name says that it is"
        gains[joint] = float(f"{gain:.3g}")
        reasons.append(
            Reason(f"{GAINS}.{joint}", f"{gains[joint]:g}", f"{why}; a data sheet is better")
        )
    signs = {joint: sign for joint, (sign, _, _) in fits.items() if sign < 0}
    settings: dict[str, Any] = {GAINS: gains, "effort_sign": signs}
    if gains and other.lower() == MILLI:
        settings["current_unit"] = "mA"
        reasons.append(Reason("current_unit", "mA", "the columns' names say so"))
    return channel, {key: value for key, value in settings.items() if value}, reasons
