"""Thresholds and priors of all stages of a diagnosis; a result records each by its name."""

from __future__ import annotations

from dataclasses import dataclass

from ident.checks.filtered_run import USUAL_TELEMETRY, TelemetrySettings
from ident.diagnosis.gap.settings import USUAL_GAP, GapSettings
from ident.diagnosis.tolerance import USUAL_TOLERANCE, ToleranceSettings
from ident.motion.settings import FOR_DIAGNOSIS, MotionSettings
from ident.records import Settings
from ident.regression.settings import USUAL_REGRESSION, RegressionSettings


class VerdictSettings(Settings, table="verdict"):
    """What of a joint's error counts as loud, and as explained, for the map and the page."""


USUAL_VERDICT = VerdictSettings()


@dataclass(frozen=True)
class DiagnosisSettings(Settings):
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
