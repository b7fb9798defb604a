"""The motion of a plan's JSON record, `plan.result/1`.

The planner is not needed: a plan is a clamped cubic spline through its points. How it gets going
and comes to rest (`ramp_s`), and by how much it is slowed down for that (`stretch`), is written in
the record.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from ident.arrays import Array, Float
from ident.errors import RecordingError, RobotError
from ident.records import JsonRecord
from ident.robot.arm import ArmModel
from ident.safe_read import read_json
from ident.trajectories.gentle_ends import RAMP_SHARE, GentleEnds
from ident.trajectories.reference import TICK_S, ReferenceMotion, ticks

SCHEMA = "plan.result/1"
# Plans as long as hours are none [s].
LONGEST_S = 3600.0
# Standstill before and after: a log begins and ends at rest [s].
PLAN_REST_S = 0.3
# Rounding of times, in ticks.
ROUNDING = 1e-9
AGAIN = "plan the motion anew"
GIVE_PLAN = "give the file of `plan solve --json`"
# Numbers of the execution that are read.
EXECUTION = ("ramp_s", "stretch")


def read_plan(path: str | Path, arm: ArmModel) -> ReferenceMotion:
    """The motion of a plan at the controller's ticks, with standstill before and after.

    Raises:
        RecordingError: No such file, no plan, or one without a motion.
        RobotError: The plan is another robot's.
    """
    file = Path(path)
    record = _read_record(file, arm)
    points = _points(file, record, arm)
    times, ramp = _times(file, record)
    if len(times) != len(points) or np.any(np.diff(times) <= 0) or times[-1] > LONGEST_S:
        what = "times_s and duration_s do not rise from point to point"
        raise RecordingError(file, what, AGAIN)
    limits = arm.known_limits
    if np.any(points < limits.lower) or np.any(points > limits.upper):
        what = "a point of the plan is out of the arm's limits"
        raise RecordingError(file, what, "plan it for this robot")
    return _follow(file.stem, times, points, ramp).held(PLAN_REST_S, PLAN_REST_S)


def _read_record(file: Path, arm: ArmModel) -> JsonRecord:
    """The record of a plan that was found for the arm."""
    record = read_json(file, GIVE_PLAN, RecordingError)
    if record.get("schema") != SCHEMA:
        raise RecordingError(file, f"no record of {SCHEMA}", GIVE_PLAN)
    if record.get("status") != "solved":
        raise RecordingError(file, f"the plan is {record.get('status')!r}, not solved", AGAIN)
    robot = record.get("robot")
    if robot != arm.name:
        what = f"the plan is for {robot!r}, the robot is {arm.name!r}"
        raise RobotError(file, what, "give --robot")
    return record


def _times(file: Path, record: JsonRecord) -> tuple[Float[Array, " K"], float]:
    """Times of the plan's points, slowed down as they are executed, and its ramp [s]."""
    try:
        execution = dict(record.get("execution") or {})
        given = [*record["times_s"], record["duration_s"]]
    except (KeyError, TypeError, ValueError):
        what = "it has no times_s, duration_s or execution"
        raise RecordingError(file, what, AGAIN) from None
    for value in (*given, *(execution[name] for name in EXECUTION if name in execution)):
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not 0.0 <= value < np.inf:
            what = f"its times hold {value!r}, not a number of 0 or more"
            raise RecordingError(file, what, AGAIN)
    times = np.array([0.0, *map(float, given)]) * float(execution.get("stretch", 1.0))
    return times, float(execution.get("ramp_s", 0.0))


def _follow(
    name: str, times: Float[Array, " K"], points: Float[Array, "K n"], ramp: float
) -> ReferenceMotion:
    """The spline through points, gently begun and ended."""
    total = float(times[-1])
    curve = CubicSpline(times, points, bc_type="clamped")
    ends = GentleEnds(total, min(ramp, RAMP_SHARE * total))
    whole = float(np.ceil(ends.duration / TICK_S - ROUNDING)) * TICK_S
    s, ds, dds = ends.at(np.minimum(ticks(whole), ends.duration))
    slope = curve(s, 1)
    dq = slope * ds[:, None]
    bent = curve(s, 2) * ds[:, None] ** 2
    ddq = bent + slope * dds[:, None]
    return ReferenceMotion(name, curve(s), dq, ddq)


def _points(file: Path, record: JsonRecord, arm: ArmModel) -> Float[Array, "K n"]:
    """Start, via points and goal of all joints of the arm, the held ones at their places [rad]."""
    try:
        given = [record["start_rad"], *record["via_points_rad"], record["goal_rad"]]
        rows = np.array(given, dtype=float)
        columns = dict(zip(map(str, record["joints"]), rows.T, strict=True))
        for name, position in (record.get("held") or {}).items():
            columns[str(name)] = np.full(len(rows), float(position))
    except (KeyError, TypeError, ValueError, AttributeError):
        what = "its points are no rows of joint angles"
        raise RecordingError(file, what, AGAIN) from None
    for name in arm.joint_names:
        if name not in columns:
            raise RobotError(file, f"the plan says nothing of {name}", "plan it for this robot")
    points = np.stack([columns[name] for name in arm.joint_names], axis=1)
    if not np.isfinite(points).all():
        raise RecordingError(file, "a point is not finite", AGAIN)
    return points
