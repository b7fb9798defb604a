"""Every fault is found under its name, on its joint, and nothing else is claimed; what is safe is mended."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from faults import freeze_rows, spoil, spoil_column, without_velocity

from ident.checks import TelemetryReport, inspect, inspect_sessions
from ident.checks.channels import stuck_positions
from ident.checks.settings import EffortSettings, ExcitationSettings, TelemetrySettings
from ident.errors import RecordingError
from ident.recordings.recording import Payload, Recording, Session
from ident.robot.arm import ArmModel


def found(report: TelemetryReport) -> dict[str, str]:
    return {issue.issue: issue.severity for issue in report.issues}


def assert_refused(report: TelemetryReport, issue: str, joints: tuple[str, ...] | None = None) -> None:
    """That one issue, fatal, on these joints."""
    assert found(report) == {issue: "fatal"}
    if joints is not None:
        assert report.issues[0].joints == joints
    assert any(character.isdigit() for character in report.issues[0].evidence)
    with pytest.raises(RecordingError, match=issue):
        report.require_fit()


@pytest.mark.parametrize("joint", range(6))
def test_a_flipped_sign_is_found_on_every_joint(joint: int, clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil_column(clean, "effort", joint, np.negative), arm)
    assert_refused(report, "effort_sign_flipped", (f"joint_{joint + 1}",))
    assert f"joint_{joint + 1} = -1" in report.issues[0].remedy


def test_a_flipped_convention_is_found_on_all_joints(clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil(clean, lambda run: run.replace(effort=-run.effort)), arm)
    assert_refused(report, "effort_sign_flipped", arm.joint_names)


def test_a_refusal_obeys_the_settings_that_it_was_given(clean: Session, arm: ArmModel) -> None:
    """Law: where more is asked than any torque explains, no sign is called flipped; where nothing is motion enough,

    clean recordings are too little.
    """
    flipped = spoil(clean, lambda run: run.replace(effort=-run.effort))
    (report,) = inspect_sessions([flipped], arm, TelemetrySettings(effort=EffortSettings(sign_explains=1.0)))
    assert "effort_sign_flipped" not in found(report)
    asked = TelemetrySettings(excitation=ExcitationSettings(least_travel=100.0))
    (report,) = inspect_sessions([clean], arm, asked)
    assert found(report) == {"insufficient_excitation": "fatal"}


SCALES = {
    "current": np.array([12.0, 12.0, 10.0, 8.0, 8.0, 8.0]),
    "per cent": np.array([3.0, 3.0, 2.0, 0.5, 0.5, 0.5]),
    "N mm": np.full(6, 1e-3),
}


@pytest.mark.parametrize("unit", SCALES)
def test_another_unit_is_no_torque(unit: str, clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil(clean, lambda run: run.replace(effort=run.effort / SCALES[unit])), arm)
    assert_refused(report, "effort_not_torque")
    assert "drive_gain" in report.issues[0].remedy


def test_one_joint_in_amperes_is_found(clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil_column(clean, "effort", 1, lambda tau: tau / 12.0), arm)
    assert_refused(report, "effort_not_torque", ("joint_2",))


def test_swapped_torques_are_told_by_their_joints(clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil(clean, lambda run: run.replace(effort=run.effort[:, [1, 0, 2, 3, 4, 5]])), arm)
    assert_refused(report, "columns_swapped", ("joint_1", "joint_2"))


def test_a_computed_torque_is_told_from_a_measured_one(clean: Session, arm: ArmModel) -> None:
    """No friction in it; noise of the measured velocity it is computed from does not hide that."""

    def computed(run):  # type: ignore[no-untyped-def]
        ddq = np.gradient(run.velocity, run.time, axis=0)
        return run.replace(effort=arm.inverse_dynamics(run.position, run.velocity, ddq))

    assert_refused(inspect(spoil(clean, computed), arm), "effort_is_model", arm.joint_names)


def test_a_command_is_no_measurement(clean: Session, arm: ArmModel) -> None:
    same = spoil(clean, lambda run: run.replace(effort_command=run.effort, position_command=run.position))
    assert found(inspect(same, arm)) == {"effort_is_model": "fatal", "position_is_command": "warning"}
    near = spoil(clean, lambda run: run.replace(effort_command=run.effort + 0.1, position_command=run.position + 1e-4))
    assert found(inspect(near, arm)) == {}


def test_a_declared_payload_belongs_to_the_model(clean: Session, arm: ArmModel) -> None:
    payload = Payload(4.0, (0.0, 0.0, 0.1))
    report = inspect(clean.replace(payload=payload), arm)
    assert report.arm is not None
    assert report.arm.inertial_parameters[50] == pytest.approx(arm.inertial_parameters[50] + 4.0)


def test_wraps_are_taken_out(clean: Session, arm: ArmModel) -> None:
    """The unwrapped positions differ from the true ones by whole turns, the same for a run."""
    away = spoil_column(clean, "position", 0, lambda q: q + 3.2)
    wrapped = spoil_column(away, "position", 0, lambda q: (q + np.pi) % (2 * np.pi) - np.pi)
    report = inspect(wrapped, arm)
    assert found(report) == {"position_wraps": "note"}
    for true, mended in zip(away.runs, report.session.runs, strict=True):
        turns = (mended.position - true.position) / (2 * np.pi)
        np.testing.assert_allclose(turns - np.round(turns[0]), 0.0, atol=1e-9)


@pytest.mark.parametrize("model", [True, False])
@pytest.mark.parametrize("velocity", ["degrees", "radians", "none"])
def test_degrees_are_found(velocity: str, model: bool, clean: Session, arm: ArmModel) -> None:
    session = spoil(clean, lambda run: run.replace(position=np.degrees(run.position)))
    if velocity == "degrees":
        session = spoil(session, lambda run: run.replace(velocity=np.degrees(run.velocity)))
    elif velocity == "none":
        session = without_velocity(session)
    report = inspect(session, arm if model else None)
    assert_refused(report, "units_degrees", arm.joint_names)
    assert "angle_unit" in report.issues[0].remedy


def test_velocities_in_degrees_are_converted(clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil(clean, lambda run: run.replace(velocity=np.degrees(run.velocity))), arm)
    assert found(report) == {"units_degrees": "note"}
    np.testing.assert_allclose(report.session.runs[0].velocity, clean.runs[0].velocity)


@pytest.mark.parametrize("factor", [1e3, 0.5, 0.9, 1.1, 2.0])
def test_a_wrong_time_base_is_found_by_the_velocity(factor: float, clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil(clean, lambda run: run.replace(time=run.time * factor)), arm)
    assert_refused(report, "wrong_time_base")
    assert "125 Hz" in report.issues[0].evidence


@pytest.mark.parametrize("factor", [1.1e9, 1.1e6, 1e3, 4.0, 3.0, 0.25])
def test_a_grossly_wrong_time_base_is_found_without_velocity(factor: float, clean: Session, arm: ArmModel) -> None:
    """By the unit of time, by inertia against gravity, or by speeds beyond the robot's limits."""
    report = inspect(without_velocity(spoil(clean, lambda run: run.replace(time=run.time * factor))), arm)
    assert_refused(report, "wrong_time_base")


