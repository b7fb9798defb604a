"""The numbers by which recordings are refused for their torque, and for too little motion."""

from __future__ import annotations

from dataclasses import dataclass

from ident.settings import Settings, number, read_group


@dataclass(frozen=True)
class EffortSettings(Settings, table="effort"):
    """Sign, scale and origin of the torque; logs are 17 of a UR10e, two of Pandas and one of a UR10."""

    moving_rad_s: float = number()
    static_Nm: float = number()
    sign_explains: float = number()
    sign_better: float = number()
    scale_low: float = number()
    scale_high: float = number()
    scale_off: float = number()
    heavy_share: float = number()
    heavy_Nm: float = number()
    follows: float = number()
    sure: float = number()
    pieces: int = number()
    friction_gain: float = number()
    rigid_explains: float = number()
    friction_share: float = number()


USUAL_EFFORT = EffortSettings()


@dataclass(frozen=True)
class ExcitationSettings(Settings, table="excitation"):
    """Whether there is motion enough."""

    largest_condition: float = number()
    least_travel: float = number()
    least_share: float = number()
    least_strokes: int = number()


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

# Thresholds of the single checks, an attribute each: `settings.toml` has their units, meanings and sources.
ANGLES = read_group(__file__, "angles")
CHANNELS = read_group(__file__, "channels")
CLOCK = read_group(__file__, "clock")
EFFORT_KIND = read_group(__file__, "effort_kind")
ARRANGEMENT = read_group(__file__, "arrangement")
