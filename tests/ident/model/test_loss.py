"""Laws of the loss model."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.signal import lfilter

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.model.loss import LossModel, LossParameters, LossResults, direction, loss_columns
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.made_up import exact_motion, made_motions, two_joint_arm

TRUE = LossParameters([0.5, 0.8], [10.0, 6.0], [8.0, 5.0], [0.0, 0.0], [0.0, 0.0])


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return two_joint_arm()


def _runs(arm: ArmModel, params: LossParameters, noise: float = 0.0, seeds: Sequence[int] = (1, 2)) -> list[Motion]:
    return made_motions(
        arm, lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq) + params.torque(dq, ddq), seeds, noise=noise
    )


def _rigid(arm: ArmModel, motions: Sequence[Motion]) -> list[Array]:
    return [arm.inverse_dynamics(motion.q, motion.dq, motion.ddq) for motion in motions]


def _values(results: LossResults) -> Float[Array, "n 4"]:
    params = results.params
    return np.stack([params.motor_inertia, params.viscous, params.coulomb, params.offset], axis=1)


def _rows(j: int, motions: Sequence[Motion], analytic: Sequence[Array]) -> tuple[Array, Array]:
    """The paper's regressor of one joint, and what the rigid arm leaves."""
    x = [loss_columns(motion, np.zeros(motion.n))[motion.moving[:, j], j, :3] for motion in motions]
    y = [
        (motion.tau_filtered - motion.filtered(torque))[motion.moving[:, j], j]
        for motion, torque in zip(motions, analytic, strict=True)
    ]
    return np.concatenate(x), np.concatenate(y)


def test_exact_data_give_the_exact_figures(arm: ArmModel) -> None:
    """Without noise, with the right transition width, every figure comes back to 1e-5, offset included."""
    true = LossParameters([0.5, 0.8], [10.0, 6.0], [8.0, 5.0], [1.5, -2.0], [0.02, 0.02])
    motions = _runs(arm, true)
    results = LossModel(offset=True, transition_speed=0.02).fit(motions, _rigid(arm, motions))
    expected = np.stack([true.motor_inertia, true.viscous, true.coulomb, true.offset], axis=1)
    assert np.allclose(_values(results), expected, rtol=1e-5)
    assert np.all(results.residual_rms < 1e-4)


def test_equals_the_pseudo_inverse_where_nothing_is_at_its_bound(arm: ArmModel) -> None:
    """Pure sign, no offset: the figures are eq. 5's pseudo-inverse to 1e-6 of their size, joint by joint."""
    motions = _runs(arm, TRUE, noise=0.5)
    analytic = _rigid(arm, motions)
    results = LossModel(transition_speed=0.0).fit(motions, analytic)
    for j in range(2):
        x, y = _rows(j, motions, analytic)
        assert np.allclose(_values(results)[j, :3], np.linalg.pinv(x) @ y, rtol=1e-6)
    assert results.at_bound == ((), ())


def test_no_figure_is_negative(arm: ArmModel) -> None:
    """Where least squares wants a negative figure it rests on zero, is named, and the others are the best that is left.

    Data with a motor inertia of -0.6: the fit of the other two equals their own pseudo-inverse to 1e-4.
    """
    motions = _runs(arm, LossParameters([-0.6, 0.8], [10.0, 6.0], [8.0, 5.0], [0, 0], [0, 0]), noise=0.2)
    analytic = _rigid(arm, motions)
    results = LossModel(transition_speed=0.0).fit(motions, analytic)
    x, y = _rows(0, motions, analytic)
    assert np.all(_values(results)[:, :3] >= 0.0)
    assert results.at_bound == (("motor_inertia",), ())
    assert results.params.motor_inertia[0] < 1e-4
    assert np.allclose(_values(results)[0, 1:3], np.linalg.pinv(x[:, 1:]) @ y, rtol=1e-4)


def test_an_offset_may_be_negative(arm: ArmModel) -> None:
    """The offset's sign is free; without it in the model it is zero."""
    motions = _runs(arm, LossParameters([0.5, 0.8], [10, 6], [8, 5], [-3.0, 2.0], [0, 0]))
    assert np.allclose(LossModel(offset=True).fit(motions, _rigid(arm, motions)).params.offset, [-3, 2], atol=0.05)
    assert np.all(LossModel().fit(motions, _rigid(arm, motions)).params.offset == 0.0)


@pytest.mark.parametrize("width", [0.005, 0.02, 0.08])
def test_each_joint_finds_its_own_transition(arm: ArmModel, width: float) -> None:
    """The width that made the data is the one of the grid that is found, joint by joint."""
    true = LossParameters([0.5, 0.8], [10.0, 6.0], [8.0, 5.0], [0, 0], [width, 0.02])
    motions = _runs(arm, true, noise=0.1)
    found = LossModel().fit(motions, _rigid(arm, motions)).params.transition_speed
    assert found.tolist() == [width, 0.02]


