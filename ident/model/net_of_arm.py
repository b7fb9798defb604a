"""The residual net of an arm: what rigid body, losses and named laws leave of the runs' torque."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ident.arrays import Array, Float
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel

if TYPE_CHECKING:  # safetensors and, for the paper's net, torch are slow to load
    from ident.model.residual_net import ResidualNet

# Torque of a run beside the rigid arm's: the motion, its rigid torque → [N m].
Known = Callable[[Motion, Float[Array, "T n"]], Float[Array, "T n"]]


def fit_net_of_arm(
    motions: Sequence[Motion],
    arm: ArmModel,
    known: Known,
    preset: str,
    seed: int,
    progress: Callable[[int, int, float], None] | None,
    checkpoint: Path | None,
) -> ResidualNet:
    """Fits the net.

    Args:
        motions: Training runs.
        arm: The identified rigid arm.
        known: What is known of the torque beside it.
        preset: `default` or `paper`.
        seed: Of the net.
        progress: Called after each joint, or epoch.
        checkpoint: Folder in which training may stop and go on.
    """
    from ident.model.residual_net import PRESETS, fit_residual_net

    states, left = [], []
    for m in motions:
        rigid = arm.with_payload(m.payload).inverse_dynamics(m.q, m.dq, m.ddq)
        states.append((m.q[m.coarse], m.dq[m.coarse], m.ddq[m.coarse], rigid[m.coarse]))
        left.append(m.tau_filtered - m.filtered(rigid + known(m, rigid)))
    moving = None if preset == "paper" else [m.moving for m in motions]
    interval = motions[0].interval * motions[0].lowpass.factor
    options = replace(PRESETS[preset], seed=seed)
    return fit_residual_net(states, left, moving, options, progress, checkpoint, interval)
