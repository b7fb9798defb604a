"""Thresholds and priors of all stages of a diagnosis; a result records each by its name."""

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
    """Thresholds of the verdict, and the discount of probabilities by a discrepancy."""

    def trust(self, law: Beside) -> float:
        """Factor on the probability of an effect, from the evidence of a discrepancy at its joints.

        With ΔL the log Bayes factor that the law adds to a discrepancy, G the law's gain alone and R what a discrepancy
        still gains beside it, the odds are (ΔL / `trust_nats`)^`trust_added` (G / R)^`trust_beside`.

        Args:
            law: Evidence of the law beside a discrepancy.
        """
        beside = max(law.gain, 1.0) / max(law.left, 1e-3 * law.gain, 1.0)
        added = max(law.log_bayes_factor, 1.0) / self.trust_nats
        odds = added**self.trust_added * beside**self.trust_beside
        return float(odds / (1.0 + odds))

    def widening(self, law: Beside) -> float:
        """Factor on the widths of a law's intervals, from what a discrepancy still explains at its joints."""
        return 1.0 + self.widening_per_fold * float(np.log1p(max(law.left, 0.0)))


USUAL_VERDICT = VerdictSettings()


@dataclass(frozen=True)
class DiagnosisSettings(Settings):
    """Thresholds and priors of all stages.

    Attributes:
        telemetry: The telemetry check: sign, scale and origin of the torque, and excitation.
        motion: From recordings to motions: the encoders' band and the common filter.
        regression: The sums and their priors.
        selection: Acceptance of effects.
        gap: Map, ceiling and replay of the gap.
        verdict: From evidence to a verdict.
    """

    telemetry: TelemetrySettings = USUAL_TELEMETRY
    motion: MotionSettings = FOR_DIAGNOSIS
    regression: RegressionSettings = USUAL_REGRESSION
    selection: SelectionSettings = USUAL_SELECTION
    gap: GapSettings = USUAL_GAP
    verdict: VerdictSettings = USUAL_VERDICT


USUAL = DiagnosisSettings()
