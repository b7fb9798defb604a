"""Numbers that decide, each with its unit, its meaning and where it comes from: what of a
recording is motion, what is noise, and where friction is known.
"""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class MotionSettings(Numbers):
    """What of a recording is motion, for a fit."""

    slowest_corner_hz: float = number(
        0.2,
        "Hz",
        "slowest corner of the smoother that is tried",
        "chosen: no arm moves so slowly throughout",
    )
    fastest_corner_share: float = number(
        0.45,
        "1",
        "fastest one, as a share of the sampling rate",
        "law: half of it is the end",
    )
    band_stretch_s: float = number(
        2.0,
        "s",
        "stretches whose spectra are averaged",
        "chosen: resolves half a hertz",
    )
    slowest_band_hz: float = number(
        4.0,
        "Hz",
        "nothing is cut off below",
        "chosen: a slow cut would blur the ends of a run, and noise falls with the fifth power of "
        "the band",
    )
    caution: float = number(
        3.0,
        "1",
        "times that encoder noise counts against motion",
        "calibrated: another simulator's sessions; three beats one and seven",
    )
    noise_known_to: float = number(
        0.35,
        "1",
        "share of the sampling rate up to which the smoother's noise follows its formula",
        "law: the formula is of continuous time",
    )
    whole_share: float = number(
        0.8,
        "1",
        "of a joint's band, up to which its states are whole",
        "law: the cut keeps 99 % there, 1 / (1 + 0.8²⁰)",
    )
    lost_share: float = number(
        0.1,
        "1",
        "share of the torque's power that motion beyond the states' band may be, for torque to be "
        "looked at there",
        "chosen: less than noise varies",
    )
    cutoff_hz: float = number(
        10.0,
        "Hz",
        "corner of the common filter where none is asked for",
        "chosen: for a fit; above is ripple and structure",
    )
    cutoff_share: float = number(
        0.2,
        "1",
        "its largest share of the sampling rate",
        "law: a filter needs some samples a period",
    )
    oversampling: float = number(
        4.0,
        "1",
        "samples kept a period of the corner",
        "chosen: for a fit",
    )
    guard: float = number(
        2.0,
        "1",
        "corner of the filter before fast logs are decimated, in corners of the common one",
        "chosen: between them lies what columns may fold down",
    )
    least_factor: int = number(
        3,
        "1",
        "samples that must make way for one, or a log is left alone",
        "chosen: else nothing is won",
    )
    least_duration_s: float = number(
        1.0,
        "s",
        "least length of a run",
        "chosen: the filter's ends blur all of a shorter one",
    )
    least_samples: int = number(
        30,
        "1",
        "and its least samples",
        "chosen: the filter's ends blur all of fewer",
    )
    reversal_periods: float = number(
        1.0,
        "1",
        "time around a stop or turn that filter and smoother smear, in periods of their corner",
        "law: the reach of a fourth-order filter",
    )
    forgetting_travel: float = number(
        0.04,
        "rad or m",
        "travel after which friction does not depend on what was before the run",
        "chosen: beyond the presliding of gears",
    )
    presliding_travel: float = number(
        0.002,
        "rad or m",
        "travel behind a turn or stop within which contacts of gears bend before they slide",
        "chosen: twice the longest of gears, 0.05 to 1 mrad",
    )
    rest_deviations: float = number(
        3.0,
        "1",
        "standard deviations of its speed below which a joint may be at rest",
        "law: one in 400",
    )
    rest_speed: float = number(
        0.002,
        "rad/s or m/s",
        "and the least such speed",
        "chosen: beneath what anyone commands",
    )
    smoother: str = number(
        "fast",
        "word",
        "what smooths: fast, or filterpy, its reference",
        "law: the same numbers",
    )


@dataclass(frozen=True)
class DiagnosisMotionSettings(MotionSettings):
    """The same for a diagnosis."""

    cutoff_hz: float = number(
        25.0,
        "Hz",
        "corner of the common filter of a diagnosis",
        "chosen: as far as effects live",
    )
    oversampling: float = number(
        2.5,
        "1",
        "samples that it keeps a period of the corner",
        "chosen: whitened statistics want no more, or the whitening blows up what the stop band "
        "leaves",
    )


@dataclass(frozen=True)
class EncoderSettings(Numbers):
    """What encoders add to positions."""

    filter_order: int = number(
        10,
        "1",
        "order of the filter that cuts states off",
        "chosen: steep: what is half kept near the cut looks like elasticity",
    )
    padding_periods: float = number(
        3.0,
        "periods",
        "of the cut, by which a run is extended beyond its ends",
        "chosen: decides nothing",
    )
    fading_periods: float = number(
        2.0,
        "periods",
        "of the cut, over which states fade in",
        "chosen: decides nothing",
    )
    steps_share: float = number(
        0.98,
        "1",
        "share of small changes that are whole multiples where these are steps of a resolution",
        "chosen: nearly all",
    )
    whole_within: float = number(
        0.05,
        "1",
        "how near to a whole one a multiple is",
        "chosen: a twentieth",
    )
    most_steps: float = number(
        10.0,
        "1",
        "steps at once of which a remainder can be determined",
        "chosen: rounding of logs",
    )
    least_changes: int = number(
        20,
        "1",
        "changes that tell",
        "chosen: twenty",
    )
    least_step: float = number(
        1.0,
        "1",
        "standard deviations of the noise below which a step can't be distinguished from none",
        "chosen: one",
    )


USUAL_MOTION = MotionSettings()
FOR_DIAGNOSIS = DiagnosisMotionSettings()
ENCODER = EncoderSettings()
