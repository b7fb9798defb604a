"""Axes of the gap's map: for each sample of a joint its speed, load, position, time since a reversal, and so on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.gap.residuals import RunResidual

# The reach changes slowly: it is computed at this rate [1/s], at most for so many samples, and interpolated.
REACH_RATE, MOST_REACHES = 10.0, 20_000

Axis = Callable[[RunResidual, int], Float[Array, " t"]]


def session_axes(series: Sequence[RunResidual]) -> dict[str, Axis]:
    """The axes for which these recordings have data, by their names in the record."""
    duration = sum(item.time[-1] - item.time[0] for item in series)
    rate = min(REACH_RATE, MOST_REACHES / max(duration, 1.0))

    @cache  # expensive kinematics, shared by all joints
    def reached(item: RunResidual) -> Float[Array, " t"]:
        return reach(item, rate)

    axes: dict[str, Axis] = {
        "speed": lambda item, j: np.abs(item.speed[:, j]),
        "direction": lambda item, j: np.sign(item.speed[:, j]),
        "load": lambda item, j: np.abs(item.run.link[item.run.motion.coarse][:, j]),
        "position": lambda item, j: item.run.motion.q[item.run.motion.coarse][:, j],
        "pose": lambda item, _: reached(item),
        "reversal": reversal_age,
        "time": lambda item, _: item.time,
    }
    if all(item.run.temperature is not None for item in series):
        axes["temperature"] = lambda item, j: np.asarray(item.run.temperature)[item.run.motion.coarse][:, j]
    return axes


def reversal_age(item: RunResidual, joint: int) -> Float[Array, " t"]:
    """Time since the joint last changed its direction [s]."""
    speed = item.speed[:, joint]
    turns = np.concatenate([[0], np.flatnonzero(np.diff(np.sign(speed)) != 0) + 1])
    return item.time - item.time[turns[np.searchsorted(turns, np.arange(len(speed)), side="right") - 1]]


def reach(item: RunResidual, rate: float) -> Float[Array, " t"]:
    """Distance of the last link from the base [m]."""
    every = max(1, round(1.0 / (rate * item.step)))
    at = np.unique(np.append(np.arange(0, len(item.time), every), len(item.time) - 1))
    arm = item.run.arm
    _, places = arm.link_poses(item.run.motion.q[item.run.motion.coarse][at], arm.links[-1:])[arm.links[-1]]
    return np.interp(np.arange(len(item.time)), at, np.linalg.norm(places, axis=1))
