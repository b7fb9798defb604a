"""What is known of an effect beside its law, in the words in which its class says it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Answer = Literal["yes", "approximate", "no"]
# No arm obeys the catalogue's laws to the letter: its own differ by some per cent in size and some degrees in phase
# (95 %, from a development set of simulated arms whose laws are others than the catalogue's).
LAW_SHARE, LAW_ANGLE = 0.15, 0.4


@dataclass(frozen=True)
class Expression:
    """How a format expresses an effect.

    Attributes:
        answer: `yes`: it states the same law; `approximate`: something near; `no`: it has no words for it.
        words: The place in the format, or the reason.
    """

    answer: Answer
    words: str

    def to_dict(self) -> dict[str, str]:
        return {"expressed": self.answer, "how": self.words}


def exactly_as(words: str) -> Expression:
    """A format states the same law."""
    return Expression("yes", words)


def nearly_as(words: str) -> Expression:
    """A format states something near."""
    return Expression("approximate", words)


def not_at_all(words: str) -> Expression:
    """A format has no words for it."""
    return Expression("no", words)


EVENT = not_at_all(
    "an event of the recording, not a property of the arm; the diagnosis gives no direction of the force"
)


@dataclass(frozen=True)
class Typical:
    """How large an effect is taken to be where nobody has found it yet.

    Attributes:
        figure: The reported figure that scales it; "" where none does.
        share: Typical size as a share of the largest plausible one (`Effect.prior_scale`), from the catalogue's sizes.
        inner: Typical inner figures, where the first point of the grid is none.
        absent: Coefficients that a typical effect has not.
        inverse: Whether it shows less as the figure grows: a stiffer spring.
    """

    figure: str = ""
    share: float = 0.2
    inner: Mapping[str, float] = field(default_factory=dict)
    absent: tuple[int, ...] = ()
    inverse: bool = False


@dataclass(frozen=True)
class Doubt:
    """How far an arm's own law may differ from an effect's, beside what the recordings leave open (95 %).

    Attributes:
        share: Of each figure's size.
        shares: Of figures for which it is another.
        places: Of figures of place, which have no size of their own, in the figure's unit.
        exact: Figures of which there is no doubt.
    """

    share: float = LAW_SHARE
    shares: Mapping[str, float] = field(default_factory=dict)
    places: Mapping[str, float] = field(default_factory=dict)
    exact: frozenset[str] = frozenset()

    def of(self, name: str, value: float) -> float:
        """Half the width that the doubt alone gives a figure, in its unit."""
        if name in self.exact:
            return 0.0
        return self.places.get(name, self.shares.get(name, self.share) * abs(value))


@dataclass(frozen=True)
class Interval:
    """A figure with its 95 % interval."""

    value: float
    low: float
    high: float

    def to_dict(self) -> dict[str, float]:
        return {"value": self.value, "low": self.low, "high": self.high}

    def words(self, unit: str, scale: float = 1.0, size: bool = False) -> str:
        """The figure with its interval as a person reads it.

        Args:
            unit: Its unit.
            scale: What that unit is the inverse of, in the figure's own: 1000 for milliradians.
            size: Whether only its size is of interest, not its sign.
        """
        value, low, high = (scale * one for one in (self.value, self.low, self.high))
        if size and value < 0.0:
            value, low, high = -value, -high, -low
        return f"{value:.3g} {unit} [{low:.3g}, {high:.3g}]"


@dataclass(frozen=True)
class Range:
    """Values that a figure can have on an arm.

    Attributes:
        low, high: Ends, in the figure's unit.
        reason: Why no arm has others.
    """

    low: float
    high: float
    reason: str
