"""Laws of the arm that a diagnosis linearises about.

Laws of the losses' torque.
"""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.signal import lfilter

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.laws.motion import direction
from ident.model.linearisation import correlation_time, fit_losses, rigid_torque, tune_links
from ident.model.loss import LossParameters, loss_columns
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.made_up import exact_motion, made_motions, two_joint_arm

TRUE = LossParameters([0.5, 0.8], [10.0, 6.0], [8.0, 5.0], [0.0, 0.0], [0.02, 0.02])


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return two_joint_arm()


def _runs(arm: ArmModel, params: LossParameters, noise: float = 0.0, seeds: Sequence[int] = (1, 2)) -> list[Motion]:
    return made_motions(
        arm, lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq) + params.torque(dq, ddq), seeds, noise=noise
    )


def _values(params: LossParameters) -> Float[Array, "n 3"]:
    return np.stack([params.motor_inertia, params.viscous, params.coulomb], axis=1)


def _fitted(arm: ArmModel, motions: Sequence[Motion]) -> LossParameters:
    return fit_losses(motions, [rigid_torque(arm, motion) for motion in motions])


def test_exact_data_give_the_exact_losses(arm: ArmModel) -> None:
    """Without noise every loss comes back to 1e-5."""
    assert np.allclose(_values(_fitted(arm, _runs(arm, TRUE))), _values(TRUE), rtol=1e-5)


def test_equals_the_pseudo_inverse_where_nothing_is_at_its_bound(arm: ArmModel) -> None:
    """Eq. 5, joint by joint; where least squares want a negative one it is zero, and the others are the best left."""
    for inertia, kept in ((0.5, slice(0, 3)), (-0.6, slice(1, 3))):
        motions = _runs(arm, LossParameters([inertia, 0.8], *(getattr(TRUE, k) for k in KINDS)), noise=0.2)
        found = _fitted(arm, motions)
        x = [loss_columns(m, found.transition_speed)[m.moving[:, 0], 0, kept] for m in motions]
        y = [(m.tau_filtered - m.filtered(rigid_torque(arm, m)))[m.moving[:, 0], 0] for m in motions]
        assert np.allclose(_values(found)[0, kept], np.linalg.pinv(np.concatenate(x)) @ np.concatenate(y), rtol=1e-6)
        assert (found.motor_inertia[0] == 0.0) == (inertia < 0.0)


KINDS = ("viscous", "coulomb", "offset", "transition_speed")


@pytest.mark.parametrize("width", [0.005, 0.02, 0.08])
def test_each_joint_finds_its_own_transition(arm: ArmModel, width: float) -> None:
    """The width that made the data is the one of the grid that is found, joint by joint."""
    true = LossParameters([0.5, 0.8], [10.0, 6.0], [8.0, 5.0], [0, 0], [width, 0.02])
    assert _fitted(arm, _runs(arm, true, noise=0.1)).transition_speed.tolist() == [width, 0.02]


def test_a_joint_that_never_moves_is_refused_by_name_and_may_be_left_out(arm: ArmModel) -> None:
    resting = []
    for motion in _runs(arm, TRUE):
        states = tuple(values * [1.0, 0.0] for values in (motion.q, motion.dq, motion.ddq))
        resting.append(exact_motion(motion.time, states, motion.tau, motion.joints))  # type: ignore[arg-type]
    with pytest.raises(RecordingError, match=r"joint_2 hardly moves.*lock it"):
        _fitted(arm, resting)
    assert not _values(fit_losses(resting, [rigid_torque(arm, m) for m in resting], {1}))[1].any()


def test_links_come_near_the_true_ones_and_silent_ones_stay(arm: ArmModel) -> None:
    """Torque of links 20 % heavier to 2 % on unseen states; without motion all stays as the URDF has it."""
    real = arm.with_inertial_parameters(1.2 * arm.inertial_parameters)
    motions = made_motions(
        arm, lambda q, dq, ddq: real.inverse_dynamics(q, dq, ddq) + TRUE.torque(dq, ddq), [1, 2], noise=0.1
    )
    tuned, base = tune_links(motions, arm, 2.0)
    test = _runs(real, TRUE, seeds=(9,))[0]
    found = rigid_torque(tuned, test) + _fitted(tuned, motions).torque(test.dq, test.ddq)  # rotors trade with links
    assert np.abs(found - test.tau).max() < 0.02 * np.abs(test.tau).max()
    assert base.rank == len(base.names)
    still = [exact_motion(m.time, (0 * m.q, 0 * m.dq, 0 * m.ddq), m.tau, m.joints) for m in motions]
    assert np.array_equal(tune_links(still, arm, 2.0)[0].inertial_parameters, arm.inertial_parameters)


@pytest.mark.parametrize(("persistence", "expected"), [(0.0, 1.0), (0.5, 3.0), (0.9, 19.0)])
def test_correlation_time_of_a_known_process(persistence: float, expected: float) -> None:
    """An AR(1) of coefficient φ: (1 + φ) / (1 - φ) samples, within 20 %."""
    noise = np.random.default_rng(2).standard_normal(50_000)
    assert correlation_time(lfilter([1.0], [1.0, -persistence], noise)) == pytest.approx(expected, rel=0.2)


def test_torque_is_eq_3() -> None:
    """B ddq + C dq + f sign(dq) + offset, with tanh in place of the sign where a width is given; zero() has none."""
    params = LossParameters([2.0, 2.0], [3.0, 3.0], [5.0, 5.0], [0.5, 0.5], [0.0, 0.1])
    dq, ddq = np.array([[0.1, 0.1], [-0.1, 0.0], [0.0, -1.0]]), np.array([[1.0, 1.0], [0.0, 0.0], [0.0, 0.0]])
    near = np.tanh(1.0)
    expected = [[7.8, 2.8 + 5 * near], [-4.8, 0.5], [0.5, -2.5 - 5 * np.tanh(10.0)]]
    assert np.allclose(params.torque(dq, ddq), expected)
    assert np.all(LossParameters.zero(2).torque(dq, ddq) == 0.0)
    assert np.all(np.abs(direction(10 * dq, params.transition_speed)) <= 1.0)
