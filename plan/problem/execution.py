"""A plan as a controller takes it: points at its step, or sampled at a rate, from rest to rest.

A clamped cubic spline starts with an acceleration, which no drive can have at once. So the plan is
begun and ended a little slower, on the same path: position, velocity and acceleration start at
rest, and the jerk is bounded everywhere. Where torque, speed or acceleration would pass a limit on
the way, the whole motion is slowed down until none does; the certificate looks at the motion as it
is executed.
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
from plan.problem.controllers import SAMPLED, Controller, load_controllers
from plan.problem.result import PlanResult

DEFAULT_RATE = 250.0
RATES = (10.0, 10_000.0)
# Formats that have no room for a mark of ours, or whose readers may know no comments.
UNMARKED = (".csv", ".tmscript")


@dataclass(frozen=True, eq=False)
class Execution:
    """A motion in points."""

    joints: tuple[str, ...]  # names of the joints, those that move first, then those that are held
    times: Float[Array, " T"]  # from 0 to the end [s]
    q: Float[Array, "T n"]  # position [rad], velocity [rad/s], acceleration [rad/s²]
    dq: Float[Array, "T n"]
    ddq: Float[Array, "T n"]
    longer: float  # time by which it takes longer than the plan [s]
    controller: Controller | None = None  # whose points these are; None of samples

    @property
    def duration(self) -> float:
        """Whole duration [s]."""
        return float(self.times[-1])

    def save(self, path: Path) -> None:
        """Writes the motion in the format of the path's suffix, whole or not at all."""
        if path.suffix == ".csv":
            require_plain_header(self.joints, path)
        with atomic_write(path) as temporary:
            if path.suffix == ".parquet":
                pq.write_table(self.table(), temporary)
            elif path.suffix == ".csv":
                pacsv.write_csv(self.table(), temporary)
            elif path.suffix == ".tmscript":
                temporary.write_text(self.tmscript(), encoding="utf-8")
            elif path.suffix == ".script":
                temporary.write_text(self.urscript(), encoding="utf-8")
            else:
                temporary.write_text(self.yaml(), encoding="utf-8")
        if path.suffix in UNMARKED:
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
        """The message `trajectory_msgs/JointTrajectory` of ROS 2.

        Accelerations stay empty, so that cubics are made.
        """
        lines = [
            "# written by armgap",
            *self._says(),
            "header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}",
            f"joint_names: {json.dumps(list(self.joints))}",
        ]
        lines.append("points:")
        for k, time in enumerate(self.times):
            second, nano = divmod(round(float(time) * 1e9), 1_000_000_000)
            lines.append(f"- positions: {_row(self.q[k])}")
            lines.append(f"  velocities: {_row(self.dq[k])}")
            lines.append("  accelerations: []")
            lines.append("  effort: []")
            lines.append(f"  time_from_start: {{sec: {second}, nanosec: {nano}}}")
        return "\n".join(lines) + "\n"

    def tmscript(self) -> str:
        """Techman's PVT commands.

        Angles [deg], speeds [deg/s] and duration [s] of each section; it starts at rest.
        """
        assert self.controller is not None
        digits = self.controller.digits
        lines = ["PVTEnter(0)"]
        for k in range(1, len(self.times)):
            numbers = [
                *np.degrees(self.q[k]),
                *np.degrees(self.dq[k]),
                self.times[k] - self.times[k - 1],
            ]
            lines.append(f"PVTPoint({','.join(_fixed(value, digits) for value in numbers)})")
        return "\n".join([*lines, "PVTExit()"]) + "\n"

    def urscript(self) -> str:
        """A URScript program of `servoj`, a call a tick."""
        controller = self.controller
        assert controller is not None
        lines = ["# written by armgap", *self._says(), "def armgap_motion():"]
        tick = f"t={controller.tick_s:g}"
        rest = f"{tick}, lookahead_time={controller.lookahead_s:g}, gain={controller.gain}"
        for q in self.q:
            angles = ", ".join(_fixed(value, controller.digits) for value in q)
            lines.append(f"  servoj([{angles}], {rest})")
        return "\n".join([*lines, "  stopj(4.0)", "end", "armgap_motion()"]) + "\n"

    def _says(self) -> list[str]:
        """For whom it is, and where it begins, as a comment."""
        if self.controller is None:
            return []
        start = ", ".join(_fixed(value, 4) for value in self.q[0])
        return [f"# for {self.controller.name}; the arm stands at [{start}] before it starts"]


