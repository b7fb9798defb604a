"""Torque and position that are not what the log says: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class SensingSettings(Numbers):
    """Torque and position that are not what the log says."""

    largest_offset: float = number(
        0.3,
        "rated torques",
        "offset that a sensor may have",
        "chosen: beyond it is broken",
    )
    least_torque_variation: float = number(
        0.004,
        "rated torques",
        "modelled torque that varies by less is as good as an offset",
        "chosen: below friction's own size",
    )
    saturation_knees: tuple[float, ...] = number(
        (0.6, 0.7, 0.8, 0.9),
        "1",
        "knees, in the largest modelled torque",
        "chosen: even steps",
    )
    knee_share: float = number(
        0.05,
        "1",
        "share of the largest reading by which the limit may lie above it",
        "chosen: drives bend into their limit",
    )
    least_peak_share: float = number(
        0.1,
        "rated torques",
        "largest torque below which no limit shows",
        "chosen: no drive is limited there",
    )
    largest_encoder_offset: float = number(
        0.07,
        "rad",
        "what zeros are off by on arms that were calibrated once",
        "chosen: four degrees",
    )
    large_offset: float = number(
        0.25,
        "rad",
        "offset whose secant is tried beside the slope at zero",
        "chosen: there the slope lacks 3 % of gravity's torque",
    )
    fine_offsets: tuple[float, ...] = number(
        (-2.4, -2.0, -1.6, -1.2, -0.8, -0.4, -0.2, 0.0, 0.2, 0.4, 0.8, 1.2, 1.6, 2.0, 2.4),
        "1",
        "shares of it on the finer grid",
        "chosen: up to 35 degrees",
    )
    least_encoder_share: float = number(
        0.0005,
        "rated torques",
        "torque that the largest offset must make at some joint",
        "chosen: less is noise",
    )
    delays: tuple[float, ...] = number(
        (0.002, 0.008, 0.02, 0.05),
        "s",
        "delays",
        "chosen: ratios of about three, from a sample to a bus",
    )
    typical_delay: float = number(
        0.01,
        "s",
        "delay by which is judged whether one is seen",
        "chosen: some samples",
    )
    least_delay_share: float = number(
        0.0005,
        "rated torques",
        "what it must change at some joint",
        "chosen: less is noise",
    )


SENSING = SensingSettings()
