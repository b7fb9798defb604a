"""From sessions to a verdict: refusals, sessions that say too little, and the form of the answer."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ident.checks.inspection import inspect_sessions
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.from_reports import diagnose_reports
from ident.diagnosis.result import Diagnosis
from ident.effects.catalogue import find_effect
from ident.errors import RecordingError
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from tests.ident.diagnosis.contract import check_diagnosis
from tests.ident.diagnosis.planted import analyse, gain_on_2, load_arm

# Enough to see that a search takes place, few enough to be quick.
FEW = tuple(find_effect(name) for name in ("spring_torque", "torque_gain_error", "load_dependent_friction"))


@pytest.fixture(scope="module")
def shipped() -> Session:
    return load_session(Path(data_path("logs/tm5_900")) / "E1")


def judge(session: Session, arm: ArmModel) -> tuple[Diagnosis, Analysis | None]:
    diagnosis, analysis, _ = diagnose_reports(inspect_sessions([session], arm), arm, FEW)
    return diagnosis, analysis


def with_effort(session: Session, change: Callable[[np.ndarray], np.ndarray]) -> Session:
    return session.replace(runs=[run.replace(effort=change(np.array(run.effort))) for run in session.runs])


def test_a_single_pose_names_nothing(arm: ArmModel, shipped: Session) -> None:
    """Law: an arm that never moves has no name for its gap, even where its torque is 30 % off."""
    rng = np.random.default_rng(2)
    q = np.full((500, 6), 0.3)
    effort = 1.3 * arm.gravity(q)
    runs = [
        Recording(
            f"hold_{k}",
            arm.joint_names,
            20.0 * k + np.arange(500) / 50.0,
            q + 1e-5 * rng.standard_normal(q.shape),
            effort + 0.1 * rng.standard_normal(q.shape),
        )
        for k in range(5)
    ]
    diagnosis, _ = judge(shipped.replace(runs=runs), arm)
    record = check_diagnosis(diagnosis.to_dict())
    assert record["verdict"] == "not_testable"
    assert record["findings"] == []


def test_joints_must_agree_between_sessions(arm: ArmModel, shipped: Session) -> None:
    """Law: sessions of different joints aren't mixed; the error names the second."""
    fewer = shipped.replace(name="fewer", path=None, runs=[run.select(run.joints[:5]) for run in shipped.runs])
    reports = [*inspect_sessions([shipped], arm), *inspect_sessions([fewer], arm)]
    with pytest.raises(RecordingError, match="fewer"):
        diagnose_reports(reports, arm, FEW)


def test_the_answer_is_as_promised() -> None:
    """Law: keys and types of the JSON are the contract's, with a finding and without NaN."""
    record = check_diagnosis(analyse(load_arm(), gain_on_2, FEW).diagnosis.to_dict())
    assert [finding["effect"] for finding in record["findings"]] == ["torque_gain_error"]
    assert record["verdict"] == "named"
    assert record["joints"] == ["joint_1", "joint_2", "joint_3"]
    assert record["session"] == {"runs": 6, "samples": 2400, "duration_s": pytest.approx(6 * 7.98)}


def test_the_shipped_arm_has_a_friction_gap(arm: ArmModel, shipped: Session) -> None:
    """Bound: of E1 and E2 together, joint 2's gap is told to be friction that grows with the load, as was simulated."""
    other = load_session(Path(data_path("logs/tm5_900")) / "E2")
    diagnosis, analysis, motions = diagnose_reports(inspect_sessions([shipped, other], arm), arm, FEW)
    record = check_diagnosis(diagnosis.to_dict())
    assert analysis is not None
    assert len(motions) == record["session"]["runs"] == 10
    found = {(finding["effect"], joint) for finding in record["findings"] for joint in finding["joints"]}
    assert ("load_dependent_friction", "joint_2") in found


def flip_2(effort: np.ndarray) -> np.ndarray:
    effort[:, 1] *= -1.0
    return effort


def test_a_flipped_sign_is_refused(arm: ArmModel, shipped: Session) -> None:
    """Law: telemetry names the joint and the remedy, and nothing is fitted: no gap, no map, no names."""
    diagnosis, analysis = judge(with_effort(shipped, flip_2), arm)
    record = check_diagnosis(diagnosis.to_dict())
    assert analysis is None
    assert record["verdict"] == "refused"
    (issue,) = (one for one in record["telemetry"] if one["severity"] == "fatal")
    assert (issue["issue"], issue["joints"]) == ("effort_sign_flipped", ["joint_2"])
    assert "effort_sign" in issue["remedy"]
    assert record["gap"] == {}
    assert record["where"] == record["findings"] == []
