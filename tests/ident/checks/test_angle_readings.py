"""Laws of angles by another convention: told with their joint by the search of all conventions; sound
sessions, mounts and other faults hold none.
"""

from collections.abc import Callable

import numpy as np
import pytest
from conftest import make_run
from faults import inspect, spoil
from scipy.spatial.transform import Rotation

from ident.checks.conventions.find import log_of
from ident.checks.conventions.model import Model
from ident.checks.inspection import inspect_alone as found
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from tests.ident.made_up import joint, link, made_session, urdf

ISSUES = ("angle_scale", "angle_coupled")
Change = Callable[[Recording], Recording]


@pytest.fixture(scope="module")
def five(arm: ArmModel) -> Session:
    """Five sound runs of 8 s."""
    rng = np.random.default_rng(23)
    runs = [make_run(arm, rng, f"run{k}", 20.0 * k, 8.0) for k in range(5)]
    return Session("five", tuple(runs))


def mixed(mixture: np.ndarray) -> Change:
    """Positions and velocities of all joints by a linear map, shape (n, n)."""

    def change(run: Recording) -> Recording:
        channels = {"position": run.position @ mixture.T}
        if run.velocity is not None:
            channels["velocity"] = run.velocity @ mixture.T
        return run.replace(**channels)

    return change


def scaled(joint: int, factor: float) -> Change:
    """One joint's angle times a factor, its velocity too."""
    mixture = np.eye(6)
    mixture[joint, joint] = factor
    return mixed(mixture)


def from_the_link_before(joint: int, sign: float) -> Change:
    """One joint's angle with the angle of the joint before."""
    mixture = np.eye(6)
    mixture[joint, joint - 1] = sign
    return mixed(mixture)


@pytest.mark.parametrize(("joint", "factor"), [(1, 2.0), (2, 2.0), (1, 0.5), (2, 0.5)])
def test_a_scaled_angle_is_told(joint: int, factor: float, five: Session, arm: ArmModel) -> None:
    """Law: with its factor, alone, and the session is read by it afterwards."""
    report = inspect(spoil(five, scaled(joint, factor)), arm)
    told = [(issue.issue, issue.joints) for issue in report.fatal]
    assert told == [("angle_scale", (arm.joint_names[joint],))]
    assert f"is {factor:.3g} times the joint's" in report.fatal[0].evidence
    size = np.ptp(report.session.runs[0].position[:, joint])
    assert size == pytest.approx(np.ptp(five.runs[0].position[:, joint]), rel=0.05)


@pytest.mark.parametrize(("joint", "sign"), [(2, 1.0), (2, -1.0)])
def test_an_angle_from_the_link_before_the_last_is_told(joint: int, sign: float, five: Session, arm: ArmModel) -> None:
    """Law: of a parallelogram, in either direction; and no other fault is told beside it."""
    report = inspect(spoil(five, from_the_link_before(joint, sign)), arm)
    told = [(issue.issue, issue.joints) for issue in report.fatal]
    assert told == [("angle_coupled", (arm.joint_names[joint],))]
    assert ("read minus" if sign > 0.0 else "read plus") in report.fatal[0].evidence
    read, sound = report.session.runs[0].position, five.runs[0].position
    np.testing.assert_allclose(np.ptp(read, axis=0), np.ptp(sound, axis=0), rtol=0.05)


def test_what_is_seen_and_not_sure_is_compared_and_nothing_else_is_told(five: Session, arm: ArmModel) -> None:
    """Law: a wrist lifts little; its angle's other convention is the likeliest reading, no other is."""
    report = inspect(spoil(five, from_the_link_before(3, 1.0)), arm)
    likeliest = report.to_dict()["conventions"][0]["hypothesis"]
    assert likeliest == {"share_of_joint_before": {"joint_4": -1}}
    assert {issue.issue for issue in report.fatal} <= {"angle_coupled"}


def test_joints_after_a_parallel_one_are_found(arm: ArmModel) -> None:
    """Law: of the arm's six axes the second to the fourth are parallel."""
    assert Model(arm).after_parallel == (2, 3)


