"""Records of a diagnosis (`ident.diagnosis/1`): joints' gaps, findings, reservations, details."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Float
from ident.diagnosis.baseline_record import TunedJoint
from ident.diagnosis.detection_limits import SizeLimit
from ident.diagnosis.gap.gap_map import Place, maps_record
from ident.diagnosis.gap.improvement import Improvement, spreads
from ident.diagnosis.heldout_gain import ReportedEffect
from ident.diagnosis.identified import IdentifiedNumbers
from ident.diagnosis.next_experiment import next_experiment
from ident.diagnosis.reservations import Reservation
from ident.diagnosis.saved import SavedParts
from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.diagnosis.tuned_links import TunedLink
from ident.effects.base import Effect
from ident.effects.catalogue import CATALOGUE
from ident.inference.conclusion import Named
from ident.recordings.recording import TelemetryIssue
from ident.records import JsonRecord
from ident.regression.design import NotTestable
from ident.results import ONE_RUN, Result
from ident.safe_read import read_record
from ident.units import FORCE

SCHEMA = "ident.diagnosis/1"


@dataclass(frozen=True, eq=False)
class Finding(ReportedEffect):
    """An accepted effect with its evidence.

    Attributes:
        evaluated: The effect with what was found of it.
        energy_before, energy_after: Mean energy error of a run at its joints, without and with it
            [J].
        energy_std: Standard deviations over the runs of both [J]; None for a single run.
        share: Its Shapley share of the gap that all effects close.
    """

    evaluated: Named
    energy_before: float
    energy_after: float
    energy_std: tuple[float | None, float | None]
    share: float

    @property
    def hidden_torque(self) -> dict[str, float]:
        """Torque of an absorbed effect that tuned inertias hide, by joint name [N m]; 0 of any
        other.
        """
        hidden = {}
        for joint, before in self.rms_before.items():
            closed = max(before**2 - self.rms_after[joint] ** 2, 0.0)
            hidden[joint] = self.evaluated.absorbed * float(np.sqrt(closed))
        return hidden

    def to_dict(self) -> JsonRecord:
        """Its record for JSON.

        Returns:
            What changes have, too (`shared_record`), `reasons`, `rivals` (odds by id), `heldout`
            (errors by joint name [N m], energy errors [J] and their standard deviations over the
            runs, `gain_rms_Nm`, `shrink`, `share`) and `evidence` (`log_score_gain` and its
            `log_score_error` [nats], `log_evidence` [nats], `judged_against`: `urdf` or `tuned`
            inertias).
        """
        return {
            **self.shared_record(),
            "reasons": [reason.to_dict() for reason in self.estimate.reasons],
            "rivals": dict(self.estimate.odds),
            "heldout": {
                "rms_before_Nm": self.rms_before,
                "rms_after_Nm": self.rms_after,
                "energy_error_before_J": self.energy_before,
                "energy_error_after_J": self.energy_after,
                **spreads(*self.energy_std),
                "gain_rms_Nm": self.gain,
                "shrink": self.shrink,
                "share": self.share,
            },
            "evidence": {
                "log_score_gain": self.evaluated.log_score[0],
                "log_score_error": self.evaluated.log_score[1],
                "log_evidence": self.evaluated.log_evidence,
                "judged_against": "urdf" if self.evaluated.absorbed else "tuned",
            },
        }


@dataclass(frozen=True)
class JointGap:
    """Errors of a joint: of the models, of the noise, and of the best function of the state.

    Attributes:
        rms: Held-out error of the tuned model [N m].
        fixed_rms: Held-out error with the URDF's inertias fixed [N m].
        noise_floor: Floor of any model's error [N m].
        ceiling_rms: Error that a flexible function of the state would leave beside the effects
            [N m].
        unexplained: Kind of inputs on which the residual depends beside the effects; None if on
            none.
        tuned_away: Torque that only inertias beyond the URDF's tolerance explain [N m].
        energy_error: Mean and standard deviation over the runs [J]; None for a single run.
        model_rms: Error of the user's own model [N m]; None without one.
        friction_spread: Standard deviation of its friction from stretch to stretch, as a share of
            the friction; None where that is not known.
        slides: Whether the joint is prismatic: units are N then.
    """

    rms: float
    fixed_rms: float
    noise_floor: float
    ceiling_rms: float
    unexplained: str | None
    tuned_away: float
    energy_error: tuple[float, float | None]
    model_rms: float | None = None
    friction_spread: float | None = None
    slides: bool = False

    def to_dict(self) -> JsonRecord:
        """Its record for JSON.

        Returns:
            `rms_Nm`, `fixed_rms_Nm`, `noise_floor_Nm`, `ceiling_rms_Nm`, `unexplained`,
            `tuned_away_Nm`, `energy_error_J` (`mean` and `std`; `std_missing` says why that is
            None), `unit` of a prismatic joint, `model_rms_Nm` with a model of the user's, and
            `friction_spread`.
        """
        mean, std = self.energy_error
        of_user_model = {} if self.model_rms is None else {"model_rms_Nm": self.model_rms}
        if self.friction_spread is not None:
            of_user_model["friction_spread"] = self.friction_spread
        return {
            **({"unit": FORCE} if self.slides else {}),
            "rms_Nm": self.rms,
            "fixed_rms_Nm": self.fixed_rms,
            "noise_floor_Nm": self.noise_floor,
            "ceiling_rms_Nm": self.ceiling_rms,
            "unexplained": self.unexplained,
            "tuned_away_Nm": self.tuned_away,
            "energy_error_J": {
                "mean": mean,
                "std": std,
                **({} if std is not None else {"std_missing": ONE_RUN}),
            },
            **of_user_model,
        }


@dataclass(frozen=True, eq=False)
class HeldOutGain:
    """Gain of all accepted effects together on held-out runs."""

    rms_before: Float[np.ndarray, " n"]  # error without them, joint by joint [N m]
    rms_after: Float[np.ndarray, " n"]  # error with them, joint by joint [N m]
    shrink: float  # share of the mean square above the noise that they close
    # Energy errors, a discrepancy in the effects' place, and the replayed motion.
    improvement: Improvement

    def to_dict(self, joints: Sequence[str]) -> JsonRecord:
        """Its record for JSON.

        Args:
            joints: Names of the arm's joints.

        Returns:
            `rms_before_Nm` and `rms_after_Nm` by joint name, `shrink` (a share), and the entries of
            `Improvement.to_dict`.
        """
        return {
            "rms_before_Nm": dict(zip(joints, map(float, self.rms_before), strict=True)),
            "rms_after_Nm": dict(zip(joints, map(float, self.rms_after), strict=True)),
            "shrink": self.shrink,
            **self.improvement.to_dict(joints),
        }


@dataclass(frozen=True, eq=False)
class Details:
    """Further results of a diagnosis, for pages and patches.

    Attributes:
        detectable: Detection limits of the effects that were not accepted.
        maps: All cells of the gap's map for the tuned model.
        maps_fixed: All cells for the model with the URDF's inertias fixed.
        baseline: Parameters of the baseline tuned beside the accepted effects, by joint.
        baseline_alone: Parameters of the baseline tuned without them.
        baseline_urdf: Parameters of the baseline with the URDF's inertias fixed.
        outside_score: Score from 0 to 1 of a cause outside the catalogue.
        leftover: For each joint the probability that a cause without a name is left there.
        tuned_links: Change of each link from the URDF by tuning, by link name.
        identified: The URDF's numbers beside those that the recordings say.
    """

    detectable: Sequence[SizeLimit]
    maps: Sequence[Place]
    maps_fixed: Sequence[Place]
    baseline: Mapping[str, TunedJoint]
    baseline_alone: Mapping[str, TunedJoint]
    baseline_urdf: Mapping[str, TunedJoint]
    outside_score: float
    leftover: Float[np.ndarray, " n"]
    tuned_links: Mapping[str, TunedLink]
    identified: IdentifiedNumbers

    def to_dict(self, names: Sequence[str]) -> JsonRecord:
        """Its record for JSON: the fields by their names, without `tuned_links`' undetermined
        figures.

        Args:
            names: Names of the arm's joints.
        """

        def by_joint(joints: Mapping[str, TunedJoint]) -> dict[str, JsonRecord]:
            return {name: joint.to_dict() for name, joint in joints.items()}

        return {
            "detectable": [limit.to_dict(names) for limit in self.detectable],
            "maps": maps_record(self.maps),
            "maps_fixed": maps_record(self.maps_fixed),
            "baseline": by_joint(self.baseline),
            "baseline_alone": by_joint(self.baseline_alone),
            "baseline_urdf": by_joint(self.baseline_urdf),
            "outside_score": self.outside_score,
            "leftover": dict(zip(names, map(float, self.leftover), strict=True)),
            "tuned_links": {name: link.to_dict() for name, link in self.tuned_links.items()},
            "identified": self.identified.to_dict(),
        }


class Exportable(Result):
    """A result whose effects can be exported to simulators."""

    def summary(self, details: bool = False) -> str:
        """The result in plain lines, as the command prints it; with `details` all of it."""
        shown = import_module("ident.show.results")
        lines = import_module("ident.show.diagnosis_lines")
        return str(
            shown.as_text(lambda console: lines.print_diagnosis(console, self.to_dict(), details))
        )

    def export(self, robot: Any, out: str | Path, **options: Any) -> Any:
        """Writes its effects for simulators as URDF, MJCF, parameters and a Python module.

        Args:
            robot: The arm, as `ident.patch` takes it.
            out: Where to write them.
            **options: As `ident.patch` takes them.

        Returns:
            What `ident.patch` returns.
        """
        return import_module("ident.api.exporting").patch(self.to_dict(), robot, out, **options)


@dataclass(frozen=True, eq=False)
class SavedDiagnosis(SavedParts, Exportable):
    """A diagnosis read from its file, with all that the diagnosis itself has to tell."""

    def to_dict(self) -> JsonRecord:
        return dict(self.record)


@dataclass(frozen=True, eq=False)
class Diagnosis(Exportable):
    """The result of a diagnosis: where the gap lies, its causes, how far they close it.

    Or why it was refused.
    Attributes:
        robot: Name of the robot.
        joints: Joint names.
        verdict: `no_gap`, `named`, `partial`, `none_of_catalogue`, `not_testable` or `refused`.
        session: Number of runs and samples, and duration.
        telemetry: Issues of the telemetry check.
        gap: Errors of each joint by name.
        where: Cells of the map in which the gap lies.
        findings: Accepted effects, those likelier than not first, and of these what closes most.
        heldout: Gain of all effects together; None if nothing was fitted.
        not_testable: Effects that these recordings cannot show, with the reason.
        reservations: Rejected effects, and other reasons to doubt.
        details: Further results; None if nothing was fitted.
        catalogue: The effects that were tested.
        settings: Thresholds and priors of all stages.
        robot_option: Argument of `--robot` for this robot.
        until: The sequence of diagnoses of which this is the last (`RepeatedLooks`), or None.
    """

    robot: str
    joints: tuple[str, ...]
    verdict: str
    session: Mapping[str, float]
    telemetry: tuple[TelemetryIssue, ...]
    gap: Mapping[str, JointGap] = field(default_factory=dict)
    where: tuple[Place, ...] = ()
    findings: tuple[Finding, ...] = ()
    heldout: HeldOutGain | None = None
    not_testable: tuple[NotTestable, ...] = ()
    reservations: tuple[Reservation, ...] = ()
    details: Details | None = None
    catalogue: tuple[Effect, ...] = CATALOGUE
    settings: DiagnosisSettings = USUAL
    robot_option: str = ""
    until: Any = None

    @staticmethod
    def load(path: str | Path) -> SavedDiagnosis:
        """The diagnosis in a file that `save`, or `ident diagnose --json`, wrote.

        Raises:
            InputError: There is no such file, or it holds no diagnosis.
        """
        remedy = "give the JSON of `ident diagnose`"
        return SavedDiagnosis(read_record(Path(path), SCHEMA, remedy))

    def to_dict(self) -> JsonRecord:
        findings = [finding.to_dict() for finding in self.findings]
        untestable = [entry.to_dict(self.joints) for entry in self.not_testable]
        loudest = self.where[0].joint if self.where else None
        advice = next_experiment(
            findings, untestable, self.catalogue, self.robot_option or self.robot, loudest
        )
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "joints": list(self.joints),
            "session": dict(self.session),
            "telemetry": [issue.to_dict() for issue in self.telemetry],
            "verdict": self.verdict,
            "gap": {name: self._gap_record(name, gap) for name, gap in self.gap.items()},
            "where": [place.to_dict() for place in self.where],
            "findings": findings,
            "heldout": {} if self.heldout is None else self.heldout.to_dict(self.joints),
            "not_testable": untestable,
            "reservations": [reservation.to_dict() for reservation in self.reservations],
            "next_experiment": advice,
            **({"identified": {}} if self.details is None else self.details.to_dict(self.joints)),
            "provenance": self.provenance.to_dict(),
            **({} if self.until is None else {"until": self.until.to_dict()}),
        }

    def _gap_record(self, joint: str, gap: JointGap) -> JsonRecord:
        """A joint's gap, with the errors of the URDF as loaded and of its rigid body [N m]."""
        record = gap.to_dict()
        if self.details is None:
            return record
        identified = self.details.identified
        if joint in identified.urdf_rms:
            record["urdf_rms_Nm"] = identified.urdf_rms[joint]
            record["rigid_body_rms_Nm"] = identified.rigid_rms[joint]
        return record
