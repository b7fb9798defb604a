"""Two joints whose motors turn each other, as in wrists: friction and inertia of each act on the other.

    τ_a += I q̈_b + V (q̇_b + m q̇_a) + C tanh((q̇_a + m q̇_b) / w),   and the same with a and b exchanged

m is 1 where a motor turns by the sum of both angles, −1 where by their difference. I, V and C of each joint are found
by least squares beside base parameters, losses and offsets of both; of the two m the one that leaves less.

Source: Gautier, Janot and Jubien 2013 (the coupled wrist of the TX series).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.model.carried import CarriedEffect, as_acting, carried_torque, moving_arm
from ident.model.inertia import PRIOR_SHARE, base_parameters, base_prior, parameter_scale
from ident.model.loss import LossParameters
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel

# Speed over which the sum of both speeds turns friction round [rad/s].
WIDTH = 0.02
# A joint's own columns: acceleration, speed, direction, one; and those of the coupling.
OWN, COUPLED = 4, 3


def read_coupling(text: str, arm: ArmModel) -> tuple[int, int]:
    """Numbers of two joints, from zero.

    Args:
        text: As `5,6`, counted from one.
        arm: The arm.

    Raises:
        InputError: It is no such pair.
    """
    words = text.split(",")
    remedy = f"give two numbers from 1 to {arm.n} as 5,6"
    if len(words) != 2 or not all(word.strip().isdecimal() for word in words):
        raise InputError("--coupling", f"{text!r} is no pair of joints", remedy)
    first, second = (int(word) - 1 for word in words)
    if first == second or not all(0 <= joint < arm.n for joint in (first, second)):
        raise InputError("--coupling", f"{text!r} is no pair of this arm's joints", remedy)
    return first, second


def fit_coupling(motions: Sequence[Motion], arm: ArmModel, first: int, second: int) -> tuple[CarriedEffect, ...]:
    """What each of two joints does to the other.

    Args:
        motions: Training runs.
        arm: The arm as its URDF describes it.
        first, second: The joints.
    """
    found = [_solve(motions, arm, (first, second), mix) for mix in (1.0, -1.0)]
    mix = 1.0 if found[0][0] <= found[1][0] else -1.0
    numbers = found[0 if mix > 0.0 else 1][1]
    effects = []
    for place, (joint, other) in enumerate(((first, second), (second, first))):
        inertia, viscous, coulomb = numbers[place]
        parameters = {
            "other_joint": float(other + 1),
            "mix": mix,
            "width_rad_s": WIDTH,
            "inertia_kgm2": float(inertia),
            "viscous_Nms_rad": float(viscous),
            "coulomb_Nm": float(coulomb),
        }
        effects.append(CarriedEffect("joint_coupling", joint, parameters))
    return tuple(effects)


def _solve(
    motions: Sequence[Motion], arm: ArmModel, pair: tuple[int, int], mix: float
) -> tuple[float, Float[Array, "2 3"]]:
    """Sum of squares that is left at both joints, and the coupling's numbers of each."""
    base = base_parameters(arm)
    width = base.rank + 2 * (OWN + COUPLED)
    sums = np.zeros((width + 1, width + 1))
    for motion in motions:
        for place, (joint, other) in enumerate((pair, pair[::-1])):
            table = np.zeros((len(motion.time), width + 1))
            regressor = arm.regressor(motion.q, motion.dq, motion.ddq, list(base.columns))
            start = base.rank + place * (OWN + COUPLED)
            own, beside = motion.dq[:, joint], motion.dq[:, other]
            table[:, : base.rank] = regressor[:, joint]
            losses = [motion.ddq[:, joint], own, np.tanh(own / WIDTH), np.ones(len(own))]
            coupled = [motion.ddq[:, other], beside + mix * own, np.tanh((own + mix * beside) / WIDTH)]
            table[:, start : start + OWN + COUPLED] = np.column_stack([*losses, *coupled])
            rigid = arm.with_payload(motion.payload).inverse_dynamics(motion.q, motion.dq, motion.ddq)
            table[:, -1] = rigid[:, joint]
            rows = motion.filtered(table)
            rows[:, -1] = motion.tau_filtered[:, joint] - rows[:, -1]
            rows = rows[motion.moving[:, joint]]
            sums += rows.T @ rows
    information = sums[:-1, :-1].copy()
    information[: base.rank, : base.rank] += base_prior(base, PRIOR_SHARE["base"] * parameter_scale(arm))
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information / np.outer(size, size)
    numbers = np.linalg.lstsq(scaled, sums[:-1, -1] / size, rcond=1e-10)[0] / size
    left = float(sums[-1, -1] - 2.0 * numbers @ sums[:-1, -1] + numbers @ sums[:-1, :-1] @ numbers)
    return left, numbers[base.rank :].reshape(2, OWN + COUPLED)[:, OWN:]


def without_carried(motion: Motion, arm: ArmModel, effects: Sequence[CarriedEffect]) -> Motion:
    """A run whose torque is what would be measured without the effects.

    Args:
        motion: The run.
        arm: The arm as its URDF describes it.
        effects: What is carried.
    """
    none = LossParameters.zero(arm.n)
    moving = moving_arm(arm.with_payload(motion.payload), none, motion.q, motion.dq, motion.ddq)
    acting = as_acting(effects, np.asarray(motion.tau), motion.interval)
    return replace(motion, tau=acting - carried_torque(effects, moving))
