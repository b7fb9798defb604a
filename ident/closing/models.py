"""The models that the loop compares: the URDF as it is, tuned, as a diagnosis has it, and randomised widely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ident.effects.base import Effect as Kind
from ident.patches.bodies import change_links, tuned_arm
from ident.patches.change import Diagnosed, Tuning
from ident.patches.command import known_effects
from ident.patches.module import describe_arm
from ident.patches.simulator_models import LawModel
from ident.patches.standalone.motion import Losses
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel
from ident.robot.rated_torque import rated_torque


def as_urdf(arm: ArmModel, payload: Payload | None = None) -> LawModel:
    """The arm as its URDF has it: its links, and the damping and friction that it states, if any."""
    n = arm.n
    plain = Tuning.none(n).losses
    losses = Losses(plain.motor_inertia, arm.model.damping, arm.model.friction, plain.transition, plain.range)
    return LawModel(describe_arm(arm.with_payload(payload)), losses)


def as_diagnosed(
    arm: ArmModel, record: Mapping[str, Any], catalogue: Sequence[Kind], payload: Payload | None = None
) -> LawModel:
    """The arm as a diagnosis has it: tuned links and losses, and all named effects that have a law."""
    diagnosed = Diagnosed.of_record(dict(record), catalogue, needed=False)
    tuned, _ = tuned_arm(diagnosed.fit_to(arm), diagnosed)
    effects, _ = known_effects(diagnosed.changes)
    return LawModel(describe_arm(tuned.with_payload(payload)), diagnosed.tuned.losses, tuple(effects))


def as_tuned(
    arm: ArmModel, record: Mapping[str, Any], catalogue: Sequence[Kind], payload: Payload | None = None
) -> LawModel:
    """The arm with links and losses tuned to the same recordings, and no effect: what identification alone gives."""
    diagnosed = Diagnosed.of_record(dict(record), catalogue, needed=False)
    arm = diagnosed.fit_to(arm)
    links = change_links(arm, diagnosed.alone.links, ())
    changed = arm.with_inertial_parameters(arm.inertial_parameters + links.total.ravel())
    return LawModel(describe_arm(changed.with_payload(payload)), diagnosed.alone.losses)


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
