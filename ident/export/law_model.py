"""Models that a simulator could hold: torque of the joints along a motion, and what a log reads of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ident.arrays import Array, Float
from ident.export.identified import IdentifiedArm
from ident.export.python import describe_arm
from ident.laws.acting import Effect, acting_torque, read_log
from ident.laws.motion import Arm, Losses, MovingArm
from ident.motion.motion import Motion
from ident.recordings.recording import Payload


class SimulatorModel(Protocol):
    """What a controller is designed with, and what a log is compared with."""

    def joint_torque(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], interval: float
    ) -> Float[Array, "T n"]:
        """Torque that the motors deliver along a run [N m]."""
        ...

    def read_log(self, torque: Float[Array, "T n"], interval: float) -> Float[Array, "T n"]:
        """What the log says of it [N m]."""
        ...


@dataclass(frozen=True, eq=False)
class LawModel:
    """Rigid body, losses, and laws of identified effects: what a patch holds.

    Attributes:
        arm: The chain, its links tuned.
        losses: Rotor inertia and friction.
        effects: Named effects; those without a law in torque are left out.
        warmth: Of a run's joints, as `MovingArm` takes it; half warm where nobody has followed it.
    """

    arm: Arm
    losses: Losses
    effects: tuple[Effect, ...] = ()
    warmth: Any = 0.5

    @classmethod
    def of(cls, identified: IdentifiedArm, payload: Payload | None = None) -> LawModel:
        """All of an identified arm that has a law, with a known payload."""
        arm = describe_arm(identified.tuned.with_payload(payload))
        return cls(arm, identified.losses, tuple(identified.effects))

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        states = MovingArm(self.arm, self.losses, q, dq, ddq, interval, warmth=self.warmth)
        plain = states.rigid + self.losses.torque(dq, ddq, states.direction)
        return np.asarray(plain + acting_torque(self.effects, states))

    def read_log(self, torque: Array, interval: float) -> Float[Array, "T n"]:
        return read_log(self.effects, torque, interval)


def log_error(model: SimulatorModel, motion: Motion) -> Float[Array, "t n"]:
    """What a model leaves of a run's log through the run's own filter; zero where a joint doesn't slide [N m]."""
    torque = model.joint_torque(motion.q, motion.dq, motion.ddq, motion.interval)
    left = motion.tau_filtered - motion.filtered(model.read_log(torque, motion.interval))
    return np.where(motion.settled, left, 0.0)
