"""Records of a comparison (`ident.comparison/1`).

What changed, at which joint, by how much; or why there are none.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ident.diagnosis.change.candidates import CARRIED
from ident.diagnosis.change.foretold import ForetoldJoint
from ident.diagnosis.change.name_changes import ToldChanges
from ident.diagnosis.change.risen_residual import RisenResidual
from ident.diagnosis.change.static_joints import SamplesUsed, StaticJoint
from ident.diagnosis.heldout_gain import ReportedEffect
from ident.diagnosis.reservations import Reservation
from ident.recordings.recording import TelemetryIssue
from ident.records import JsonRecord
from ident.regression.design import NotTestable
from ident.results import Result


@dataclass(frozen=True)
class Side:
    """Description of one of the two sets."""

    sessions: tuple[str, ...] = ()  # names of its sessions
    runs: int = 0  # number of runs
    samples: int = 0  # number of samples
    duration_s: float = 0.0  # duration of its runs together [s]
    # Of each session the load at the flange that was taken as known, 0 for none [kg].
    payload_kg: tuple[float, ...] = ()
    # Gravity in the base's frame by its first session [m/s²]; None for the URDF's.
    gravity_mps2: tuple[float, float, float] | None = None

    def to_dict(self) -> JsonRecord:
        """Its record for JSON: its fields, `gravity_mps2` None where it is not stated."""
        gravity = None if self.gravity_mps2 is None else list(self.gravity_mps2)
        lists = {"sessions": list(self.sessions), "payload_kg": list(self.payload_kg)}
        return {**vars(self), **lists, "gravity_mps2": gravity}


@dataclass(frozen=True, eq=False)
class ArmChange(ReportedEffect):
    """A change with its evidence.

    Parameters are after minus before, errors are those of the later set.
    """

    p_value: float  # of the change, corrected for the number of tests
    log_score: tuple[float, float]  # gain on held-out runs with its standard error [nats]
    evidence: float  # log evidence [nats]
    run_spread: float  # between-run standard deviation of the effect, as a share of the change

    @property
    def action(self) -> str:
        """What a person at the cell can do about it, with the other joints where it may be.

        Says so where it may be a load instead.
        """
        elsewhere = [effect for effect, _ in self.elsewhere]
        if self.effect != CARRIED and CARRIED in elsewhere:
            return f"{super().action}; or is it the tool? these recordings can't tell"
        return super().action

    def to_dict(self) -> JsonRecord:
        """Its record for JSON.

        Returns:
            What findings have, too (`shared_record`), `reasons`, `heldout` (errors of the later set
            by joint name [N m], `gain_rms_Nm`, `shrink`) and `evidence` (`p_value`,
            `log_score_gain` and its `log_score_error` [nats], `log_evidence` [nats], `run_spread`
            as a share).
        """
        return {
            **self.shared_record(),
            "reasons": [reason.to_dict() for reason in self.estimate.reasons],
            "heldout": {
                "rms_before_Nm": self.rms_before,
                "rms_after_Nm": self.rms_after,
                "gain_rms_Nm": self.gain,
                "shrink": self.shrink,
            },
            "evidence": {
                "p_value": self.p_value,
                "log_score_gain": self.log_score[0],
                "log_score_error": self.log_score[1],
                "log_evidence": self.evidence,
                "run_spread": self.run_spread,
            },
        }


@dataclass(frozen=True, eq=False)
class ArmComparison(Result):
    """The result of a comparison.

    Attributes:
        robot: Name of the robot.
        joints: Joint names.
        verdict: `no_change`, `changed`, `changed_unexplained`, `not_testable` or `refused`.
        sides: The earlier and the later set.
        telemetry: Issues of the telemetry checks of both.
        changes: Changes, in the order of the torque that they explain.
        rms_before, rms_after: Held-out error of the later set, without and with the changes, by
            joint [N m].
        noise: Floor of each joint's error [N m].
        run_spread: Between-run variation of friction, as a share.
        not_testable: Effects that these recordings cannot show, with the reason.
        reservations: Rejected changes, with the reason.
        cutoff: Corner of the common filter [Hz]; NaN where nothing was filtered.
        still: Joints that stood still in one of the sets.
        risen: Joints whose residual rose by no law.
        unforetold: Joints of which one set's model does not foretell the other.
        used: Use of each joint's samples.
        slides: Prismatic joints: units are N and m, whatever a key's name says.
        told: What the changes were told from; None where nothing was compared.
    """

    robot: str
    joints: tuple[str, ...]
    verdict: str
    sides: tuple[Side, Side] = (Side(), Side())
    telemetry: tuple[TelemetryIssue, ...] = ()
    changes: tuple[ArmChange, ...] = ()
    rms_before: dict[str, float] = field(default_factory=dict)
    rms_after: dict[str, float] = field(default_factory=dict)
    noise: dict[str, float] = field(default_factory=dict)
    run_spread: dict[str, float] = field(default_factory=dict)
    not_testable: tuple[NotTestable, ...] = ()
    reservations: tuple[Reservation, ...] = ()
    cutoff: float = np.nan
    still: tuple[StaticJoint, ...] = ()
    risen: tuple[RisenResidual, ...] = ()
    unforetold: tuple[ForetoldJoint, ...] = ()
    used: tuple[SamplesUsed, ...] = ()
    slides: tuple[str, ...] = ()
    told: ToldChanges | None = None

    def to_dict(self) -> JsonRecord:
        untestable = [entry.to_dict(self.joints) for entry in self.not_testable]
        return {
            "schema": "ident.comparison/1",
            "robot": self.robot,
            "joints": list(self.joints),
            **({"slides": list(self.slides)} if self.slides else {}),
            "before": self.sides[0].to_dict(),
            "after": self.sides[1].to_dict(),
            "telemetry": [issue.to_dict() for issue in self.telemetry],
            "verdict": self.verdict,
            "changes": [change.to_dict() for change in self.changes],
            "heldout": {
                "rms_before_Nm": self.rms_before,
                "rms_after_Nm": self.rms_after,
                "noise_Nm": self.noise,
            },
            "friction_run_spread": self.run_spread,
            "samples_used": [samples.to_dict() for samples in self.used],
            "not_testable": untestable,
            "still": [joint.to_dict() for joint in self.still],
            "unforetold": [joint.to_dict() for joint in self.unforetold],
            "risen": [joint.to_dict() for joint in self.risen],
            "reservations": [reservation.to_dict() for reservation in self.reservations],
            "provenance": self.provenance.to_dict(),
        }
