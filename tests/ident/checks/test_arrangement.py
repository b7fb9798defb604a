"""Laws of which way gravity pulls on a base, and of where a URDF's bodies lie."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ident.checks.arrangement import check_bodies
from ident.checks.inspection import inspect_alone as found
from ident.checks.inspection import inspect_sessions
from ident.checks.report import REPORTED_BY_A_FIT, as_mounted, overrule, require_same_mount
from ident.command_options import FitOptions
from ident.errors import RecordingError
from ident.fitting.fit import fit_hybrid
from ident.model.hybrid import HybridModel
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from ident.robot.chain import compute_joint_poses
from ident.sessions import open_sessions
from tests.ident.checks.mounts import angle_between, mounted
from tests.ident.checks.real_arms import REAL, load_real
from tests.ident.made_up import joint, link, made_session, urdf

GRAVITY = np.array([0.0, 0.0, -9.81])
Vector = tuple[float, float, float] | None


def require_mounts(session: Session, arm: ArmModel, turns: int = 30) -> None:
    """Orientations of the base, by chance: gravity is found within 3°, and nothing is refused for it."""
    as_it_is = found(session, arm)
    assert not as_it_is.find("mounting")
    for turn in Rotation.random(turns, random_state=np.random.RandomState(7)):
        report = found(session, arm.with_gravity(turn.apply(GRAVITY)))
        # A mount is proposed, and nothing else is refused for it.
        assert {issue.issue for issue in report.fatal} <= {issue.issue for issue in as_it_is.fatal} | {"mounting"}
        # A tilt below 20° as it is measured is for a diagnosis to find.
        assert report.find("mounting") or angle_between(turn.apply(GRAVITY), GRAVITY) < 23.0
        for issue in report.find("mounting"):
            assert angle_between(np.array(report.session.gravity), GRAVITY) < 3.0
            assert "gravity_mps2 = [" in issue.remedy


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("degrees", [6.0, 14.0, 24.0, 80.0])
def test_no_turn_of_the_base_is_refused_as_anything_else(
    degrees: float, axis: str, session: Session, arm: ArmModel
) -> None:
    """Joint 1 of an upright arm then has a gravity torque in the model, and none in its recording."""
    report = found(session, arm.with_gravity(Rotation.from_euler(axis, degrees, degrees=True).apply(GRAVITY)))
    assert {issue.issue for issue in report.fatal} <= ({"mounting"} if degrees > 20.0 else set())


def test_a_mount_is_read_from_joints_that_move(session: Session, arm: ArmModel) -> None:
    """Friction holds a joint that stands still: whichever torque it shows there turns no base."""
    run = session.runs[0]
    still = run.replace(name="still", position=run.position[::-1], velocity=np.zeros_like(run.position))
    held = np.arange(len(run)) // 200 * 200
    still = still.replace(position=still.position[held], effort=run.effort[held] + 15.0 * np.sign(run.position[held]))
    turned, issues = mounted(session.replace(runs=[*session.runs, still]), arm.with_gravity([9.81, 0.0, 0.0]))
    assert issues
    assert angle_between(np.array(turned.model.gravity.linear), GRAVITY) < 3.0


def test_a_planar_arm_with_a_spring_stands_as_it_stands() -> None:
    """Law: gravity out of a planar arm's plane only scales its torque, and none is turned that has its own size."""
    places = zip("ab", ("base", "upper"), ("upper", "fore"), strict=True)
    joints = [joint(*place, axis="0 1 0", turn="0 0 0") for place in places]
    links = [link("base"), link("upper", 3.4, "0.16 0.01 0", 0.04), link("fore", 1.9, "0.13 0 0")]
    arm = ArmModel.from_urdf(urdf(*links, *joints))
    spring = np.array([0.3, 0.0])
    law = lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq) + spring * q + 0.8 * np.tanh(dq / 0.01)  # noqa: E731
    made = made_session(arm, law, [3, 4], duration=20.0)
    assert not mounted(made, arm)[1]
    turned, issues = mounted(made, arm.with_gravity([9.81, 0.0, 0.0]))
    assert issues
    along, across, down = turned.model.gravity.linear
    assert angle_between(np.array([along, 0.0, down]), GRAVITY) < 3.0
    assert abs(across) < 0.25 * abs(down)  # 14 degrees out of the plane are 3 % of the torque


def test_stated_gravity_stands(session: Session, arm: ArmModel) -> None:
    """Law: gravity that session.toml states is used, and doubted where the torque follows another."""
    report = found(session.replace(gravity=(9.81, 0.0, 0.0)), arm)
    assert report.session.gravity == (9.81, 0.0, 0.0)
    (issue,) = report.find("mounting")
    assert "session.toml's is used" in issue.evidence
    assert not found(session.replace(gravity=(0.0, 0.0, -9.81)), arm).find("mounting")


