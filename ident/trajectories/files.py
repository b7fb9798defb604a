"""Files of commands, as `plan excite` writes them: `time` and `<joint>/position_command`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
from scipy.interpolate import make_interp_spline

from ident.arrays import Array, Float
from ident.errors import RecordingError, first_line
from ident.files import atomic_write, require_plain_header
from ident.recordings.load import require_readable_size
from ident.recordings.parquet import open_parquet, read_numbers
from ident.robot.arm import ArmModel
from ident.safe_read import open_regular
from ident.trajectories.reference import TICK_S, ReferenceMotion, sampled, ticks

SUFFIXES = (".csv", ".parquet")
# Every so many ticks are written: 250 Hz.
THINNING = 4
# Commands that stand farther apart than this say too little of what lies between them [s].
LARGEST_STEP_S = 0.05
# A motion of fewer ticks is none: it has no acceleration that could be told [s].
SHORTEST_S = 10 * TICK_S
# Fewer rows are no motion.
FEWEST_ROWS = 5
# Rounding of times, in ticks.
ROUNDING = 1e-6
# What is asked for where cells are no numbers.
WRITE_OUT = "write every time and position out"


def read_commands(path: str | Path, arm: ArmModel) -> tuple[ReferenceMotion, ...]:
    """Reads a command file, or a folder of them in the order of their names, one a run.

    Raises:
        RecordingError: No such file, a joint or the time is missing, or the values make no motion
            within limits.
    """
    path = Path(path)
    files = [path]
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.suffix in SUFFIXES)
    if not files:
        remedy = "give a folder that `plan excite --out` wrote"
        raise RecordingError(path, "holds no .csv or .parquet file", remedy)
    return tuple(_read_file(file, arm) for file in files)


def write_commands(
    motions: Sequence[ReferenceMotion], joints: Sequence[str], folder: str | Path
) -> tuple[Path, ...]:
    """Writes one file a motion at 250 Hz: positions [rad] and velocities [rad/s]."""
    folder = Path(folder)
    require_plain_header(joints, folder)
    folder.mkdir(parents=True, exist_ok=True)
    width = max(len(str(len(motions))), 2)
    written = []
    for number, motion in enumerate(motions, start=1):
        path = folder / f"{number:0{width}d}_{motion.name}.csv"
        with atomic_write(path) as file:
            pacsv.write_csv(_as_table(motion, joints), file)
        written.append(path)
    return tuple(written)


def _as_table(motion: ReferenceMotion, joints: Sequence[str]) -> pa.Table:
    """A motion as a file has it."""
    q = motion.q[::THINNING]
    dq = motion.dq[::THINNING]
    columns = {"time": np.round(np.arange(len(q)) * THINNING * TICK_S, 6)}
    for j, name in enumerate(joints):
        columns[f"{name}/position_command"] = np.round(q[:, j], 8)
        columns[f"{name}/velocity_command"] = np.round(dq[:, j], 7)
    return pa.table(columns)


def _read_file(path: Path, arm: ArmModel) -> ReferenceMotion:
    time, q = _read_columns(path, arm)
    _check(path, time, q, arm)
    since_start = time - time[0]
    curve = make_interp_spline(since_start, q, k=3, bc_type="clamped")
    whole = np.floor(float(since_start[-1]) / TICK_S + ROUNDING) * TICK_S
    name = path.stem.lstrip("0123456789_") or path.stem
    return sampled(name, curve(ticks(whole)))


def _read_table(path: Path, wanted: Sequence[str]) -> pa.Table:
    """The columns of a file: of a Parquet file only those that are wanted."""
    if path.suffix == ".parquet":
        with open_parquet(path) as file:
            return read_numbers(file, wanted, path)
    with open_regular(path, "give a .csv or .parquet file of commands", RecordingError) as stream:
        return pacsv.read_csv(stream)


def _read_columns(path: Path, arm: ArmModel) -> tuple[Float[Array, " T"], Float[Array, "T n"]]:
    """Times [s], and positions of all joints [rad]."""
    require_readable_size(path)
    wanted = ["time", *(f"{name}/position_command" for name in arm.joint_names)]
    try:
        table = _read_table(path, wanted)
    except (OSError, ValueError, pa.ArrowException) as error:  # a name that is not UTF-8, too
        what = f"can't be read ({first_line(error)})"
        raise RecordingError(path, what, "give a .csv or .parquet file of commands") from None
    try:
        missing = [name for name in wanted if name not in set(table.column_names)]
    except UnicodeDecodeError:
        what = "a column's name is not UTF-8"
        raise RecordingError(path, what, "write the file as UTF-8 text") from None
    if missing:
        remedy = f"give the columns {', '.join(wanted)}"
        raise RecordingError(path, f"no column {missing[0]!r}", remedy)
    try:
        time, *columns = (np.asarray(table[name], dtype=float) for name in wanted)
    except (ValueError, TypeError):
        raise RecordingError(path, "holds cells that are no numbers", WRITE_OUT) from None
    return time, np.stack(columns, axis=1)


def _check(path: Path, time: Float[Array, " T"], q: Float[Array, "T n"], arm: ArmModel) -> None:
    """Refuses commands that are no motion within limits."""
    is_finite = np.isfinite(time).all() and np.isfinite(q).all()
    if len(time) < FEWEST_ROWS or not is_finite:
        what = "too few rows, or values that are not finite"
        raise RecordingError(path, what, WRITE_OUT)
    steps = np.diff(time)
    if steps.min() <= 0.0 or steps.max() > LARGEST_STEP_S:
        worst = int(np.argmin(steps) if steps.min() <= 0.0 else np.argmax(steps))
        what = f"line {worst + 3}: time goes on by {steps[worst]:.4g} s"
        remedy = f"let time rise by at most {LARGEST_STEP_S:g} s from row to row"
        raise RecordingError(path, what, remedy)
    duration = time[-1] - time[0]
    if duration < SHORTEST_S:
        what = f"its motion takes {duration:.3g} s"
        remedy = f"give a motion of {SHORTEST_S:g} s or more, time in seconds"
        raise RecordingError(path, what, remedy)
    limits = arm.known_limits
    outside = np.argwhere((q < limits.lower) | (q > limits.upper))
    if len(outside):
        row, j = outside[0]
        what = f"line {row + 2}: {arm.joint_names[j]} at {q[row, j]:.3f} rad is out of its limits"
        remedy = f"stay within {arm.lower[j]:.2f} to {arm.upper[j]:.2f} rad"
        raise RecordingError(path, what, remedy)
