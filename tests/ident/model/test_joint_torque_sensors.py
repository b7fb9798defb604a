"""Effort without friction: rows near reversals count, losses are zero; and never where a joint has friction."""

from __future__ import annotations

import numpy as np
import pytest

from ident.arrays import Array
from ident.model.identification import HowToIdentify, Identified, describe, identify
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.made_up import made_motions, two_joint_arm

NOISE_NM = np.array([2.0, 1.0])


def drawn(arm: ArmModel, coulomb: tuple[float, float], seeds: list[int]) -> list[Motion]:
    """Runs of an arm that is heavier than its drawing, with noise in its torque."""
    rng = np.random.default_rng([7, *seeds])
    true = arm.with_inertial_parameters(1.2 * arm.inertial_parameters)

    def law(q: Array, dq: Array, ddq: Array) -> Array:
        dry = np.array(coulomb) * np.sign(dq)
        return true.inverse_dynamics(q, dq, ddq) + dry + NOISE_NM * rng.standard_normal(q.shape)

    return list(made_motions(arm, law, seeds, duration=12.0))


def error(found: Identified, arm: ArmModel, test: list[Motion]) -> float:
    """Error of the torque against the truth without noise [N m]."""
    true = arm.with_inertial_parameters(1.2 * arm.inertial_parameters)
    losses = found.loss.params
    off = []
    for motion in test:
        states = (motion.q, motion.dq, motion.ddq)
        rigid = found.inertia.arm.inverse_dynamics(*states) - true.inverse_dynamics(*states)
        dry = losses.coulomb * np.sign(motion.dq)
        off.append(rigid + losses.motor_inertia * motion.ddq + losses.viscous * motion.dq + dry)
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2)))


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return two_joint_arm()


def test_torque_at_the_link_has_no_losses(arm: ArmModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: they are exactly zero, that is told, and the torque is nearer to the truth than with friction sought."""
    test, better = drawn(arm, (0.0, 0.0), [90]), []
    for seed in (1, 2, 3):
        train = drawn(arm, (0.0, 0.0), [seed])
        found = identify(train, arm, HowToIdentify("consistent"))
        assert found.lossless == arm.joint_names
        params = found.loss.params
        assert np.all(np.stack([params.motor_inertia, params.viscous, params.coulomb]) < 1e-9)
        assert "torque at the link" in "\n".join(describe(found))
        with monkeypatch.context() as patch:
            patch.setattr(
                "ident.model.identification.find_frictionless", lambda found, n, again: (np.zeros(n, bool), found)
            )
            better.append(error(found, arm, test) / error(identify(train, arm, HowToIdentify("consistent")), arm, test))
    assert np.mean(better) < 0.8


@pytest.mark.parametrize("coulomb", [(8.0, 0.0), (0.0, 4.0), (8.0, 4.0)])
def test_where_one_joint_has_friction_none_is_without(arm: ArmModel, coulomb: tuple[float, float]) -> None:
    """Law: effort is of one kind at all joints; then nothing changes."""
    found = identify(drawn(arm, coulomb, [1]), arm, HowToIdentify("consistent"))
    assert found.lossless == ()
    assert found.loss.params.coulomb == pytest.approx(coulomb, abs=0.6)
