"""The numbers by which recordings become motions: smoothing, the encoders' band, the common filter, what is settled."""

from __future__ import annotations

from dataclasses import dataclass

from ident.settings import Settings, number


@dataclass(frozen=True)
class MotionSettings(Settings, table="motion"):
    """What of a recording is motion, what is noise, and where friction is known; the usual ones are those of a fit."""

    slowest_corner_hz: float = number()
    fastest_corner_share: float = number()
    band_stretch_s: float = number()
    slowest_band_hz: float = number()
    caution: float = number()
    noise_known_to: float = number()
    whole_share: float = number()
    cutoff_hz: float = number()
    cutoff_share: float = number()
    oversampling: float = number()
    guard: float = number()
    least_factor: int = number()
    least_duration_s: float = number()
    least_samples: int = number()
    reversal_periods: float = number()
    forgetting_travel: float = number()
    rest_deviations: float = number()
    rest_speed: float = number()
    smoother: str = number()


USUAL_MOTION = MotionSettings()
FOR_DIAGNOSIS = MotionSettings(cutoff_hz=25.0, oversampling=2.5)
