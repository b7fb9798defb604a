"""Units, signs, gains and joint order of columns whose meaning is known.

By what the numbers and the robot say of them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ident.arrays import Array, Float
from ident.checks.conventions.find import find_conventions, is_changed
from ident.checks.conventions.reread import reread
from ident.checks.conventions.told import describe, rivals
from ident.checks.conventions.words import in_words
from ident.checks.effort import States, collect_states
from ident.checks.filtered_run import compare_velocities
from ident.checks.inspection import check_rows
from ident.infer.families import words_of
from ident.infer.guess import Reason, Signals
from ident.infer.settings import UNITS as LIMIT
from ident.recordings.recording import Session
from ident.recordings.session_toml import ANGLE_UNITS, TIME_UNITS
from ident.robot.arm import ArmModel

# No joint of an arm turns farther than three turns to a side [rad].
FARTHEST_RAD = 6 * math.pi
COUNTS = 4096  # of the encoders of Feetech's and Dynamixel's servos, a turn
# Its name, its factor to SI, and why.
Unit = tuple[str | int, float, Reason | None]


def time_unit(signals: Signals) -> Unit:
    """The unit of time, by the column's name and by the step from sample to sample."""
    if signals.clock is None:
        return "s", 1.0, None
    step = float(np.median(np.diff(signals.time)))
    words = words_of(signals.clock)
    named = [unit for unit in TIME_UNITS if unit != "s" and unit in words]
    fitting = []
    for unit, factor in TIME_UNITS.items():
        if LIMIT.fastest_s <= step * factor <= LIMIT.slowest_s:
            fitting.append(unit)
    named_and_fitting = [unit for unit in named if unit in fitting]
    unit = next(iter([*named_and_fitting, *fitting]), "s")
    factor = TIME_UNITS[unit]
    rate = 1.0 / max(step * factor, 1e-300)
    seen = f"the median step is {step:.6g}, so {rate:.4g} Hz"
    return unit, factor, Reason("time_unit", unit, seen)


def angle_unit(signals: Signals, arm: ArmModel | None) -> Unit:
    """Radians, degrees or counts, by the robot's limits, else by what no arm can do.

    Whole numbers beyond the limits in degrees, too, are an encoder's counts.
    """
    position = signals.tables["position"]
    far = np.abs(position).max(axis=0)
    turning = np.ones(len(far), dtype=bool)
    reach = np.full(len(far), FARTHEST_RAD)
    if arm is not None:
        known = [arm.joint_names.index(joint) for joint in signals.joints]
        turning = ~arm.sliding_joints[known]
        reach = np.minimum(arm.known_limits.reach[known], FARTHEST_RAD)
    beyond = turning & (far > 1.1 * reach)
    largest = far[turning].max(initial=0.0)
    if not beyond.any():
        within = "the robot's limits" if arm is not None else "three turns"
        seen = f"the largest angle is {largest:.3g}, within {within} in radians"
        return "rad", 1.0, Reason("angle_unit", "rad", seen)
    span = float(np.ptp(position, axis=0)[turning].max())
    if span < LIMIT.least_span_deg and largest < FARTHEST_RAD:
        names = np.array(signals.joints)[beyond]
        beyond_limits = f"{', '.join(names)}: beyond the URDF's limits, then"
        seen = f"as degrees no joint turns by more than {span:.2g}; {beyond_limits}"
        return "rad", 1.0, Reason("angle_unit", "rad", seen)
    j = int(np.argmax(np.where(beyond, far / reach, 0.0)))
    limit = f"its limit is {reach[j]:.3g} rad or {math.degrees(reach[j]):.4g} deg"
    seen = f"{signals.joints[j]} goes to {far[j]:.4g}; {limit}"
    are_whole = not np.any(position % 1.0)
    if far[j] > 1.1 * math.degrees(reach[j]) and are_whole:
        why = f"{seen}; whole numbers: counts"
        return COUNTS, math.tau / COUNTS, Reason("counts_per_turn", f"{COUNTS}", why)
    return "deg", ANGLE_UNITS["deg"], Reason("angle_unit", "deg", seen)


def zero_count(position: Float[Array, "T n"], unit: Unit) -> float:
    """The count at which a joint's angle is zero: the middle of a turn, or 0 of counts that run
    below it; 0 of other units.

    Args:
        position: As the file has it.
        unit: Of its angles.
    """
    counts, _, reason = unit
    is_counted = reason is not None and reason.what == "counts_per_turn"
    runs_below = float(position.min(initial=0.0)) < 0.0
    return float(counts) / 2.0 if is_counted and not runs_below else 0.0


def slide_scales(signals: Signals, arm: ArmModel | None) -> tuple[dict[str, float], list[Reason]]:
    """Of each joint that slides what its unit is in metres, and why.

    Millimetres where metres lie beyond its limits.
    """
    scales: dict[str, float] = {}
    reasons: list[Reason] = []
    if arm is None:
        return scales, reasons
    farthest = np.abs(signals.tables["position"]).max(axis=0)
    far = dict(zip(signals.joints, farthest, strict=True))
    rows = zip(arm.joint_names, arm.known_limits.reach, arm.sliding_joints, strict=True)
    for name, reach, slides in rows:
        if not slides or name not in far:
            continue
        scales[name] = 1e-3 if far[name] > 1.1 * reach else 1.0
        why = f"it goes to {far[name]:.4g}; its limit is {reach:.3g} m"
        reasons.append(Reason(f"slide_scale.{name}", f"{scales[name]:g}", why))
    return scales, reasons