def test_a_gap_parts_the_run(clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil(clean, lambda run: run.at(np.r_[0:700, 900 : len(run)]), run=2), arm)
    assert found(report) == {"time_gap": "note"}
    assert [run.name for run in report.session.runs][2:4] == ["run2[0]", "run2[1]"]
    assert report.session.samples == clean.samples - 200


@pytest.mark.parametrize("kind", ["repeated", "late", "ahead"])
def test_rows_out_of_order_are_dropped(kind: str, clean: Session, arm: ArmModel) -> None:
    rows = np.arange(len(clean.runs[1]))
    shift = {"late": -0.1, "ahead": 1e3}.get(kind, 0.0)
    changes: dict[str, Callable] = {
        "repeated": lambda run: run.at(np.repeat(rows, 1 + (rows % 50 == 0))),
        "late": lambda run: run.replace(time=run.time + np.where(rows == 500, shift, 0.0)),
        "ahead": lambda run: run.replace(time=run.time + np.where(rows == 500, shift, 0.0)),
    }
    report = inspect(spoil(clean, changes[kind], run=1), arm)
    assert found(report) == {"time_not_increasing": "note"}
    assert (np.diff(report.session.runs[1].time) > 0).all()
    assert len(report.session.runs[1]) == (len(rows) if kind == "repeated" else len(rows) - 1)


