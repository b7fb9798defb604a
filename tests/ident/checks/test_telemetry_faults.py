"""Every fault is found under its name, on its joint, and nothing else is claimed; what is safe is mended."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from faults import Column, freeze_rows, inspect, spoil, spoil_column, without_velocity

from ident.checks.channels import stuck_positions
from ident.checks.inspection import inspect_sessions
from ident.checks.report import TelemetryReport
from ident.checks.settings import EffortSettings, ExcitationSettings, TelemetrySettings
from ident.errors import RecordingError
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel

Fault = Callable[[Session], Session]


def found(report: TelemetryReport) -> dict[str, str]:
    return {issue.issue: issue.severity for issue in report.issues}


def column(channel: str, joint: int, change: Column, run: int | None = None) -> Fault:
    return lambda session: spoil_column(session, channel, joint, change, run)


def every(change: Callable[[Recording], Recording], run: int | None = None) -> Fault:
    return lambda session: spoil(session, change, run)


def frozen(channel: str, joint: int) -> Fault:
    return column(channel, joint, partial(freeze_rows, first=500, last=620), 1)


def both(*faults: Fault) -> Fault:
    return lambda session: faults[-1](both(*faults[:-1])(session)) if faults else session


def times(run: Recording, factor: float) -> Recording:
    return run.replace(time=factor * run.time)


def degrees(run: Recording, velocity: float | None = 1.0) -> Recording:
    """A run whose positions are in degrees, and its velocities times a factor, or without them."""
    speed = None if velocity is None or run.velocity is None else velocity * run.velocity
    return run.replace(position=np.degrees(run.position), velocity=speed)


DEG = 180.0 / np.pi
ALL = tuple(f"joint_{i}" for i in range(1, 7))
SWAPPED = [1, 0, 2, 3, 4, 5]
CURRENT = np.array([12.0, 12.0, 10.0, 8.0, 8.0, 8.0])
PER_CENT = np.array([3.0, 3.0, 2.0, 0.5, 0.5, 0.5])
NOISE = np.random.default_rng(0).normal(size=1500)
# The fault, the issue that refuses it, its joints (None: not asked), and what its evidence or remedy says.
Refused = tuple[Fault, str, tuple[str, ...] | None, str]
REFUSED: dict[str, Refused] = {
    "sign of all": (every(lambda run: run.replace(effort=-run.effort)), "effort_sign_flipped", ALL, ""),
    "one current": (column("effort", 1, lambda tau: tau / 12.0), "effort_not_torque", ALL[1:2], ""),
    "swapped": (every(lambda run: run.replace(effort=run.effort[:, SWAPPED])), "columns_swapped", ALL[:2], ""),
    "coarse time": (every(lambda run: run.replace(time=np.round(run.time, 1))), "time_not_increasing", None, ""),
}  # fmt: skip
for j, name in enumerate(ALL):
    REFUSED[f"sign of {name}"] = (column("effort", j, np.negative), "effort_sign_flipped", (name,), f"{name} = -1")
for unit in (CURRENT, PER_CENT, np.full(6, 1e-3)):
    loud = every(lambda run, unit=unit: run.replace(effort=run.effort / unit))  # type: ignore[misc]
    REFUSED[f"effort over {unit[0]}"] = (loud, "effort_not_torque", None, "drive_gain")
for value in (0.0, 3.0):
    dead = column("effort", 4, lambda tau, value=value: np.full_like(tau, value))  # type: ignore[misc]
    REFUSED[f"dead torque {value}"] = (dead, "stuck_channel", ALL[4:5], "")
for factor in (1e3, 0.5, 0.9, 1.1, 2.0):
    REFUSED[f"time base {factor:g}"] = (every(partial(times, factor=factor)), "wrong_time_base", None, "125 Hz")
# By the unit of time, by inertia against gravity, or by speeds beyond the robot's limits.
for factor in (1.1e9, 1.1e6, 1e3, 4.0, 3.0, 0.25):
    slow = both(every(partial(times, factor=factor)), without_velocity)
    REFUSED[f"time base {factor:g} without velocity"] = (slow, "wrong_time_base", None, "")
for speed in (DEG, 1.0, None):
    turned = every(partial(degrees, velocity=speed))
    REFUSED[f"degrees, velocity {speed}"] = (turned, "units_degrees", ALL, "angle_unit")


@pytest.mark.parametrize("fault", REFUSED)
def test_a_fault_is_refused_by_name(fault: str, clean: Session, arm: ArmModel) -> None:
    """Law: that one issue, fatal, with figures; degrees without a robot, too."""
    spoilt, (_, issue, joints, words) = REFUSED[fault][0](clean), REFUSED[fault]
    for robot in (arm, None) if issue == "units_degrees" else (arm,):
        report = inspect(spoilt, robot)
        assert found(report) == {issue: "fatal"}
        first = report.issues[0]
        assert joints in (None, first.joints)
        assert words in first.evidence + first.remedy
        assert any(character.isdigit() for character in first.evidence)
        with pytest.raises(RecordingError, match=issue):
            report.require_fit()


def test_radians_read_as_degrees_are_refused(clean: Session, arm: ArmModel) -> None:
    """Law: a motion too small for its torque is one in another unit; one of that size is none."""
    small = every(lambda run: run.replace(position=run.position / DEG, velocity=run.velocity / DEG))(clean)
    report = inspect(small, arm)
    assert found(report) == {"units_degrees": "fatal"}
    assert 'angle_unit = "rad"' in report.issues[0].remedy
    calm = every(lambda run: run.replace(effort=arm.gravity(run.position) + 0.01 * np.sign(run.velocity)))
    assert not inspect(calm(small), arm).find("units_degrees")


def wild(q: np.ndarray) -> np.ndarray:
    return np.where(np.arange(len(q)) == 444, q + 5.0, q)


def shifted(run: Recording, by: float) -> Recording:
    return run.replace(time=run.time + np.where(np.arange(len(run)) == 500, by, 0.0))


# The fault, what is reported, its joints (None: not asked), and how many samples are lost.
TOLD: dict[str, tuple[Fault, dict[str, str], tuple[str, ...] | None, int]] = {
    "gap": (every(lambda run: run.at(np.r_[0:700, 900 : len(run)]), 2), {"time_gap": "note"}, None, 200),
    "late row": (every(partial(shifted, by=-0.1), 1), {"time_not_increasing": "note"}, None, 1),
    "row ahead": (every(partial(shifted, by=1e3), 1), {"time_not_increasing": "note"}, None, 1),
    "repeated rows": (
        every(lambda run: run.at(np.repeat(np.arange(len(run)), 1 + (np.arange(len(run)) % 50 == 0))), 1),
        {"time_not_increasing": "note"},
        None,
        0,
    ),
    "clock restarts": (
        every(lambda run: run.replace(time=run.time - 5.0 * (np.arange(len(run)) >= 700)), 1),
        {"time_not_increasing": "warning"},
        None,
        0,
    ),
    "frozen position": (frozen("position", 1), {"stuck_channel": "warning", "time_gap": "note"}, None, 121),
    "the same without velocity": (
        both(frozen("position", 1), without_velocity),
        {"stuck_channel": "warning", "time_gap": "note"},
        None,
        121,
    ),
    "frozen torque": (frozen("effort", 1), {"stuck_channel": "warning", "time_gap": "note"}, None, 121),
    "wild sample": (column("position", 3, wild, 1), {"garbage_cells": "note"}, ALL[3:4], 1),
    "cut torque": (column("effort", 0, lambda tau: np.clip(tau, -15, 15)), {"clipped_effort": "warning"}, ALL[:1], 0),
    "torque cut most of the time": (
        column("effort", 1, lambda tau: np.minimum(tau, 0.4 * tau.max() + 1e-5 * tau)),
        {"clipped_effort": "warning"},
        ALL[1:2],
        0,
    ),
    "joint at rest": (
        both(column("position", 5, np.ones_like), column("velocity", 5, np.zeros_like)),
        {"insufficient_excitation": "warning"},
        ALL[5:],
        0,
    ),
    "velocities in degrees": (
        every(lambda run: run.replace(velocity=np.degrees(run.velocity))),
        {"units_degrees": "note"},
        None,
        0,
    ),
    # Velocities that are none are left out.
    "dead velocity": (column("velocity", 1, np.zeros_like), {"stuck_channel": "warning"}, ALL[1:2], 0),
    "flipped velocity": (column("velocity", 3, np.negative), {"velocity_inconsistent": "warning"}, ALL[3:4], 0),
    "scaled velocity": (column("velocity", 3, lambda v: 1.5 * v), {"velocity_inconsistent": "warning"}, ALL[3:4], 0),
    "velocity of noise": (column("velocity", 3, lambda _: NOISE), {"velocity_inconsistent": "warning"}, ALL[3:4], 0),
}


@pytest.mark.parametrize("fault", TOLD)
def test_a_fault_is_told_and_mended(fault: str, clean: Session, arm: ArmModel) -> None:
    """Law: nothing else is claimed, time increases again, and no more samples are lost than were bad."""
    spoil_it, expected, joints, lost = TOLD[fault]
    report = inspect(spoil_it(clean), arm)
    assert found(report) == expected
    assert joints in (None, report.issues[0].joints)
    assert report.session.samples == clean.samples - lost
    assert all((np.diff(run.time) > 0).all() for run in report.session.runs)
    assert report.session.common_clock == (fault != "clock restarts")
    if "velocity" in fault:
        assert all(run.velocity is None for run in report.session.runs)
    elif fault == "velocities in degrees":
        np.testing.assert_allclose(report.session.runs[0].velocity, clean.runs[0].velocity)


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


def test_a_computed_torque_is_told_from_a_measured_one(clean: Session, arm: ArmModel) -> None:
    """No friction in it; noise of the velocity that it is computed from does not hide that. Nor is a command one."""

    def computed(run: Recording) -> Recording:
        ddq = np.gradient(run.velocity, run.time, axis=0)
        return run.replace(effort=arm.inverse_dynamics(run.position, run.velocity, ddq))

    report = inspect(spoil(clean, computed), arm)
    assert found(report) == {"effort_is_model": "fatal"}
    assert report.issues[0].joints == arm.joint_names
    same = spoil(clean, lambda run: run.replace(effort_command=run.effort, position_command=run.position))
    report = inspect(same, arm)
    assert found(report) == {"effort_is_model": "fatal", "position_is_command": "warning"}
    assert "position of every joint equals its command" in report.find("position_is_command")[0].evidence
    near = spoil(clean, lambda run: run.replace(effort_command=run.effort + 0.1, position_command=run.position + 1e-4))
    assert found(inspect(near, arm)) == {}


def test_wraps_are_taken_out(clean: Session, arm: ArmModel) -> None:
    """The unwrapped positions differ from the true ones by whole turns, the same for a run."""
    away = spoil_column(clean, "position", 0, lambda q: q + 3.2)
    report = inspect(spoil_column(away, "position", 0, lambda q: (q + np.pi) % (2 * np.pi) - np.pi), arm)
    assert found(report) == {"position_wraps": "note"}
    for true, mended in zip(away.runs, report.session.runs, strict=True):
        turns = (mended.position - true.position) / (2 * np.pi)
        np.testing.assert_allclose(turns - np.round(turns[0]), 0.0, atol=1e-9)


def test_trembling_stamps_are_evened_and_those_of_uneven_samples_stay(clean: Session, arm: ArmModel) -> None:
    """A receiver's jitter of 3 ms on 8 ms is taken out to below 0.2 ms; where samples are lost, stamps are right."""
    rng = np.random.default_rng(1)
    report = inspect(spoil(clean, lambda run: run.replace(time=run.time + rng.uniform(-3e-3, 3e-3, len(run)))), arm)
    assert found(report) == {"jitter": "note"}
    assert np.abs(report.session.runs[0].time - clean.runs[0].time).max() < 2e-4
    rng = np.random.default_rng(2)
    lossy = spoil(clean, lambda run: run.at(np.flatnonzero(rng.uniform(size=len(run)) > 0.2)))
    report = inspect(lossy, arm)
    assert found(report) == {"jitter": "note"}
    np.testing.assert_array_equal(report.session.runs[0].time, lossy.runs[0].time)


