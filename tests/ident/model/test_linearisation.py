"""Laws of the arm that a diagnosis linearises about.

Laws of the losses' torque.
"""

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from ident.arrays import Array, Float
from ident.command_options import FitOptions
from ident.errors import RecordingError
from ident.fitting.fit_sums import FitSums
from ident.fitting.identification import identify
from ident.laws.motion import direction
from ident.model.linearisation import (
    Sliding,
    _sharpest,
    fit_sliding,
    stop_operator,
)
from ident.model.loss import LossParameters
from ident.motion.motion import Motion, prepare
from ident.recordings.recording import Payload, Recording, Session
from ident.regression.baseline import Baseline, correlation_time, fit_baseline, rigid_torque
from ident.robot.arm import ArmModel
from tests.bench.peers.ur10_fixture import JOINTS, Fixture, Split
from tests.ident.diagnosis.planted import COULOMB, ROTOR, VISCOUS
from tests.ident.made_up import exact_motion, made_motions

TRUE = LossParameters([0.5, 0.8], [10.0, 6.0], [8.0, 5.0], [0.0, 0.0], [0.02, 0.02])


def _runs(arm: ArmModel, params: LossParameters, noise: float = 0.0, seeds: Sequence[int] = (1, 2)) -> list[Motion]:
    return made_motions(arm, params, seeds, noise=noise)


def _values(params: LossParameters) -> Float[Array, "n 3"]:
    return np.stack([params.motor_inertia, params.viscous, params.coulomb], axis=1)


def _fitted(arm: ArmModel, motions: Sequence[Motion]) -> LossParameters:
    return _tuned(motions, arm, 1e-9).loss


def _tuned(motions: Sequence[Motion], arm: ArmModel, share: float, still: Collection[int] = ()) -> Baseline:
    """The arm and its losses, dry friction turning sharply."""
    return fit_baseline(motions, arm, share, still=still, sliding=Sliding(np.zeros(arm.n), np.zeros(arm.n)))


def test_exact_data_give_the_exact_losses(two_joints: ArmModel) -> None:
    """Without noise every loss comes back to 1e-5."""
    assert np.allclose(_values(_fitted(two_joints, _runs(two_joints, TRUE))), _values(TRUE), rtol=1e-5)


def test_equals_the_pseudo_inverse_where_nothing_is_at_its_bound(two_joints: ArmModel) -> None:
    """Eq. 5, joint by joint; where least squares want a negative one it is zero, and the others are the best left."""
    for inertia, kept in ((0.5, slice(0, 3)), (-0.6, slice(1, 3))):
        motions = _runs(two_joints, LossParameters([inertia, 0.8], *(getattr(TRUE, k) for k in KINDS)), noise=0.2)
        found = _fitted(two_joints, motions)
        moves = [(m.ddq, m.dq, direction(m.dq, found.transition_speed)) for m in motions]
        x = [m.filtered(np.stack(own, -1))[m.moving[:, 0], 0, kept] for m, own in zip(motions, moves, strict=True)]
        y = [(m.tau_filtered - m.filtered(rigid_torque(two_joints, m)))[m.moving[:, 0], 0] for m in motions]
        assert np.allclose(_values(found)[0, kept], np.linalg.pinv(np.concatenate(x)) @ np.concatenate(y), rtol=1e-6)
        assert (found.motor_inertia[0] == 0.0) == (inertia < 0.0)


KINDS = ("viscous", "coulomb", "offset", "transition_speed")


def test_a_joint_that_never_moves_is_refused_by_name_and_may_be_left_out(two_joints: ArmModel) -> None:
    resting = []
    for motion in _runs(two_joints, TRUE):
        states = tuple(values * [1.0, 0.0] for values in (motion.q, motion.dq, motion.ddq))
        resting.append(exact_motion(motion.time, states, motion.tau, motion.joints))  # type: ignore[arg-type]
    with pytest.raises(RecordingError, match=r"joint_2 hardly moves.*lock it"):
        _fitted(two_joints, resting)
    assert not _values(_tuned(resting, two_joints, 2.0, {1}).loss)[1].any()


