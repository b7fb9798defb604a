"""Ripple of the teeth: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class RippleSettings(Numbers):
    """Ripple of the teeth."""

    ripple_orders: tuple[float, ...] = number(
        (1.0, 2.0),
        "turns of the motor",
        "orders of the teeth",
        "law: a wave generator has two lobes",
    )
    fewest: float = number(
        8.0,
        "1",
        "fewest cycles a turn that are looked at",
        "chosen: below lie laws of position",
    )
    most: float = number(
        600.0,
        "1",
        "most cycles a turn",
        "chosen: above no encoder tells the phase",
    )
    octaves: int = number(
        8,
        "1",
        "octaves of speed into which samples are sorted: of each line those count that pass it "
        "slowly enough",
        "chosen: eight reach from rest to full speed",
    )
    octave_parts: int = number(
        4,
        "1",
        "parts of such an octave",
        "law: a sample counts for at least 84 % of the lines that it passes slowly enough",
    )
    least_travel: float = number(
        0.2,
        "rad",
        "travel that shows a line apart from its neighbours",
        "chosen: some lines",
    )
    padding: int = number(
        4,
        "1",
        "times the angle is continued by zeros",
        "law: no line between two points of the sum is missed",
    )
    around: int = number(
        50,
        "lines",
        "on either side of one that tell what is usual there",
        "chosen: many, and near",
    )
    chance: float = number(
        0.01,
        "1",
        "chance of a line among noise that stands out so far",
        "law: one in a hundred",
    )
    most_lines: int = number(
        2,
        "1",
        "lines of a joint",
        "chosen: a limit on work",
    )
    most_tried: int = number(
        5,
        "lines",
        "that are taken out to see what is usual around them, each time",
        "chosen: a limit on work",
    )
    least_cycles: float = number(
        3.0,
        "1",
        "cycles of a line that show its phase",
        "chosen: three",
    )
    largest_phase_noise: float = number(
        0.7,
        "rad",
        "noise of the position, in the line's phase, beyond which it doesn't show",
        "chosen: a tenth of a turn",
    )


RIPPLE = RippleSettings()
