"""Laws of angles by another convention: told with their joint; sound sessions, and other faults,
hold none."""

from collections.abc import Callable

import numpy as np
import pytest
from conftest import make_run
from faults import inspect, spoil, without_velocity

from ident.checks.angle_readings import check_angle_readings
from ident.checks.filtered_run import USUAL_EFFORT
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path

Change = Callable[[Recording], Recording]


@pytest.fixture(scope="module")
def five(arm: ArmModel) -> Session:
    """Five sound runs of 8 s."""
    rng = np.random.default_rng(23)
    return Session("five", tuple(make_run(arm, rng, f"run{k}", 20.0 * k, 8.0) for k in range(5)))


def mixed(mixture: np.ndarray) -> Change:
    """Positions and velocities of all joints by a linear map, shape (n, n)."""

    def change(run: Recording) -> Recording:
        channels = {"position": run.position @ mixture.T}
        if run.velocity is not None:
            channels["velocity"] = run.velocity @ mixture.T
        return run.replace(**channels)

    return change


def scaled(joint: int, factor: float) -> Change:
    """One joint's angle in another unit, its velocity too."""
    mixture = np.eye(6)
    mixture[joint, joint] = factor
    return mixed(mixture)


def from_the_base(joint: int, sign: float) -> Change:
    """One joint's angle with the angle of the joint before."""
    mixture = np.eye(6)
    mixture[joint, joint - 1] = sign
    return mixed(mixture)


@pytest.mark.parametrize(("joint", "factor"), [(1, 2.0), (2, 2.0), (1, 0.5), (2, 3.0)])
def test_a_scaled_angle_is_told_with_its_factor(joint: int, factor: float, five: Session, arm: ArmModel) -> None:
    """Law: whatever the factor, and the session is read by it afterwards."""
    spoilt = spoil(five, scaled(joint, factor))
    read, (issue,) = check_angle_readings(spoilt, arm, USUAL_EFFORT)
    assert (issue.issue, issue.severity) == ("angle_scale", "fatal")
    assert issue.joints == (arm.joint_names[joint],)
    told = float(issue.evidence.partition(" is ")[2].partition(" times")[0])
    assert told == pytest.approx(factor, rel=0.1)
    size = np.ptp(read.runs[0].position[:, joint]) / np.ptp(five.runs[0].position[:, joint])
    assert size == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_angle_from_the_base_is_told(sign: float, five: Session, arm: ArmModel) -> None:
    """Law: of a parallelogram, in either direction; and no other fault is told beside it."""
    report = inspect(spoil(five, from_the_base(2, sign)), arm)
    told = [(issue.issue, issue.joints) for issue in report.fatal]
    assert told == [("angle_coupled", ("joint_3",))]
    assert ("minus" if sign > 0.0 else "plus") in report.fatal[0].evidence


def test_a_doubled_angle_alone_is_told_without_velocities(five: Session, arm: ArmModel) -> None:
    """Law: in a whole inspection, where nothing but the positions shows it."""
    report = inspect(without_velocity(spoil(five, scaled(1, 2.0))), arm)
    told = [(issue.issue, issue.joints) for issue in report.fatal]
    assert told == [("angle_scale", ("joint_2",))]


def turned_effort(run: Recording) -> Recording:
    return run.replace(effort=-run.effort)


def reversed_axis(run: Recording) -> Recording:
    sign = np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0])
    return run.replace(position=sign * run.position, effort=sign * run.effort)


def shifted_zero(angle: float) -> Change:
    shift = np.array([0.0, angle, 0.0, 0.0, 0.0, 0.0])
    return lambda run: run.replace(position=run.position + shift)


def slow_clock(run: Recording) -> Recording:
    return run.replace(time=2.0 * run.time, velocity=None)


OTHER_FAULTS = {
    "efforts of the other sign": turned_effort,
    "a reversed axis": reversed_axis,
    "a zero by a quarter turn": shifted_zero(np.pi / 2),
    "a zero that is off": shifted_zero(0.3),
    "a clock at half its speed": slow_clock,
}


@pytest.mark.parametrize("fault", OTHER_FAULTS.values(), ids=OTHER_FAULTS)
def test_other_faults_are_not_taken_for_it(fault: Change, five: Session, arm: ArmModel) -> None:
    """Law: signs, axes, zeros and clocks of the whole log are other checks'."""
    assert check_angle_readings(spoil(five, fault), arm, USUAL_EFFORT)[1] == []


def test_a_torque_without_gravity_is_not_taken_for_it(five: Session, arm: ArmModel) -> None:
    def compensated(run: Recording) -> Recording:
        return run.replace(effort=run.effort - arm.gravity(run.position))

    assert check_angle_readings(spoil(five, compensated), arm, USUAL_EFFORT)[1] == []


def test_a_joint_that_follows_multiples_of_its_angle_is_not_taken_for_it(five: Session, arm: ArmModel) -> None:
    """Law: what a joint's own torque alone says is its transmission's, not its angle's."""

    def rippled(run: Recording) -> Recording:
        effort = np.array(run.effort)
        effort[:, 1] += 20.0 * np.sin(2.0 * run.position[:, 1])
        return run.replace(effort=effort)

    assert check_angle_readings(spoil(five, rippled), arm, USUAL_EFFORT)[1] == []


@pytest.mark.parametrize("name", ["E1", "E2", "T1", "payload_1544g", "sealed_1", "sealed_3"])
def test_angles_as_they_were_recorded_stand(name: str) -> None:
    session = load_session(data_path(f"logs/tm5_900/{name}"))
    assert check_angle_readings(session, ArmModel.load("tm5-900"), USUAL_EFFORT)[1] == []
