"""Joints whose effort holds no friction: torque sensors behind the gear, or a model's torque.

Effort without dry friction is torque at the link, to which neither viscous friction nor the rotor
belongs: where the recordings agree, they are zero too.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.fitting.joint_estimate import JointEstimate

# Dry friction below a filtered row's noise harms no row near a reversal more than that noise does.
# Real arms have up to 50 times as much at some joint.
HARMLESS = 1.0
# A joint surely has more where its value is so many standard deviations from zero; its upper bound
# is so many above it.
SURE = 3.0
BOUND = 2.0
# 99 % quantile of chi-square by the number of loss parameters: beyond it they are not zero
# together.
NOT_ZERO = {3: 11.345, 4: 13.277}
# Place of dry friction among a joint's loss parameters.
COULOMB = 2


def find_frictionless(
    clear: JointEstimate,
    joints: int,
    through_reversals: Callable[[Bool[Array, " n"]], JointEstimate],
) -> tuple[Bool[Array, " n"], JointEstimate]:
    """Joints without dry friction, and the estimate with all their moving rows.

    Effort is of one kind at all joints: where one surely has dry friction, none is without.

    Args:
        clear: The estimate clear of reversals.
        joints: How many there are.
        through_reversals: Makes the estimate anew with all moving rows of some joints.
    """
    chosen: Bool[Array, " n"] = np.full(joints, not _some_has_friction(clear, joints))
    while np.any(chosen):
        with_all = through_reversals(chosen)
        if _some_has_friction(with_all, joints):
            break
        value, std = _coulomb(with_all, joints)
        remaining = chosen & (value + BOUND * std < HARMLESS * with_all.noise)
        if np.array_equal(remaining, chosen):
            return chosen, with_all
        chosen = remaining
    return np.zeros(joints, dtype=bool), clear


def _some_has_friction(estimate: JointEstimate, joints: int) -> bool:
    value, std = _coulomb(estimate, joints)
    return bool(np.any(value > np.maximum(SURE * std, HARMLESS * estimate.noise)))


def lossless_parameters(
    estimate: JointEstimate, frictionless: Bool[Array, " n"]
) -> Int[Array, " z"]:
    """Positions of the losses of joints without friction that are zero as far as can be told.

    Returns:
        Positions in the estimate's values; empty if there are none.
    """
    zero: list[int] = []
    for joint in np.flatnonzero(frictionless):
        index = estimate.index(int(joint))
        values = estimate.values[index]
        covariance = estimate.covariance[np.ix_(index, index)]
        square = values @ np.linalg.pinv(covariance, hermitian=True) @ values
        if square < NOT_ZERO[len(index)]:
            zero += index.tolist()
    return np.array(zero, dtype=int)


def _coulomb(estimate: JointEstimate, joints: int) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Value and standard deviation of each joint's dry friction."""
    places = [int(estimate.index(joint)[COULOMB]) for joint in range(joints)]
    return estimate.values[places], estimate.std[places]
