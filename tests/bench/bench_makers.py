"""Time-optimal plans of five arms against their makers' limits, by differences of the written file.

Position, speed, acceleration and jerk are taken anew from the positions of the controller's file, at 1 kHz; the URDF's
own limits count beside the maker's (`plan/problem/makers_limits.toml`). The file is read as trajectory_msgs defines a
JointTrajectory: its keys, their lengths, ascending times, and joints that the arm has.

    python -m tests.bench.bench_makers [ARM ...]
"""

from __future__ import annotations

import re
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import plan
from ident.arrays import Array
from ident.robot.arm import ArmModel
from plan.problem.execution import execute

ENDS = {
    "panda": ([0, -45, 0, -135, 0, 90, 45], [60, 10, -20, -80, 20, 120, 0]),
    "ur10": ([0, -90, 60, -60, -90, 0], [70, -60, 90, -110, -60, 45]),
    "ur5": ([0, -90, 60, -60, -90, 0], [-80, -70, 100, -120, -100, 60]),
    "tm5-900": ([50, 0, -120, 0, 90, 0], [80, 30, -90, 20, 60, 40]),
    "xarm7": ([0, -20, 0, 40, 0, 60, 0], [50, 10, 20, 70, -20, 40, 60]),
}
RATE = 1000.0  # [Hz]
POINT = {"positions", "velocities", "accelerations", "effort", "time_from_start"}


def read_trajectory(path: Path) -> tuple[list[str], Array, dict[str, Array]]:
    """Joints, times [s] and the values of a JointTrajectory.

    Raises:
        ValueError: It is none.
    """
    message = next(yaml.safe_load_all(path.read_text(encoding="utf-8")))
    joints, points = message["joint_names"], message["points"]
    times = np.array([p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points])
    if set(message) - {"header"} != {"joint_names", "points"} or any(set(p) - POINT for p in points):
        raise ValueError(f"{path}: other keys than the message has")
    if np.any(np.diff(times) <= 0.0) or any(not 0 <= p["time_from_start"]["nanosec"] < 10**9 for p in points):
        raise ValueError(f"{path}: its times do not ascend")
    values = {key: np.array([p[key] for p in points]) for key in POINT - {"time_from_start"} if points[0].get(key)}
    if any(one.shape != (len(times), len(joints)) for one in values.values()):
        raise ValueError(f"{path}: not one value a joint")
    return joints, times, values


def makers_row(arm: ArmModel) -> dict[str, Any]:
    """What the table has of an arm's maker."""
    table = Path(plan.__file__).parent / "problem/makers_limits.toml"
    names = (arm.name.lower(), arm.source.stem.lower() if arm.source else "")
    rows = tomllib.loads(table.read_text(encoding="utf-8"))["arm"]
    return next((row for row in rows if any(re.fullmatch(row["name"], name) for name in names)), {})


def shares(name: str, folder: Path) -> tuple[dict[str, float], str]:
    """Largest share of each limit that a plan takes, and what was planned."""
    arm, (start, goal) = ArmModel.load(name), ENDS[name]
    arm = arm.keeping(arm.joint_names[: len(start)])
    scene, out = folder / f"{name}.toml", folder / f"{name}.yaml"
    scene.write_text(f'robot = "{name}"\n[task]\nstart_deg = {start}\ngoal_deg = {goal}\n', encoding="utf-8")
    result = plan.solve(scene, objective="time")
    if result.status != "solved":
        return {}, f"{result.status}: {result.reason}"
    execute(result, RATE).save(out)
    joints, times, values = read_trajectory(out)
    if joints != list(arm.joint_names):
        raise ValueError(f"{out}: joints {joints}, not {list(arm.joint_names)}")
    q, step, row = values["positions"], 1.0 / RATE, makers_row(arm)
    kept = times[-1] - times[-2] > 0.5 * step  # the end is a point of its own, however near the last
    q = q if kept else q[:-1]
    middle = 0.5 * (arm.upper + arm.lower)
    found = {"position": np.max(np.abs(q - middle) / (0.5 * (arm.upper - arm.lower)))}
    speed = np.minimum(arm.velocity_limit, row.get("speed_rad_s", np.inf))
    limits = {"speed": speed, "acceleration": row.get("acceleration_rad_s2"), "jerk": row.get("jerk_rad_s3")}
    for order, (key, limit) in enumerate(limits.items(), start=1):
        if limit is not None:
            found[key] = np.max(np.abs(np.diff(q, order, axis=0)) / step**order / np.array(limit))
    advice = "" if row.get("binding") else ", advice only"
    return {key: float(value) for key, value in found.items()}, f"{times[-1]:.2f} s{advice}"


def main(*names: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for name in names or ENDS:
            found, words = shares(name, Path(folder))
            print(f"{name}: {words}; {', '.join(f'{key} {value:.3f}' for key, value in found.items())}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