def test_a_position_that_leaves_its_command_is_frozen(clean: Session, arm: ArmModel) -> None:
    """Frozen to the run's end: no jump tells, and the velocity was made of the positions."""

    def follow(run: Recording) -> np.ndarray:
        return np.column_stack([np.interp(run.time + 0.02, run.time, q) for q in run.position.T])

    commanded = spoil(without_velocity(clean), lambda run: run.replace(position_command=follow(run)))
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
        speed = np.gradient(held, run.time, axis=0) if velocity else None
        return run.replace(position=held, velocity=speed, position_command=wanted)

    session = spoil(clean, creeps)
    assert (np.diff(session.runs[0].position, axis=0) == 0.0).mean() > 0.1
    assert not stuck_positions(session.runs[0]).any()
    assert not inspect(session, arm).find("stuck_channel")


def leap_of(run: Recording, rows: int) -> np.ndarray:
    """A step of 0.8 rad at joint 4 in the midst of a run, over so many rows."""
    size = 0.8 * np.clip((np.arange(len(run)) - 332) / rows, 0.0, 1.0)
    return np.outer(size, np.arange(6) == 3)


@pytest.mark.parametrize("rows", [1, 10])
def test_gaps_and_jumps_part_a_run(clean: Session, arm: ArmModel, rows: int) -> None:
    """Where the arm is elsewhere after a jump, by its torque too, both parts are used. Also where a
    filter has smeared the jump, so that each of its steps alone is one that an arm may make.
    """

    def leaps(run: Recording) -> Recording:
        q = run.position + leap_of(run, rows)
        ddq = np.gradient(run.velocity, run.time, axis=0)
        before = arm.inverse_dynamics(run.position, run.velocity, ddq)
        after = arm.inverse_dynamics(q, run.velocity, ddq)
        return run.replace(position=q, effort=run.effort + after - before)

    report = inspect(spoil(clean, leaps, 1), arm)
    assert found(report) == {"time_gap": "warning"}
    assert [run.name for run in report.session.runs][1:3] == ["run1[0]", f"run1[{3 * rows - 2}]"]


