"""What happened in the plant → what the recording says of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import lfilter

from ident.arrays import Array, Float
from ident.recordings.recording import Recording
from ident.simulation.hardware import Hardware
from ident.simulation.sensing import read_encoder, read_temperature, read_torque, sample
from ident.simulation.simulator import Simulator, Trace
from ident.trajectories.reference import TICK_S, ReferenceMotion

Progress = Callable[[], None]
# A log's resolution: far below the sensors' own, so that files stay small.
_DECIMALS = {
    "position": 7,
    "effort": 4,
    "velocity": 6,
    "position_command": 7,
    "velocity_command": 6,
    "temperature": 1,
}


def no_progress() -> None:
    """Shows nothing."""


@dataclass(frozen=True)
class Channels:
    """What is logged."""

    rate: float = 250.0  # log rate [Hz]
    velocity: bool = True  # whether the drives' velocities are logged
    commands: bool = True  # whether commanded positions and velocities are
    temperature: bool = False  # whether housing temperatures are
    # `differenced` readings of the position, the `true` one, the controller's estimate `filtered`
    # again, or as it is.
    velocity_kind: str = "estimate"
    velocity_delay: float = 0.0  # how late the filter is [s]
    # largest deviation of a sample's instant from the even grid, as a share of the interval
    jitter: float = 0.0
    lost: float = 0.0  # share of samples that are missing


def draw_pauses(runs: int, bounds: tuple[float, float], rng: np.random.Generator) -> list[float]:
    """Standstill before each run [s]; none before the first."""
    return [0.0, *map(float, rng.uniform(*bounds, runs - 1))]


def record_runs(
    hardware: Hardware,
    motions: Sequence[ReferenceMotion],
    channels: Channels,
    rng: np.random.Generator,
    pauses: Sequence[float],
    progress: Progress = no_progress,
    feeds: Sequence[Float[Array, "K n"]] | None = None,
) -> tuple[list[Recording], list[Trace]]:
    """Runs motions on an arm and records them.

    Args:
        hardware: The hidden arm.
        motions: What it is asked to do.
        channels: What is logged, how often.
        rng: Source of chance: plant and sensors have streams of their own, so that one does not
            shift the other.
        pauses: Standstill before each run [s].
        progress: Called after each run.
        feeds: Feed-forward torque of each motion [N m], if it is known already.

    Returns:
        The runs as recorded, and as they truly were.
    """
    plant_rng, sensor_rng = rng.spawn(2)
    simulator = Simulator(hardware, plant_rng)
    traces = simulator.run(motions, pauses, progress, feeds)
    width = max(len(str(len(motions))), 2)
    names = [f"{i:0{width}d}_{motion.name}" for i, motion in enumerate(motions, start=1)]
    runs = [
        record_one(hardware, run, name, channels, sensor_rng)
        for run, name in zip(traces, names, strict=True)
    ]
    return runs, traces


def record_one(
    hardware: Hardware, trace: Trace, name: str, channels: Channels, rng: np.random.Generator
) -> Recording:
    """One run as the log shows it."""
    ticks = trace.times
    sensing = hardware.sensing
    log = trace.log
    end = float(ticks[-1])
    last = int(np.floor(end * channels.rate + 1e-9))
    times = np.arange(last + 1) / channels.rate
    if channels.jitter > 0.0:
        away = channels.jitter / channels.rate * rng.uniform(-1.0, 1.0, len(times))
        times = np.clip(times + away, 0.0, end)
    if channels.lost > 0.0:
        received = rng.random(len(times)) >= channels.lost
        received[[0, -1]] = True  # the first and the last sample are never missing
        times = times[received]
    angle = log.link_angle if sensing.link_side else log.angle
    position = read_encoder(sensing, ticks, angle, times, rng)
    effort = read_torque(sensing, ticks, log.torque, log.speed, times, trace.start, rng)
    logged: dict[str, Array] = {"position": position, "effort": effort}
    if channels.velocity and channels.velocity_kind == "differenced":
        steps = np.diff(position, axis=0) / np.diff(times)[:, None]
        logged["velocity"] = np.concatenate([steps[:1], steps])
    elif channels.velocity:
        speed = log.speed if channels.velocity_kind == "true" else log.speed_estimate
        if channels.velocity_kind == "filtered":
            keep = np.exp(-TICK_S / channels.velocity_delay)
            speed, _ = lfilter([1.0 - keep], [1.0, -keep], speed, axis=0, zi=keep * speed[:1])
        logged["velocity"] = sample(ticks, speed, times)
    if channels.commands:
        logged["position_command"] = sample(ticks, trace.motion.q, times)
        logged["velocity_command"] = sample(ticks, trace.motion.dq, times)
    if channels.temperature:
        logged["temperature"] = read_temperature(ticks, log.temperature, times, rng)
    rounded: dict[str, Any] = {
        key: np.round(values, _DECIMALS[key]) for key, values in logged.items()
    }
    return Recording(name, hardware.arm.joint_names, np.round(trace.start + times, 6), **rounded)
