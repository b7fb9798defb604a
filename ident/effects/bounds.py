"""Which figures an arm can have: what lies outside is no finding, however well it fits.

An effect states the range of its figures (`Effect.physical`) as a function of the arm: its reach, the rated torque and
the range of a joint, the friction that the joint has. It also states which figures define it; where the 95 % interval
of each of these holds zero, nobody can say that there is such an effect.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ident.effects.effect_info import Interval
from ident.robot.arm import ArmModel

if TYPE_CHECKING:
    from ident.effects.base import Effect, SessionContext

# An effect that takes more than this share of what a joint can give leaves a joint that hardly moves by itself.
LARGEST_TORQUE_SHARE = 0.5
# Bounds are of the arm's own rating and friction, which nobody knows better than by this factor.
KNOWN_WITHIN = 1.5


def undefined(effect: Effect, figures: Mapping[str, Interval]) -> str | None:
    """Why nobody can say that there is an effect of such figures: all that define it may be zero; or None."""
    names = [name for name in effect.defining if name in figures]
    if names and all(figures[name].low <= 0.0 <= figures[name].high for name in names):
        return f"the 95 % interval of {' and '.join(names)} holds zero"
    return None


def impossible(effect: Effect, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> str | None:
    """Why no arm has an effect of such figures, or None: a 95 % interval that lies beyond a bound as a whole.

    Args:
        effect: The effect.
        session: The runs.
        joint: Its joint.
        figures: The reported figures.
    """
    for name, allowed in effect.physical(session, joint, figures).items():
        found, value = figures[name], figures[name].value
        # Both ends of a range about zero are sizes; a lower end of its own is a law (friction does not drive).
        slack = KNOWN_WITHIN if allowed.low in (0.0, -allowed.high) else 1.0
        possible = found.high >= slack * allowed.low and found.low <= slack * allowed.high
        if not (np.isfinite(value) and possible):
            return f"{name} {value:.3g} lies outside {allowed.low:.3g} to {allowed.high:.3g}: {allowed.reason}"
    return None


def arm_mass(arm: ArmModel) -> float:
    """Mass of all moving links [kg]: what an arm weighs, it is rated by."""
    return float(arm.inertial_parameters[::10].sum())


def arm_reach(arm: ArmModel) -> float:
    """Length of the chain from the first joint to the last link's centre of mass, stretched out [m]."""
    steps = [np.asarray(placement.translation) for placement in list(arm.model.jointPlacements)[2:]]
    last = arm.inertial_parameters[-10:]
    tip = float(np.linalg.norm(last[1:4])) / float(last[0]) if last[0] > 0.0 else 0.0
    sliding = sum(float(arm.upper[j] - arm.lower[j]) for j in np.flatnonzero(arm.sliding_joints))
    return float(sum(np.linalg.norm(step) for step in steps)) + tip + (sliding if np.isfinite(sliding) else 0.0)


def joint_range(session: SessionContext, joint: int, seen: tuple[float, float]) -> tuple[float, float]:
    """Where a joint can go [rad]: its limits in the URDF, or where it has none a turn about what was seen."""
    arm = session.runs[0].arm
    low, high = float(arm.lower[joint]), float(arm.upper[joint])
    if np.isfinite(low) and np.isfinite(high) and high > low and high - low < 8.0 * np.pi:
        return low, high
    return seen[0] - np.pi, seen[1] + np.pi
