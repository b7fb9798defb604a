"""What planting an effect needs: what it does to a session, and memories along a motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.simulation.real.moved_arm import MovedArm, View

Parameters = dict[str, float | str]
Draw = np.random.Generator
# Travel over which dry friction turns round [rad].
BRISTLE = 3e-4


@dataclass(frozen=True, eq=False)
class PlantedChange:
    """What a planted effect does to a session."""

    parameters: Parameters  # what is true, by the catalogue's names and units
    torque: Float[Array, "N n"]  # added to the recorded torque [N m]
    shift: Float[Array, " n"] | float = 0.0  # added to the recorded positions [rad]
    # the URDF that is given, if that changes; then the bodies' torque is `unseen`
    urdf: str | None = None
    unseen: Array | float = 0.0  # torque that the given model lacks [N m]

    @property
    def felt(self) -> Float[Array, "N n"]:
        """Torque that a model without the effect would have to explain [N m]."""
        return self.torque + self.unseen


@dataclass(frozen=True)
class Planted:
    """An effect that can be planted."""

    change: Callable[[MovedArm, int, float, Draw], PlantedChange]  # its physics
    most: Callable[[MovedArm, int], float]  # largest size that an arm has
    view: View = "refit"  # what a refit may absorb before the rest counts as visible
    whole_arm: bool = False  # whether it is named of the arm, not of a joint
    local: bool = False  # whether it acts for a while only, and is measured then
    neighbours: bool = False  # whether another joint has a part in it


def at_joint(
    arm: MovedArm, j: int, torque: Float[Array, " N"], parameters: Parameters
) -> PlantedChange:
    """A torque added at one joint [N m], nothing at the others.

    Args:
        arm: The motion.
        j: Number of the joint.
        torque: At each row.
        parameters: What the answer says of it.
    """
    added = np.zeros_like(arm.tau)
    added[:, j] = torque
    return PlantedChange(parameters, added)


def bristle(
    arm: MovedArm, speed: Float[Array, " N"], travel: float = BRISTLE
) -> Float[Array, " N"]:
    """Sign of a speed with a memory: z' = |v| (sign v - z) / travel, from rest at the start of each
    run.
    """
    begins = ~np.isfinite(arm.steps)
    steps = np.where(begins, 0.0, arm.steps)
    keep = np.exp(-np.abs(speed) * steps / travel)
    rows = zip(keep.tolist(), np.sign(speed).tolist(), begins.tolist(), strict=True)
    deflection = np.empty(len(speed))
    z = 0.0
    for k, (stay, sign, is_begin) in enumerate(rows):
        if is_begin:
            z = 0.0
        z = sign + (z - sign) * stay
        deflection[k] = z
    return deflection


def decay(arm: MovedArm, power: Float[Array, " N"], constant: float) -> Float[Array, " N"]:
    """θ' = power - θ / constant over the session's clock, pauses included."""
    dt = np.diff(arm.t, prepend=arm.t[0])
    keep = np.exp(-dt / constant)
    heat = power * np.where(np.isfinite(arm.steps), dt, 0.0)
    warmth = np.empty(len(power))
    theta = 0.0
    for k, (stay, gained) in enumerate(zip(keep.tolist(), heat.tolist(), strict=True)):
        theta = theta * stay + gained
        warmth[k] = theta
    return warmth