@pytest.mark.parametrize("rows", [1, 10])
def test_an_encoder_that_jumps_has_another_zero(clean: Session, arm: ArmModel, rows: int) -> None:
    """Law: parted likewise, what follows is refused by the zero that its torque tells."""

    def leaps(run: Recording) -> Recording:
        return run.replace(position=run.position + leap_of(run, rows))

    report = inspect(spoil(clean, leaps, 1), arm)
    assert found(report) == {"zero_shifted": "fatal", "time_gap": "warning"}
    moved = report.issues[0]
    assert moved.joints == ("joint_4",)
    assert f"run1[{3 * rows - 2}]: the zero of joint_4 is moved by 0.80 rad" in moved.evidence
    assert [run.name for run in report.session.runs] == ["run0", "run1[0]", "run2", "run3", "run4"]


def test_too_little_is_told_and_evaluated_all_the_same(clean: Session, arm: ArmModel) -> None:
    """Too few blocks forbid a fit, not an evaluation; and two short sessions together may be enough."""
    short, other = (clean.replace(runs=[clean.runs[k].at(slice(0, 400))]) for k in (0, 1))
    report = inspect(short, arm)
    assert found(report) == {"too_few_runs": "fatal"}
    assert report.require_fit(learning=False) is report
    assert all("too_few_runs" not in found(each) for each in inspect_sessions([short, other], arm))


def test_motion_that_does_not_tell_the_parameters_apart(clean: Session, arm: ArmModel) -> None:
    """One joint that moves leaves the others untold; where none does, nothing can be fitted."""
    run = clean.runs[0]
    lone = np.where(np.arange(6) == 1, run.position, 0.2)
    tau = run.effort * (np.arange(6) == 1) + arm.gravity(lone)
    report = inspect(Session("one", (run.replace(position=lone, velocity=None, effort=tau),)), arm)
    seen = {issue.joints for issue in report.find("insufficient_excitation")}
    assert seen == {(), tuple(name for name in ALL if name != "joint_2")}
    rest = spoil(clean, lambda run: run.replace(position=0.0 * run.position + 0.1, velocity=None))
    assert inspect(rest, arm).find("insufficient_excitation")[0].severity == "fatal"