@pytest.mark.real
@pytest.mark.parametrize("turns", [6, pytest.param(30, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", REAL)
def test_gravity_is_found_however_a_real_base_is_mounted(
    name: str, turns: int, real_data: Path, request: pytest.FixtureRequest
) -> None:
    if name == "dual arm":
        reason = "one of thirty turns is read as gravity that is compensated"
        request.applymarker(pytest.mark.xfail(reason=reason))
    require_mounts(*load_real(name, real_data), turns)


@pytest.mark.real
@pytest.mark.parametrize("towards", [20.0, 140.0, 260.0])
@pytest.mark.parametrize("degrees", [12.0, 18.0, 26.0])
def test_a_likelier_mount_spares_a_torque(degrees: float, towards: float, real_data: Path) -> None:
    """Law: joint 1 of an upright arm shows none of the gravity torque that a tilt would give it; not
    the torque, but the tilt is wrong, however little it gains at the other joints.
    """
    axis = Rotation.from_euler("z", towards, degrees=True).apply([1.0, 0.0, 0.0])
    tilt = Rotation.from_rotvec(np.radians(degrees) * axis)
    session, arm = load_real("ur10", real_data)
    report = found(session, arm.with_gravity(tilt.apply(GRAVITY)))
    assert {issue.issue for issue in report.fatal} <= {"mounting"}


def test_a_model_of_an_arm_on_a_wall_keeps_its_gravity(session: Session, arm: ArmModel, tmp_path: Path) -> None:
    """session.toml's gravity, or the one that was found, goes with the session, the model, and what it is tested on."""
    write_session(session.replace(gravity=(0.0, 0.0, -9.81)), tmp_path / "session")
    again = load_session(tmp_path / "session")
    assert again.gravity == (0.0, 0.0, -9.81)
    opened = open_sessions(again, arm.with_gravity([9.81, 0.0, 0.0]))
    np.testing.assert_allclose(opened.arm.model.gravity.linear, GRAVITY)
    with pytest.raises(RecordingError, match="gravity_mps2"):
        open_sessions(session, arm.with_gravity([9.81, 0.0, 0.0]))
    wall = open_sessions(session, arm.with_gravity([9.81, 0.0, 0.0]), accept=["mounting"])
    model = fit_hybrid(wall.motions, wall.arm, FitOptions(links=6, inertia="nominal", net="none"), []).model
    model.save(tmp_path / "model")
    loaded = HybridModel.load(tmp_path / "model")
    np.testing.assert_allclose(loaded.arm.model.gravity.linear, wall.arm.model.gravity.linear)
    assert angle_between(np.array(wall.arm.model.gravity.linear), GRAVITY) < 3.0


STANDING = (0.0, 0.0, -9.81)
HANGING = (0.0, 0.0, 9.81)


@pytest.mark.parametrize(
    ("first", "later", "refused"),
    [
        (None, STANDING, False),
        (STANDING, (0.0, 0.0, -9.80665), False),
        (STANDING, None, False),
        (None, HANGING, True),
        (STANDING, HANGING, True),
        (STANDING, (0.1, 0.0, -9.81), True),
    ],
)
def test_sessions_that_are_used_together_have_one_mount(
    first: Vector, later: Vector, refused: bool, session: Session, arm: ArmModel
) -> None:
    """Law: a later session that says another mount than the first, or than the URDF, is refused in one line that
    names both; one that says nothing is mounted as the first.
    """
    sessions = [session.replace(gravity=first), session.replace(name="later", path=None, gravity=later)]
    if not refused:
        require_same_mount(as_mounted(arm, sessions[0]), *sessions)
        return
    with pytest.raises(RecordingError, match=rf"later.*gravity_mps2 = .*{session.name}"):
        inspect_sessions(sessions, arm)


@pytest.mark.parametrize("robot", ["tm5-900", "panda", "ur10", "z1"])
def test_bodies_in_the_frame_of_the_base_are_refused_as_such(robot: str, session: Session) -> None:
    """A diagnosis refuses such a URDF and blames no torque; a fit, which finds the bodies, goes on."""
    arm = ArmModel.load(robot)
    poses = compute_joint_poses(arm.chain, np.zeros((1, arm.n)), range(1, arm.n + 1))
    links = np.array(arm.inertial_parameters.reshape(arm.n, 10))
    links[:, 1:4] += links[:, :1] * np.concatenate([place for _, place in poses.values()])
    assert not check_bodies(session, arm)
    assert len(check_bodies(session, arm.with_inertial_parameters(links.ravel()))[0].joints) > 1
    if robot == "tm5-900":
        report = found(session, arm.with_inertial_parameters(links.ravel()))
        assert [issue.issue for issue in report.fatal] == ["bodies_misplaced"]
        assert not overrule(report, (), REPORTED_BY_A_FIT).fatal
