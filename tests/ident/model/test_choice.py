"""Laws of what a fit's model is made of: chosen by runs left out."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from ident.arrays import Array
from ident.command_options import FitOptions
from ident.errors import InputError
from ident.fitting.choice import choose
from ident.fitting.fit import fit_hybrid
from ident.laws.friction_laws import JointStates, load_dependent_friction
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.made_up import exact_motion, multisine

OWN = np.array([[0.6, 10.0, 8.0], [0.8, 6.0, 5.0]])  # rotor inertia, viscous, Coulomb of each joint
RATE, NOISE = 100.0, 0.1
Further = Callable[[Array, Array, Array, Array], Array]


def made_runs(arm: ArmModel, further: Further, runs: int = 5, width: float = 1e-3, seed: int = 0) -> list[Motion]:
    """Runs of a two-joint arm with plain losses and something further."""
    rng, motions = np.random.default_rng(seed), []
    time = np.arange(int(10.0 * RATE)) / RATE
    for k in range(runs):
        q, dq, ddq = multisine(rng, time, 2)
        rigid = arm.inverse_dynamics(q, dq, ddq)
        tau = rigid + OWN[:, 0] * ddq + OWN[:, 1] * dq + OWN[:, 2] * np.tanh(dq / width)
        tau = tau + further(q, dq, ddq, rigid) + NOISE * rng.standard_normal(dq.shape)
        motions.append(exact_motion(time, (q, dq, ddq), tau, arm.joint_names, f"run_{k}"))
    return motions


def nothing(q: Array, dq: Array, ddq: Array, rigid: Array) -> Array:
    """No further torque."""
    return np.zeros_like(q)


def constant(q: Array, dq: Array, ddq: Array, rigid: Array) -> Array:
    """A sensor's bias at the first joint."""
    return np.broadcast_to(np.array([1.5, 0.0]), q.shape)


def loaded(q: Array, dq: Array, ddq: Array, rigid: Array) -> Array:
    """Friction of the second joint that grows by 15 % of its load."""
    states = JointStates(q[:, 1], dq[:, 1], rigid[:, 1], np.sign(dq[:, 1]))
    both = load_dependent_friction(states, {"terms": 2.0})
    return np.column_stack([np.zeros(len(q)), 0.15 * (both[0] + both[1])])


def test_offsets_are_there_where_runs_left_out_ask_for_them(two_joints: ArmModel) -> None:
    """A bias is found as an offset and not as friction; where there is none, no offset is fitted."""
    biased = choose(made_runs(two_joints, constant), two_joints)
    assert biased.offset
    assert not choose(made_runs(two_joints, nothing), two_joints).offset
    assert not choose(made_runs(two_joints, constant), two_joints, offset="off").offset
    model = fit_hybrid(made_runs(two_joints, constant), two_joints, FitOptions(net="none")).model
    assert model.loss.offset[0] == pytest.approx(1.5, abs=0.2)


def test_friction_that_runs_left_out_ask_for_is_a_law_of_its_joint(two_joints: ArmModel) -> None:
    """Load-dependent friction is taken at the joint that has it; an arm with plain losses gets no law."""
    found = choose(made_runs(two_joints, loaded), two_joints)
    assert ("load_dependent_friction", 1) in {(law.effect, law.joint) for law in found.laws}
    assert choose(made_runs(two_joints, nothing), two_joints).laws == ()
    assert choose(made_runs(two_joints, loaded), two_joints, tried=False).laws == ()


