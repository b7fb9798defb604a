"""What a motion does not show is told: one sinusoid, one direction, copies of one recording."""

from __future__ import annotations

import numpy as np
import pytest

from ident.arrays import Array
from ident.checks.excitation import Amount, Independence
from ident.checks.report import TelemetryReport
from ident.recordings.recording import Recording, Session, TelemetryIssue
from ident.robot.arm import ArmModel
from tests.ident.made_up import two_joint_arm

RATE, SECONDS = 100.0, 12.0
TIME = np.arange(0.0, SECONDS, 1.0 / RATE)
Tones = tuple[tuple[float, float], ...]
ONE, OTHER = ((0.6, 1.9),), ((0.6, 2.5),)
MANY = ((0.5, 1.1), (0.3, 2.7), (0.2, 4.3))


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return two_joint_arm()


def motion(*tones: Tones, noise: float = 1e-5, seed: int = 0) -> Array:
    """Angles of each joint as sums of sinusoids (amplitude [rad], angular frequency [rad/s]), and encoder noise."""
    clean = np.stack([sum(a * np.sin(w * TIME + j) for a, w in joint) for j, joint in enumerate(tones)], axis=1)
    return clean + noise * np.random.default_rng(seed).normal(size=clean.shape)


def issues(arm: ArmModel, *motions: Array) -> list[TelemetryIssue]:
    runs = []
    for k, q in enumerate(motions):
        dq = np.gradient(q, 1.0 / RATE, axis=0)
        tau = arm.gravity(q) + 5.0 * dq
        runs.append(Recording(f"run_{k}", arm.joint_names, TIME + 20.0 * k, q, tau))
    amount = Amount()
    session = Session("made up", tuple(runs))
    amount.take(session, TelemetryReport(session, (), arm))
    return [issue for issue in amount.issues() if "angle" in issue.evidence or "times up" in issue.evidence]


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
def test_recordings_of_one_sinusoid_are_refused(arm: ArmModel, noise: float) -> None:
    """Law: however often it is repeated, nothing tells inertia from what goes with the angle."""
    (found,) = issues(arm, *(motion(ONE, ONE, noise=noise, seed=k) for k in range(3)))
    assert (found.issue, found.severity, found.joints) == ("insufficient_excitation", "fatal", arm.joint_names)
    assert "plan excite" in found.remedy


def test_an_answer_that_rests_on_one_recording_is_refused(arm: ArmModel) -> None:
    """Law: two the same and another one are one sinusoid wherever the other is held out."""
    same, other = motion(ONE, ONE), motion(OTHER, OTHER, seed=1)
    (found,) = issues(arm, same, motion(ONE, ONE, seed=2), other)
    assert found.severity == "fatal"


def test_motion_of_several_frequencies_is_enough(arm: ArmModel) -> None:
    assert issues(arm, *(motion(MANY, MANY, seed=k) for k in range(3))) == []
    assert issues(arm, motion(MANY, MANY)) == []
    # A third recording of another speed makes up for it: two are left that differ, whichever is held out.
    three = (((0.6, 1.2),), ONE, ((0.6, 3.1),))
    assert issues(arm, *(motion(tones, tones) for tones in three)) == []


def test_a_poor_joint_beside_a_rich_one_is_named(arm: ArmModel) -> None:
    (found,) = issues(arm, *(motion(MANY, ONE, seed=k) for k in range(3)))
    assert (found.severity, found.joints) == ("warning", arm.joint_names[1:])


def test_a_direction_that_is_shown_once_is_told(arm: ArmModel) -> None:
    """Law: friction of a direction of motion is known only where that is repeated."""
    q = np.stack([0.1 * TIME + 0.02 * np.sin(1.3 * TIME), motion(MANY, MANY)[:, 1]], axis=1)
    (found,) = issues(arm, q)
    assert found.joints == arm.joint_names[:1]
    assert "1 times up and 0 times down" in found.evidence


def test_joints_that_move_one_after_the_other_are_enough(arm: ArmModel) -> None:
    """Law: a joint is judged by the recordings in which it moves."""
    still = np.zeros((len(TIME), 1))
    rich = motion(MANY, MANY)
    assert issues(arm, np.hstack([rich[:, :1], still]), np.hstack([still, rich[:, 1:]])) == []


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
