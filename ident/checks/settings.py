"""The numbers by which recordings are refused for their torque, and for too little motion."""

from __future__ import annotations

from dataclasses import dataclass

from ident.settings import Settings, number


@dataclass(frozen=True)
class EffortSettings(Settings):
    """Sign, scale and origin of the torque; logs are 17 of a UR10e, two of Pandas and one of a UR10."""

    moving_rad_s: float = number(
        0.02,
        "rad/s",
        "speed (root mean square) from which on a joint moves",
        "chosen: a few times a filtered velocity's noise",
    )
    static_Nm: float = number(
        10.0, "N m", "change of gravity that shows at rest, too", "chosen: above the friction of arms of this size"
    )
    sign_explains: float = number(
        0.5,
        "1",
        "share of minus the torque that the model explains where a sign is wrong",
        "calibrated: moving joints reach at least 0.59 with the right sign",
    )
    sign_better: float = number(
        0.3, "1", "by how much more than of the torque", "calibrated: at most 0.27 with the wrong sign"
    )
    scale_low: float = number(
        0.5,
        "1",
        "least coefficient of gravity of a torque in N m",
        "calibrated: 0.84 at the least on heavy joints; currents lie near 0.1, per cent near 0.3",
    )
    scale_high: float = number(
        4.0, "1", "and the largest", "calibrated: 1.84 with an unknown payload of 2.6 kg; N mm lie at 1000"
    )
    scale_off: float = number(
        0.07,
        "1",
        "by how much the model's torque must be off to be told",
        "chosen: the shipped arm's joints lie within 6 %",
    )
    heavy_share: float = number(
        0.2,
        "1",
        "share of the most loaded joint's change of gravity from which on a joint is heavy",
        "chosen: less tells little of a scale",
    )
    heavy_Nm: float = number(0.5, "N m", "and the least change", "chosen: less is friction's size")
    follows: float = number(
        0.3, "1", "share of a heavy joint's torque that the model must explain", "calibrated: heavy joints reach 0.97"
    )
    sure: float = number(3.0, "1", "standard errors by which gravity's coefficient must lie outside", "law: one in 400")
    pieces: int = number(12, "1", "pieces of the session that these come from", "chosen: each some seconds")
    friction_gain: float = number(
        0.05,
        "1",
        "share of a residual's variance that friction must take, or the torque is a model's",
        "calibrated: 22 % at the least; 2.6 % of a controller's own model",
    )
    rigid_explains: float = number(
        0.99, "1", "share of the variance that a rigid model explains of itself", "chosen: but for numbers that differ"
    )
    friction_share: float = number(
        0.005, "1", "friction, as a share of the torque's spread, that is none", "chosen: no gear has so little"
    )


USUAL_EFFORT = EffortSettings()


@dataclass(frozen=True)
class ExcitationSettings(Settings):
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
    least_strokes: int = number(2, "1", "times that a direction of motion must be shown", "law: once is not repeated")


USUAL_EXCITATION = ExcitationSettings()


@dataclass(frozen=True)
class TelemetrySettings(Settings):
    """What recordings are refused by.

    Attributes:
        effort: Sign, scale and origin of the torque.
        excitation: Whether there is motion enough.
    """

    effort: EffortSettings = USUAL_EFFORT
    excitation: ExcitationSettings = USUAL_EXCITATION


USUAL_TELEMETRY = TelemetrySettings()
