"""What joints and arms usually have: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class TypicalSettings(Numbers):
    """What joints and arms usually have, where nothing else is known."""

    typical_coulomb_share: float = number(
        0.05,
        "rated torques",
        "Coulomb friction where the baseline has none yet",
        "chosen: as gears have",
    )
    typical_viscous_speed: float = number(
        2.0,
        "rad/s",
        "speed at which viscous friction adds as much again",
        "chosen: as gears have",
    )
    least_speed_ratio: float = number(
        3.0,
        "speeds of rest",
        "that a joint must reach to count as moving",
        "chosen: far beyond noise",
    )
    slide_per_turn: float = number(
        0.1,
        "m/rad",
        "what a joint that slides goes for a radian of one that turns, where travel and speed are "
        "asked for",
        "chosen: the radius of pulleys and pinions",
    )
    least_poses: float = number(
        0.1,
        "rad or m",
        "poses that lie nearer to each other are one",
        "chosen: gravity hardly changes",
    )
    sampled_states: int = number(
        200,
        "1",
        "samples of a session by which structure and typical sizes are judged",
        "chosen: a limit on work",
    )
    near: float = number(
        2.5,
        "1",
        "factor of where it was taken within which a secant is right",
        "chosen: inner grids are about as wide",
    )


TYPICAL = TypicalSettings()
