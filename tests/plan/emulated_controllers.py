"""What controllers make of the files that they are sent, written anew from their own sources.

Shares no code with `plan`. Each reads a file and gives the motion at a fine rate: times, positions, velocities and
accelerations of all joints.

Sources: Techman, tmr_ros2 (tm_command.cpp, tm_ros2_movit_sct.cpp); ros-controls, ros2_controllers (trajectory.cpp);
Universal Robots, Universal_Robots_Client_Library (external_control.urscript) and the article on servoj.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

# Samples of each section, or of each tick.
FINE = 12
# UR's script: largest speed [rad/s], and how hard it lets the last section brake [rad/s²].
FASTEST, BRAKES = 6.283185, 15.0


@dataclass(frozen=True, eq=False)
class Moved:
    """A motion as it is executed."""

    times: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray


@dataclass(frozen=True, eq=False)
class Points:
    """What a file holds: times, positions, velocities and, if it has them, accelerations."""

    times: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray | None = None


def read_tmscript(path: Path, start: np.ndarray) -> Points:
    """PVT commands in degrees; the arm stands still at the start."""
    lines = path.read_text().split("\n")
    assert lines[0] == "PVTEnter(0)"
    assert lines[-2:] == ["PVTExit()", ""]
    rows = []
    for line in lines[1:-2]:
        found = re.fullmatch(r"PVTPoint\((.*)\)", line)
        assert found is not None, line
        rows.append([float(number) for number in found.group(1).split(",")])
    table = np.array(rows)
    assert table.shape[1] == 13
    times = np.concatenate([[0.0], np.cumsum(table[:, 12])])
    q = np.concatenate([start[None], np.radians(table[:, :6])])
    dq = np.concatenate([np.zeros((1, 6)), np.radians(table[:, 6:12])])
    return Points(times, q, dq)


def read_trajectory(path: Path) -> Points:
    """A JointTrajectory, its numbers as they stand there."""
    text = path.read_text()
    parts = {name: [] for name in ("positions", "velocities", "accelerations")}
    for name, rows in parts.items():
        for found in re.findall(rf"{name}: (\[[^\]]*\])", text):
            rows.append(json.loads(found))
    stamps = re.findall(r"time_from_start: \{sec: (\d+), nanosec: (\d+)\}", text)
    times = np.array([int(second) + 1e-9 * int(nano) for second, nano in stamps])
    ddq = None if not parts["accelerations"][0] else np.array(parts["accelerations"])
    return Points(times, np.array(parts["positions"]), np.array(parts["velocities"]), ddq)


def read_urscript(path: Path) -> tuple[np.ndarray, float]:
    """Targets of servoj, and its period."""
    calls = re.findall(r"servoj\((\[[^\]]*\]), t=([0-9.e-]+),", path.read_text())
    periods = {float(period) for _, period in calls}
    assert len(periods) == 1
    # A script's numbers are floats of 24 bits, and nobody says that the targets are held in more.
    targets = np.array([json.loads(row) for row, _ in calls], dtype=np.float32)
    return targets.astype(float), periods.pop()


def through_tm_driver(points: Points) -> Points:
    """Points that Techman's driver keeps, and their numbers as it prints them for the arm."""
    least, last, before = 0.025, 0, 0
    kept = []
    for k in range(1, len(points.times) - 1):
        if points.times[k] - points.times[last] >= least:
            before, last = last, k
            kept.append((k, points.times[k] - points.times[before]))
    end = len(points.times) - 1
    if points.times[end] - points.times[last] >= least:
        kept.append((end, points.times[end] - points.times[last]))
    else:
        kept[-1] = (end, points.times[end] - points.times[before])
    numbers = np.array([k for k, _ in kept])
    lengths = np.round([length for _, length in kept], 5)
    times = np.concatenate([[0.0], np.cumsum(lengths)])
    q = np.radians(np.round(np.degrees(points.q[numbers]), 5))
    dq = np.radians(np.round(np.degrees(points.dq[numbers]), 5))
    return Points(times, np.concatenate([points.q[:1], q]), np.concatenate([0.0 * dq[:1], dq]))


def by_polynomials(points: Points) -> Moved:
    """Each section by the polynomial that its ends leave: a cubic; with accelerations a quintic."""
    share = np.linspace(0.0, 1.0, FINE + 1)
    out = []
    for k in range(len(points.times) - 1):
        length = points.times[k + 1] - points.times[k]
        conditions = [points.q[k], points.dq[k], points.q[k + 1], points.dq[k + 1]]
        rows = [(0.0, 0), (0.0, 1), (length, 0), (length, 1)]
        if points.ddq is not None:
            conditions += [points.ddq[k], points.ddq[k + 1]]
            rows += [(0.0, 2), (length, 2)]
        degree = len(rows)
        matrix = np.array([_derivative(at, order, degree) for at, order in rows])
        coefficients = np.linalg.solve(matrix, np.array(conditions))
        local = share * length
        states = [np.array([_derivative(t, order, degree) for t in local]) @ coefficients for order in range(3)]
        out.append((points.times[k] + local, *states))
    return Moved(*(np.concatenate(part) for part in zip(*out, strict=True)))


