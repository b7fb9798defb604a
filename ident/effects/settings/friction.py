"""Friction of speed, load, place and direction: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class FrictionSettings(Numbers):
    """Friction of speed, load, place and direction."""

    largest_load_share: float = number(
        0.2,
        "1",
        "largest share of load-dependent friction in the load",
        "chosen: gears with less efficiency are rare",
    )
    least_load_range: float = number(
        0.004,
        "1",
        "share of the rated torque by which a load must vary, or it gives nothing but more "
        "Coulomb friction",
        "chosen: below friction's own size",
    )
    least_top_speed: float = number(
        0.05,
        "rad/s",
        "speeds below leave nothing of a curve over speed",
        "chosen: slower motion is presliding",
    )
    viscous_exponents: tuple[float, ...] = number(
        (0.3, 0.5, 0.7, 2.0),
        "1",
        "exponents of friction over speed",
        "chosen: greases and churning",
    )
    knees: tuple[tuple[float, ...], ...] = number(
        ((0.05, 0.2), (0.05, 0.5), (0.2, 0.2), (0.2, 0.5), (0.6, 0.2)),
        "rad/s, 1",
        "of laws that are straight up to a knee: its speed, and the exponent beyond it",
        "chosen: lubricants that thin",
    )
    fine_knee_factors: tuple[float, ...] = number(
        (0.4, 0.63, 1.0, 1.6, 2.5),
        "1",
        "knees of the finer grid, in a law's own",
        "chosen: ratios of about 1.6",
    )
    fine_knees: tuple[float, ...] = number(
        (0.02, 0.05, 0.1),
        "rad/s",
        "knees that are tried of a law without one",
        "chosen: below usual speeds",
    )
    fine_bent_steps: tuple[float, ...] = number(
        (-0.3, -0.15, -0.07, 0.0, 0.07, 0.15, 0.3),
        "1",
        "steps of the exponent with a knee, which makes up for it",
        "chosen: wider than without",
    )
    fine_exponent_steps: tuple[float, ...] = number(
        (-0.15, -0.1, -0.05, 0.0, 0.05, 0.1, 0.15),
        "1",
        "steps of the exponent without one",
        "chosen: half of the coarse grid's",
    )
    least_exponent: float = number(
        0.05,
        "1",
        "least exponent beyond a knee",
        "chosen: below it a law is Coulomb's",
    )


FRICTION = FrictionSettings()
