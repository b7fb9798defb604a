"""A plan as a controller takes it: sampled at its rate, from rest to rest without a jump of the acceleration.

A clamped cubic spline starts with an acceleration, which no drive can have at once. So the plan is begun and ended a
little slower, on the same path: position, velocity and acceleration start at rest, and the jerk is bounded everywhere.
Where torque, speed or acceleration would pass a limit on the way, the whole motion is slowed down until none does; the
certificate looks at the motion as it is executed.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.files import atomic_write, require_plain_header
from ident.outputs import WRITER, mark_file
from plan.problem.result import PlanResult

SUFFIXES = (".csv", ".yaml", ".yml", ".parquet")
DEFAULT_RATE = 250.0
RATES = (10.0, 10_000.0)


@dataclass(frozen=True, eq=False)
class Execution:
    """A sampled motion."""

    joints: tuple[str, ...]  # names of the joints, those that move first, then those that are held
    times: Float[Array, " T"]  # from 0 to the end [s]
    q: Float[Array, "T n"]  # position [rad], velocity [rad/s], acceleration [rad/s²]
    dq: Float[Array, "T n"]
    ddq: Float[Array, "T n"]
    longer: float  # time by which it takes longer than the plan [s]

    @property
    def duration(self) -> float:
        """Whole duration [s]."""
        return float(self.times[-1])

    def save(self, path: Path) -> None:
        """Writes the motion in the format of the path's suffix, whole or not at all."""
        if path.suffix == ".csv":
            require_plain_header(self.joints, path)
        with atomic_write(path) as part:
            if path.suffix == ".parquet":
                pq.write_table(self.table(), part)
            elif path.suffix == ".csv":
                pacsv.write_csv(self.table(), part)
            else:
                part.write_text(self.yaml(), encoding="utf-8")
        if path.suffix == ".csv":
            mark_file(path)

    def table(self) -> pa.Table:
        """Commands in the native columns."""
        columns: dict[str, Array] = {"time": self.times}
        for j, name in enumerate(self.joints):
            columns[f"{name}/position_command"] = self.q[:, j]
            columns[f"{name}/velocity_command"] = self.dq[:, j]
            columns[f"{name}/acceleration_command"] = self.ddq[:, j]
        return pa.table(columns).replace_schema_metadata(WRITER)

    def yaml(self) -> str:
        """The message `trajectory_msgs/JointTrajectory` of ROS 2."""
        lines = [
            "# written by armgap",
            "header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}",
            f"joint_names: {json.dumps(list(self.joints))}",
        ]
        lines.append("points:")
        for k, time in enumerate(self.times):
            second, nano = divmod(round(float(time) * 1e9), 1_000_000_000)
            lines.append(f"- positions: {_row(self.q[k])}")
            lines.append(f"  velocities: {_row(self.dq[k])}")
            lines.append(f"  accelerations: {_row(self.ddq[k])}")
            lines.append("  effort: []")
            lines.append(f"  time_from_start: {{sec: {second}, nanosec: {nano}}}")
        return "\n".join(lines) + "\n"


def _row(values: Float[Array, " n"]) -> str:
    """Numbers that readers of YAML 1.1 take for numbers, too: to them -8e-09 is a text."""
    return f"[{', '.join(np.format_float_positional(round(float(value), 9) + 0.0, trim='0') for value in values)}]"


def require_writable(path: Path, rate: float) -> None:
    """Raises InputError for a format or a rate that no motion can be written in."""
    if path.suffix not in SUFFIXES:
        raise InputError("--out", f"{path.name!r} is no motion's name", f"end it in one of: {', '.join(SUFFIXES)}")
    if not RATES[0] <= rate <= RATES[1]:
        raise InputError("--rate", f"{rate:g} Hz", f"give {RATES[0]:g} to {RATES[1]:g} Hz")


def execute(result: PlanResult, rate: float = DEFAULT_RATE) -> Execution:
    """The motion of a solved plan at a rate [Hz]; the last sample lies at the end, however short its step."""
    assert result.splines is not None
    law = result.execution
    total = law.duration
    times = np.append(np.arange(0.0, total - 0.5 / rate, 1.0 / rate), total) if total > 0.0 else np.zeros(1)
    q, dq, ddq = law.states(result.splines, times)
    held = np.repeat(np.array(list(result.held.values()))[None], len(times), axis=0).reshape(len(times), -1)
    still = np.zeros_like(held)
    q, dq, ddq = (np.concatenate(pair, axis=1) for pair in ((q, held), (dq, still), (ddq, still)))
    return Execution((*result.joints, *result.held), times, q, dq, ddq, total - float(result.splines.total[0]))
