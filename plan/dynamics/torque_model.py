"""From a fitted model to what the planner evaluates: the joints that the task moves, the others held still."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.errors import ModelError
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.robot.arm import ArmModel
from plan.dynamics.compiled_nets import read_residual
from plan.dynamics.power import ChainTorque


def reduce_arm(arm: ArmModel, moving: int, held: Sequence[float]) -> ArmModel:
    """The arm with its last joints locked at given positions [rad]: the exact reduction."""
    if moving == arm.n:
        return arm
    return arm.locked(arm.joint_names[moving:], held)


def torque_of_robot(arm: ArmModel) -> ChainTorque:
    """Torque of a rigid arm without losses: what can be planned with before anything was fitted."""
    return ChainTorque(arm.chain, LossParameters.zero(arm.n))


def torque_of_model(model: HybridModel, moving: int, held: Sequence[float]) -> ChainTorque:
    """Torque of a fitted model for the first joints, the others held.

    Args:
        model: The fitted model, of as many joints as move or more.
        moving: Number of joints that move.
        held: Positions of the robot's other joints [rad].
    """
    if model.coupling is not None:
        what = "the model has two joints on one shaft, which plans don't know"
        raise ModelError(f"model of {model.robot.name}", what, "fit it without --coupling")
    fixed = np.asarray(held, dtype=float)[: len(model.joint_names) - moving]
    arm = reduce_arm(model.arm, moving, list(fixed))
    net = None
    if model.net is not None:
        net = read_residual(model.net)
        net = net if len(fixed) == 0 else net.frozen(fixed)
    named = tuple(law for law in model.named if law.joint < moving)  # of joints that stand still there is no friction
    loss = model.loss
    parts = loss.motor_inertia, loss.viscous, loss.coulomb, loss.offset, loss.transition_speed
    return ChainTorque(arm.chain, LossParameters(*(part[:moving] for part in parts)), net, named)
