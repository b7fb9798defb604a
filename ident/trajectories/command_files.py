"""Commanded motions as files, as `plan excite` writes them: `time` and `<joint>/position_command` of every joint."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq
from scipy.interpolate import make_interp_spline

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.files import atomic_write
from ident.recordings.load import require_readable_size
from ident.robot.arm import ArmModel
from ident.trajectories.reference import TICK_S, ReferenceMotion, sampled, ticks

SUFFIXES = (".csv", ".parquet")
# Every so many ticks are written: 250 Hz.
THINNING = 4
# Commands that stand farther apart than this say too little of what lies between them [s].
LARGEST_STEP_S = 0.05


def read_commands(path: str | Path, arm: ArmModel) -> tuple[ReferenceMotion, ...]:
    """Reads a command file, or a folder of them in the order of their names, one a run.

    Args:
        path: File or folder.
        arm: The arm that is to follow them.

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
    table = _table(path)
    try:
        names = set(table.column_names)
    except UnicodeDecodeError:
        raise RecordingError(path, "a column's name is not UTF-8", "write the file as UTF-8 text") from None
    wanted = ["time", *(f"{name}/position_command" for name in arm.joint_names)]
    missing = [name for name in wanted if name not in names]
    if missing:
        raise RecordingError(path, f"no column {missing[0]!r}", f"give the columns {', '.join(wanted)}")
    try:
        columns = [np.asarray(table[name], dtype=float) for name in wanted]
    except (ValueError, TypeError):
        raise RecordingError(path, "holds cells that are no numbers", "write every time and position out") from None
    time, q = columns[0], np.stack(columns[1:], axis=1)
    _check(path, time, q, arm)
    curve = make_interp_spline(time - time[0], q, k=3, bc_type="clamped")
    motion = sampled(path.stem.lstrip("0123456789_") or path.stem, curve(_ticks_of(time)))
    return motion


def _table(path: Path) -> pa.Table:
    require_readable_size(path)
    try:
        return pq.read_table(path) if path.suffix == ".parquet" else pacsv.read_csv(path)
    except (OSError, ValueError, pa.ArrowException) as error:  # a name that is not UTF-8 is a ValueError
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordingError(path, f"can't be read ({reason})", "give a .csv or .parquet file of commands") from None


def _check(path: Path, time: Float[Array, " T"], q: Float[Array, "T n"], arm: ArmModel) -> None:
    if len(time) < 5 or not np.isfinite(time).all() or not np.isfinite(q).all():
        raise RecordingError(path, "too few rows, or values that are not finite", "write every time and position out")
    steps = np.diff(time)
    if steps.min() <= 0.0 or steps.max() > LARGEST_STEP_S:
        worst = int(np.argmin(steps) if steps.min() <= 0.0 else np.argmax(steps))
        raise RecordingError(
            path,
            f"line {worst + 3}: time goes on by {steps[worst]:.4g} s",
            f"let time rise by at most {LARGEST_STEP_S:g} s from row to row",
        )
    outside = np.argwhere((q < arm.lower) | (q > arm.upper))
    if len(outside):
        row, j = outside[0]
        raise RecordingError(
            path,
            f"line {row + 2}: {arm.joint_names[j]} at {q[row, j]:.3f} rad is out of its limits",
            f"stay within {arm.lower[j]:.2f} to {arm.upper[j]:.2f} rad",
        )


def _ticks_of(time: Float[Array, " T"]) -> Float[Array, " K"]:
    return ticks(np.floor(float(time[-1] - time[0]) / TICK_S + 1e-6) * TICK_S)
