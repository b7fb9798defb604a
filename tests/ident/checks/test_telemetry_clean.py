"""Healthy recordings raise no alarm: neither made-up nor real ones."""

import json
from pathlib import Path

import numpy as np
import pytest
from faults import inspect, spoil_column

from ident.checks.inspection import inspect_sessions
from ident.checks.report import TelemetryReport
from ident.errors import InputError, RecordingError
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.recordings.save import write_recording, write_session
from ident.robot.arm import ArmModel

HARMLESS = {"jitter", "clock_restarts", "joints_renamed"}


def alarms(report: TelemetryReport) -> set[str]:
    return {issue.issue for issue in report.issues} - HARMLESS


@pytest.mark.parametrize("velocity", [True, False])
@pytest.mark.parametrize("model", [True, False])
def test_a_clean_session_is_clean(clean: Session, arm: ArmModel, velocity: bool, model: bool) -> None:
    session = clean if velocity else clean.replace(runs=[run.replace(velocity=None) for run in clean.runs])
    report = inspect(session, arm if model else None)
    assert report.issues == ()
    assert report.is_fit
    assert report.require_fit() is report
    for before, after in zip(session.runs, report.session.runs, strict=True):
        np.testing.assert_array_equal(before.position, after.position)
        np.testing.assert_array_equal(before.time, after.time)


def test_one_long_run_is_enough(clean: Session, arm: ArmModel) -> None:
    assert inspect(clean.replace(runs=clean.runs[:1]), arm).issues == ()


def test_inertias_and_friction_that_are_off_are_no_fault_of_the_telemetry(clean: Session, arm: ArmModel) -> None:
    """A model 30 % too light: the torque's scale is reported, with masses as a cause, and nothing is refused."""
    lighter = arm.with_inertial_parameters(0.7 * np.array(arm.inertial_parameters))
    report = inspect(clean, lighter)
    assert report.is_fit
    assert {issue.issue for issue in report.issues} == {"torque_scale"}


def test_coarse_channels_are_healthy(clean: Session, arm: ArmModel) -> None:
    """Torque in steps of 1 N m, positions of a 13-bit encoder."""
    step = 2.0 * np.pi / 2**13

    def coarse(run: Recording) -> Recording:
        return run.replace(effort=np.round(run.effort), position=np.round(run.position / step) * step)

    assert alarms(inspect(clean.replace(runs=[coarse(run) for run in clean.runs]), arm)) == set()


def test_rest_is_healthy(clean: Session, arm: ArmModel) -> None:
    """Standing still for seconds repeats positions; that is no stuck encoder."""

    def rests(run: Recording) -> Recording:
        hold = np.minimum(np.arange(len(run)), len(run) - 400)
        still = (np.arange(len(run)) < len(run) - 400)[:, None]
        # Braked gently: the last samples' speed fades out.
        noise = 0.3 * np.random.default_rng(0).normal(size=run.effort.shape)
        return run.replace(
            position=run.position[hold], velocity=None, effort=np.where(still, run.effort, run.effort[hold] + noise)
        )

    assert alarms(inspect(clean.replace(runs=[rests(run) for run in clean.runs]), arm)) == set()


@pytest.mark.real
@pytest.mark.parametrize("folder", ["identification", "jointwise", "validation"])
@pytest.mark.parametrize("velocity", [True, False])
def test_the_ur10e_logs_are_clean_but_for_real_jitter(
    folder: str, velocity: bool, real_data: Path, ur10e_toml: Path
) -> None:
    """Intervals of 2 to 30 ms are reported; positions show that the stamps are right, so they stay as they are.

    Where the arm stops, single samples of current are wild (264 N m between −6 and −3): that is reported, too. So is
    the elbow's gain, which the literature has a third too large for this arm.
    """
    session = load_session(real_data / "ur10e" / folder, session_file=ur10e_toml)
    if not velocity:
        session = session.replace(runs=[run.replace(velocity=None) for run in session.runs])
    arm = ArmModel.load(real_data / "ur10e/ur10e.urdf")
    loaded = [run.name for run in session.runs if "load_2600" in run.name]
    if loaded:  # the one run with a load among those without is told, and nothing else is
        (told,) = inspect(session, arm).fatal
        assert told.issue == "runs_differ"
        assert f"{loaded[0]}:" in told.evidence
        session = session.replace(runs=[run for run in session.runs if run.name not in loaded])
    report = inspect(session, arm)
    assert alarms(report) <= {"effort_spike", "torque_scale"}
    (scale,) = report.find("torque_scale")
    assert scale.joints == ("elbow_joint",)
    (jitter,) = report.find("jitter")
    assert jitter.severity == "note"
    np.testing.assert_array_equal(report.session.runs[0].time, session.runs[0].time)


