"""A plan's JSON record, `plan.result/1`, as a motion that an arm can be asked to follow.

The planner is not needed for that: a plan is a clamped cubic spline through its points, and how it gets going and
comes to rest (`ramp_s`), and by how much it is slowed down for that (`stretch`), is written in the record.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from ident.arrays import Array, Float
from ident.errors import RecordingError, RobotError
from ident.robot.arm import ArmModel
from ident.safe_read import read_json
from ident.trajectories.ramps import RAMP_SHARE, GentleEnds
from ident.trajectories.reference import TICK_S, ReferenceMotion, ticks

SCHEMA = "plan.result/1"
# Plans as long as hours are none [s].
LONGEST_S = 3600.0
# Standstill before and after: a log begins and ends at rest [s].
REST_S = 0.3


def read_plan(path: str | Path, arm: ArmModel) -> ReferenceMotion:
    """The motion of a plan at the controller's ticks, with standstill before and after.

    Args:
        path: JSON file of `plan solve --json`.
        arm: The arm that is to follow it.

    Raises:
        RecordingError: No such file, no plan, or one without a motion.
        RobotError: The plan is another robot's.
    """
    file = Path(path)
    record = _record(file)
    _require_arm(file, record, arm)
    points = _points(file, record, arm)
    times = np.array([0.0, *_numbers(file, record, "times_s"), _number(file, record, "duration_s")])
    execution = record.get("execution") or {}
    if not isinstance(execution, dict):
        raise RecordingError(file, "its execution is no table", "plan the motion anew")
    ramp = _number(file, execution, "ramp_s") if "ramp_s" in execution else 0.0
    times *= _number(file, execution, "stretch") if "stretch" in execution else 1.0
    if len(times) != len(points) or np.any(np.diff(times) <= 0) or times[-1] > LONGEST_S:
        raise RecordingError(file, "times_s and duration_s do not rise from point to point", "plan the motion anew")
    if np.any(points < arm.lower) or np.any(points > arm.upper):
        raise RecordingError(file, "a point of the plan is out of the arm's limits", "plan it for this robot")
    curve = CubicSpline(times, points, bc_type="clamped")
    ends = GentleEnds(float(times[-1]), min(ramp, RAMP_SHARE * float(times[-1])))
    t = ticks(float(np.ceil(ends.duration / TICK_S - 1e-9)) * TICK_S)
    s, ds, dds = ends.at(np.minimum(t, ends.duration))
    dq, ddq = curve(s, 1), curve(s, 2)
    motion = ReferenceMotion(file.stem, curve(s), dq * ds[:, None], ddq * ds[:, None] ** 2 + dq * dds[:, None])
    return motion.held(REST_S, REST_S)


def _record(file: Path) -> dict[str, Any]:
    record = read_json(file, "give the file of `plan solve --json`", RecordingError)
    if record.get("schema") != SCHEMA:
        raise RecordingError(file, f"no record of {SCHEMA}", "give the file of `plan solve --json`")
    if record.get("status") != "solved":
        raise RecordingError(file, f"the plan is {record.get('status')!r}, not solved", "plan the motion anew")
    return record


def _require_arm(file: Path, record: dict[str, Any], arm: ArmModel) -> None:
    if record.get("robot") != arm.name:
        raise RobotError(file, f"the plan is for {record.get('robot')!r}, the robot is {arm.name!r}", "give --robot")
    joints, held = record.get("joints"), record.get("held") or {}
    if not isinstance(joints, list) or not all(isinstance(one, str) for one in joints) or not isinstance(held, dict):
        raise RecordingError(file, "its joints are no list of names", "plan the motion anew")
    named = {*joints, *held}
    strange = [name for name in arm.joint_names if name not in named]
    if strange:
        raise RobotError(file, f"the plan says nothing of {strange[0]}", "plan it for this robot")


def _points(file: Path, record: dict[str, Any], arm: ArmModel) -> Float[Array, "K n"]:
    """Start, via points and goal of all joints of the arm, the held ones at their places [rad]."""
    moving = record.get("joints", [])
    try:
        rows = [record["start_rad"], *record["via_points_rad"], record["goal_rad"]]
        given = np.array(rows, dtype=float).reshape(len(rows), len(moving))
        held = {str(name): float(value) for name, value in (record.get("held") or {}).items()}
    except (KeyError, TypeError, ValueError):
        raise RecordingError(file, "its points are no rows of joint angles", "plan the motion anew") from None
    columns = [given[:, moving.index(n)] if n in moving else np.full(len(rows), held[n]) for n in arm.joint_names]
    points = np.stack(columns, axis=1)
    if not np.isfinite(points).all():
        raise RecordingError(file, "a point is not finite", "plan the motion anew")
    return points


def _number(file: Path, table: dict[str, Any], key: str) -> float:
    value = table.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value) or value < 0.0:
        raise RecordingError(file, f"{key} is {value!r}, not a number of 0 or more", "plan the motion anew")
    return float(value)


def _numbers(file: Path, table: dict[str, Any], key: str) -> list[float]:
    values = table.get(key)
    if not isinstance(values, list):
        raise RecordingError(file, f"{key} is no list of numbers", "plan the motion anew")
    return [_number(file, {key: value}, key) for value in values]
