"""All numbers that decide a verdict, stage by stage; a result records each by its name."""

from __future__ import annotations

from dataclasses import dataclass

from ident.checks.settings import USUAL_TELEMETRY, TelemetrySettings
from ident.diagnosis.gap.settings import USUAL_GAP, GapSettings
from ident.diagnosis.regression.posterior import Beside
from ident.diagnosis.regression.settings import USUAL_REGRESSION, RegressionSettings
from ident.diagnosis.selection.settings import USUAL_SELECTION, SelectionSettings
from ident.motion.settings import FOR_DIAGNOSIS, MotionSettings
from ident.settings import Settings, number


@dataclass(frozen=True)
class VerdictSettings(Settings):
    """What the evidence amounts to."""

    named_from: float = number(
        0.8, "1", "and from which on the names tell the whole story", "chosen: four fifths of it"
    )
    even_odds: float = number(
        0.5,
        "1",
        "least probability of a name for part of a gap to have a cause of the catalogue",
        "law: more likely than not",
    )
    trust_nats: float = number(
        150.0,
        "nats",
        "log Bayes factor beside a discrepancy, of a law that explains as much as the discrepancy, believed by half",
        "calibrated: 178 names given to 132 semi-real sessions",
    )
    trust_exponents: tuple[float, float] = number(
        (0.9, 0.68),
        "1",
        "growth of the odds with that factor, and with the law's gain over what the discrepancy still sees",
        "calibrated: likewise, by logistic regression",
    )
    least_believed: float = number(
        0.1, "1", "a name believed less, beside a discrepancy, is none", "chosen: one in ten is no cause to look at"
    )
    least_gap_share: float = number(
        0.06,
        "1",
        "share of its mean square that can be explained from which on a joint has a gap",
        "calibrated: early development sets",
    )
    noise_margin: float = number(
        1.08,
        "1",
        "error on other runs over what all candidates together leave of runs that they were fitted on",
        "calibrated: early development sets",
    )
    stands_out: float = number(
        1.35,
        "1",
        "error over innovation, in units of the middle joint's, that is unexplained",
        "calibrated: early development sets",
    )
    much_left: float = number(
        1.8,
        "1",
        "mean square over the noise's, and over that of the middle joint, that is unexplained",
        "calibrated: of 150 healthy arms of drawn worlds none came beyond 1.75",
    )
    far_left: float = number(2.5, "1", "the same, whatever the other joints have", "calibrated: early development sets")
    loud: float = number(
        1.15, "1", "error over noise from which on a gap speaks for itself", "chosen: a third of the mean square"
    )

    def trust(self, law: Beside) -> float:
        """How far a law is believed beside a discrepancy at its joints.

        Odds grow with what it adds to the evidence of a flexible function, and with its part of what can be explained.
        """
        of_nats, of_share = self.trust_exponents
        gained = (max(law.log_bayes_factor, 1.0) / self.trust_nats) ** of_nats
        odds = gained * (law.gain / max(law.left, 1e-3 * law.gain, 1e-9)) ** of_share
        return odds / (1.0 + odds)


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
