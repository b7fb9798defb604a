"""All numbers that decide a verdict, stage by stage; a result records each by its name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.checks.filtered_run import USUAL_TELEMETRY, TelemetrySettings
from ident.diagnosis.gap.settings import USUAL_GAP, GapSettings
from ident.diagnosis.selection.settings import USUAL_SELECTION, SelectionSettings
from ident.motion.filter import FOR_DIAGNOSIS, MotionSettings
from ident.records import Settings
from ident.regression.posterior import Beside
from ident.regression.settings import USUAL_REGRESSION, RegressionSettings


class VerdictSettings(Settings, table="verdict"):
    """What the evidence amounts to."""

    def trust(self, law: Beside) -> float:
        """How far a law is believed at its joints.

        Odds grow with what it adds to the evidence of a flexible function, and with its gain over what the flexible
        function still finds beside it.

        Args:
            law: What it is worth beside a discrepancy.
        """
        beside = max(law.gain, 1.0) / max(law.left, 1e-3 * law.gain, 1.0)
        added = max(law.log_bayes_factor, 1.0) / self.trust_nats
        odds = added**self.trust_added * beside**self.trust_beside
        return float(odds / (1.0 + odds))

    def widening(self, law: Beside) -> float:
        """By how much a law's intervals widen for what a discrepancy still finds at its joints."""
        return 1.0 + self.widening_per_fold * float(np.log1p(max(law.left, 0.0)))


USUAL_VERDICT = VerdictSettings()


@dataclass(frozen=True)
class DiagnosisSettings(Settings):
    """Numbers that decide a verdict.

    Attributes:
        telemetry: What recordings are refused by: sign, scale and origin of the torque, and too little motion.
        motion: How recordings become motions: the encoders' band, the common filter, what is settled.
        regression: What the sums are made of, and what is known beforehand.
        selection: Which effects get a name.
        gap: Where the gap lies, what could explain it, how the motion nears.
        verdict: What it all amounts to.
    """

    telemetry: TelemetrySettings = USUAL_TELEMETRY
    motion: MotionSettings = FOR_DIAGNOSIS
    regression: RegressionSettings = USUAL_REGRESSION
    selection: SelectionSettings = USUAL_SELECTION
    gap: GapSettings = USUAL_GAP
    verdict: VerdictSettings = USUAL_VERDICT


USUAL = DiagnosisSettings()
