"""What measured torques are: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class EffortSettings(Numbers):
    """Sign, scale and origin of the torque.

    Logs are 17 of a UR10e, two of Pandas and one of a UR10.
    """

    moving_rad_s: float = number(
        0.02,
        "rad/s",
        "speed (root mean square) from which on a joint moves",
        "chosen: a few times a filtered velocity's noise",
    )
    static_Nm: float = number(
        10.0,
        "N m",
        "change of gravity that shows at rest, too",
        "chosen: above the friction of arms of this size",
    )
    sign_explains: float = number(
        0.5,
        "1",
        "share of minus the torque that the model explains where a sign is wrong",
        "calibrated: moving joints reach at least 0.59 with the right sign",
    )
    sign_better: float = number(
        0.3,
        "1",
        "by how much more than of the torque",
        "calibrated: at most 0.27 with the wrong sign",
    )
    scale_low: float = number(
        0.4,
        "1",
        "least coefficient of gravity of a torque in N m",
        "calibrated: 0.84 at the least on heavy joints, so that half of it is a wrong gain; "
        "currents lie near 0.1, per cent near 0.3",
    )
    scale_high: float = number(
        4.0,
        "1",
        "and the largest",
        "calibrated: 1.84 with an unknown payload of 2.6 kg; N mm lie at 1000",
    )
    scale_off: float = number(
        0.07,
        "1",
        "by how much the model's torque must be off to be reported",
        "chosen: the shipped arm's joints lie within 6 %",
    )
    heavy_share: float = number(
        0.2,
        "1",
        "share of the most loaded joint's change of gravity from which on a joint is heavy",
        "chosen: less tells little of a scale",
    )
    heavy_Nm: float = number(
        0.5,
        "N m",
        "and the least change",
        "chosen: less is friction's size",
    )
    follows: float = number(
        0.3,
        "1",
        "share of a heavy joint's torque that the model must explain",
        "calibrated: heavy joints reach 0.97",
    )
    sure: float = number(
        3.0,
        "1",
        "standard errors by which gravity's coefficient must lie outside",
        "law: one in 400",
    )
    pieces: int = number(
        12,
        "1",
        "pieces of the session that these come from",
        "chosen: each some seconds",
    )
    friction_gain: float = number(
        0.05,
        "1",
        "share of a residual's variance that friction must take, or the torque is a model's",
        "calibrated: 22 % at the least; 2.6 % of a controller's own model",
    )
    rigid_explains: float = number(
        0.99,
        "1",
        "share of the variance that a rigid model explains of itself",
        "chosen: but for numbers that differ",
    )
    friction_share: float = number(
        0.005,
        "1",
        "friction, as a share of the torque's spread, that is none",
        "chosen: no gear has so little",
    )


@dataclass(frozen=True)
class EffortKindSettings(Numbers):
    """Of what an effort is: a torque, a current, or one without gravity."""

    sure: float = number(
        0.2,
        "1",
        "standard error below which gravity's coefficient counts as known",
        "chosen: one is then five errors off zero",
    )
    pieces: int = number(
        10,
        "1",
        "pieces of the recordings that it comes from",
        "chosen: each some seconds",
    )
    absent: float = number(
        0.2,
        "1",
        "coefficient below which gravity is not in the torque",
        "calibrated: within 0.05 on the shipped recordings; what the driver's own masses leave is "
        "allowed for",
    )
    present: float = number(
        0.75,
        "1",
        "and above which it is",
        "calibrated: whole torques of real logs have 0.84 to 1.48",
    )
    least_inertia: float = number(
        0.5,
        "1",
        "least coefficient of inertia of a torque without gravity",
        "calibrated: raw currents of a UR10e reach 0.07 to 0.2",
    )
    over_gravity: float = number(
        4.0,
        "1",
        "and times gravity's",
        "calibrated: a current or a percentage follows both as faintly",
    )
    faint: float = number(
        0.03,
        "1",
        "gravity's coefficient where motion is too slow to show inertia",
        "calibrated: raw currents of a UR10e follow it at 0.09 to 0.13",
    )
    motor_friction: float = number(
        0.05,
        "1",
        "friction's share of the torque (standard deviations) of a motor before its gear",
        "chosen: less is a torque at the link",
    )
    same: float = number(
        1e-09,
        "1",
        "how close to one effort and current correlate where one is made of the other",
        "law: rounding",
    )
    own_motion: tuple[float, ...] = number(
        (0.85, 0.95),
        "1",
        "share of a torque that the recorded motion explains: below the first others moved, above "
        "the second none did",
        "chosen: friction leaves some per cent",
    )
    large_share: float = number(
        0.99,
        "1",
        "share of samples below the torque that is held against the rating",
        "chosen: torques beyond it are short",
    )
    most_rated: float = number(
        5.0,
        "1",
        "times its rating that a torque reaches",
        "chosen: drives give two or three times it, other units lie at a hundred",
    )


USUAL_EFFORT = EffortSettings()
EFFORT_KIND = EffortKindSettings()
