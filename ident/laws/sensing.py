"""What the log tells of a torque: gain, offset, lateness, flat tops."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.laws.chain import Array

# An effect: its id, its joint's index (-1 for the whole arm), its figures.
Effect = tuple[str, int, dict[str, float]]
# What the log tells of a torque, against what turns the joint.
SENSING = ("torque_gain_error", "torque_offset", "torque_delay", "torque_saturation")


def read_log(effects: Sequence[Effect], torque: Array, interval: float) -> Array:
    """What the log reads of a torque: gain, offset, then lateness, then flat tops [N m].

    The offset is that of the middle of the diagnosed session; its drift is left out.
    """
    log = np.array(torque, dtype=float)
    for name, joint, figures in effects:
        if name == "torque_gain_error":
            log[:, joint] *= 1.0 + figures["gain"]
    for name, joint, figures in effects:
        if name == "torque_offset":
            log[:, joint] += figures["offset_Nm"]
    log = shifted(log, total_delay(effects), interval)
    for name, joint, figures in effects:
        if name == "torque_saturation":
            above = np.maximum(np.abs(log[:, joint]) - figures["knee_Nm"], 0.0)
            log[:, joint] -= figures["lost"] * np.sign(log[:, joint]) * above
    return log


def undo_log(effects: Sequence[Effect], log: Array, interval: float) -> Array:
    """The inverse: torque behind a log, but for what flat tops cut off [N m]."""
    torque = shifted(np.array(log, dtype=float), -total_delay(effects), interval)
    for name, joint, figures in effects:
        if name == "torque_offset":
            torque[:, joint] -= figures["offset_Nm"]
    for name, joint, figures in effects:
        if name == "torque_gain_error":
            torque[:, joint] /= 1.0 + figures["gain"]
    return torque


def total_delay(effects: Sequence[Effect]) -> float:
    """Lateness of the torque log [s]."""
    return sum(figures["delay_s"] for name, _, figures in effects if name == "torque_delay")


def shifted(values: Array, delay: float, interval: float) -> Array:
    """Signals late by a time, by the cubic through the four samples around each instant; ends are held."""
    if delay == 0.0:
        return values
    if interval <= 0.0:
        raise ValueError("a delay needs a whole run, evenly sampled, and its interval")
    whole = int(np.floor(delay / interval))
    u = delay / interval - whole
    weights = (
        -u * (1 - u) * (2 - u) / 6,  # of one sample later
        (1 + u) * (1 - u) * (2 - u) / 2,
        (1 + u) * u * (2 - u) / 2,
        -(1 + u) * u * (1 - u) / 6,
    )
    at = np.arange(len(values)) - whole
    total = np.zeros_like(values)
    for offset, weight in zip((1, 0, -1, -2), weights, strict=True):
        total += weight * values[np.clip(at + offset, 0, len(values) - 1)]
    return total