def test_spikes_pull_squares_and_not_the_robust_fit(arm: ArmModel) -> None:
    """Bursts of 60 N m in 3 % of the time: Huber's fit stays within 3 % of every friction figure, and at least

    three times nearer than squares.
    """
    spiky = []
    for motion in _runs(arm, TRUE, noise=0.2):
        tau = motion.tau.copy()
        for start in range(100, len(tau) - 20, 400):
            tau[start : start + 12] += 60.0
        spiky.append(exact_motion(motion.time, (motion.q, motion.dq, motion.ddq), tau, motion.joints))
    truth = np.stack([TRUE.viscous, TRUE.coulomb], axis=1)
    errors = {}
    for robust in (False, True):
        results = LossModel(robust=robust, transition_speed=0.0).fit(spiky, _rigid(arm, spiky))
        errors[robust] = np.abs(_values(results)[:, 1:3] / truth - 1)
    assert errors[True].max() < 0.03
    assert errors[True].max() < errors[False].max() / 3


def test_intervals_cover_the_truth_under_autocorrelated_noise(arm: ArmModel) -> None:
    """60 sessions of 40 s with AR(1) noise of 0.33 s correlation time: the 95 % intervals hold 90 to 99 % of the true

    figures (blocks of 1.5 s). Intervals that took samples as independent would hold fewer than 60 %.
    """
    truth = np.stack([TRUE.motor_inertia, TRUE.viscous, TRUE.coulomb, TRUE.offset], axis=1)
    model, inside, naive = LossModel(offset=True, transition_speed=0.0), [], []
    for session in range(60):
        rng, motions = np.random.default_rng(session), []
        seeds = [1000 + 2 * session, 1001 + 2 * session]
        for motion in made_motions(arm, lambda q, dq, ddq: TRUE.torque(dq, ddq), seeds):
            noise = 0.3 * lfilter([1.0], [1.0, -0.97], rng.standard_normal(motion.tau.shape), axis=0)
            states = (motion.q, motion.dq, motion.ddq)
            motions.append(exact_motion(motion.time, states, motion.tau + noise, motion.joints))
        results = model.fit(motions, [np.zeros_like(motion.tau) for motion in motions])
        low, high = np.moveaxis(results.conf_int(), -1, 0)
        inside.append((low <= truth) & (truth <= high))
        for j in range(2):
            x = np.concatenate([loss_columns(motion, np.zeros(2))[motion.moving[:, j], j] for motion in motions])
            std = results.residual_rms[j] * np.sqrt(np.diag(np.linalg.inv(x.T @ x)))
            naive.append(np.abs(_values(results)[j] - truth[j]) < 1.96 * std)
    assert 0.90 <= np.mean(inside) <= 0.99
    assert np.mean(naive) < 0.60


def test_wider_level_wider_interval(arm: ArmModel) -> None:
    """The 99 % interval holds the 95 % one, and both hold the estimate in their middle."""
    motions = _runs(arm, TRUE, noise=0.5)
    results = LossModel().fit(motions, _rigid(arm, motions))
    narrow, wide = results.conf_int(0.95), results.conf_int(0.99)
    fitted = slice(0, 3)
    assert np.all(wide[:, fitted, 0] < narrow[:, fitted, 0])
    assert np.all(narrow[:, fitted, 1] < wide[:, fitted, 1])
    assert np.allclose(narrow.mean(axis=-1), _values(results))


def test_summary_has_a_row_for_each_fitted_figure(arm: ArmModel) -> None:
    """Joint, name, value, interval and unit of every figure that was fitted, and a note on those at their bound."""
    motions = _runs(arm, LossParameters([-0.6, 0.8], [10.0, 6.0], [8.0, 5.0], [0, 0], [0, 0]), noise=0.2)
    results = LossModel(transition_speed=0.0).fit(motions, _rigid(arm, motions))
    lines = results.summary().splitlines()
    assert len(lines) == 1 + 2 * 3
    assert "95 % interval" in lines[0]
    assert lines[1].startswith("joint_1")
    assert "motor_inertia" in lines[1]
    assert lines[1].endswith("kg m²  on its bound")
    assert lines[6].split()[:2] == ["joint_2", "coulomb"]
    assert lines[6].endswith("N m")
    assert float(lines[6].split()[2]) == pytest.approx(5.0, abs=0.1)


@pytest.mark.parametrize("width", [None, 0.0])
def test_a_joint_that_never_moves_is_refused_by_name(arm: ArmModel, width: float | None) -> None:
    """Its loss can't be known: the error names the joint and what to do."""
    resting = []
    for motion in _runs(arm, TRUE):
        states = tuple(values * [1.0, 0.0] for values in (motion.q, motion.dq, motion.ddq))
        resting.append(exact_motion(motion.time, states, motion.tau, motion.joints))
    with pytest.raises(RecordingError, match=r"joint_2 hardly moves.*lock it"):
        LossModel(transition_speed=width).fit(resting, _rigid(arm, resting))


def test_torque_is_eq_3() -> None:
    """B ddq + C dq + f sign(dq) + offset, with tanh in place of the sign where a width is given; zero() has none."""
    params = LossParameters([2.0, 2.0], [3.0, 3.0], [5.0, 5.0], [0.5, 0.5], [0.0, 0.1])
    dq, ddq = np.array([[0.1, 0.1], [-0.1, 0.0], [0.0, -1.0]]), np.array([[1.0, 1.0], [0.0, 0.0], [0.0, 0.0]])
    near = np.tanh(1.0)
    expected = [[7.8, 2.8 + 5 * near], [-4.8, 0.5], [0.5, -2.5 - 5 * np.tanh(10.0)]]
    assert np.allclose(params.torque(dq, ddq), expected)
    assert np.all(LossParameters.zero(2).torque(dq, ddq) == 0.0)
    assert np.all(np.abs(direction(10 * dq, params.transition_speed)) <= 1.0)
