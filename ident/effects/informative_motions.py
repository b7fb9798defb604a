"""Which motion shows an effect, and what tells two effects apart that one recording cannot.

Running a path both ways parts odd torques from even ones, a ladder of speeds parts the laws of friction, a change of
pose parts what follows the load from what follows the angle. Where two effects are the same torque in every motion,
only another set-up of the arm parts them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar, Protocol


@dataclass(frozen=True)
class Showing:
    """A kind of motion and what it takes.

    Attributes:
        family: Short name; `plan excite` has motions of these names.
        words: What to do, with {joint} for the joint.
        minutes: Usual length [min].
    """

    family: str
    words: str
    minutes: float


SHOWINGS: dict[str, Showing] = {
    one.family: one
    for one in (
        Showing("ladder", "{joint} there and back at steady speeds from 0.02 rad/s to its fastest", 4),
        Showing("reversals", "{joint} slowly to and fro between ever nearer turning points", 3),
        Showing("chirp", "{joint} and its neighbours swept in frequency, to 10 Hz or so, about poses under load", 3),
        Showing("holds", "standstill in many poses, each approached from both sides, and {joint} both ways between", 4),
        Showing("poses", "the same path of {joint} both ways, repeated in other poses of the other joints", 4),
        Showing("wide", "all joints fast over wide poses", 4),
        Showing("vias", "all joints by clamped splines through chosen via points", 4),
        Showing("random", "all joints there and back through random points, as fast as their limits allow", 4),
        Showing("jointwise", "one joint after the other, the rest at standstill", 4),
        Showing("slow", "{joint} at two slow steady speeds, 0.02 and 0.04 rad/s", 4),
        Showing("repeat", "one motion of {joint} cold, after ten minutes of fast work, and after a rest", 25),
        Showing("loaded", "{joint} at its highest loads: arm stretched out, fast starts and stops", 3),
        Showing("free", "the same motion again in free space, with nothing near the arm", 2),
    )
}

# What parts two effects that are the same torque, or nearly so, in every motion: another set-up of the arm.
KNOWN_MASS = (
    "hang a known mass on the flange, give it as [payload] in session.toml, and record the same motion again: its "
    "torque is known, so the gain is; a wrong mass of the links changes nothing about it"
)
GAIN_OR_PAYLOAD = (
    "record the same motion with a known mass on the flange ([payload] of session.toml) and without it: the difference "
    "is known, so the gain is"
)
LOAD_OR_LINK = (
    "take everything off the flange, note it in session.toml, and record the same motion again: what stays belongs to "
    "the last link; or hang a known mass on and give it as [payload]"
)
BRAKES_CLOSED = (
    "log ten seconds at standstill with the brakes closed and the drives idle, before and after the motion: no "
    "friction reaches the motor then, and what its torque reads is the offset; standstill under control does not do, "
    "friction stays in the joint there"
)
LEVEL_OR_LINKS = (
    "turn the base by a quarter about the vertical, or level it with a spirit level, and record the same motion again: "
    "a tilt turns with the base, the links' masses don't"
)
LEVEL_OR_ZERO = (
    "turn the base by a quarter about the vertical and record the same motion again: a tilt changes its sign over the "
    "joints, an encoder's zero doesn't"
)


class ShownBy(Protocol):
    """What an effect says of the motions that show it: see `ident.effects.base.Effect`."""

    id: ClassVar[str]
    shown_by: ClassVar[str]
    parted_by: ClassVar[Mapping[str, str]]
    set_ups: ClassVar[Mapping[str, str]]


def family_for(effects: Sequence[str], known: Iterable[ShownBy]) -> str:
    """The kind of motion that shows effects, or parts the first pair of them that has one of its own.

    Args:
        effects: Their ids.
        known: The effects that there are; what is none of them has no motion of its own.
    """
    by_id = {effect.id: effect for effect in known}
    asked = [by_id[effect] for effect in effects if effect in by_id]
    for one, other in combinations(asked, 2):
        family = one.parted_by.get(other.id) or other.parted_by.get(one.id)
        if family:
            return family
    families = [effect.shown_by for effect in asked]
    return max(families, key=families.count) if families else "wide"


def describe_motion(family: str, joint: str) -> str:
    """A kind of motion in words, for one joint."""
    return SHOWINGS[family].words.format(joint=joint)


def setup_for(effects: Sequence[str], known: Iterable[ShownBy]) -> str | None:
    """The change of set-up that parts effects which no motion, or hardly any, can part; None where motion does."""
    by_id = {effect.id: effect for effect in known}
    for one, other in combinations(effects, 2):
        for effect, rival in ((one, other), (other, one)):
            if effect in by_id and rival in by_id[effect].set_ups:
                return by_id[effect].set_ups[rival]
    return None
