"""Servos that log goal and position only: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class ServoSettings(Numbers):
    """Fits of what holds a servo back."""

    least_samples: int = number(
        30,
        "1",
        "runs shorter than this have no spectrum to speak of",
        "chosen: a second of a slow bus",
    )
    least_sound: float = number(
        0.5,
        "1",
        "share of the rows in which goal and position must be numbers",
        "chosen: most",
    )
    same: float = number(
        1e-06,
        "1",
        "share of the position's own spread by which a goal must differ from it to be one",
        "chosen: rounding",
    )
    piece_s: float = number(
        1.5,
        "s",
        "pieces whose errors are taken as independent",
        "chosen: longer than a swing",
    )
    least_pieces: int = number(
        10,
        "1",
        "fewer tell nothing",
        "chosen: a spread needs ten",
    )
    parts: int = number(
        10,
        "1",
        "parts that are left out in turn",
        "chosen: a tenth each",
    )
    longest_delay: float = number(
        0.2,
        "s",
        "delays that are tried reach this far",
        "chosen: a bus of hobby servos is read every 5 to 30 ms",
    )
    delay_step: float = number(
        0.002,
        "s",
        "in these steps",
        "chosen: a parabola finds what lies between",
    )
    least_travel: float = number(
        0.05,
        "rad",
        "a joint that moves less has no story to tell",
        "chosen: beyond play",
    )
    least_gravity: float = number(
        0.02,
        "N m",
        "gravity that changes less bends nothing",
        "chosen: below a hobby servo's friction",
    )
    false: float = number(
        0.05,
        "1",
        "chance of any false figure over a whole arm",
        "law: one in twenty",
    )
    level: float = number(
        0.95,
        "1",
        "level of the intervals",
        "law: 95 %",
    )


SERVO = ServoSettings()
