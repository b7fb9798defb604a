"""Faults put into real recordings are found; the true faults that real logs offer are, too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from faults import spoil, spoil_column

from ident.checks import inspect
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel

pytestmark = pytest.mark.real


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


def test_a_flipped_sign_is_found_on_every_joint(real: tuple[Session, ArmModel]) -> None:
    session, arm = real
    for joint, name in enumerate(arm.joint_names):
        (issue,) = inspect(spoil_column(session, "effort", joint, np.negative), arm).find("effort_sign_flipped")
        assert issue.joints == (name,)


def test_another_unit_is_no_torque(real: tuple[Session, ArmModel]) -> None:
    session, arm = real
    for scale in (0.1, 1000.0):
        report = inspect(spoil(session, lambda run, scale=scale: run.replace(effort=run.effort * scale)), arm)
        assert [issue.issue for issue in report.fatal] == ["effort_not_torque"]


def test_degrees_and_milliseconds_are_found(real: tuple[Session, ArmModel]) -> None:
    session, arm = real
    degrees = spoil(
        session, lambda run: run.replace(position=np.degrees(run.position), velocity=np.degrees(run.velocity))
    )
    assert [issue.issue for issue in inspect(degrees, arm).fatal] == ["units_degrees"]
    slow = spoil(session, lambda run: run.replace(time=1e3 * run.time))
    assert [issue.issue for issue in inspect(slow, arm).fatal] == ["wrong_time_base"]


def test_the_ur10e_controllers_own_model_is_no_measurement(real_data: Path, ur10e_model_toml: Path) -> None:
    """The last columns of its logs: at least five of six joints are told to be computed."""
    session = load_session(real_data / "ur10e/identification", session_file=ur10e_model_toml)
    report = inspect(session, ArmModel.load(real_data / "ur10e/ur10e.urdf"))
    (issue,) = report.fatal
    assert issue.issue == "effort_is_model"
    assert len(issue.joints) >= 5


def test_raw_currents_are_no_torque(real_data: Path, tmp_path: Path, ur10e_toml: Path) -> None:
    """The UR10e's currents, read as if they were effort."""
    settings = tmp_path / "session.toml"
    settings.write_text(ur10e_toml.read_text().replace("/current", "/effort").partition("[drive")[0])
    session = load_session(real_data / "ur10e/validation", session_file=settings)
    (issue,) = inspect(session, ArmModel.load(real_data / "ur10e/ur10e.urdf")).fatal
    assert issue.issue == "effort_not_torque"
    assert "drive_gain" in issue.remedy
