"""A small laboratory: one arm without noise, on which an effect is switched on and off."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array
from ident.simulation.causes import Circumstances, find_cause
from ident.simulation.hardware import Hardware
from ident.simulation.sensing import read_encoder, read_torque
from ident.simulation.simulator import Simulator
from ident.trajectories.reference import ReferenceMotion, ramps, together

RATE_HZ = 250.0


@dataclass(frozen=True)
class Run:
    """One run as recorded without noise; arrays of shape (T, n)."""

    time: Array
    position: Array
    velocity: Array
    effort: Array


def record(hardware: Hardware, motions: Sequence[ReferenceMotion], pause: float = 1.0) -> list[Run]:
    """Recordings without noise; the same chance in every call."""
    silent = hardware.replace(sensing=hardware.sensing.silent())
    traces = Simulator(silent, np.random.default_rng(5)).run(motions, [pause] * len(motions), lambda: None)
    runs = []
    for trace in traces:
        times = np.arange(0.0, trace.times[-1], 1.0 / RATE_HZ)
        rng = np.random.default_rng(0)
        position = read_encoder(silent.sensing, trace.times, trace.log.angle, times, rng)
        read = read_torque(silent.sensing, trace.times, trace.log.torque, trace.log.speed, times, trace.start, rng)
        velocity = np.column_stack([np.interp(times, trace.times, column) for column in trace.log.speed.T])
        runs.append(Run(times, position, velocity, read))
    return runs


def with_effect(
    hardware: Hardware, motions: Sequence[ReferenceMotion], effect: str, joint: int, size: float
) -> Hardware:
    """The arm with one effect; its other parameters are drawn from a fixed seed."""
    cause = find_cause(effect)
    scene = Circumstances(hardware, joint, motions, np.random.default_rng(11))
    return cause.apply(scene, cause.checked(scene, size))[0]


def changes(
    hardware: Hardware, motions: Sequence[ReferenceMotion], effect: str, joint: int, size: float, pause: float = 1.0
) -> tuple[list[Array], list[Run]]:
    """Effort with the effect less effort without, run by run, and the runs without."""
    before = record(hardware, motions, pause)
    after = record(with_effect(hardware, motions, effect, joint, size), motions, pause)
    return [b.effort - a.effort for a, b in zip(before, after, strict=True)], before


def there_and_back(pose: Array, joint: int, span: float, speeds: Sequence[float], push: float = 4.0) -> ReferenceMotion:
    """One joint to and fro about a pose at given speeds, the others still."""
    moves = [(pose[joint] + side * span, speed) for speed in speeds for side in (1.0, -1.0)]
    paths = [np.full(1, value) for value in pose]
    paths[joint] = ramps(pose[joint] - span, moves, push, 0.2)
    return together("there_and_back", paths)