def _derivative(t: float, order: int, degree: int) -> np.ndarray:
    """What each power of time gives, derived so many times."""
    row = np.zeros(degree)
    for power in range(order, degree):
        factor = 1.0
        for k in range(order):
            factor *= power - k
        row[power] = factor * t ** (power - order)
    return row


def by_speedj(points: Points, tick: float) -> Moved:
    """Each section's cubic from where the arm is, as velocities at the ticks; between ticks velocity is linear.

    The script slows the last section down where it would end too fast.
    """
    place, speed, now, out = points.q[0].copy(), np.zeros(points.q.shape[1]), 0.0, []
    last = len(points.times) - 1
    for k in range(1, last + 1):
        length = points.times[k] - points.times[k - 1]
        goal, end = points.q[k], points.dq[k]
        first, begin = speed.copy(), place.copy()
        second = (-3.0 * begin + 3.0 * goal - 2.0 * first * length - end * length) / length**2
        third = (2.0 * begin - 2.0 * goal + first * length + end * length) / length**3

        def cubic(t: float, parts: tuple = (first, second, third)) -> np.ndarray:  # type: ignore[type-arg]
            return parts[0] + 2.0 * t * parts[1] + 3.0 * t**2 * parts[2]

        travelled, scale, slowing = 0.0, 1.0, 0.0
        while length - travelled > tick * 1.0001:
            left = length - travelled
            if k == last and slowing == 0.0 and left <= FASTEST / BRAKES:
                ahead = np.abs(cubic(travelled + tick)).max()
                slowing = left + tick if ahead > BRAKES * (left - tick) else 0.0
            scale = left / slowing if slowing else 1.0
            travelled += tick * scale
            now, place, speed = _ramp(out, now, place, speed, cubic(travelled) * scale, tick)
        while slowing and length - travelled >= 1e-5:
            scale = (length - travelled) / slowing
            travelled += tick * scale
            now, place, speed = _ramp(out, now, place, speed, cubic(travelled) * scale, tick)
        scale = 0.0 if slowing else 1.0
        now, place, speed = _ramp(out, now, place, speed, cubic(length) * scale, length - travelled)
    return Moved(*(np.concatenate(part) for part in zip(*out, strict=True)))


def _ramp(out: list, now: float, place: np.ndarray, speed: np.ndarray, wanted: np.ndarray, tick: float) -> tuple:  # type: ignore[type-arg]
    """Velocity from one value to the next along one tick."""
    t = np.linspace(0.0, tick, FINE + 1)[:, None]
    push = (wanted - speed) / tick
    q = place + speed * t + 0.5 * push * t**2
    out.append((now + t[:, 0], q, speed + push * t, np.repeat(push[None], len(t), axis=0)))
    return now + tick, q[-1], wanted


def by_servoj(targets: np.ndarray, tick: float) -> Moved:
    """Targets joined by lines and averaged over one tick, sampled; the rest of its filter is not published."""
    fine = 40
    at = np.arange(len(targets)) * tick
    t = np.arange(-fine, fine * len(targets) + 1) * (tick / fine)
    lines = np.stack([np.interp(t, at, column) for column in targets.T], axis=1)
    # The average by the integral of the lines, which are linear between samples.
    steps = 0.5 * (lines[1:] + lines[:-1]) * (tick / fine)
    whole = np.concatenate([np.zeros((1, targets.shape[1])), np.cumsum(steps, axis=0)])
    half = fine // 2
    q = (whole[fine:] - whole[:-fine]) / tick
    middle = slice(half, -half)
    dq = (lines[fine:] - lines[:-fine]) / tick
    # Acceleration is steady between the middles of two lines: its value there by the change of velocity.
    ddq = np.gradient(dq, tick / fine, axis=0)
    return Moved(t[middle], q, dq, ddq)


def moved(name: str, tick_s: float, path: Path, start: np.ndarray) -> Moved:
    """A written file as the controller of that name executes it, one of ticks a point each such time [s]."""
    if name == "tmscript":
        return by_polynomials(read_tmscript(path, start))
    if path.suffix == ".script":
        return by_servoj(*read_urscript(path))
    points = read_trajectory(path)
    if name == "tm_ros2":
        return by_polynomials(through_tm_driver(points))
    return by_speedj(points, tick_s) if name == "ur_spline" else by_polynomials(points)