def test_links_come_near_the_true_ones_and_silent_ones_stay(two_joints: ArmModel) -> None:
    """Torque of links 20 % heavier to 2 % on unseen states; without motion all stays as the URDF has it."""
    real = two_joints.with_inertial_parameters(1.2 * two_joints.inertial_parameters)
    motions = _runs(real, TRUE, 0.1)
    tuned = _tuned(motions, two_joints, 2.0)
    test = _runs(real, TRUE, seeds=(9,))[0]
    found = rigid_torque(tuned.arm, test) + tuned.loss.torque(test.dq, test.ddq)  # rotors trade with links
    assert np.abs(found - test.tau).max() < 0.02 * np.abs(test.tau).max()
    assert tuned.base.rank == len(tuned.base.names)
    still = [exact_motion(m.time, (0 * m.q, 0 * m.dq, 0 * m.ddq), m.tau, m.joints) for m in motions]
    assert np.array_equal(
        _tuned(still, two_joints, 2.0, {0, 1}).arm.inertial_parameters, two_joints.inertial_parameters
    )


@pytest.mark.parametrize(("persistence", "expected"), [(0.0, 1.0), (0.5, 3.0), (0.9, 19.0)])
def test_correlation_time_of_a_known_process(persistence: float, expected: float) -> None:
    """An AR(1) of coefficient φ: (1 + φ) / (1 - φ) samples, within 20 %."""
    noise = np.random.default_rng(2).standard_normal(50_000)
    assert correlation_time(lfilter([1.0], [1.0, -persistence], noise)) == pytest.approx(expected, rel=0.2)


def record(three_joints: ArmModel, sliding: str) -> list[Motion]:
    def law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        slip = (
            np.stack([stop_operator(np.ascontiguousarray(column), 2e-4) / 2e-4 for column in q.T], axis=1)
            if sliding == "range"
            else np.tanh(dq / 0.04)
        )
        return three_joints.inverse_dynamics(q, dq, ddq) + ROTOR * ddq + VISCOUS * dq + COULOMB * slip

    return made_motions(three_joints, law, range(3), 8.0, 200.0, noise=0.1)


@pytest.mark.parametrize("kind", ["range", "speed"])
def test_what_turns_the_friction_round_is_found(three_joints: ArmModel, kind: str) -> None:
    """Law: tanh(dq / 0.04) is found as a speed of 0.04 rad/s at every joint; a stop of 0.2 mrad, which the position is
    too noisy to follow, by what comes nearest: where the joint slides steadily its direction is right."""
    motions = record(three_joints, kind)
    found = fit_sliding(motions, [three_joints.inverse_dynamics(m.q, m.dq, m.ddq) for m in motions])
    if kind == "speed":
        np.testing.assert_array_equal(found.range, 0.0)
        np.testing.assert_allclose(found.speed, 0.04)
        return
    assert (found.range > 5e-5).any()
    for motion in motions:
        off = found.direction(motion)[motion.coarse] - np.sign(motion.dq[motion.coarse])
        assert np.sqrt(np.mean(off[motion.settled] ** 2)) < 0.1


@pytest.mark.parametrize(("kind", "most"), [("thins", 0.15), ("falls", 0.03)])
def test_friction_that_bends_over_speed_is_no_slow_turning(three_joints: ArmModel, kind: str, most: float) -> None:
    """Law: beside drag that grows as asinh(dq / 0.1), or friction that falls by a third over 0.14 rad/s from rest, dry
    friction that turns round at once is found to do so."""

    def law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        slip = np.tanh(dq / 1e-3)
        falls = 0.25 * COULOMB * slip * np.exp(-((np.abs(dq) / 0.14) ** 1.5))
        bent = COULOMB * np.arcsinh(dq / 0.1) if kind == "thins" else falls
        return three_joints.inverse_dynamics(q, dq, ddq) + ROTOR * ddq + bent + 0.5 * COULOMB * slip

    motions = made_motions(three_joints, law, range(3), 8.0, 200.0, noise=0.1)
    found = fit_sliding(motions, [three_joints.inverse_dynamics(m.q, m.dq, m.ddq) for m in motions])
    for motion in motions:
        off = found.direction(motion)[motion.coarse] - np.sign(motion.dq[motion.coarse])
        assert np.sqrt(np.mean(off[motion.settled] ** 2, axis=0)).max() < most


@pytest.mark.parametrize("alike", [1, 16])
def test_samples_that_err_alike_count_once(alike: int) -> None:
    """Law: a smoother turning that leaves 0.6 % less of 3000 samples is nine nats better where each errs for itself;
    where sixteen err alike it is not, and the sharper one is taken.
    """
    samples = np.full((60, 1), 50.0)
    left = np.random.default_rng(0).chisquare(50 / alike, size=(60, 1)) * alike
    assert _sharpest(np.array([1.006 * left, left]), samples)[0] == (1 if alike == 1 else 0)


@pytest.fixture(scope="module")
def fixture() -> Fixture:
    made = Fixture()
    made.check()  # it is the recipe's arm to the last digit
    return made


