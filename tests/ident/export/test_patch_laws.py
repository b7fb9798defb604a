"""Laws of the written module: the same torque as the effects' own columns."""

from __future__ import annotations

import numpy as np
import pytest

from ident.arrays import Array
from ident.effects.base import Interval, SessionContext, Variant
from ident.effects.catalogue import CATALOGUE, find_effect
from ident.export.controllers import describe_arm
from ident.export.identified import Change
from ident.laws.acting import KNOWN, Effect, acting_torque, read_log, undo_log
from ident.laws.motion import Losses, MovingArm, rigid_torque
from ident.model.linearisation import Sliding
from ident.robot.arm import ArmModel
from tests.ident.effects.smooth_motion import COULOMB, VISCOUS
from tests.ident.made_up import random_states, sliding_arm

# Effect, joint, coefficients, which of its variants, and what linearisation may cost as a share of the torque.
CASES = [
    ("stribeck_friction", 1, [3.0], 3, 1e-9),
    ("nonlinear_viscous_friction", 1, [2.0], 1, 1e-9),
    ("nonlinear_viscous_friction", 1, [2.0], -1, 1e-9),
    ("load_dependent_friction", 1, [0.07, 0.02], 0, 1e-9),
    ("load_dependent_friction", 1, [0.05, 0.03, 0.02, 0.1], 1, 1e-9),
    ("presliding_hysteresis", 1, [1.5, 0.5, 0.0, 2.0, 0.7], 0, 1e-9),
    ("position_dependent_friction", 2, [1.0, 2.0], 1, 1e-9),
    ("asymmetric_friction", 2, [1.0, 0.5], 0, 1e-9),
    ("joint_coupling", 2, [1.0, 2.0, 0.3], 0, 1e-9),
    ("joint_elasticity", 1, [1.0], 1, 2e-2),
    ("backlash", 1, [5e-4], 0, 1e-2),
    ("torque_ripple", 1, [1.0, 0.5], 0, 1e-9),
    ("torque_ripple", 1, [1.0, 0.5], 1, 1e-9),
    ("spring_torque", 2, [2.0, 1.0], 0, 1e-9),
    ("spring_torque", 2, [2.0, 1.0, 0.5, -0.4], 1, 1e-9),
    ("spring_torque", 2, [2.0, 1.0], 2, 1e-9),
    ("payload", -1, [1.0, 0.002, -0.003, 0.001], 0, 1e-3),
    ("link_inertial_error", 2, [0.3, 0.01, -0.02, 0.01], 0, 1e-9),
    ("gravity_misalignment", -1, [1e-3, -2e-3], 0, 5e-3),
    ("torque_gain_error", 1, [0.05], 0, 1e-9),
    ("torque_offset", 1, [0.7, 0.0], 0, 1e-9),
    ("torque_delay", -1, [0.008], 1, 1e-9),
    ("torque_saturation", 1, [1.0], 1, 1e-9),
    ("torque_saturation", 1, [0.6], 0, 1e-9),
    ("encoder_offset", 1, [1e-4], 0, 1e-3),
]


def states_of(session: SessionContext, k: int, losses: Losses | None = None) -> MovingArm:
    """A run as the module sees it."""
    run = session.runs[k]
    zero = np.zeros(run.n)
    known = losses or Losses(zero, VISCOUS, COULOMB, np.full(run.n, 0.01), zero)
    motion = run.motion
    return MovingArm(describe_arm(run.arm), known, motion.q, motion.dq, motion.ddq, run.interval, run.direction)


def as_named(session: SessionContext, name: str, joint: int, variant: Variant, beta: Array) -> Effect:
    """The effect as a diagnosis reports it and a patch takes it."""
    effect = find_effect(name)
    figures = effect.parameters(session, max(joint, 0), variant, beta, np.zeros((len(beta), len(beta))))
    figures |= {key: Interval(value, value, value) for key, value in variant.inner.items()}
    law = {"coefficients": list(beta), "shape": dict(variant.shape)} if effect.open_law else None
    return name, joint, Change(name, joint, (), figures, law, effect).values


def predicted(effect: Effect, motion: MovingArm) -> Array:
    """Extra torque of one effect, of the log's own effects too."""
    model = motion.rigid + motion.losses.torque(motion.dq, motion.ddq, motion.direction)
    return np.asarray(read_log([effect], model + acting_torque([effect], motion), motion.interval) - model)


def by_columns(session: SessionContext, name: str, joint: int, variant: Variant, beta: Array, k: int) -> Array:
    """The same from the effect's own columns."""
    torque = find_effect(name).columns(session, max(joint, 0), variant)[k] @ beta
    if torque.ndim == 2:
        return np.asarray(torque)
    whole = np.zeros((len(torque), session.n))
    whole[:, joint] = torque
    return whole


