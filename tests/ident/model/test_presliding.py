"""How friction turns round: over a displacement, however fast, or over a speed; each is found for what it is."""

from __future__ import annotations

import numpy as np
import pytest

from ident.model.linearisation import Sliding, _sharpest, fit_sliding, stop_operator
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import COULOMB, ROTOR, VISCOUS, load_arm
from tests.ident.made_up import made_motions


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return load_arm()


def record(arm: ArmModel, sliding: str) -> list[Motion]:
    def law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        slip = (
            np.stack([stop_operator(np.ascontiguousarray(column), 2e-4) / 2e-4 for column in q.T], axis=1)
            if sliding == "range"
            else np.tanh(dq / 0.04)
        )
        return arm.inverse_dynamics(q, dq, ddq) + ROTOR * ddq + VISCOUS * dq + COULOMB * slip

    return made_motions(arm, law, range(3), 8.0, 200.0, noise=0.1)


def test_a_stop_holds_its_range() -> None:
    """Law: the state never leaves ±r, equals the path inside it, and turns over 2 r after a reversal."""
    q = np.concatenate([np.linspace(0.0, 1.0, 101), np.linspace(1.0, 0.0, 101)])
    state = stop_operator(q, 0.1)
    assert np.abs(state).max() <= 0.1
    np.testing.assert_allclose(state[:11], q[:11], atol=1e-12)
    np.testing.assert_allclose(state[101:122], 0.1 - (1.0 - q[101:122]), atol=1e-12)
    np.testing.assert_allclose(state[125:], -0.1)


def test_direction_does_not_depend_on_the_pace(arm: ArmModel) -> None:
    """Law: the same path at half the speed has the same direction at the same places."""
    (motion,) = record(arm, "range")[:1]
    sliding = Sliding(np.full(3, 1e-3), np.ones(3))
    slow = Motion(**{**vars(motion), "dq": motion.dq / 2})
    np.testing.assert_array_equal(sliding.direction(motion), sliding.direction(slow))


@pytest.mark.parametrize("kind", ["range", "speed"])
def test_what_turns_the_friction_round_is_found(arm: ArmModel, kind: str) -> None:
    """Law: tanh(dq / 0.04) is found as a speed of 0.04 rad/s at every joint; a stop of 0.2 mrad, which the position is
    too noisy to follow, by what comes nearest: where the joint slides steadily its direction is right."""
    motions = record(arm, kind)
    found = fit_sliding(motions, [arm.inverse_dynamics(m.q, m.dq, m.ddq) for m in motions])
    if kind == "speed":
        np.testing.assert_array_equal(found.range, 0.0)
        np.testing.assert_allclose(found.speed, 0.04)
        return
    assert (found.range > 5e-5).any()
    for motion in motions:
        off = found.direction(motion)[motion.coarse] - np.sign(motion.dq[motion.coarse])
        assert np.sqrt(np.mean(off[motion.settled] ** 2)) < 0.1


def test_a_lubricant_that_thins_is_no_slow_turning(arm: ArmModel) -> None:
    """Law: beside drag that grows as asinh(dq / 0.1) dry friction that turns round at once is found to do so."""

    def law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        drag = COULOMB * np.arcsinh(dq / 0.1)
        return arm.inverse_dynamics(q, dq, ddq) + ROTOR * ddq + drag + 0.5 * COULOMB * np.tanh(dq / 1e-3)

    motions = made_motions(arm, law, range(3), 8.0, 200.0, noise=0.1)
    found = fit_sliding(motions, [arm.inverse_dynamics(m.q, m.dq, m.ddq) for m in motions])
    for motion in motions:
        off = found.direction(motion)[motion.coarse] - np.sign(motion.dq[motion.coarse])
        assert np.sqrt(np.mean(off[motion.settled] ** 2, axis=0)).max() < 0.15


@pytest.mark.parametrize("alike", [1, 16])
def test_samples_that_err_alike_count_once(alike: int) -> None:
    """Law: a smoother turning that leaves 0.6 % less of 3000 samples is nine nats better where each errs for itself;

    where sixteen err alike it is not, and the sharper one is taken.
    """
    samples = np.full((60, 1), 50.0)
    left = np.random.default_rng(0).chisquare(50 / alike, size=(60, 1)) * alike
    assert _sharpest(np.array([1.006 * left, left]), samples)[0] == (1 if alike == 1 else 0)
