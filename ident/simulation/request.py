"""What the user asks of the simulated arm, checked before anything runs."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ident.errors import InputError
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel
from ident.simulation.causes import Cause, find_cause

WHOLE_ARM = ("", "arm", "all", "-")
_SIZE = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?x?")


@dataclass(frozen=True)
class EffectRequest:
    """One effect, requested as ID:JOINT:SIZE."""

    effect: str  # id, of the catalogue or outside it
    joint: str = ""  # joint's name or number from 1; empty for an effect of the whole arm
    size: float | None = None  # physical size in the effect's unit; None for a typical one
    amplitude: float | None = None  # visible amplitude in multiples of the noise floor instead of a size

    @property
    def cause(self) -> Cause:
        return find_cause(self.effect)


def parse_effect(text: str) -> EffectRequest:
    """Reads ID:JOINT:SIZE. SIZE is a number in the effect's unit, `3x` for three times the noise floor, or missing.

    Raises:
        InputError: Not of that form, or an unknown id.
    """
    parts = [part.strip() for part in text.split(":")]
    cause = find_cause(parts[0])
    if len(parts) > 3:
        raise InputError("--effect", f"{text!r} has {len(parts)} parts", "write ID:JOINT:SIZE")
    if len(parts) == 2 and cause.whole_arm and _SIZE.fullmatch(parts[1]):
        parts.insert(1, "")
    joint = parts[1] if len(parts) > 1 else ""
    size = parts[2] if len(parts) > 2 else ""
    if not size:
        return EffectRequest(cause.id, joint)
    if not _SIZE.fullmatch(size):
        raise InputError(
            "--effect",
            f"{text!r}: {size!r} is not a size",
            "give a number in SI units, or one that ends in x: multiples of the noise floor",
        )
    if not size.endswith("x"):
        return EffectRequest(cause.id, joint, float(size))
    if float(size[:-1]) <= 0.0:
        raise InputError("--effect", f"{text!r}: a visible amplitude of {size}", "choose more than 0x")
    return EffectRequest(cause.id, joint, amplitude=float(size[:-1]))


def parse_payload(text: str) -> Payload:
    """Reads MASS or MASS@X,Y,Z: kilograms, and metres in the frame of the last link.

    Raises:
        InputError: Not of that form.
    """
    mass, _, place = text.partition("@")
    try:
        numbers = [float(mass), *(float(part) for part in place.split(",") if place)]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 4):
        raise InputError("--payload", f"{text!r} is not a payload", "write MASS or MASS@X,Y,Z in kg and m")
    x, y, z = numbers[1:] or (0.0, 0.0, 0.0)
    return Payload(numbers[0], (x, y, z))


def find_joint(request: EffectRequest, arm: ArmModel) -> int:
    """Index of the joint that an effect is asked for; the last for an effect of the whole arm.

    Raises:
        InputError: No such joint, or none given where one is needed.
    """
    if request.cause.whole_arm:
        return arm.n - 1
    names = arm.joint_names
    listed = f"choose from: {', '.join(names)}"
    if request.joint in WHOLE_ARM:
        raise InputError("--effect", f"{request.effect} needs a joint", listed)
    if request.joint in names:
        return names.index(request.joint)
    if request.joint.isdecimal() and 1 <= int(request.joint) <= arm.n:
        return int(request.joint) - 1
    raise InputError("--effect", f"{request.effect}: no joint {request.joint!r}", listed)
