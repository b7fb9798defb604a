"""What a model that a simulator holds can be asked, whatever the simulator."""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import ModuleType
from typing import Protocol

import numpy as np

from ident.arrays import Array, Float

# What a motion is off by that grows without bound [rad].
LOST = 2.0 * np.pi


class SimulatorModel(Protocol):
    """What a controller is designed with, and what a log is compared with."""

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        """Torque that the motors deliver along a run [N m].

        Args:
            q: Joint positions (T, n) [rad].
            dq: Speeds (T, n) [rad/s].
            ddq: Accelerations (T, n) [rad/s²].
            interval: Time from row to row [s].
        """

    def read_log(self, torque: Float[Array, "T n"], interval: float) -> Float[Array, "T n"]:
        """What the log says of a joint torque [N m].

        Args:
            torque: What `joint_torque` gave.
            interval: Time from row to row [s].
        """


class LoadedModel(SimulatorModel, ABC):
    """A patched file in its simulator; its log is read as far as the file says."""

    form: str
    module: ModuleType | None = None
    """A written module that stands in for what the file lacks: of a URDF also what the log reads.
    """

    @abstractmethod
    def own_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        """`joint_torque` of the file alone."""

    @abstractmethod
    def roll_out(
        self,
        states: Float[Array, "2 w n"],
        twists: Float[Array, "w 2 s"],
        drive: Float[Array, "w T n"],
        extra: Float[Array, "w T n"],
        interval: float,
    ) -> Float[Array, "2 w n"]:
        """States after w stretches of time under what a log says of the torque.

        Args:
            states: Positions and velocities at their starts [rad, rad/s].
            twists: What the springs' deflections and their rates are there (`deflections`).
            drive: Logged torque, already earlier by the log's delay [N m].
            extra: Joint torque added to it [N m].
            interval: Sampling interval of both [s].
        """

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        torque = self.own_torque(q, dq, ddq, interval)
        if self.module is None:
            return torque
        return torque + self.missing(q, dq, ddq, interval)

    def deflections(
        self, q: Array, dq: Array, ddq: Array, interval: float
    ) -> Float[Array, "T 3 s"]:
        """Deflection, rate and acceleration of the model's s springs along a motion.

        No log tells of them [rad, rad/s, rad/s²].
        """
        return np.zeros((len(q), 3, 0))

    def missing(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        """Joint torque along a run that is added to the file's own [N m]."""
        if self.module is None:
            return np.zeros_like(q)
        return np.asarray(self.module.missing_torque(self.form, q, dq, ddq, interval), dtype=float)

    def undo_log(self, log: Array, interval: float) -> Float[Array, "T n"]:
        """What `roll_out` takes for a log: earlier by its lateness as the file says it [N m]."""
        return log


def at_steps(values: Float[Array, "w T n"], interval: float, step: float) -> Float[Array, "S w n"]:
    """Values in the middle of a simulator's steps, between samples on straight lines.

    Args:
        values: Signals of w stretches.
        interval: Time between their samples [s].
        step: Time between the simulator's steps [s].
    """
    last = (values.shape[1] - 1) * interval
    middles = np.arange(0.0, last - 0.5 * step, step) + 0.5 * step
    samples = middles / interval
    before = np.minimum(samples.astype(int), values.shape[1] - 2)
    share = (samples - before)[:, None, None]
    rows = np.moveaxis(values, 1, 0)
    after = share * rows[before + 1]
    return np.asarray((1.0 - share) * rows[before] + after)
