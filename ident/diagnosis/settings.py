"""Thresholds and priors of all stages of a diagnosis; a result records each by its name."""

from __future__ import annotations

from dataclasses import dataclass

from ident.checks.settings import USUAL_TELEMETRY, TelemetrySettings
from ident.diagnosis.gap.settings import USUAL_GAP, GapSettings
from ident.diagnosis.tolerance import USUAL_TOLERANCE, ToleranceSettings
from ident.motion.settings import FOR_DIAGNOSIS, MotionSettings
from ident.records import Numbers, number
from ident.regression.settings import USUAL_REGRESSION, RegressionSettings


@dataclass(frozen=True)
class VerdictSettings(Numbers):
    """What of a joint's error counts as loud, and as explained, for the map and the page."""

    loud: float = number(
        1.15,
        "1",
        "ratio of error to noise above which a joint has a gap without a finding",
        "chosen: a third of the mean square",
    )
    explained: float = number(
        0.8,
        "1",
        "share of a joint's reducible mean square that a name must close for the page to tell no "
        "other reason of it",
        "chosen: four fifths of it",
    )


@dataclass(frozen=True)
class TunedLinksSettings(Numbers):
    """Links whose tuned inertias are told."""

    factors: tuple[float, ...] = number(
        (3.0, 8.0, 20.0),
        "1",
        "factors on a URDF's usual error that are tried for one link",
        "chosen: up to 80 % of its own size",
    )
    least_nats: float = number(
        5.0,
        "nats",
        "least log odds that one link is off by more than the others, for each link",
        "law: odds of 150 to 1",
    )
    beyond: float = number(
        3.0,
        "1",
        "standard deviations of a usual URDF beyond which a link is wrong",
        "law: one in 400 of right links",
    )
    least_share: float = number(
        0.5,
        "1",
        "least share of a parameter's prior variance that the recordings must remove for it to be "
        "reported",
        "chosen: most of it",
    )
    unknown: float = number(
        100.0,
        "1",
        "factor on a URDF's usual standard deviation for a prior without information",
        "chosen: beyond the size of any link",
    )
    least_moment: float = number(
        0.001,
        "1",
        "share of mass x reach of all that turns with a joint, below which its moment is zero: "
        "gravity does not act on the joint",
        "chosen: a thousandth",
    )


@dataclass(frozen=True)
class LimitSettings(Numbers):
    """What these recordings could have shown."""

    nine_in_ten: float = number(
        1.2816,
        "1",
        "standard deviations by which the required gain must be exceeded for a probability of "
        "nine in ten",
        "law: the normal's 90 %",
    )
    proportion: float = number(
        0.05,
        "1",
        "largest deviation from proportionality between a parameter and its coefficients for "
        "which there is a limit",
        "chosen: a twentieth",
    )
    nothing: float = number(
        100.0,
        "1",
        "multiple of the largest plausible effect above which an effect is invisible",
        "chosen: beyond all tolerance",
    )
    response: int = number(
        4000,
        "1",
        "samples of the impulse response over which the variance of autoregressive noise is summed",
        "chosen: far beyond its memory",
    )


@dataclass(frozen=True)
class LookSettings(Numbers):
    """Looks at more and more runs."""

    first_runs: int = number(
        5,
        "1",
        "number of runs of the first look",
        "chosen: fewer cannot be left out whole",
    )
    growth: float = number(
        1.5,
        "1",
        "ratio of the numbers of runs of successive looks",
        "chosen: all looks together cost about three times the last",
    )


TUNED_LINKS = TunedLinksSettings()
DETECTION_LIMITS = LimitSettings()
LOOKS = LookSettings()
USUAL_VERDICT = VerdictSettings()


@dataclass(frozen=True)
class DiagnosisSettings(Numbers):
    """Thresholds and priors of all stages.

    Attributes:
        telemetry: The telemetry check: sign, scale and origin of the torque, and excitation.
        motion: From recordings to motions: the encoders' band and the common filter.
        regression: The sums and their priors.
        gap: Map, ceiling and replay of the gap.
        tolerance: When tuned inertias exceed the URDF's tolerance.
        verdict: From evidence to a verdict.
    """

    telemetry: TelemetrySettings = USUAL_TELEMETRY
    motion: MotionSettings = FOR_DIAGNOSIS
    regression: RegressionSettings = USUAL_REGRESSION
    gap: GapSettings = USUAL_GAP
    tolerance: ToleranceSettings = USUAL_TOLERANCE
    verdict: VerdictSettings = USUAL_VERDICT


USUAL = DiagnosisSettings()
