"""A written URDF in Pinocchio."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.export.loaded_model import LOST, LoadedModel, at_steps
from ident.laws.motion import Losses
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel

# Step of the rollouts: dry friction near rest is stiff [s].
ROLLOUT_STEP = 2.5e-4


class LoadedUrdf(LoadedModel):
    """A URDF in Pinocchio.

    Rotor inertia, and how friction turns round, stand in the parameter file instead.
    """

    form = "urdf"

    def __init__(self, arm: ArmModel, losses: Losses, payload: Payload | None) -> None:
        """An arm with losses, of which the rotor inertia stands in no URDF."""
        self.losses = losses
        self.arm = arm.with_payload(payload).with_rotors(losses.motor_inertia)

    @classmethod
    def read(
        cls,
        path: Path,
        locked: tuple[str, ...],
        losses: Losses,
        payload: Payload | None,
        tip: str = "",
    ) -> LoadedUrdf:
        """A file: damping and dry friction are what it says, whatever `losses` hold.

        Args:
            path, locked, losses, payload: The file, joints to lock, and what stands beside it.
            tip: Name of the arm's last joint where the file has several arms; else empty.
        """
        arm = ArmModel.from_whole_urdf(path.read_text(encoding="utf-8"), path, tip)
        arm = arm.locked([name for name in locked if name in arm.joint_names])
        stated = replace(losses, viscous=arm.model.damping, coulomb=arm.model.friction)
        return cls(arm, stated, payload)

    def own_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        if interval <= 0.0:
            slip = np.tanh(dq / self.losses.transition)
        else:
            slip = self.losses.direction(q, dq)
        return self.arm.inverse_dynamics(q, dq, ddq) + self._friction(dq, slip)

    def _friction(self, dq: Array, slip: Array) -> Array:
        """C dq + f s [N m]."""
        return np.asarray(self.losses.viscous * dq + self.losses.coulomb * slip)

    def read_log(self, torque: Array, interval: float) -> Float[Array, "T n"]:
        if self.module is None:
            return torque
        return np.asarray(self.module.log_of_torque(torque, interval), dtype=float)

    def undo_log(self, log: Array, interval: float) -> Float[Array, "T n"]:
        if self.module is None:
            return log
        return np.asarray(self.module.torque_of_log(log, interval), dtype=float)

    def roll_out(
        self, states: Array, twists: Array, drive: Array, extra: Array, interval: float
    ) -> Float[Array, "2 w n"]:
        """Euler's method, velocity first, friction by its slope ahead.

            (M + h D) a = M a₀,  D = C + f ∂s/∂dq

        with the acceleration a₀ of forward dynamics: else friction of a light link would swing up.
        M is that of the start: no more hangs on it than how steps end, not where they lead. What
        slides at the start has slid before.
        """
        q, dq = np.array(states)
        losses = self.losses
        slip = np.tanh(dq / losses.transition)
        has_range = losses.range > 0.0
        reach = np.where(has_range, losses.range, 1.0)
        steepest = np.where(has_range, ROLLOUT_STEP / reach, 1.0 / losses.transition)
        inertia = self.arm.derivatives(q, 0.0 * q, 0.0 * q)[2]
        unit = np.eye(q.shape[1])
        for torque in at_steps(drive + extra, interval, ROLLOUT_STEP):
            free = self.arm.forward_dynamics(q, dq, torque - self._friction(dq, slip))
            slope = steepest * (1.0 - slip**2)
            drag = (losses.viscous + losses.coulomb * slope)[:, :, None] * unit
            implicit = inertia + ROLLOUT_STEP * drag
            acceleration = np.linalg.solve(implicit, inertia @ free[:, :, None])[:, :, 0]
            dq = dq + ROLLOUT_STEP * acceleration
            q = q + ROLLOUT_STEP * dq
            stressed = np.clip(slip + ROLLOUT_STEP * dq / reach, -1.0, 1.0)
            slip = np.where(has_range, stressed, np.tanh(dq / losses.transition))
        stayed = (np.abs(q - states[0]) < LOST).all(axis=1, keepdims=True)
        lost = np.stack([states[0] + LOST, states[1]])
        return np.where(~stayed, lost, np.stack([q, dq]))