def paced_runs(arm: ArmModel, paces: Sequence[float], friction: Callable[[Array], Array], seed: int) -> list[Motion]:
    """Runs at so many shares of a usual pace, with plain losses but for their dry friction."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(10.0 * RATE)) / RATE
    motions = []
    for k, pace in enumerate(paces):
        q, dq, ddq = (pace * part for part in multisine(rng, time, 2))
        tau = arm.inverse_dynamics(q, dq, ddq) + OWN[:, 0] * ddq + OWN[:, 1] * dq + friction(dq)
        tau = tau + 0.5 * NOISE * rng.standard_normal(dq.shape)
        motions.append(exact_motion(time, (q, dq, ddq), tau, arm.joint_names, f"run_{k}"))
    return motions


def test_how_friction_turns_round_is_no_law(two_joints: ArmModel) -> None:
    """Joints that stick and creep below 0.02 rad/s, in no way that a tanh turns, are told their plain losses."""

    def sticking(dq: Array) -> Array:
        return OWN[:, 2] * np.sign(dq) * np.clip((dq / 0.02) ** 2, 0.3, 1.0)

    runs = paced_runs(two_joints, (0.05, 0.05, 0.5, 0.8, 1.0), sticking, seed=1)
    assert choose(runs, two_joints).laws == ()
    loss = fit_hybrid(runs, two_joints, FitOptions(net="none")).model.loss
    assert np.allclose(loss.viscous, OWN[:, 1], rtol=0.05)
    assert np.allclose(loss.coulomb, OWN[:, 2], rtol=0.05)


def test_a_law_that_one_slow_run_shows_is_found(two_joints: ArmModel) -> None:
    """Friction that falls over the first 0.1 rad/s is named at its joint, though four of five runs are faster."""

    def falling(dq: Array) -> Array:
        extra = np.array([0.0, 1.5]) * np.exp(-np.abs(dq) / 0.1)
        return (OWN[:, 2] + extra) * np.tanh(dq / 1e-3)

    found = choose(paced_runs(two_joints, (0.1, 0.5, 0.5, 1.0, 1.0), falling, seed=0), two_joints)
    assert [(law.effect, law.joint) for law in found.laws] == [("stribeck_friction", 1)]


def test_the_width_of_friction_is_found(two_joints: ArmModel) -> None:
    """A knee of 0.04 rad/s is told from a sharp turn, and one slow run spoils no damping."""
    smooth = made_runs(two_joints, nothing, width=0.04)
    assert np.all(np.abs(choose(smooth, two_joints).widths - 0.04) <= 0.02)
    assert np.all(choose(made_runs(two_joints, nothing), two_joints).widths <= 0.01)
    rng, time = np.random.default_rng(9), np.arange(1000) / RATE
    q, dq, ddq = (0.06 * part for part in multisine(rng, time, 2))
    tau = two_joints.inverse_dynamics(q, dq, ddq) + OWN[:, 0] * ddq + OWN[:, 1] * dq + OWN[:, 2] * np.tanh(dq / 0.04)
    slow = exact_motion(time, (q, dq, ddq), tau, two_joints.joint_names, "slow")
    loss = fit_hybrid([*smooth, slow], two_joints, FitOptions(net="none")).model.loss
    assert np.allclose(loss.viscous, OWN[:, 1], rtol=0.03)
    assert np.allclose(loss.coulomb, OWN[:, 2], rtol=0.03)


def test_the_cost_of_bodies_is_said_where_a_drive_gain_is_off(two_joints: ArmModel) -> None:
    """A gain of a third makes bodies that could exist dear: base parameters are taken, and the joint is named."""
    runs = []
    for run in made_runs(two_joints, nothing):
        gain = np.array([1.0, 0.2])
        runs.append(exact_motion(run.time, (run.q, run.dq, run.ddq), gain * run.tau, run.joints, run.name))
    found = choose(runs, two_joints, tried=False)
    errors = {kind: one.total for kind, one in found.errors.items()}
    assert errors[found.kind] <= 1.01 * min(errors.values())
    assert errors["nominal"] > 2.0 * errors[found.kind]
    assert any("URDF's inertias cost" in line and "joint_" in line for line in found.describe())
    assert set(found.to_dict()["rmse_by_inertia_Nm"]) == {"consistent", "base", "nominal"}


def test_a_coupling_is_fitted_carried_and_kept(two_joints: ArmModel, tmp_path: Path) -> None:
    """Friction and inertia that each motor puts on the other joint come back, and go with the model's folder."""

    def coupled(q: Array, dq: Array, ddq: Array, rigid: Array) -> Array:
        both = 2.0 * np.tanh(dq.sum(axis=1) / 0.02)
        return np.column_stack([both + 0.5 * dq[:, 1] + 0.1 * ddq[:, 1], both + 0.5 * dq[:, 0] + 0.1 * ddq[:, 0]])

    runs = made_runs(two_joints, coupled)
    model = fit_hybrid(runs[:4], two_joints, FitOptions(net="none", coupling="1,2")).model
    for effect in model.carried:
        assert effect.parameters["mix"] == 1.0
        assert effect.parameters["coulomb_Nm"] == pytest.approx(2.0, abs=0.15)
        assert effect.parameters["viscous_Nms_rad"] == pytest.approx(0.5, abs=0.1)
    loaded_model = HybridModel.load(model.save(tmp_path / "model"))
    states = runs[4].q, runs[4].dq, runs[4].ddq
    assert np.allclose(loaded_model.torque(*states), model.torque(*states), atol=1e-9)
    left = runs[4].filtered(model.torque(*states) - runs[4].tau)[runs[4].moving]
    assert np.sqrt(np.mean(left**2)) < 3.0 * NOISE
    with pytest.raises(InputError, match=r"--coupling: .*no pair"):
        fit_hybrid(runs, two_joints, FitOptions(net="none", coupling="1,1"))


def test_a_model_of_the_defaults_is_saved_with_its_choice(two_joints: ArmModel, tmp_path: Path) -> None:
    """What was chosen, and what each kind of inertias leaves, stands in the folder and comes back."""
    model = fit_hybrid(made_runs(two_joints, loaded), two_joints, FitOptions(net="none")).model
    again = HybridModel.load(model.save(tmp_path / "model"))
    assert again.provenance["choice"] == model.provenance["choice"]
    assert again.provenance["choice"]["inertia"] == again.inertia
    assert again.named == model.named
