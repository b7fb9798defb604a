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

from ident.laws.table import TABLE


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


SHOWINGS: dict[str, Showing] = {family: Showing(family, **one) for family, one in TABLE["motions"].items()}
# What parts two effects that are the same torque, or nearly so, in every motion: another set-up of the arm.
KNOWN_MASS: str = TABLE["set_ups"]["known_mass"]


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
