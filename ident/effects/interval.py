"""An estimate with its interval, and how a person reads it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

# Units that sentences use for those of parameters: how many there are in one.
UNIT_SCALE = {"mrad": 1e3, "ms": 1e3, "%": 100.0}
# Milliradians with degrees beside them, of angles that people set by a level or a display.
WITH_DEGREES = "mrad°"


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval."""

    value: float  # the estimate
    low: float  # ends of the interval
    high: float
    # Which ends the recordings leave open, where `low` and `high` are those of the values that were
    # tried or that an arm can have: "low", "high", "both", or "" for none.
    open: Literal["", "low", "high", "both"] = ""
    # Ends with the URDF's own error added, where `low` and `high` are for the URDF as it is; None
    # where it has no part.
    low_with_urdf: float | None = None
    high_with_urdf: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Its record for JSON.

        Returns:
            `value`, `low`, `high`; `low_with_urdf` and `high_with_urdf` where they are known, and
            `open` where an end is.
        """
        ends: dict[str, Any] = {"value": self.value, "low": self.low, "high": self.high}
        if self.low_with_urdf is not None and self.high_with_urdf is not None:
            ends |= {"low_with_urdf": self.low_with_urdf, "high_with_urdf": self.high_with_urdf}
        return {**ends, "open": self.open} if self.open else ends

    def wider(self, factor: float) -> Interval:
        """An interval about `factor` times as wide.

        One that does not go beyond zero grows by ratios, and never does. An end that is open stays:
        it is no estimate.
        """
        low = self.low
        high = self.high
        if self.open not in ("low", "both"):
            low = self._moved(low, factor)
        if self.open not in ("high", "both"):
            high = self._moved(high, factor)
        return replace(self, low=low, high=high)

    def _moved(self, end: float, factor: float) -> float:
        """An end so many times as far from the estimate."""
        if self.value != 0.0 and min(self.low * self.value, self.high * self.value) >= 0.0:
            return self.value * float((end / self.value) ** factor)
        return self.value + factor * (end - self.value)

    def reported(self, unit: str, scale: float = 1.0) -> str:
        """The value alone, to three digits, with its unit.

        Args:
            unit: The unit.
            scale: What the value is multiplied by: 1000 for milliradians.
        """
        return f"{_three_digits(scale * self.value)} {unit}"

    def __format__(self, how: str) -> str:
        """As `how` says: a unit for the estimate with its interval; `=unit` for its value, `|unit`
        for its size; and

        `?more,less` for the first word where it is positive. Without a unit the value is a whole
        number.
        """
        if how.startswith("?"):
            return how[1:].split(",")[self.value <= 0.0]
        unit = how.lstrip("=|")
        if unit == WITH_DEGREES:
            degrees = _three_digits(math.degrees(self.value), self._resolution(180.0 / math.pi))
            return f"{self.words('mrad', 1e3)} ({degrees}°)"
        scale = UNIT_SCALE.get(unit, 1.0)
        if not unit:
            return str(round(self.value))
        if how.startswith("="):
            return self.reported(unit, scale)
        return self.words(unit, scale, size=how.startswith("|"))

    def _resolution(self, scale: float) -> float:
        """The last of three digits of the farther end: what of the value is less is nothing.

        Args:
            scale: What the ends are multiplied by.
        """
        farther = scale * max(abs(self.low), abs(self.high))
        known = 0.0 < farther < math.inf
        return 10.0 ** (math.floor(math.log10(farther)) - 2) if known else 0.0

    def words(self, unit: str, scale: float = 1.0, size: bool = False) -> str:
        """The estimate with its interval as a person reads it; of an open one the end that is
        known.

        Args:
            unit: Its unit; "" for a plain number.
            scale: What value and ends are multiplied by: 1000 for milliradians of an estimate in
                rad.
            size: Whether only its size is of interest, not its sign.
        """
        factor = -scale if size and scale * self.value < 0.0 else scale
        ends = sorted((factor * self.low, factor * self.high))
        middle = _three_digits(factor * self.value, self._resolution(scale))
        least = _three_digits(ends[0])
        most = _three_digits(ends[1])
        unit = f" {unit}" if unit else ""
        known = {
            "high": f"at least {least}{unit}",
            "low": f"at most {most}{unit}",
            "both": f"{middle}{unit} (a guess: the recordings leave it open)",
        }
        return known.get(self.open, f"{middle}{unit} [{least}, {most}]")


def _three_digits(value: float, least: float = 0.0) -> str:
    """A number as people write it: a true minus, none before 0, thousands in full.

    Args:
        value: The number.
        least: What is smaller than half of it is 0.
    """
    value = 0.0 if abs(value) < 0.5 * least else value
    text = f"{value + 0.0:.3g}"
    if 1e3 <= abs(value) < 1e6:
        text = f"{float(text):.0f}"
    return text.replace("-", "−")
