"""What the user asks of the simulated arm, checked before anything runs, and its answer, open or
sealed.

A sealed envelope holds the answer encrypted; the folder tells nothing without the key, and the
SHA-256 of the envelope, printed when it was made, shows later that nobody changed it. The cipher is
a stream of HMAC-SHA-256 blocks with a separate authentication tag, all from the standard library:
it keeps an answer from a reader, not a state secret.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import re
from dataclasses import dataclass, field
from pathlib import Path

from ident.errors import InputError
from ident.files import atomic_write
from ident.recordings.recording import Payload
from ident.records import JsonRecord, Record, as_json
from ident.robot.arm import ArmModel
from ident.safe_read import read_json
from ident.simulation.causes import Cause, find_cause

ENVELOPE_NAME = "envelope.json"
# Answers are padded to a multiple of this length: the length of the envelope tells nothing.
PADDING = 4096


@dataclass(frozen=True)
class TrueEffect(Record):
    """One thing that was wrong."""

    effect: str  # id, of the catalogue or outside it
    in_catalogue: bool  # which of the two
    joints: tuple[str, ...]  # the joint, or none for the whole arm
    size: float  # in the unit of `parameter`
    parameter: str  # name of the size
    # true parameters, by the contract's names where they exist there
    parameters: dict[str, float | str]
    # visible amplitude at each joint; empty if not measured
    visible_Nm: dict[str, float] = field(default_factory=dict)


WHOLE_ARM = ("", "arm", "all", "-")
_SIZE = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?x?")


@dataclass(frozen=True)
class Answer(Record):
    """What happened in a session."""

    robot: str
    seed: int
    effects: tuple[TrueEffect, ...]  # what was wrong
    decoys: tuple[str, ...]
    # What the best model leaves at each joint: the torque's noise, and what else its world adds.
    noise_floor_Nm: dict[str, float]
    world: JsonRecord = field(default_factory=dict)  # that it was drawn in; empty without one
    # Rotor inertia, viscous and dry friction of each joint; empty without a world.
    losses: dict[str, dict[str, float]] = field(default_factory=dict)

    def to_dict(self) -> JsonRecord:
        # Answers of sessions without a world say nothing of one: sealed ones must stay as they are.
        unsaid = {name for name in ("world", "losses") if not getattr(self, name)}
        return {
            "schema": "ident.answer/1",
            **{k: v for k, v in super().to_dict().items() if k not in unsaid},
        }

    @classmethod
    def from_dict(cls, values: JsonRecord) -> Answer:
        """Inverse of `to_dict` after a passage through JSON."""
        effects = tuple(
            TrueEffect(**{**entry, "joints": tuple(entry["joints"])}) for entry in values["effects"]
        )
        fields = {key: value for key, value in values.items() if key != "schema"}
        return cls(**{**fields, "effects": effects, "decoys": tuple(values["decoys"])})


def seal(answer: Answer, folder: Path, key: bytes) -> str:
    """Writes the answer into an envelope in the session's folder; returns the envelope's SHA-256.

    The key is a secret of 16 bytes or more, not used for another envelope.
    """
    plain = as_json(answer.to_dict(), None).encode()
    padded = plain.ljust(-(-(len(plain) + 1) // PADDING) * PADDING)
    text = _cipher(padded, key)
    tag = hmac.new(_derive(key, b"tag"), text, hashlib.sha256).hexdigest()
    envelope = json.dumps({"schema": "ident.envelope/1", "tag": tag, "text": text.hex()}) + "\n"
    with atomic_write(folder / ENVELOPE_NAME) as temporary:
        temporary.write_text(envelope, encoding="utf-8")
    return hashlib.sha256(envelope.encode()).hexdigest()


def open_envelope(path: Path, key: bytes) -> Answer:
    """Opens an envelope (the file, or the session's folder that holds it) with the key that it was
    sealed with.

    Raises:
        InputError: Not an envelope, changed since it was sealed, or another key.
    """
    path = path / ENVELOPE_NAME if path.is_dir() else path
    try:
        envelope = read_json(path, "give the folder of a sealed session")
        text = bytes.fromhex(envelope["text"])
        tag = str(envelope["tag"])
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            path, f"no envelope ({error})", "give the folder of a sealed session"
        ) from None
    wanted = hmac.new(_derive(key, b"tag"), text, hashlib.sha256).hexdigest()
    if not hmac.compare_digest(tag.encode("utf-8", "replace"), wanted.encode()):
        raise InputError(
            path,
            "the key does not fit, or the envelope was changed",
            "give the key printed at sealing",
        )
    return Answer.from_dict(json.loads(_cipher(text, key)))


def _derive(key: bytes, purpose: bytes) -> bytes:
    return hmac.new(key, b"ident.envelope/" + purpose, hashlib.sha256).digest()


def _cipher(text: bytes, key: bytes) -> bytes:
    """Adds the key stream; its own inverse."""
    stream_key = _derive(key, b"text")
    blocks = range(-(-len(text) // 32))
    stream = b"".join(
        hmac.new(stream_key, i.to_bytes(8, "big"), hashlib.sha256).digest() for i in blocks
    )
    return bytes(a ^ b for a, b in zip(text, stream, strict=False))


@dataclass(frozen=True)
class EffectRequest:
    """One effect, requested as ID:JOINT:SIZE."""

    effect: str  # id, of the catalogue or outside it
    joint: str = ""  # joint's name or number from 1; empty for an effect of the whole arm
    size: float | None = None  # physical size in the effect's unit; None for a typical one
    # visible amplitude in multiples of the noise floor instead of a size
    amplitude: float | None = None

    @property
    def cause(self) -> Cause:
        """The cause that the id names."""
        return find_cause(self.effect)


def parse_effect(text: str) -> EffectRequest:
    """Reads ID:JOINT:SIZE. SIZE is a number in the effect's unit, `3x` for three times the noise
    floor, or missing.

    Raises:
        InputError: Not of that form, or an unknown id.
    """
    parts = [piece.strip() for piece in text.split(":")]
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
        remedy = "give a number in SI units, or one that ends in x: multiples of the noise floor"
        raise InputError("--effect", f"{text!r}: {size!r} is not a size", remedy)
    if not size.endswith("x"):
        return EffectRequest(cause.id, joint, float(size))
    if float(size[:-1]) <= 0.0:
        raise InputError(
            "--effect", f"{text!r}: a visible amplitude of {size}", "choose more than 0x"
        )
    return EffectRequest(cause.id, joint, amplitude=float(size[:-1]))


def parse_payload(text: str) -> Payload:
    """Reads MASS or MASS@X,Y,Z: kilograms, and metres in the frame of the last link.

    Raises:
        InputError: Not of that form.
    """
    mass, _, place = text.partition("@")
    try:
        numbers = [float(mass), *(float(number) for number in place.split(",") if place)]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 4):
        raise InputError(
            "--payload", f"{text!r} is not a payload", "write MASS or MASS@X,Y,Z in kg and m"
        )
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
