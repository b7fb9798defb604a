"""Law: one bad value anywhere is found, told and cut out; what is left is the clean session without that row."""

import warnings
from collections.abc import Callable

import numpy as np
import pytest
from faults import Column, inspect, spoil, spoil_column

from ident.arrays import Array
from ident.checks.clock import mend_clock_jumps, mend_order, split_at_gaps
from ident.checks.excitation import Amount, Independence
from ident.checks.filtered_run import filter_run
from ident.checks.inspection import inspect_sessions
from ident.checks.report import TelemetryReport
from ident.checks.spikes import mend_absurd, mend_channel_spikes
from ident.checks.time_base import mend_time_unit
from ident.recordings.recording import Recording, Session, TelemetryIssue
from ident.robot.arm import ArmModel


def found(report: TelemetryReport) -> dict[str, str]:
    return {issue.issue: issue.severity for issue in report.issues}


def set_value(row: int | slice, value: float) -> Column:
    def change(values: np.ndarray) -> np.ndarray:
        changed = np.array(values)
        changed[row] = value
        return changed

    return change


SIZES = {
    "effort": (400.0, 1e3, 1e4, -1e4, 1e8, 1e282),
    "position": (7.5, 1e3, -1e6, 1e282),
    "velocity": (1e2, -1e5, 1e282),
}


@pytest.mark.parametrize("channel", SIZES)
@pytest.mark.parametrize("row", [0, 1, 733, -2, -1])
def test_one_bad_sample_is_cut_out(channel: str, row: int, clean: Session) -> None:
    bad = range(len(clean.runs[3]))[row]
    for joint, size in enumerate(SIZES[channel]):
        spoilt = spoil_column(clean, channel, joint, set_value(row, size), 3)
        session, absurd = mend_absurd(spoilt)
        session, spikes = mend_channel_spikes(session)
        (issue,) = (*absurd, *spikes)
        assert issue.issue == ("effort_spike" if channel == "effort" and size < 1e12 else "garbage_cells")
        assert clean.joints[joint] in issue.joints
        # The bad row is gone; where torque turns round beside it, its neighbour may go with it.
        lost = np.flatnonzero(~np.isin(clean.runs[3].time, session.runs[3].time))
        assert bad in lost
        assert len(lost) <= 2
        assert np.abs(lost - bad).max() <= 1
        whole = np.isin(clean.runs[3].time, session.runs[3].time)
        assert np.array_equal(session.runs[3].effort, clean.runs[3].effort[whole])
        assert all(session.runs[k] is spoilt.runs[k] for k in (0, 1, 2, 4))


