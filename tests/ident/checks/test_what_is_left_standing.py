"""Laws of order: no check judges rows or columns that an earlier one condemned, and one cause is told once."""

from collections.abc import Callable

import numpy as np
import pytest
from faults import freeze_rows, inspect, spoil, spoil_column, without_velocity

from ident.checks.channels import stuck_positions
from ident.checks.inspection import check_rows
from ident.checks.report import TelemetryReport
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel


def found(report: TelemetryReport) -> dict[str, str]:
    """Severity of each issue by its name."""
    return {issue.issue: issue.severity for issue in report.issues}


def with_limits(arm: ArmModel, effort: float, velocity: float, room: bool = True) -> ArmModel:
    """The arm with other limits in its URDF."""
    model = arm.model.copy()
    model.effortLimit = np.full(arm.n, effort)
    model.velocityLimit = np.full(arm.n, velocity)
    if not room:
        model.lowerPositionLimit, model.upperPositionLimit = np.zeros(arm.n), np.zeros(arm.n)
    return ArmModel(arm.name, arm.urdf, model, arm.joint_names)


def frozen_effort(share: float) -> Callable[[Recording], Recording]:
    """The effort of a controller that shows it for a share of the time only: zero before, its last value after."""

    def change(run: Recording) -> Recording:
        first = int(0.5 * (1.0 - share) * len(run))
        last = len(run) - first
        effort = np.array(run.effort)
        effort[:first] = 0.0
        effort[last:] = effort[last - 1]
        return run.replace(effort=effort)

    return change


@pytest.mark.parametrize("share", [0.8, 0.6, 0.45])
def test_frozen_efforts_are_left_out_and_nothing_else_is_said_of_them(
    share: float, clean: Session, arm: ArmModel
) -> None:
    report = inspect(spoil(clean, frozen_effort(share)), arm)
    assert report.is_fit
    assert {issue.issue for issue in report.issues} <= {"stuck_channel", "time_gap"}
    assert report.session.samples == pytest.approx(share * clean.samples, rel=0.05)


def test_where_all_is_frozen_nothing_is_judged(clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil(clean, lambda run: run.replace(effort=freeze_rows(run.effort, 5, len(run) - 1))), arm)
    assert [issue.issue for issue in report.fatal] == ["stuck_channel"]
    assert not report.effort


@pytest.mark.parametrize("channel", ["position", "effort", "velocity"])
def test_no_check_of_rows_is_moved_by_rows_that_an_earlier_one_dropped(
    channel: str, clean: Session, arm: ArmModel
) -> None:
    """Law: what is reported and kept is the same whatever stands in the cells that the first check condemns."""
    kept = []
    for value in (1e13, -1e14, 1e30):

        def wild(values: np.ndarray, value: float = value) -> np.ndarray:
            return np.where(np.arange(len(values)) % 400 == 7, value, values)

        session, issues = check_rows(spoil_column(clean, channel, 2, wild, run=1), arm)
        kept.append((session, [(issue.issue, issue.joints) for issue in issues]))
    for session, issues in kept[1:]:
        assert issues == kept[0][1]
        for run, other in zip(session.runs, kept[0][0].runs, strict=True):
            np.testing.assert_array_equal(run.position, other.position)
            np.testing.assert_array_equal(run.effort, other.effort)


@pytest.mark.parametrize(("effort", "velocity", "room"), [(0.0, 0.0, False), (1.0, 1.0, True), (1.0, 0.0, False)])
@pytest.mark.parametrize("has_velocity", [True, False])
def test_placeholders_are_no_limits(
    effort: float, velocity: float, room: bool, has_velocity: bool, clean: Session, arm: ArmModel
) -> None:
    """Law: what an exporter writes where nobody gave a limit condemns neither clock nor torque."""
    session = clean if has_velocity else without_velocity(clean)
    report = inspect(session, with_limits(arm, effort, velocity, room))
    assert report.is_fit
    assert set(found(report)) == ({"urdf_limits"} if 1.0 in (effort, velocity) else set())


@pytest.mark.parametrize("velocity", [0.9, 0.6, 0.4])
def test_a_limit_of_speed_that_is_too_low_is_the_urdfs_fault(velocity: float, clean: Session, arm: ArmModel) -> None:
    """Law: at a clock that a velocity, or inertia, confirms the limit is wrong."""
    slow = with_limits(arm, 300.0, velocity)
    for session in (clean, without_velocity(clean)):
        report = inspect(session, slow)
        assert report.is_fit
        assert set(found(report)) <= {"urdf_limits"}


@pytest.mark.parametrize("speed", [8.0, 20.0, 40.0])
def test_a_fast_arm_is_neither_in_degrees_nor_parted(speed: float) -> None:
    """Law: small, direct-drive and falling arms may turn faster than any industrial one."""
    time = np.arange(0.0, 20.0, 0.004)
    rate = 2.0 * np.pi * 0.8
    position = np.column_stack([speed / rate * np.sin(rate * time + k) for k in range(2)])
    effort = np.column_stack([np.cos(position[:, k]) + 0.1 * np.cos(rate * time + k) for k in range(2)])
    session = Session("fast", (Recording("run", ("a", "b"), time, position, effort),))
    kept, issues = check_rows(session, None)
    assert not [issue for issue in issues if issue.issue in ("units_degrees", "garbage_cells", "time_gap")]
    assert kept.samples == session.samples


def test_an_encoder_that_stands_while_the_arm_stands_is_not_stuck(clean: Session) -> None:
    """Law: an arm that waits and starts again with a step has no frozen encoder; one joint among moving ones has."""
    run = clean.runs[0]
    held = freeze_rows(run.position, 300, 420)
    held[421:] += held[420] - run.position[420] + 0.3
    waits = run.replace(position=held, velocity=None)
    assert not stuck_positions(waits).any()
    alone = np.array(run.position)
    alone[:, 2] = held[:, 2]
    assert stuck_positions(run.replace(position=alone, velocity=None))[:, 2].any()


@pytest.mark.parametrize("step", [5, 8, 13])
def test_slow_sampling_is_told_with_what_is_lost(step: int, clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil(clean, lambda run: run.at(slice(None, None, step))), arm)
    rate = 125.0 / step
    assert bool(report.find("slow_sampling")) == (rate < 27.0)
    for issue in report.find("slow_sampling"):
        assert f"{rate:.3g} samples a second" in issue.evidence


@pytest.mark.parametrize("sign", [-1.0, 0.0])
def test_inertias_that_no_body_has_are_named(sign: float, clean: Session, arm: ArmModel) -> None:
    """Law: the link is named, and its mass and centre are used all the same."""
    parameters = np.array(arm.inertial_parameters).reshape(arm.n, 10)
    parameters[2, 4:] = 0.0
    centre = parameters[2, 1:4] / parameters[2, 0]
    parallel = parameters[2, 0] * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    about = parallel + np.diag([sign * 0.2, sign * 0.2, 0.4])
    parameters[2, 4:] = about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    report = inspect(clean, arm.with_inertial_parameters(parameters.ravel()))
    (issue,) = report.find("urdf_inertia")
    assert issue.joints == (arm.joint_names[2],)
    assert issue.severity == ("warning" if sign < 0.0 else "note")
