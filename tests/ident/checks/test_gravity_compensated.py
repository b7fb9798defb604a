"""Laws of efforts that gravity was taken out of, by the driver or by session.toml's word."""

from pathlib import Path

import numpy as np
import pytest

from ident.errors import RecordingError
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from tests.ident.checks.faults import inspect, spoil, without_velocity
from tests.ident.made_up import joint, link, urdf

LOGS = Path(__file__).parents[3] / "logs/tm5_900"


def compensated(session: Session, arm: ArmModel) -> Session:
    """As a driver logs it that takes gravity out."""
    return spoil(session, lambda run: run.replace(effort=run.effort - arm.gravity(run.position)))


@pytest.mark.parametrize("velocity", [True, False])
def test_gravity_that_was_taken_out_is_found_and_put_back(clean: Session, arm: ArmModel, velocity: bool) -> None:
    """Neither another unit nor another time base: the torque comes back to rounding."""
    session = clean if velocity else without_velocity(clean)
    report = inspect(compensated(session, arm), arm)
    assert [(one.issue, one.severity) for one in report.issues] == [("effort_gravity_compensated", "warning")]
    assert {one.kind for one in report.effort} == {"gravity_compensated"}
    for before, after in zip(session.runs, report.session.runs, strict=True):
        np.testing.assert_allclose(after.effort, before.effort, atol=1e-9)


def test_the_payload_is_in_the_gravity_that_is_added() -> None:
    session, arm = load_session(LOGS / "payload_1544g"), ArmModel.load("tm5-900")
    report = inspect(compensated(session, arm.with_payload(session.payload)), arm)
    assert [one.issue for one in report.issues] == ["effort_gravity_compensated"]
    np.testing.assert_allclose(report.session.runs[0].effort, session.runs[0].effort, atol=1e-9)


def test_a_spring_that_carries_the_arm_is_not_gravity_taken_out(clean: Session, arm: ArmModel) -> None:
    """It hides gravity on its own joint; the others show it."""
    sprung = spoil(clean, lambda run: run.replace(effort=run.effort - (np.arange(6) == 1) * arm.gravity(run.position)))
    assert not inspect(sprung, arm).find("effort_gravity_compensated")


def test_an_arm_that_gravity_does_not_load_is_not_judged(clean: Session) -> None:
    """Vertical axes only: nothing tells whether gravity is in the effort, and nothing is said."""
    scara = ArmModel.from_urdf(
        urdf(
            link("base"),
            link("link_1"),
            link("link_2"),
            joint("turn_1", "base", "link_1").replace("0.4 -0.7 1.1", "0 0 1.1"),
            joint("turn_2", "link_1", "link_2").replace("0.4 -0.7 1.1", "0 0 1.1"),
        )
    )

    def turned(run: Recording) -> Recording:
        q, dq = run.position[:, :2], np.asarray(run.velocity)[:, :2]
        ddq = np.gradient(dq, run.time, axis=0)
        noise = 0.02 * np.random.default_rng(1).normal(size=q.shape)
        tau = scara.inverse_dynamics(q, dq, ddq) + 0.5 * np.tanh(dq / 0.01) + 0.8 * dq + noise
        return Recording(run.name, scara.joint_names, run.time, q, tau, velocity=dq)

    session = Session("scara", tuple(turned(run) for run in clean.runs))
    assert np.abs(scara.gravity(session.runs[0].position)).max() < 1e-9
    report = inspect(session, scara)
    assert not report.find("effort_gravity_compensated")
    assert "gravity_compensated" not in {one.kind for one in report.effort}


def test_session_toml_says_so_where_the_motion_cannot(clean: Session, arm: ArmModel, tmp_path: Path) -> None:
    """Added once: the mended session says that gravity is in its effort now."""
    whole, folder = clean.replace(runs=clean.runs[:2]), tmp_path / "said"
    write_session(compensated(whole, arm), folder)
    (folder / "session.toml").write_text('effort_kind = "gravity_compensated"\n')
    report = inspect(load_session(folder), arm)
    (issue,) = report.find("effort_gravity_compensated")
    assert issue.severity == "warning"
    assert "session.toml says" in issue.evidence
    report.mend(tmp_path / "mended")
    again = inspect(load_session(tmp_path / "mended"), arm)
    assert not again.find("effort_gravity_compensated")
    np.testing.assert_allclose(again.session.runs[0].effort, whole.runs[0].effort, atol=1e-9)


def test_session_toml_has_the_last_word_against_a_guess(clean: Session, arm: ArmModel) -> None:
    said = compensated(clean, arm).replace(effort_kind="joint_torque")
    assert not inspect(said, arm).find("effort_gravity_compensated")


def test_gravity_that_is_there_is_not_added_again(clean: Session, arm: ArmModel) -> None:
    report = inspect(clean.replace(effort_kind="gravity_compensated"), arm)
    assert [(one.issue, one.severity) for one in report.issues] == [("effort_gravity_compensated", "fatal")]


def test_an_unknown_kind_is_refused(clean: Session, tmp_path: Path) -> None:
    write_session(clean.replace(runs=clean.runs[:1]), tmp_path / "session")
    (tmp_path / "session/session.toml").write_text('effort_kind = "gravity"\n')
    with pytest.raises(RecordingError, match=r"effort_kind = 'gravity'.*write"):
        load_session(tmp_path / "session")