def check_velocity(signals: Signals) -> tuple[Signals, Reason | None, str | None]:
    """The signals without a velocity that is not their positions' derivative, and why.

    In the same unit.
    """
    if "velocity" not in signals.tables:
        return signals, None, None
    run = signals.run(np.zeros_like(signals.tables["position"]))
    compared = compare_velocities(Session("guess", (run,)))
    if compared is None:
        return signals, None, None
    moves, slopes, correlations = compared
    if not moves.any():
        return signals, None, None
    slope = float(np.median(slopes[moves]))
    match = float(np.median(correlations[moves]))
    seen = f"{slope:.3g} times the positions' derivative, correlation {match:.3f}"
    if abs(slope - 1.0) < LIMIT.slope_off and match > LIMIT.same_signal:
        return signals, Reason("velocity", "in the positions' unit per second", seen), None
    columns = dict(signals.columns)
    del columns["velocity"]
    tables = {name: signals.tables[name] for name in columns}
    signals = replace(signals, columns=columns, tables=tables)
    return signals, None, f"not used: {seen}; position is differentiated instead"


def sample_rate(signals: Signals, stated: float | None) -> tuple[float | None, Reason | None]:
    """The rate of a table without time [Hz].

    As the file states it, else by velocity against position's steps.
    """
    if signals.clock is not None:
        return None, None
    if stated is not None:
        why = "the data set states it, or the user does"
        return stated, Reason("sample_rate_hz", f"{stated:g}", why)
    if "velocity" not in signals.tables:
        return None, None
    steps = np.gradient(signals.tables["position"], axis=0)
    speed = signals.tables["velocity"]
    power = (steps**2).sum(axis=0)
    moves = power > 0
    slope = (speed * steps).sum(axis=0)[moves] / power[moves]
    rate = round(float(np.median(slope)), 1) if len(slope) else 0.0
    interval = 1.0 / max(rate, 1e-9)
    if not LIMIT.fastest_s <= interval <= LIMIT.slowest_s:
        return None, None
    why = "velocity is so many times the step from sample to sample"
    return rate, Reason("sample_rate_hz", f"{rate:g}", why)


def torque_of(signals: Signals) -> Array:
    """The torque's columns: efforts, or currents where there are none."""
    return signals.tables["effort" if "effort" in signals.tables else "current"]


def session_of(signals: Signals, arm: ArmModel) -> Session | None:
    """The motion of the robot's joints with the torque's columns as they stand.

    As a check of its rows leaves it: through a gap, or a row that is broken, nothing is derived.
    None where no joint is the robot's.
    """
    run = signals.run(torque_of(signals))
    present = [name for name in arm.joint_names if name in run.joints]
    if not present:
        return None
    session = Session("guess", (run.select(present),))
    mended, _ = check_rows(session, None)
    return mended if mended.samples else session


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
    same = Reread(signals.joints, signals.joints, settings={}, states=None, reasons=[])
    session = session_of(signals, arm)
    if session is None:
        return same
    recorded = arm.keeping(signals.joints)
    same = same._replace(states=collect_states(session, recorded))
    conventions = find_conventions(session, recorded)
    if conventions is None or not is_changed(conventions):
        return same
    hypothesis = replace(conventions.best.hypothesis, effort_sign=(1,) * recorded.n)
    readings = (conventions.best, *rivals(conventions))
    why = "; else ".join(in_words(reading, session.joints) for reading in readings)
    known = describe(hypothesis, session.joints)
    settings: dict[str, Any] = {}
    for key in ("direction", "zero_rad", "unit", "gravity_mps2"):
        if key in known:
            settings[key] = known[key]
    joints = _moved(signals.joints, session.joints, hypothesis.order)
    torques = _moved(signals.joints, session.joints, hypothesis.effort_order)
    reasons = []
    if joints != signals.joints or torques != signals.joints:
        reasons.append(Reason("joints", ", ".join(joints), why))
    for key, value in settings.items():
        evidence = f"as {reasons[0].what} above" if reasons else why
        reasons.append(Reason(key, json.dumps(value), evidence))
    turned = recorded
    if not isinstance(hypothesis.gravity, str):
        turned = recorded.with_gravity(np.array(hypothesis.gravity))
    states = collect_states(reread(session, hypothesis), turned)
    return Reread(joints, torques, settings, states, reasons)


def _moved(
    joints: tuple[str, ...], present: Sequence[str], order: Sequence[int]
) -> tuple[str, ...]:
    """The joints' names, of which those that are the robot's stand where a hypothesis has them."""
    renamed = {present[column]: present[j] for j, column in enumerate(order)}
    return tuple(renamed.get(name, name) for name in joints)