def test_a_clock_that_restarts_inside_a_file_parts_it(clean: Session, arm: ArmModel) -> None:
    rows = np.arange(len(clean.runs[1]))
    report = inspect(spoil(clean, lambda run: run.replace(time=run.time - 5.0 * (rows >= 700)), run=1), arm)
    assert found(report) == {"time_not_increasing": "warning"}
    assert not report.session.common_clock
    assert report.session.samples == clean.samples


def test_time_in_coarse_steps_is_refused(clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil(clean, lambda run: run.replace(time=np.round(run.time, 1))), arm)
    assert_refused(report, "time_not_increasing")


def test_trembling_stamps_of_even_samples_are_evened(clean: Session, arm: ArmModel) -> None:
    """A receiver's jitter of 3 ms on 8 ms is taken out to below 0.2 ms; the samples themselves stay."""
    rng = np.random.default_rng(1)
    report = inspect(spoil(clean, lambda run: run.replace(time=run.time + rng.uniform(-3e-3, 3e-3, len(run)))), arm)
    assert found(report) == {"jitter": "note"}
    assert np.abs(report.session.runs[0].time - clean.runs[0].time).max() < 2e-4


def test_truly_uneven_samples_keep_their_stamps(clean: Session, arm: ArmModel) -> None:
    """Every third sample lost here and there: the stamps are right, and told to be uneven."""
    rng = np.random.default_rng(2)
    session = spoil(clean, lambda run: run.at(np.flatnonzero(rng.uniform(size=len(run)) > 0.2)))
    report = inspect(session, arm)
    assert found(report) == {"jitter": "note"}
    np.testing.assert_array_equal(report.session.runs[0].time, session.runs[0].time)


@pytest.mark.parametrize("velocity", [True, False])
def test_a_frozen_position_is_cut_out(velocity: bool, clean: Session, arm: ArmModel) -> None:
    session = spoil_column(clean, "position", 1, lambda q: freeze_rows(q, 500, 620), run=1)
    report = inspect(session if velocity else without_velocity(session), arm)
    assert found(report) == {"stuck_channel": "warning", "time_gap": "note"}
    assert report.find("stuck_channel")[0].joints == ("joint_2",)
    assert report.session.samples == clean.samples - 121


def follow(run: Recording, late: float) -> np.ndarray:
    """The command that a joint follows by so many seconds late."""
    return np.column_stack([np.interp(run.time + late, run.time, q) for q in run.position.T])


def test_a_position_that_leaves_its_command_is_frozen(clean: Session, arm: ArmModel) -> None:
    """Frozen to the run's end: no jump tells, and the velocity was made of the positions."""
    commanded = spoil(without_velocity(clean), lambda run: run.replace(position_command=follow(run, 0.02)))
    assert found(inspect(commanded, arm)) == {}
    report = inspect(spoil_column(commanded, "position", 1, lambda q: freeze_rows(q, 1200, 1499), run=1), arm)
    assert found(report) == {"stuck_channel": "warning"}
    assert report.session.samples == clean.samples - 300


@pytest.mark.parametrize("velocity", [True, False])
def test_a_joint_that_friction_holds_is_not_frozen(velocity: bool, clean: Session, arm: ArmModel) -> None:
    """A soft controller lets a joint stand until the command is a dead zone away: true, and told by nothing."""
    zone = 0.06

    def creeps(run: Recording) -> Recording:
        held, wanted = np.array(run.position), np.array(run.position)
        for k in range(1, len(run)):
            held[k] = np.clip(held[k - 1], wanted[k] - zone, wanted[k] + zone)
        return run.replace(
            position=held, velocity=np.gradient(held, run.time, axis=0) if velocity else None, position_command=wanted
        )

    session = spoil(clean, creeps)
    assert (np.diff(session.runs[0].position, axis=0) == 0.0).mean() > 0.1
    assert not stuck_positions(session.runs[0]).any()
    assert not inspect(session, arm).find("stuck_channel")


