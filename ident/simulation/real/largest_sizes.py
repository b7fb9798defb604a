"""How large a planted effect may be: functions of the moved arm and a joint's index."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ident.simulation.causes.mechanisms import length_of
from ident.simulation.real.moved_arm import MovedArm


def up_to(share: float) -> Callable[[MovedArm, int], float]:
    """A torque of so many times what the joint's drive hardly exceeds."""
    return lambda arm, j: share * float(arm.peak[j])


def at_speed(share: float) -> Callable[[MovedArm, int], float]:
    """A coefficient of speed that makes a share of the joint's largest torque at its fastest.

    Args:
        share: Of the torque that the joint's drive hardly exceeds.

    Returns:
        What takes a moved arm and a joint's index to the coefficient [N m s/rad].
    """

    def largest(arm: MovedArm, j: int) -> float:
        fastest = float(np.quantile(np.abs(arm.v[:, j]), 0.95))
        return share * float(arm.peak[j]) / (fastest + 1e-3)

    return largest


def of_friction(share: float) -> Callable[[MovedArm, int], float]:
    """A torque of so many times the joint's Coulomb friction: friction brakes, and static friction
    is not far more.
    """
    return lambda arm, j: share * float(arm.coulomb[j])


def over_range(share: float) -> Callable[[MovedArm, int], float]:
    """A stiffness that makes such a torque over half of the joint's range."""

    def largest(arm: MovedArm, j: int) -> float:
        span = float(np.ptp(arm.q[:, j]))
        return 2.0 * share * float(arm.peak[j]) / (span + 1e-3)

    return largest


def fixed(most: float) -> Callable[[MovedArm, int], float]:
    """A function of arm and joint number that gives the same largest size for every joint."""
    return lambda arm, j: most


def of_viscous(share: float) -> Callable[[MovedArm, int], float]:
    """A coefficient of so many times the joint's viscous friction."""
    return lambda arm, j: share * float(arm.viscous[j])


def twist_at_peak(angle: float) -> Callable[[MovedArm, int], float]:
    """A compliance [rad/(N m)] that twists by so much [rad] under the joint's peak torque."""
    return lambda arm, j: angle / float(arm.peak[j])


def lifted_mass(arm: MovedArm, j: int) -> float:
    """The mass [kg] that half of the strongest joint's peak torque holds at half of the arm's
    length.
    """
    return float(arm.peak.max()) / (9.81 * length_of(arm.model))


def push_at_length(share: float) -> Callable[[MovedArm, int], float]:
    """A force [N] that makes so many times the strongest peak torque at the arm's length."""
    return lambda arm, j: share * float(arm.peak.max()) / length_of(arm.model)
