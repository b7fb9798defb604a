"""What columns mean: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class UnnamedSettings(Numbers):
    """Columns without names."""

    even: float = number(
        3.0,
        "medians",
        "steps of a clock differ from their median by less",
        "chosen: a logger's jitter",
    )
    nearly_all: float = number(
        0.99,
        "1",
        "share of the samples for which they do",
        "chosen: gaps are rare",
    )
    same_motion: float = number(
        0.9,
        "1",
        "correlation from which on derivative and velocity are the same signal",
        "chosen: noise leaves as much",
    )
    stride: int = number(
        5,
        "samples",
        "over which a derivative is taken",
        "chosen: noise of encoders weighs less over several",
    )
    fewest_channels: int = number(
        3,
        "1",
        "channels without names that can be made out",
        "law: position, its derivative, and what follows the model",
    )
    as_good: float = number(
        0.05,
        "1",
        "two torques of which the model explains the same share within this are one, commanded "
        "and measured",
        "chosen: filters and noise",
    )


@dataclass(frozen=True)
class UnitSettings(Numbers):
    """Units, signs and gains of columns."""

    fastest_s: float = number(
        0.0002,
        "s",
        "fastest step of robots' logs",
        "chosen: 5 kHz",
    )
    slowest_s: float = number(
        0.5,
        "s",
        "slowest step",
        "chosen: 2 Hz",
    )
    least_span_deg: float = number(
        5.0,
        "degrees",
        "a log in which no joint turns farther is none of a moving arm",
        "chosen: as a tremble",
    )
    slope_off: float = number(
        0.1,
        "1",
        "velocity is in the positions' unit if its slope against their derivative is one within "
        "this",
        "chosen: filters",
    )
    same_signal: float = number(
        0.9,
        "1",
        "correlation from which on it is that signal",
        "chosen: noise leaves as much",
    )
    clearly_more: float = number(
        0.2,
        "1",
        "another order of joints, or sign, is taken where the model explains so much more of the "
        "torque",
        "chosen: beyond chance",
    )
    trusted: float = number(
        0.5,
        "1",
        "a gain rests on gravity if the model explains at least this share of the joint's current",
        "chosen: half",
    )
    unlike_neighbours: float = number(
        3.0,
        "1",
        "a gain that is off the median of the other joints' by more than so many of their robust "
        "standard deviations, of logarithms, is no guess",
        "law: as an outlier is usually cut",
    )
    sure_gain: float = number(
        0.2,
        "1",
        "and if pieces of the run agree within this share of it (standard error)",
        "chosen: two of it are the difference between neighbouring joints",
    )


UNNAMED = UnnamedSettings()
UNITS = UnitSettings()
