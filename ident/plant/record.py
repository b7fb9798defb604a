"""What happened in the plant → what the recording says of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.plant.hardware import Hardware
from ident.plant.sensing import read_encoder, read_temperature, read_torque, sample
from ident.plant.simulator import Simulator, Trace
from ident.plant.thermal import AMBIENT_DEGC
from ident.recordings.recording import Recording
from ident.trajectories.reference import Motion

Progress = Callable[[], None]


def no_progress() -> None:
    """Shows nothing."""


@dataclass(frozen=True)
class Channels:
    """What is logged.

    Attributes:
        rate: Log rate [Hz].
        velocity: Whether the drives' velocities are logged.
        commands: Whether commanded positions and velocities are.
        temperature: Whether housing temperatures are.
    """

    rate: float = 250.0
    velocity: bool = True
    commands: bool = True
    temperature: bool = False


def draw_pauses(runs: int, bounds: tuple[float, float], rng: np.random.Generator) -> list[float]:
    """Standstill before each run [s]; none before the first."""
    return [0.0, *map(float, rng.uniform(*bounds, runs - 1))]


def record_runs(
    hardware: Hardware,
    motions: Sequence[Motion],
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
        rng: Source of chance: plant and sensors have streams of their own, so that one does not shift the other.
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
    return [
        record_one(hardware, trace, f"{i:0{width}d}_{trace.motion.name}", channels, sensor_rng)
        for i, trace in enumerate(traces, start=1)
    ], traces


def record_one(hardware: Hardware, trace: Trace, name: str, channels: Channels, rng: np.random.Generator) -> Recording:
    """One run as the log shows it."""
    ticks, sensing, log = trace.times, hardware.sensing, trace.log
    times = np.arange(int(np.floor(ticks[-1] * channels.rate + 1e-9)) + 1) / channels.rate
    channels_of: dict[str, Array | None] = {
        "position": read_encoder(sensing, ticks, log.angle, times, rng),
        "effort": read_torque(sensing, ticks, log.torque, log.speed, times, trace.start, rng),
        "velocity": sample(ticks, log.speed_estimate, times) if channels.velocity else None,
        "position_command": sample(ticks, trace.motion.q, times) if channels.commands else None,
        "velocity_command": sample(ticks, trace.motion.dq, times) if channels.commands else None,
        "temperature": None,
    }
    if channels.temperature:
        channels_of["temperature"] = read_temperature(ticks, log.temperature, times, AMBIENT_DEGC, rng)
    rounded: dict[str, Any] = {
        key: np.round(values, _DECIMALS[key]) for key, values in channels_of.items() if values is not None
    }
    time = np.round(trace.start + times, 6)
    return Recording(name=name, joints=hardware.arm.joint_names, time=time, **rounded)


# A log's resolution: far below the sensors' own, so that files stay small.
_DECIMALS = {
    "position": 7,
    "effort": 4,
    "velocity": 6,
    "position_command": 7,
    "velocity_command": 6,
    "temperature": 1,
}
