"""The models that the loop compares: the URDF as it is, tuned, as a diagnosis has it, and randomised widely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ident.effects.base import Effect as Kind
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.law_model import LawModel
from ident.export.python import describe_arm
from ident.laws.motion import Losses
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel
from ident.robot.traits import rated_torque


def as_urdf(arm: ArmModel, payload: Payload | None = None) -> LawModel:
    """The arm as its URDF has it: its links, and the damping and friction that it states, if any."""
    return LawModel.of(IdentifiedArm.as_urdf(arm), payload)


def as_diagnosed(
    arm: ArmModel, record: Mapping[str, Any], catalogue: Sequence[Kind], payload: Payload | None = None
) -> LawModel:
    """The arm as a diagnosis has it: tuned links and losses, and all identified effects that have a law."""
    return LawModel.of(_candidates(arm, record, catalogue)["after"], payload)


def as_tuned(
    arm: ArmModel, record: Mapping[str, Any], catalogue: Sequence[Kind], payload: Payload | None = None
) -> LawModel:
    """The arm with links and losses tuned to the same recordings, and no effect: what identification alone gives."""
    return LawModel.of(_candidates(arm, record, catalogue)["tuned"], payload)


def _candidates(arm: ArmModel, record: Mapping[str, Any], catalogue: Sequence[Kind]) -> dict[str, IdentifiedArm]:
    return Diagnosed.of_record(dict(record), catalogue, needed=False).candidates(arm)


# Wide randomisation, as it is done without recordings: dry friction, and viscous friction at top speed, each from
# nothing to this share of rated torque; rotor inertia from nothing to twice what gears of that rating have; masses
# evenly about the URDF's. A trainer's guess, not a measured figure.
FRICTION_SHARE = 0.1
# Rotor inertia of a gear of 157 N m [kg m²], and how it grows with the rating: of strain-wave gears' data sheets.
ROTOR_157, ROTOR_GROWTH = 1.0, 1.55
# Over this speed the randomised friction turns round [rad/s].
TURNING_SPEED = 0.02


def as_randomised(arm: ArmModel, payload: Payload | None = None) -> LawModel:
    """The middle of wide ranges: of all feed-forwards the one with the least mean square error over them."""
    rated = rated_torque(arm)
    speed = np.where((arm.velocity_limit > 0.0) & (arm.velocity_limit < 50.0), arm.velocity_limit, 3.0)
    middle = 0.5 * FRICTION_SHARE * rated
    losses = Losses(
        motor_inertia=ROTOR_157 * (rated / 157.0) ** ROTOR_GROWTH,
        viscous=middle / speed,
        coulomb=middle,
        transition=np.full(arm.n, TURNING_SPEED),
        range=np.zeros(arm.n),
    )
    return LawModel(describe_arm(arm.with_payload(payload)), losses)
