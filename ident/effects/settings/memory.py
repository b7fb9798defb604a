"""Friction with a memory: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class MemorySettings(Numbers):
    """Friction with a memory."""

    time_constants: tuple[float, ...] = number(
        (30.0, 120.0, 480.0, 1800.0),
        "s",
        "time constants of warming up",
        "chosen: from a small gear to a large one",
    )
    fine_time_factors: tuple[float, ...] = number(
        (0.4, 0.5, 0.63, 0.8, 1.0, 1.25, 1.6, 2.0, 2.5),
        "1",
        "factors of the finer grid",
        "chosen: ratios of about 1.25",
    )
    longest_time_constant: float = number(
        4.0,
        "sessions",
        "time constants beyond are straight lines, all the same",
        "chosen: four",
    )
    least_session: float = number(
        60.0,
        "s",
        "session that shows warming up without a sensor",
        "chosen: shorter ones hardly warm",
    )
    least_temperature_range: float = number(
        1.0,
        "K",
        "temperature that must be gone through",
        "chosen: a sensor's steps",
    )
    temperature_average: float = number(
        5.0,
        "s",
        "time over which steps and noise of a sensor are averaged",
        "chosen: they are slow and coarse",
    )
    displacements: tuple[float, ...] = number(
        (0.002, 0.006, 0.018, 0.05),
        "rad",
        "ranges of stops",
        "chosen: ratios of about three, from what contacts of all gears bend to elasticity",
    )
    stops_side_by_side: tuple[int, ...] = number(
        (1, 2, 3),
        "1",
        "stops of neighbouring ranges that a build-up is made of",
        "chosen: three bend it enough",
    )
    largest_noise_share: float = number(
        0.3,
        "1",
        "position noise that a stop bears, as a share of its range",
        "chosen: more turns it round",
    )


MEMORY = MemorySettings()
