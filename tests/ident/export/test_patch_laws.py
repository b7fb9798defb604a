"""Laws of the written module: the same torque as the effects' own columns."""

import numpy as np
import pytest

from ident.effects.base import Effect, SessionContext
from ident.effects.catalogue import CATALOGUE
from ident.laws.acting import KNOWN, acting_torque, read_log, undo_log
from ident.laws.motion import Losses, MovingArm, rigid_torque
from ident.model.carried import describe_arm
from ident.model.linearisation import Sliding
from ident.robot.arm import ArmModel
from tests.ident.effects.smooth_motion import COULOMB, VISCOUS
from tests.ident.export.exact_laws import drawn, in_module, states_of
from tests.ident.made_up import random_states, sliding_arm


@pytest.mark.parametrize("effect", [one for one in CATALOGUE if not one.event], ids=lambda effect: effect.id)
def test_the_module_evaluates_the_law(effect: Effect, session: SessionContext) -> None:
    """From a diagnosis' record alone the module gives the law's torque to 1 % of its largest, over random draws."""
    rng = np.random.default_rng(4)
    assert effect.id in KNOWN
    for _ in range(3):
        variant, change, beta = drawn(effect, session, rng)
        found, wanted = in_module(session, change, variant, beta)
        np.testing.assert_allclose(found, wanted, atol=1e-2 * np.abs(wanted).max())


@pytest.mark.parametrize("robot", ["tm5-900", "sliding"])
def test_the_modules_dynamics_are_the_arms(robot: str) -> None:
    """Newton and Euler in NumPy agree with Pinocchio, for turning and sliding joints."""
    arm = sliding_arm() if robot == "sliding" else ArmModel.load(robot)
    states = random_states(np.random.default_rng(2), 50, arm.n)
    np.testing.assert_allclose(rigid_torque(describe_arm(arm), *states), arm.inverse_dynamics(*states), atol=1e-9)


def test_a_log_is_undone(session: SessionContext) -> None:
    """Gain, offset and delay of a log are taken out again."""
    effects = [
        ("torque_gain_error", 1, {"gain": 0.1}),
        ("torque_offset", 2, {"offset_Nm": 0.7}),
        ("torque_delay", -1, {"delay_s": 0.0123}),
    ]
    torque, interval = session.runs[0].rigid, session.runs[0].interval
    back = undo_log(effects, read_log(effects, torque, interval), interval)
    np.testing.assert_allclose(back[10:-10], torque[10:-10], atol=2e-3 * np.abs(torque).max())


def test_laws_with_a_memory_ask_for_a_run(session: SessionContext) -> None:
    """One state does not say what went before."""
    states = states_of(session.runs[0])
    one = MovingArm(states.arm, states.losses, states.q[:1], states.dq[:1], states.ddq[:1])
    effect = ("presliding_hysteresis", 1, {"part_0_Nm": 1.0, "range_0_rad": 0.01})
    with pytest.raises(ValueError, match="give a whole run"):
        acting_torque([effect], one)


def test_friction_turns_round_as_the_diagnosis_has_it(session: SessionContext) -> None:
    """Over a displacement at some joints, over a speed at the others: the module's direction is the diagnosis's."""
    sliding = Sliding(np.array([0.0, 2e-4, 0.0, 5e-5, 4e-4, 0.0]), np.array([0.01, 1.0, 0.03, 1.0, 1.0, 0.005]))
    losses = Losses(np.zeros(6), VISCOUS, COULOMB, np.where(sliding.range > 0.0, 0.01, sliding.speed), sliding.range)
    run = session.runs[1]
    states = MovingArm(describe_arm(run.arm), losses, run.motion.q, run.motion.dq, run.motion.ddq, run.interval)
    np.testing.assert_allclose(states.direction, sliding.direction(run.motion), atol=1e-12)