def scaled_joints(report: TelemetryReport) -> set[str]:
    return {joint for issue in report.find("torque_scale") for joint in issue.joints}


@pytest.mark.real
def test_the_pandas_and_the_ur10_are_clean(real_data: Path, sapienza: Session) -> None:
    """But for joints whose torque is not their URDF's gravity: of two Pandas' the third and fourth, a UR10's elbow.

    One of the Pandas carries no hand, which its URDF has.
    """
    sessions = {
        "panda": [sapienza, load_session(real_data / "panda/unisa_fer/panda_exciting_trajectory.db3")],
        "ur10": [load_session(real_data / "ur10_cb/ur10_exciting_trajectory.db3")],
    }
    for robot, recordings in sessions.items():
        for session in recordings:
            report = inspect(session, ArmModel.load(robot))
            assert alarms(report) <= {"torque_scale", "body_differs"}, session.name
            expected = {"elbow_joint"} if robot == "ur10" else {"panda_joint3", "panda_joint4"}
            if report.find("body_differs"):
                assert session is sapienza
                assert not scaled_joints(report)
            else:
                assert expected <= scaled_joints(report) <= expected | {"panda_joint2"}, session.name
            assert report.session.joints == ArmModel.load(robot).joint_names


@pytest.fixture(scope="module", params=["ur10e", "panda", "panda bag", "ur10 bag"])
def real(request: pytest.FixtureRequest, real_data: Path, ur10e_toml: Path) -> tuple[Session, ArmModel]:
    """A real session and its robot."""
    if request.param == "ur10e":
        session = load_session(real_data / "ur10e/identification/ur-20_02_10-30sec_12harm.csv", session_file=ur10e_toml)
        return session, ArmModel.load(real_data / "ur10e/ur10e.urdf")
    if request.param == "panda":
        return request.getfixturevalue("sapienza"), ArmModel.load("panda")
    if request.param == "panda bag":
        return load_session(real_data / "panda/unisa_fer/panda_exciting_trajectory.db3"), ArmModel.load("panda")
    return load_session(real_data / "ur10_cb/ur10_exciting_trajectory.db3"), ArmModel.load("ur10")


@pytest.mark.real
def test_a_flipped_sign_is_found_on_every_joint(real: tuple[Session, ArmModel]) -> None:
    session, arm = real
    for joint, name in enumerate(arm.joint_names):
        (issue,) = inspect(spoil_column(session, "effort", joint, np.negative), arm).find("effort_sign_flipped")
        assert issue.joints == (name,)


def test_the_report_is_json_with_the_worst_first(clean: Session, arm: ArmModel) -> None:
    session = spoil_column(clean, "effort", 0, np.negative)
    session = spoil_column(session, "position", 3, lambda q: np.where(np.arange(len(q)) == 444, q + 5.0, q))
    data = json.loads(json.dumps(inspect(session, arm).to_dict()))
    assert [issue["severity"] for issue in data["telemetry"]] == ["fatal", "note"]
    assert set(data["telemetry"][0]) == {"issue", "joints", "severity", "evidence", "remedy"}
    assert (data["fit"], data["runs"], data["joints"]) == (False, 5, list(arm.joint_names))


def test_bad_cells_are_refused_by_name_and_mended_on_request(clean: Session, arm: ArmModel, tmp_path: Path) -> None:
    """One line names file, line and column; the mended copy is the session without that row, and is accepted."""
    write_session(clean, tmp_path / "session")
    path = tmp_path / "session/run0.parquet"
    write_recording(clean.runs[0], path.with_suffix(".csv"))
    path.unlink()
    lines = path.with_suffix(".csv").read_text().splitlines()
    cells = lines[100].split(",")
    lines[100] = ",".join([cells[0], "O.5", *cells[2:]])
    path.with_suffix(".csv").write_text("\n".join(lines))
    report = inspect(load_session(tmp_path / "session"), arm)
    with pytest.raises(InputError, match=r"run0.csv, line 101, column joint_1/position: 'O.5'") as caught:
        report.require_fit()
    assert "\n" not in str(caught.value)
    assert "--mend" in caught.value.remedy
    report.mend(tmp_path / "mended")
    again = inspect(load_session(tmp_path / "mended"), arm)
    assert again.issues == ()
    assert again.session.samples == clean.samples - 1


def test_sessions_together_need_the_same_joints(clean: Session, arm: ArmModel) -> None:
    fewer = clean.replace(runs=[run.select(arm.joint_names[:5]) for run in clean.runs])
    with pytest.raises(RecordingError, match="other joints"):
        inspect_sessions([clean, fewer], arm)


def test_another_robots_joints_are_refused(clean: Session) -> None:
    with pytest.raises(RecordingError, match="none of the robot's"):
        inspect(clean, ArmModel.load("ur10"))
