"""Whether there is motion enough: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class ExcitationSettings(Numbers):
    """Whether there is motion enough."""

    largest_condition: float = number(
        100.0,
        "1",
        "condition number of the base regressor above which motion tells too little",
        "chosen: a torque error of 1 % can double a parameter; optimised motion reaches 10 to 60",
    )
    least_travel: float = number(
        0.05,
        "rad or m",
        "travel below which a joint shows neither friction nor gravity",
        "chosen: beyond the presliding of gears",
    )
    least_share: float = number(
        0.1,
        "1",
        "share of the acceleration's variance that must not follow from the angle",
        "law: below it an inertia's variance is inflated tenfold (Marquardt 1970)",
    )
    least_strokes: int = number(
        2,
        "1",
        "times that a direction of motion must be shown",
        "law: once is not repeated",
    )


@dataclass(frozen=True)
class InformationSettings(Numbers):
    """What a recording holds that can be learnt from."""

    least_samples: int = number(
        100,
        "1",
        "shorter runs tell nothing of lines",
        "chosen: ten lines of ten samples",
    )
    flat: float = number(
        1e-06,
        "1",
        "share of the steepest slope below which a torque holds",
        "chosen: rounding",
    )
    rounding: float = number(
        0.001,
        "1",
        "share by which two slopes of one line differ",
        "chosen: tables with five decimals",
    )
    most_samples: float = number(
        0.5,
        "1",
        "share of the changing samples that lie on lines",
        "chosen: most",
    )
    least_corners: int = number(
        5,
        "1",
        "fewer corners have no distance",
        "chosen: a median of four",
    )
    shortest_line: int = number(
        3,
        "1",
        "samples from corner to corner at the least",
        "chosen: two are any two neighbours",
    )
    regular: float = number(
        0.8,
        "1",
        "share of the corners that come in one step or several",
        "chosen: most, but for samples that were dropped",
    )
    most_joints: float = number(
        0.5,
        "1",
        "share of the joints that change at which it must be so",
        "chosen: most",
    )


USUAL_EXCITATION = ExcitationSettings()
INFORMATION = InformationSettings()
