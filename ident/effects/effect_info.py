"""What is known of an effect beside its law, in the words in which its class says it.

Which motion shows an effect, and what tells two effects apart that one recording cannot.

Running a path both ways parts odd torques from even ones, a ladder of speeds parts the laws of
friction, a change of pose parts what follows the load from what follows the angle. Where two
effects are the same torque in every motion, only another set-up of the arm parts them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from math import log
from typing import Any, Literal, Protocol

from ident.laws.carried import TABLE

Answer = Literal["yes", "approximate", "no"]
# A parameter whose name begins with this is no estimate but the state at which the fitted law was
# evaluated for another one: `bend_Nm` is torque of the law at `at_speed_rad_s`. Sentences and cards
# say these: no number in them is made by a formula that is written a second time.
STATE = "at_"
# Kinds of motion by their short names, of which `plan excite` has motions: what to do in `words`,
# with {joint} for the joint, and the usual length in `minutes`.
SHOWINGS: dict[str, dict[str, Any]] = TABLE["motions"]
# What parts two effects that are the same torque, or nearly so, in every motion: another set-up of
# the arm.
KNOWN_MASS: str = TABLE["set_ups"]["known_mass"]


@dataclass(frozen=True)
class Expression:
    """How a format expresses an effect."""

    # `yes`: it states the same law; `approximate`: something near; `no`: it has no words for it
    answer: Answer
    words: str  # the place in the format, or the reason
    part: str = ""  # which part of the file carries it, as its writer calls it; "" for none
    # Parameters with which the format has no words for it after all, and the reason then.
    unless: tuple[str, ...] = ()
    otherwise: str = ""

    def to_dict(self) -> dict[str, str]:
        """Its record for JSON: `expressed` (the answer) and `how` (in words)."""
        return {"expressed": self.answer, "how": self.words}

    def given(self, parameters: Mapping[str, float]) -> Expression:
        """How the format expresses an effect with these parameters.

        Itself, or the answer `no` where a parameter of `unless` is not zero.
        """
        if any(parameters[name] for name in self.unless):
            return Expression("no", self.otherwise)
        return self


@dataclass(frozen=True)
class Typical:
    """How large an effect is taken to be where nobody has found it yet."""

    figure: str = ""  # the reported parameter that scales it; "" where none does
    # Typical size as a share of the largest plausible one (`Effect.prior_scale`), from the
    # catalogue's sizes.
    share: float = 0.2
    # Typical inner parameters, where the first point of the grid is none.
    inner: Mapping[str, float] = field(default_factory=dict)
    absent: tuple[int, ...] = ()  # coefficients that a typical effect has not
    inverse: bool = False  # whether it shows less as the parameter grows: a stiffer spring

    def distance(
        self, inner: Mapping[str, float], reported: Mapping[str, float] | None = None
    ) -> float:
        """How far inner parameters are from those reported, else from typical ones.

        The sum of the logarithms of their ratios, without sign; 0 where none is known.
        """
        wanted = {**self.inner, **(reported or {})}
        return sum(
            abs(log(max(wanted[name], 1e-9) / inner[name])) for name in inner if name in wanted
        )


@dataclass(frozen=True)
class Doubt:
    """What is certain of an effect: how far an arm's own law differs from it in all else is fitted
    to a corpus.
    """

    exact: frozenset[str] = frozenset()  # parameters of which there is no doubt


@dataclass(frozen=True)
class AsChange:
    """What is known of an effect as a change between two sets of recordings."""

    order: int = 0  # its place among the changes that are tested; 0 where it is none
    # whether arms obey its law to the letter: bodies fall, readings are scaled and shifted
    exact: bool = False
    # whether it is a body, of which the tuned baseline says already what all runs alike say
    body: bool = False
    friction: bool = False  # whether it is a law of friction, which differs from run to run anyhow
    common_gain: bool = False  # whether a gain that both sets share makes it as open as that gain
    # Whether the later set's runs lay it out: where its lines, widths or windows are looked for.
    later_alone: bool = False
    # the parameter that is negative where the change is that something has gone; "" for none
    taken_off: str = ""
    sentence: str = ""  # what to do about it, as `Effect.sentence`


@dataclass(frozen=True)
class Range:
    """Values that a parameter can have on an arm."""

    low: float  # ends, in the parameter's unit
    high: float
    reason: str  # why no arm has others


class ToldApart(Protocol):
    """What of an effect's record says how it is told from others; see `EffectRecord`."""

    @property
    def id(self) -> str: ...
    @property
    def shown_by(self) -> str: ...
    @property
    def parted_by(self) -> Mapping[str, str]: ...
    @property
    def set_ups(self) -> Mapping[str, str]: ...


def family_for(effects: Sequence[str], known: Iterable[ToldApart]) -> str:
    """The kind of motion that shows effects.

    Args:
        effects: Their ids.
        known: Records by which they are told; ids that are none of these are passed over.

    Returns:
        The kind that parts the first pair of them that has one of its own; else the one that shows
        most of them; `wide` without any.
    """
    by_id = {effect.id: effect for effect in known}
    asked = [by_id[effect] for effect in effects if effect in by_id]
    for first, other in combinations(asked, 2):
        if family := first.parted_by.get(other.id) or other.parted_by.get(first.id):
            return family
    families = [effect.shown_by for effect in asked]
    return max(families, key=families.count) if families else "wide"


def describe_motion(family: str, joint: str) -> str:
    """A kind of motion in words.

    Args:
        family: Its name, one of `SHOWINGS`.
        joint: Name of the joint that it is for.
    """
    return str(SHOWINGS[family]["words"].format(joint=joint))


def setup_for(effects: Sequence[str], known: Iterable[ToldApart]) -> str | None:
    """The change of set-up that parts effects which no motion, or hardly any, can part.

    Args:
        effects: Their ids.
        known: Records by which they are told.

    Returns:
        In words; None where motion does.
    """
    by_id = {effect.id: effect for effect in known}
    for first, other in combinations(effects, 2):
        for effect, rival in ((first, other), (other, first)):
            if effect in by_id and rival in by_id[effect].set_ups:
                return by_id[effect].set_ups[rival]
    return None