@pytest.mark.parametrize("degrees", [8.0, 15.0, 30.0, 90.0])
@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_mount_is_no_angle(degrees: float, axis: str, five: Session, arm: ArmModel) -> None:
    """Law: gravity's direction is compared with it in one search."""
    turned = Rotation.from_euler(axis, degrees, degrees=True).apply([0.0, 0.0, -9.81])
    report = inspect(five, arm.with_gravity(turned))
    assert not [issue for issue in report.issues if issue.issue in ISSUES]


def shifted_zero(angle: float) -> Change:
    shift = np.array([0.0, angle, 0.0, 0.0, 0.0, 0.0])
    return lambda run: run.replace(position=run.position + shift)


def rippled(run: Recording) -> Recording:
    """What a joint's own torque alone says of a multiple of its angle is its transmission's."""
    effort = np.array(run.effort)
    effort[:, 1] += 20.0 * np.sin(2.0 * run.position[:, 1])
    return run.replace(effort=effort)


OTHER_FAULTS: dict[str, Change] = {
    "efforts of the other sign": lambda run: run.replace(effort=-run.effort),
    "a zero by a quarter turn": shifted_zero(np.pi / 2),
    "a zero that is off": shifted_zero(0.3),
    "a ripple of twice the angle": rippled,
    "a clock at half its speed": lambda run: run.replace(time=2.0 * run.time, velocity=None),
}


@pytest.mark.parametrize("fault", OTHER_FAULTS.values(), ids=OTHER_FAULTS)
def test_other_faults_are_not_taken_for_it(fault: Change, five: Session, arm: ArmModel) -> None:
    report = inspect(spoil(five, fault), arm)
    assert not [issue for issue in report.issues if issue.issue in ISSUES]


@pytest.mark.parametrize("name", ["E1", "T1", "payload_1544g", "sealed_1", "sealed_3"])
def test_angles_as_they_were_recorded_stand(name: str) -> None:
    session = load_session(data_path(f"logs/tm5_900/{name}"))
    assert log_of(session) is not None
    report = inspect(session, ArmModel.load("tm5-900"))
    assert not [issue for issue in report.issues if issue.issue in ISSUES]


@pytest.mark.parametrize("size", [0.2, 1.0])
@pytest.mark.parametrize("with_velocity", [False, True])
def test_a_slide_in_millimetres_is_told_by_the_urdfs_limits(size: float, with_velocity: bool) -> None:
    """Law: farther or faster than a slide may by nearer to a thousand than to one is millimetres; metres are none."""
    bounds = '<limit lower="-0.4" upper="0.4" effort="300" velocity="0.6"/>'
    turn = joint("turn", "base", "arm", axis="0 1 0")
    slide = joint("lift", "arm", "quill", "prismatic", "0 0 1", bounds)
    arm = ArmModel.from_urdf(urdf(link("base"), link("arm", 4.0), link("quill", 2.0), turn, slide))

    def law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        small = [1.0, 0.3 * size]
        return arm.inverse_dynamics(q * small, dq * small, ddq * small) + 5.0 * np.tanh(dq / 0.01)

    made = made_session(arm, law, [1, 2, 3], duration=15.0)
    runs = []
    for run in made.runs:
        metres = run.position * [1.0, 0.3 * size]
        velocity = np.gradient(metres, run.time, axis=0) if with_velocity else None
        runs.append(run.replace(position=metres, velocity=velocity))
    sound = made.replace(runs=runs)
    per_metre = np.array([1.0, 1000.0])
    long = []
    for run in runs:
        velocity = None if run.velocity is None else run.velocity * per_metre
        long.append(run.replace(position=run.position * per_metre, velocity=velocity))
    assert not found(sound, arm).find("units_degrees")
    (issue,) = found(made.replace(runs=long), arm).find("units_degrees")
    assert issue.severity == "fatal"
    assert issue.joints == ("lift",)
    assert "slide_scale = {lift = 0.001}" in issue.remedy