def test_a_frozen_torque_is_cut_out(clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil_column(clean, "effort", 1, lambda tau: freeze_rows(tau, 500, 620), run=1), arm)
    assert found(report) == {"stuck_channel": "warning", "time_gap": "note"}


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_a_dead_torque_is_refused(value: float, clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil_column(clean, "effort", 4, lambda tau: np.full_like(tau, value)), arm)
    assert_refused(report, "stuck_channel", ("joint_5",))


def test_a_dead_encoder_is_refused(clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil_column(clean, "position", 1, lambda q: np.full_like(q, 0.3)), arm)
    assert report.issues[0].issue == "stuck_channel"
    assert not report.is_fit


def test_a_dead_velocity_is_left_out(clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil_column(clean, "velocity", 1, np.zeros_like), arm)
    assert found(report) == {"stuck_channel": "warning"}
    assert all(run.velocity is None for run in report.session.runs)


VELOCITIES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "flipped": np.negative,
    "scaled": lambda dq: 1.5 * dq,
    "noise": lambda dq: np.random.default_rng(0).normal(size=len(dq)),
}


@pytest.mark.parametrize("kind", VELOCITIES)
def test_a_velocity_that_is_none_is_left_out(kind: str, clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil_column(clean, "velocity", 3, VELOCITIES[kind]), arm)
    assert found(report) == {"velocity_inconsistent": "warning"}
    assert report.issues[0].joints == ("joint_4",)
    assert all(run.velocity is None for run in report.session.runs)


def test_a_cut_off_torque_is_told(clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil_column(clean, "effort", 0, lambda tau: np.clip(tau, -15.0, 15.0)), arm)
    assert found(report) == {"clipped_effort": "warning"}
    assert report.issues[0].joints == ("joint_1",)
    assert "15 N m" in report.issues[0].evidence


def test_wild_samples_are_dropped(clean: Session, arm: ArmModel) -> None:
    def wild(q: np.ndarray) -> np.ndarray:
        return np.where(np.arange(len(q)) == 444, q + 5.0, q)

    report = inspect(spoil_column(clean, "position", 3, wild, run=1), arm)
    assert found(report) == {"garbage_cells": "note"}
    assert report.session.samples == clean.samples - 1


def test_a_jump_parts_the_run(clean: Session, arm: ArmModel) -> None:
    report = inspect(spoil_column(clean, "position", 3, lambda q: q + 0.8 * (np.arange(len(q)) >= 333), run=1), arm)
    assert found(report) == {"time_gap": "warning"}
    assert len(report.session.runs) == 6


def test_too_little_is_told_and_evaluated_all_the_same(clean: Session, arm: ArmModel) -> None:
    """Too few blocks forbid a fit, not an evaluation; and two short sessions together may be enough."""
    short = clean.replace(runs=[clean.runs[0].at(slice(0, 700))])
    report = inspect(short, arm)
    assert_refused(report, "too_few_runs")
    assert report.require_fit(learning=False) is report
    other = clean.replace(runs=[clean.runs[1].at(slice(0, 700))])
    assert all("too_few_runs" not in found(each) for each in inspect_sessions([short, other], arm))


def test_a_joint_that_rests_is_told(clean: Session, arm: ArmModel) -> None:
    still = spoil_column(spoil_column(clean, "position", 5, np.ones_like), "velocity", 5, np.zeros_like)
    report = inspect(still, arm)
    assert found(report) == {"insufficient_excitation": "warning"}
    assert report.issues[0].joints == ("joint_6",)


def test_motion_of_one_joint_does_not_tell_the_parameters_apart(clean: Session, arm: ArmModel) -> None:
    run = clean.runs[0]
    lone = np.where(np.arange(6) == 1, run.position, 0.2)
    tau = run.effort * (np.arange(6) == 1) + arm.gravity(lone)
    report = inspect(Session("one", (run.replace(position=lone, velocity=None, effort=tau),)), arm)
    assert {issue.joints for issue in report.find("insufficient_excitation")} == {
        (),
        ("joint_1", "joint_3", "joint_4", "joint_5", "joint_6"),
    }


def test_nothing_that_moves_is_fatal(clean: Session, arm: ArmModel) -> None:
    rest = spoil(clean, lambda run: run.replace(position=0.0 * run.position + 0.1, velocity=None))
    report = inspect(rest, arm)
    assert report.find("insufficient_excitation")[0].severity == "fatal"