def _row(values: Float[Array, " n"]) -> str:
    """Numbers that readers of YAML 1.1 take for numbers, too: to them -8e-09 is a text."""
    rounded = [round(float(value), 9) + 0.0 for value in values]
    numbers = [np.format_float_positional(value, trim="0") for value in rounded]
    return f"[{', '.join(numbers)}]"


def _fixed(value: float, digits: int) -> str:
    """A number with so many decimals, without a minus before nought."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"


def require_writable(path: Path, rate: float) -> None:
    """Raises InputError for a format or a rate that no motion can be written in.

    Args:
        path: The file that is to be written. Its suffix is `.csv`, `.parquet`, or that of a
            controller: `.yaml`, `.yml`, or one of `controllers.toml`.
        rate: Samples a second [Hz], within `RATES`; looked at for every format.
    """
    suffixes = [*SAMPLED, ".yml", *(controller.suffix for controller in load_controllers())]
    if path.suffix not in suffixes:
        ends = ", ".join(sorted(set(suffixes)))
        raise InputError("--out", f"{path.name!r} is no motion's name", f"end it in one of: {ends}")
    if not RATES[0] <= rate <= RATES[1]:
        raise InputError("--rate", f"{rate:g} Hz", f"give {RATES[0]:g} to {RATES[1]:g} Hz")


def execute(result: PlanResult, rate: float = DEFAULT_RATE) -> Execution:
    """The motion of a solved plan at a rate [Hz].

    The last sample lies at the end, however short its step.
    """
    assert result.splines is not None
    law = result.execution
    curve = result.splines
    if result.certificate is not None and not result.stands:
        curve = result.certificate.curve
    total = law.duration
    times = (
        np.append(np.arange(0.0, total - 0.5 / rate, 1.0 / rate), total)
        if total > 0.0
        else np.zeros(1)
    )
    q, dq, ddq = law.states(curve, times)
    return _with_held(result, times, (q, dq, ddq), total - float(result.splines.total[0]), None)


def points_of(result: PlanResult) -> Execution:
    """The points of a solved plan that its controller is sent."""
    assert result.splines is not None
    assert result.certificate is not None
    controller = result.certificate.controller
    assert controller is not None
    if result.stands:
        q = result.splines.points[0, :1]
        return _with_held(result, np.zeros(1), (q, 0.0 * q, 0.0 * q), 0.0, controller)
    times, q, dq = controller.sent(result.splines)
    ddq = result.splines.at(np.minimum(times, float(result.splines.total[0])))[2]
    return _with_held(result, times, (q, dq, ddq), 0.0, controller)


def write_motion_file(result: PlanResult, path: Path, rate: float = DEFAULT_RATE) -> Execution:
    """Writes a solved plan and returns what was written.

    Args:
        result: A plan that was solved.
        path: Its suffix says the format. One of a table (`SAMPLED`), or a plan without a
            controller: samples. Else the controller's own points.
        rate: Samples a second [Hz]; of no meaning to a controller's points.
    """
    certificate = result.certificate
    sampled = path.suffix in SAMPLED or certificate is None or certificate.controller is None
    motion = execute(result, rate) if sampled else points_of(result)
    motion.save(path)
    return motion


def _with_held(
    result: PlanResult,
    times: Float[Array, " T"],
    states: tuple[Array, Array, Array],
    longer: float,
    controller: Controller | None,
) -> Execution:
    """Points of all joints, those that are held among them."""
    held = np.repeat(np.array(list(result.held.values()))[None], len(times), axis=0).reshape(
        len(times), -1
    )
    still = np.zeros_like(held)
    q, dq, ddq = (
        np.concatenate(pair, axis=1) for pair in zip(states, (held, still, still), strict=True)
    )
    return Execution((*result.joints, *result.held), times, q, dq, ddq, longer, controller)
