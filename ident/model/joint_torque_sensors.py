"""Joints whose effort holds no friction: torque sensors behind the gear, or a model's torque.

Rows near reversals are left out of an estimate because dry friction there depends on what was before. Where there is
none, they are as good as any other, and in some recordings the larger half. Effort without dry friction is torque at
the link, to which neither viscous friction nor the rotor belongs: where the recordings agree, they are zero too.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ident.arrays import Array, Bool, Int
from ident.model.joint_estimate import JointEstimate

# Dry friction below a filtered row's noise harms no row near a reversal more than that noise does.
# Real arms have up to 50 times as much at some joint.
HARMLESS = 1.0
# A joint surely has more where its value is so many standard deviations from zero; its upper bound is so many above it.
SURE, BOUND = 3.0, 2.0
# 99 % quantile of chi-square by the number of loss figures: beyond it they are not zero together.
NOT_ZERO = {3: 11.345, 4: 13.277}
COULOMB = 2


def find_frictionless(
    found: JointEstimate, joints: int, through_reversals: Callable[[Bool[Array, " n"]], JointEstimate]
) -> tuple[Bool[Array, " n"], JointEstimate]:
    """Joints without dry friction, and the estimate with all their moving rows.

    Effort is of one kind at all joints: where one surely has dry friction, none is without.

    Args:
        found: The estimate clear of reversals.
        joints: How many there are.
        through_reversals: Makes the estimate anew with all moving rows of some joints.
    """
    chosen: Bool[Array, " n"] = np.full(joints, not _some_has_friction(found, joints))
    while np.any(chosen):
        with_all = through_reversals(chosen)
        value, std = _coulomb(with_all, joints)
        if _some_has_friction(with_all, joints):
            break
        kept = chosen & (value + BOUND * std < HARMLESS * with_all.noise)
        if np.array_equal(kept, chosen):
            return chosen, with_all
        chosen = kept
    return np.zeros(joints, dtype=bool), found


def _some_has_friction(found: JointEstimate, joints: int) -> bool:
    value, std = _coulomb(found, joints)
    return bool(np.any(value > np.maximum(SURE * std, HARMLESS * found.noise)))


def lossless_parameters(found: JointEstimate, frictionless: Bool[Array, " n"]) -> Int[Array, " z"]:
    """Positions of the losses of joints without friction, joint by joint, that are zero as far as can be told."""
    zero: list[int] = []
    for joint in np.flatnonzero(frictionless):
        index = found.index(int(joint))
        values, covariance = found.values[index], found.covariance[np.ix_(index, index)]
        if values @ np.linalg.pinv(covariance, hermitian=True) @ values < NOT_ZERO[len(index)]:
            zero += index.tolist()
    return np.array(zero, dtype=int)


def _coulomb(found: JointEstimate, joints: int) -> tuple[Array, Array]:
    """Value and standard deviation of each joint's dry friction."""
    at = [int(found.index(joint)[COULOMB]) for joint in range(joints)]
    return found.values[at], found.std[at]
