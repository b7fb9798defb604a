"""All numbers that decide a verdict, stage by stage; a result records each by its name."""

from __future__ import annotations

from dataclasses import dataclass

from ident.checks.settings import USUAL_TELEMETRY, TelemetrySettings
from ident.diagnosis.gap.settings import USUAL_GAP, GapSettings
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
    half_trust_share: float = number(
        0.3,
        "1",
        "a law's part of all that can be explained at its joints at which it is believed by half",
        "calibrated: semi-real sessions",
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

    def trust(self, share: float) -> float:
        """How far a law is believed that makes up a share of what can be explained at its joints: odds ∝ share's²."""
        odds = lambda one: (one / max(1.0 - one, 1e-6)) ** 2  # noqa: E731
        return odds(share) / (odds(share) + odds(self.half_trust_share))


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