@pytest.mark.parametrize("size", [300.0, 1e282])
def test_a_bad_sample_changes_nothing_else(size: float, clean: Session, arm: ArmModel) -> None:
    """The whole inspection finds the one fault, and no library warns of it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = inspect(spoil_column(clean, "effort", 1, set_value(0, size), 0), arm)
    assert found(report) == {"effort_spike" if size < 1e12 else "garbage_cells": "note"}


@pytest.mark.parametrize("size", [400.0, 1e4])
@pytest.mark.parametrize("rows", [6, 40, 600])
@pytest.mark.parametrize("together", [True, False])
def test_many_bad_torques_are_cut_out_or_refused(
    size: float, rows: int, together: bool, clean: Session, arm: ArmModel
) -> None:
    """Law: however many, in a row or scattered: told as what they are, and not one is left in the session."""
    at = np.arange(300, 300 + rows) if together else np.random.default_rng(0).choice(1500, rows, replace=False)
    report = inspect(spoil_column(clean, "effort", 1, set_value(at, size), 2), arm)
    severity = "fatal" if rows > 100 else "warning" if rows > 10 else "note"
    assert found(report) == {"effort_spike": severity} | {
        key: "note" for key in ("jitter", "time_gap") if key in found(report)
    }
    assert max(np.abs(run.effort).max() for run in report.session.runs) < 300.0


@pytest.mark.parametrize("size", [15.0, 400.0, 1e4])
@pytest.mark.parametrize("velocity", [True, False])
def test_many_bad_positions_are_no_degrees(size: float, velocity: bool, clean: Session, arm: ArmModel) -> None:
    """Law: damage is refused as damage, whatever unit it would have been."""
    at = np.random.default_rng(0).choice(1500, 300, replace=False)
    spoilt = spoil_column(clean, "position", 1, set_value(at, size), 2)
    if not velocity:
        spoilt = spoil(spoilt, lambda run: run.replace(velocity=None))
    report = inspect(spoilt, arm)
    assert (report.fatal[0].issue, report.fatal[0].joints) == ("garbage_cells", ("joint_2",))
    assert not report.find("units_degrees")


def test_a_broken_velocity_is_left_out(clean: Session, arm: ArmModel) -> None:
    """Nobody needs it: the session is used without it."""
    at = np.random.default_rng(0).choice(1500, 300, replace=False)
    report = inspect(spoil_column(clean, "velocity", 1, set_value(at, 50.0), 2), arm)
    assert found(report) == {"garbage_cells": "warning"}
    assert all(run.velocity is None for run in report.session.runs)
    assert report.session.samples == clean.samples


def test_friction_alone_is_not_far(clean: Session) -> None:
    """A joint that rests, and then has its friction at once, beside joints that carry the arm."""

    def leaps(run: Recording) -> Recording:
        effort = np.array(run.effort)
        effort[:, 0] = np.where(np.arange(len(run)) % 500 < 300, 0.0, 25.0)
        return run.replace(effort=effort)

    assert mend_channel_spikes(spoil(clean, leaps))[1] == []


def with_time(change: Column) -> Callable[[Recording], Recording]:
    def changed(run: Recording) -> Recording:
        return run.replace(time=change(np.array(run.time)))

    return changed


def test_a_clock_that_is_set_while_recording(clean: Session) -> None:
    """First stamp zero, then seconds since 1970: no grid lies between them."""
    spoilt = spoil(clean, with_time(lambda time: np.concatenate([[0.0], time[1:] + 1.7e9])))
    session, issues = mend_clock_jumps(spoilt)
    assert [(one.issue, one.severity) for one in issues] == [("clock_jump", "note")]
    assert session.samples == clean.samples - 5
    amid = spoil(clean, with_time(lambda time: np.where(np.arange(len(time)) < 700, time, time + 1e15)), 2)
    assert filter_run(amid.runs[2]) is None
    assert len(mend_clock_jumps(amid)[0].runs) == 6


@pytest.mark.parametrize("row", [0, 1, 500, -1])
@pytest.mark.parametrize("stamp", [0.0, -1e9, 1e9, 1e18, 1e282, -1e282])
def test_one_bad_stamp_is_cut_out(row: int, stamp: float, clean: Session) -> None:
    session = spoil(clean, with_time(set_value(row, stamp)), 3)
    for step in (mend_absurd, mend_order, mend_clock_jumps, split_at_gaps):
        session, issues = step(session)
        assert all(one.severity == "note" for one in issues)
    assert clean.samples - 2 <= session.samples <= clean.samples
    assert all(run.duration < 13.0 for run in session.runs)


def test_whole_nanoseconds_are_read(clean: Session) -> None:
    session = spoil(clean, with_time(lambda time: np.floor(time * 1e9) + 1_700_000_000_000_000_000))
    session, issues = mend_time_unit(session)
    assert [(one.issue, one.severity) for one in issues] == [("wrong_time_base", "note")]
    assert session.runs[0].sample_interval == pytest.approx(clean.runs[0].sample_interval, rel=1e-4)
    assert mend_time_unit(clean) == (clean, [])


def test_the_same_recording_twice_is_told(clean: Session) -> None:
    (issue,) = inspect_sessions([clean, clean.replace(name="copy")])[0].find("repeated_session")
    assert (issue.issue, issue.severity) == ("repeated_session", "fatal")
    assert "copy/run0 is clean/run0" in issue.evidence
    assert not inspect(clean).find("repeated_session")


RATE, SECONDS = 100.0, 12.0
TIME = np.arange(0.0, SECONDS, 1.0 / RATE)
Tones = tuple[tuple[float, float], ...]
ONE, OTHER = ((0.6, 1.9),), ((0.6, 2.5),)
MANY = ((0.5, 1.1), (0.3, 2.7), (0.2, 4.3))


def motion(*tones: Tones, noise: float = 1e-5, seed: int = 0) -> Array:
    """Angles of each joint as sums of sinusoids (amplitude [rad], angular frequency [rad/s]), and encoder noise."""
    clean = np.stack([sum(a * np.sin(w * TIME + j) for a, w in joint) for j, joint in enumerate(tones)], axis=1)
    return clean + noise * np.random.default_rng(seed).normal(size=clean.shape)


def issues(two_joints: ArmModel, *motions: Array) -> list[TelemetryIssue]:
    runs = []
    for k, q in enumerate(motions):
        dq = np.gradient(q, 1.0 / RATE, axis=0)
        tau = two_joints.gravity(q) + 5.0 * dq
        runs.append(Recording(f"run_{k}", two_joints.joint_names, TIME + 20.0 * k, q, tau))
    amount, session = Amount(), Session("made up", tuple(runs))
    amount.take(session, TelemetryReport(session, (), two_joints))
    return [issue for issue in amount.issues() if "angle" in issue.evidence or "it moves" in issue.evidence]


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
def test_recordings_of_one_sinusoid_are_refused(two_joints: ArmModel, noise: float) -> None:
    """Law: however often it is repeated, nothing tells inertia from what goes with the angle."""
    (found,) = issues(two_joints, *(motion(ONE, ONE, noise=noise, seed=k) for k in range(3)))
    assert (found.issue, found.severity, found.joints) == ("insufficient_excitation", "fatal", two_joints.joint_names)
    assert "plan excite" in found.remedy


def test_an_answer_that_rests_on_one_recording_is_refused(two_joints: ArmModel) -> None:
    """Law: two the same and another one are one sinusoid wherever the other is held out."""
    (found,) = issues(two_joints, motion(ONE, ONE), motion(ONE, ONE, seed=2), motion(OTHER, OTHER, seed=1))
    assert (found.severity, ": with one recording left out, " in found.evidence) == ("fatal", True)
    assert ": with a fifth of the recording left out, " in issues(two_joints, motion(ONE, ONE))[0].evidence


def test_a_direction_that_is_shown_once_is_told(two_joints: ArmModel) -> None:
    """Law: friction of a direction of motion is known only where that is repeated."""
    q = np.stack([0.1 * TIME + 0.02 * np.sin(1.3 * TIME), motion(MANY, MANY)[:, 1]], axis=1)
    (found,) = issues(two_joints, q)
    assert found.joints == two_joints.joint_names[:1]
    assert "1 time up and 0 times down" in found.evidence


def test_the_share_is_that_of_the_acceleration_alone() -> None:
    """Law: independent of units, offsets and length: two equal tones of one amplitude share the variance by w^4."""
    shares = []
    for scale in (1.0, 3.0):
        found = Independence()
        t = np.arange(0.0, 40.0 * np.pi, 0.01)
        q = scale * 0.05 * (np.sin(t) + np.sin(2 * t))
        dq, ddq = scale * 0.05 * (np.cos(t) + 2 * np.cos(2 * t)), -scale * 0.05 * (np.sin(t) + 4 * np.sin(2 * t))
        found.take(q[:, None], dq[:, None], ddq[:, None])
        shares.append(float(found.shown()[0][0]))
    # ddq = -2.5 q + 1.5 (sin t - sin 2t): the last part is 4.5 / 17 of the variance.
    np.testing.assert_allclose(shares, 2.25 / 8.5, rtol=0.02)
