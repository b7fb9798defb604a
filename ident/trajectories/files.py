"""Motions in files: commands as `plan excite` writes them, and a plan's JSON record, `plan.result/1`.

A command file holds `time` and `<joint>/position_command` of every joint. For a plan the planner is not needed: it is a
clamped cubic spline through its points, and how it gets going and comes to rest (`ramp_s`), and by how much it is
slowed down for that (`stretch`), is written in the record.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
from scipy.interpolate import CubicSpline, make_interp_spline

from ident.arrays import Array, Float
from ident.errors import RecordingError, RobotError, first_line
from ident.files import atomic_write, require_plain_header
from ident.recordings.load import require_readable_size
from ident.recordings.parquet import open_parquet
from ident.robot.arm import ArmModel
from ident.safe_read import read_json
from ident.trajectories.reference import RAMP_SHARE, TICK_S, GentleEnds, ReferenceMotion, sampled, ticks

SUFFIXES = (".csv", ".parquet")
# Every so many ticks are written: 250 Hz.
THINNING = 4
# Commands that stand farther apart than this say too little of what lies between them [s].
LARGEST_STEP_S = 0.05
# A motion of fewer ticks is none: it has no acceleration that could be told [s].
SHORTEST_S = 10 * TICK_S


def read_commands(path: str | Path, arm: ArmModel) -> tuple[ReferenceMotion, ...]:
    """Reads a command file, or a folder of them in the order of their names, one a run.

    Raises:
        RecordingError: No such file, a joint or the time is missing, or the values make no motion within limits.
    """
    path = Path(path)
    files = sorted(one for one in path.iterdir() if one.suffix in SUFFIXES) if path.is_dir() else [path]
    if not files:
        raise RecordingError(path, "holds no .csv or .parquet file", "give a folder that `plan excite --out` wrote")
    return tuple(_read_one(one, arm) for one in files)


def write_commands(motions: Sequence[ReferenceMotion], joints: Sequence[str], folder: str | Path) -> tuple[Path, ...]:
    """Writes one file a motion at 250 Hz: positions [rad] and velocities [rad/s] from rest to rest."""
    folder = Path(folder)
    require_plain_header(joints, folder)
    folder.mkdir(parents=True, exist_ok=True)
    width = max(len(str(len(motions))), 2)
    written = []
    for number, motion in enumerate(motions, start=1):
        q, dq = motion.q[::THINNING], motion.dq[::THINNING]
        columns = {"time": np.round(np.arange(len(q)) * THINNING * TICK_S, 6)}
        for j, name in enumerate(joints):
            columns[f"{name}/position_command"] = np.round(q[:, j], 8)
            columns[f"{name}/velocity_command"] = np.round(dq[:, j], 7)
        written.append(folder / f"{number:0{width}d}_{motion.name}.csv")
        with atomic_write(written[-1]) as part:
            pacsv.write_csv(pa.table(columns), part)
    return tuple(written)


def _read_one(path: Path, arm: ArmModel) -> ReferenceMotion:
    require_readable_size(path)
    wanted = ["time", *(f"{name}/position_command" for name in arm.joint_names)]
    try:
        table = open_parquet(path).read() if path.suffix == ".parquet" else pacsv.read_csv(path)
    except (OSError, ValueError, pa.ArrowException) as error:  # a name that is not UTF-8 is a ValueError
        what = f"can't be read ({first_line(error)})"
        raise RecordingError(path, what, "give a .csv or .parquet file of commands") from None
    try:
        missing = [name for name in wanted if name not in set(table.column_names)]
    except UnicodeDecodeError:
        raise RecordingError(path, "a column's name is not UTF-8", "write the file as UTF-8 text") from None
    if missing:
        raise RecordingError(path, f"no column {missing[0]!r}", f"give the columns {', '.join(wanted)}")
    try:
        time, *columns = (np.asarray(table[name], dtype=float) for name in wanted)
    except (ValueError, TypeError):
        raise RecordingError(path, "holds cells that are no numbers", "write every time and position out") from None
    q = np.stack(columns, axis=1)
    _check(path, time, q, arm)
    curve = make_interp_spline(time - time[0], q, k=3, bc_type="clamped")
    whole = np.floor(float(time[-1] - time[0]) / TICK_S + 1e-6) * TICK_S
    return sampled(path.stem.lstrip("0123456789_") or path.stem, curve(ticks(whole)))


def _check(path: Path, time: Float[Array, " T"], q: Float[Array, "T n"], arm: ArmModel) -> None:
    """Refuses commands that are no motion within limits."""
    if len(time) < 5 or not np.isfinite(time).all() or not np.isfinite(q).all():
        raise RecordingError(path, "too few rows, or values that are not finite", "write every time and position out")
    steps = np.diff(time)
    if steps.min() <= 0.0 or steps.max() > LARGEST_STEP_S:
        worst = int(np.argmin(steps) if steps.min() <= 0.0 else np.argmax(steps))
        what, remedy = f"time goes on by {steps[worst]:.4g} s", f"let time rise by at most {LARGEST_STEP_S:g} s"
        raise RecordingError(path, f"line {worst + 3}: {what}", f"{remedy} from row to row")
    if time[-1] - time[0] < SHORTEST_S:
        what = f"its motion takes {time[-1] - time[0]:.3g} s"
        raise RecordingError(path, what, f"give a motion of {SHORTEST_S:g} s or more, time in seconds")
    limits = arm.known_limits
    outside = np.argwhere((q < limits.lower) | (q > limits.upper))
    if len(outside):
        row, j = outside[0]
        what = f"line {row + 2}: {arm.joint_names[j]} at {q[row, j]:.3f} rad is out of its limits"
        raise RecordingError(path, what, f"stay within {arm.lower[j]:.2f} to {arm.upper[j]:.2f} rad")


SCHEMA = "plan.result/1"
# Plans as long as hours are none [s].
LONGEST_S = 3600.0
# Standstill before and after: a log begins and ends at rest [s].
PLAN_REST_S = 0.3


def read_plan(path: str | Path, arm: ArmModel) -> ReferenceMotion:
    """The motion of a plan at the controller's ticks, with standstill before and after.

    Raises:
        RecordingError: No such file, no plan, or one without a motion.
        RobotError: The plan is another robot's.
    """
    file, again = Path(path), "plan the motion anew"
    record = read_json(file, "give the file of `plan solve --json`", RecordingError)
    if record.get("schema") != SCHEMA:
        raise RecordingError(file, f"no record of {SCHEMA}", "give the file of `plan solve --json`")
    if record.get("status") != "solved":
        raise RecordingError(file, f"the plan is {record.get('status')!r}, not solved", again)
    if record.get("robot") != arm.name:
        raise RobotError(file, f"the plan is for {record.get('robot')!r}, the robot is {arm.name!r}", "give --robot")
    points = _points(file, record, arm)
    try:
        execution, given = dict(record.get("execution") or {}), [*record["times_s"], record["duration_s"]]
    except (KeyError, TypeError, ValueError):
        raise RecordingError(file, "it has no times_s, duration_s or execution", again) from None
    for value in (*given, *(execution[name] for name in ("ramp_s", "stretch") if name in execution)):
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < np.inf:
            raise RecordingError(file, f"its times hold {value!r}, not a number of 0 or more", again)
    times = np.array([0.0, *map(float, given)]) * float(execution.get("stretch", 1.0))
    if len(times) != len(points) or np.any(np.diff(times) <= 0) or times[-1] > LONGEST_S:
        raise RecordingError(file, "times_s and duration_s do not rise from point to point", again)
    limits = arm.known_limits
    if np.any(points < limits.lower) or np.any(points > limits.upper):
        raise RecordingError(file, "a point of the plan is out of the arm's limits", "plan it for this robot")
    curve = CubicSpline(times, points, bc_type="clamped")
    ends = GentleEnds(float(times[-1]), min(float(execution.get("ramp_s", 0.0)), RAMP_SHARE * float(times[-1])))
    t = ticks(float(np.ceil(ends.duration / TICK_S - 1e-9)) * TICK_S)
    s, ds, dds = ends.at(np.minimum(t, ends.duration))
    dq, ddq = curve(s, 1), curve(s, 2)
    motion = ReferenceMotion(file.stem, curve(s), dq * ds[:, None], ddq * ds[:, None] ** 2 + dq * dds[:, None])
    return motion.held(PLAN_REST_S, PLAN_REST_S)


def _points(file: Path, record: dict[str, Any], arm: ArmModel) -> Float[Array, "K n"]:
    """Start, via points and goal of all joints of the arm, the held ones at their places [rad]."""
    try:
        rows = np.array([record["start_rad"], *record["via_points_rad"], record["goal_rad"]], dtype=float)
        columns = dict(zip(map(str, record["joints"]), rows.T, strict=True))
        columns |= {str(name): np.full(len(rows), float(at)) for name, at in (record.get("held") or {}).items()}
    except (KeyError, TypeError, ValueError, AttributeError):
        raise RecordingError(file, "its points are no rows of joint angles", "plan the motion anew") from None
    strange = [name for name in arm.joint_names if name not in columns]
    if strange:
        raise RobotError(file, f"the plan says nothing of {strange[0]}", "plan it for this robot")
    points = np.stack([columns[name] for name in arm.joint_names], axis=1)
    if not np.isfinite(points).all():
        raise RecordingError(file, "a point is not finite", "plan the motion anew")
    return points
