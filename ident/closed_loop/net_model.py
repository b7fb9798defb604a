"""A residual net alone: the URDF's rigid arm, and a net for all the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from ident.model.residual_net import PRESETS, ResidualNet, fit_residual_net
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel


@dataclass(frozen=True, eq=False)
class NetModel:
    """Rigid arm and net; it takes the log for the torque.

    Attributes:
        arm: The arm as its URDF describes it, with what it is known to carry.
        net: Trained on what the rigid arm leaves.
    """

    arm: ArmModel
    net: ResidualNet

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        rigid = self.arm.inverse_dynamics(q, dq, ddq)
        return np.asarray(rigid + self.net.predict(q, dq, ddq, rigid))

    def read_log(self, torque: Array, interval: float) -> Float[Array, "T n"]:
        return torque


def train_net(arm: ArmModel, motions: Sequence[Motion], seed: int) -> NetModel:
    """Trains the net on runs of one set-up."""
    arm = arm.with_payload(motions[0].payload)
    rigid = [arm.inverse_dynamics(run.q, run.dq, run.ddq) for run in motions]
    states = [
        (run.q[run.coarse], run.dq[run.coarse], run.ddq[run.coarse], torque[run.coarse])
        for run, torque in zip(motions, rigid, strict=True)
    ]
    left = [run.tau_filtered - run.filtered(torque) for run, torque in zip(motions, rigid, strict=True)]
    interval = motions[0].interval * motions[0].lowpass.factor
    options = replace(PRESETS["default"], seed=seed)
    return NetModel(arm, fit_residual_net(states, left, [run.moving for run in motions], options, interval=interval))