def motion(split: Split) -> Motion:
    run = Recording("run", JOINTS, split.time, split.q, split.tau)
    return prepare(Session("fixture", (run,)))[0]


def test_a_stop_holds_its_range() -> None:
    """Law: the state never leaves ±r, equals the path inside it, and turns over 2 r after a reversal."""
    q = np.concatenate([np.linspace(0.0, 1.0, 101), np.linspace(1.0, 0.0, 101)])
    state = stop_operator(q, 0.1)
    assert np.abs(state).max() <= 0.1
    np.testing.assert_allclose(state[:11], q[:11], atol=1e-12)
    np.testing.assert_allclose(state[101:122], 0.1 - (1.0 - q[101:122]), atol=1e-12)
    np.testing.assert_allclose(state[125:], -0.1)


def test_torque_is_eq_3() -> None:
    """B ddq + C dq + f sign(dq) + offset, with tanh in place of the sign where a width is given; zero() has none."""
    params = LossParameters([2.0, 2.0], [3.0, 3.0], [5.0, 5.0], [0.5, 0.5], [0.0, 0.1])
    dq, ddq = np.array([[0.1, 0.1], [-0.1, 0.0], [0.0, -1.0]]), np.array([[1.0, 1.0], [0.0, 0.0], [0.0, 0.0]])
    near = np.tanh(1.0)
    expected = [[7.8, 2.8 + 5 * near], [-4.8, 0.5], [0.5, -2.5 - 5 * np.tanh(10.0)]]
    assert np.allclose(params.torque(dq, ddq), expected)
    assert np.all(LossParameters.zero(2).torque(dq, ddq) == 0.0)
    assert np.all(np.abs(direction(10 * dq, params.transition_speed)) <= 1.0)


@pytest.mark.parametrize(("level", "peer"), [("low", 0.138), ("high", 0.196)])
def test_unseen_torque_is_nearer_to_the_truth_than_a_peers(
    fixture: Fixture, tmp_path: Path, level: str, peer: float
) -> None:
    """Law: over all samples, ends of the run included; two draws stay below what the peer has in the mean of five."""
    arm = ArmModel.load(fixture.write_urdf(tmp_path / "ur10.urdf"))
    worst = []
    for number in range(2):
        train, test = (fixture.split(name, level, number) for name in ("training", "validation"))
        found, seen = identify(FitSums.gather([motion(train)], arm, FitOptions())), motion(test)
        losses = found.loss.params
        shown = found.inertia.arm.inverse_dynamics(seen.q, seen.dq, seen.ddq)
        shown += losses.motor_inertia * seen.ddq + losses.viscous * seen.dq + losses.coulomb * np.sign(seen.dq)
        worst.append(np.sqrt(np.mean((shown - test.true_tau) ** 2, axis=0)).max())
    assert np.mean(worst) < peer


@pytest.mark.parametrize("cause", ["load", "tilt", "spring", "offset"])
def test_what_the_urdf_lacks_is_not_taken_for_how_friction_turns_round(cause: str) -> None:
    """Law: a torque of where the arm is, many times its friction's, moves no joint's turning."""
    arm = ArmModel.load("tm5-900", joints=["joint_1", "joint_2", "joint_3"])
    losses = LossParameters([0.5, 0.8, 0.3], [10.0, 6.0, 4.0], [4.0, 5.0, 2.0], [0.0] * 3, [0.01] * 3)
    true = arm
    if cause == "load":
        true = arm.with_payload(Payload(6.0, (0.05, 0.1, 0.1)))
    elif cause == "tilt":
        true = arm.with_gravity(np.array([1.2, -0.8, -9.7]))

    def law(q: Array, dq: Array, ddq: Array) -> Array:
        tau = true.inverse_dynamics(q, dq, ddq) + losses.torque(dq, ddq)
        if cause == "spring":
            tau = tau + 40.0 * (q - 0.3)
        return tau + 15.0 if cause == "offset" else tau

    slow = made_motions(arm, law, (1, 2, 3), duration=12.0, noise=0.1)
    sound = made_motions(arm, losses, (1, 2, 3), duration=12.0, noise=0.1)
    found = fit_baseline(slow, arm)
    usual = fit_baseline(sound, arm)
    assert found.sliding.range.tolist() == usual.sliding.range.tolist()
    assert found.sliding.speed.tolist() == usual.sliding.speed.tolist()
    assert found.loss.transition_speed.tolist() == usual.loss.transition_speed.tolist() == [0.01] * 3