@pytest.mark.parametrize(
    ("name", "joint", "coefficients", "index", "tolerance"), CASES, ids=[case[0] for case in CASES]
)
def test_the_module_says_what_the_columns_say(
    session: SessionContext, name: str, joint: int, coefficients: list[float], index: int, tolerance: float
) -> None:
    """From reported figures alone the module gives the torque of columns times coefficients."""
    variant = find_effect(name).variants(session, max(joint, 0))[index]
    width = find_effect(name).columns(session, max(joint, 0), variant)[0].shape[-1]
    beta = np.pad(np.array(coefficients), (0, width - len(coefficients)))
    if name == "joint_elasticity":
        beta /= variant.shape["stiffness_Nm_rad"]  # a point of the grid is exact at its own stiffness
    effect = as_named(session, name, joint, variant, beta)
    wanted = by_columns(session, name, joint, variant, beta, 1)
    found = predicted(effect, states_of(session, 1))
    assert np.abs(wanted).max() > 1e-3
    np.testing.assert_allclose(found, wanted, atol=tolerance * np.abs(wanted).max())


def test_the_other_laws_are_told_apart() -> None:
    """Every effect of the catalogue has a law, but for contact, whose direction no diagnosis reports."""
    assert {*KNOWN, "external_contact"} == {effect.id for effect in CATALOGUE}


def test_warm_friction_is_a_share_of_the_cold(session: SessionContext) -> None:
    """With the session's warmth given, the module has the columns' torque on top of the cold joint's losses."""
    thermal = find_effect("thermal_friction")
    variant, beta = thermal.variants(session, 1)[0], np.array([4.0, 1.0])
    columns = thermal.columns(session, 1, variant)[1]
    run, mean = session.runs[1], variant.shape["mean"]
    cold = Losses(np.zeros(6), VISCOUS + mean * beta[0], COULOMB - mean * beta[1], np.full(6, 0.01), np.zeros(6))
    warmth = columns[:, 1] / np.where(run.direction[:, 1] == 0.0, 1.0, run.direction[:, 1])
    states = states_of(session, 1, cold)
    warm = MovingArm(states.arm, cold, states.q, states.dq, states.ddq, states.interval, states.slip, warmth)
    effect = as_named(session, "thermal_friction", 1, variant, beta)
    np.testing.assert_allclose(acting_torque([effect], warm)[:, 1], columns @ beta, atol=1e-6)


@pytest.mark.parametrize("robot", ["tm5-900", "sliding"])
def test_the_modules_dynamics_are_the_arms(robot: str) -> None:
    """Newton and Euler in NumPy agree with Pinocchio, for turning and sliding joints."""
    arm = sliding_arm() if robot == "sliding" else ArmModel.load(robot)
    states = random_states(np.random.default_rng(2), 50, arm.n)
    np.testing.assert_allclose(rigid_torque(describe_arm(arm), *states), arm.inverse_dynamics(*states), atol=1e-9)


def test_a_log_is_undone(session: SessionContext) -> None:
    """Gain, offset and delay of a log are taken out again."""
    effects: list[Effect] = [
        ("torque_gain_error", 1, {"gain": 0.1}),
        ("torque_offset", 2, {"offset_Nm": 0.7}),
        ("torque_delay", -1, {"delay_s": 0.0123}),
    ]
    torque, interval = session.runs[0].rigid, session.runs[0].interval
    back = undo_log(effects, read_log(effects, torque, interval), interval)
    np.testing.assert_allclose(back[10:-10], torque[10:-10], atol=2e-3 * np.abs(torque).max())


def test_laws_with_a_memory_ask_for_a_run(session: SessionContext) -> None:
    """One state does not say what went before."""
    states = states_of(session, 0)
    one = MovingArm(states.arm, states.losses, states.q[:1], states.dq[:1], states.ddq[:1])
    effect = ("presliding_hysteresis", 1, {"part_0_Nm": 1.0, "range_0_rad": 0.01})
    with pytest.raises(ValueError, match="give a whole run"):
        acting_torque([effect], one)


@pytest.mark.parametrize("mix", [1.0, -1.0])
def test_friction_of_two_joints_together(session: SessionContext, mix: float) -> None:
    """The sign of the viscous part says whether the sum or the difference of two joints rubs."""
    variants = find_effect("joint_coupling").variants(session, 1)
    variant = next(v for v in variants if v.other == 0 and v.shape["mix"] == mix)
    beta = np.array([2.0, mix * 0.5])
    effect = as_named(session, "joint_coupling", 1, variant, beta)
    left = predicted(effect, states_of(session, 0)) - by_columns(session, "joint_coupling", 1, variant, beta, 0)
    assert np.sqrt(np.mean(left**2)) < 0.02 * 2.0


def test_friction_turns_round_as_the_diagnosis_has_it(session: SessionContext) -> None:
    """Over a displacement at some joints, over a speed at the others: the module's direction is the diagnosis's."""
    sliding = Sliding(np.array([0.0, 2e-4, 0.0, 5e-5, 4e-4, 0.0]), np.array([0.01, 1.0, 0.03, 1.0, 1.0, 0.005]))
    losses = Losses(np.zeros(6), VISCOUS, COULOMB, np.where(sliding.range > 0.0, 0.01, sliding.speed), sliding.range)
    run = session.runs[1]
    states = MovingArm(describe_arm(run.arm), losses, run.motion.q, run.motion.dq, run.motion.ddq, run.interval)
    np.testing.assert_allclose(states.direction, sliding.direction(run.motion), atol=1e-12)
