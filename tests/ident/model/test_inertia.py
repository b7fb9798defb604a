"""Laws of identified link inertias.

Least squares within what an arm can be: the conditions of a least value hold, and both solvers agree.
"""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
import pytest

from ident.arrays import Array, Float
from ident.command_options import FitOptions, Inertia
from ident.fitting.fit_sums import FitSums
from ident.fitting.identification import Identified, identify
from ident.model.bodies import is_consistent, solve_bounded, solve_partly_non_negative
from ident.model.inertia import base_parameters
from ident.model.loss import LossParameters
from ident.motion.motion import Motion
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel
from ident.robot.tolerance import parameter_scale
from tests.ident.made_up import exact_motion, made_motions, random_states, sliding_arm

LOSS = LossParameters(*(np.full(6, value) for value in (0.1, 8.0, 6.0, 0.0, 0.02)))
MODES: tuple[Inertia, ...] = ("nominal", "base", "consistent")


@pytest.fixture(scope="module")
def real(tm5: ArmModel) -> ArmModel:
    """The same arm as it was built: masses 15 %, centres of mass 10 mm, moments 10 % off; still real bodies."""
    rng, links = np.random.default_rng(5), []
    for row in tm5.inertial_parameters.reshape(6, 10):
        body = pin.Inertia.FromDynamicParameters(row)
        mass = body.mass * (1 + 0.15 * rng.standard_normal())
        lever = body.lever + 0.01 * rng.standard_normal(3)
        links.append(pin.Inertia(mass, lever, body.inertia * (1 + 0.1 * rng.uniform(-1, 1))).toDynamicParameters())
    return tm5.with_inertial_parameters(np.concatenate(links))


@pytest.fixture(scope="module")
def training(real: ArmModel) -> list[Motion]:
    return _measured(real, [1, 2, 3])


@pytest.fixture(scope="module")
def fits(training: list[Motion], tm5: ArmModel) -> dict[str, Identified]:
    return {mode: identify(FitSums.gather(training, tm5, FitOptions(inertia=mode))) for mode in MODES}


def _measured(arm: ArmModel, seeds: Sequence[int], noise: float = 0.3) -> list[Motion]:
    return made_motions(arm, LOSS, seeds, 15.0, noise=noise)


@pytest.mark.parametrize(
    ("robot", "rank"), [("tm5-900", 36), ("ur10", 36), ("ur5", 36), ("kinova", 36), ("panda", 43), ("xarm7", 43)]
)
def test_number_of_base_parameters_is_the_known_one(robot: str, rank: int) -> None:
    """36 for six-joint arms with parallel joints 2 and 3 on a vertical joint 1, 43 for the seven-joint ones."""
    assert base_parameters(ArmModel.load(robot)).rank == rank


@pytest.mark.parametrize("robot", ["tm5-900", "panda", "sliding"])
def test_base_parameters_carry_the_whole_torque(robot: str) -> None:
    """Y[:, columns] B π = Y π on states that were not used to find them, to 1e-9 of the torque."""
    arm = sliding_arm() if robot == "sliding" else ArmModel.load(robot)
    base = base_parameters(arm)
    regressor = arm.regressor(*random_states(np.random.default_rng(9), 100, arm.n))
    pi = arm.inertial_parameters * (1 + 0.3 * np.random.default_rng(10).standard_normal(10 * arm.n))
    torque = regressor @ pi
    reduced = regressor[:, :, list(base.columns)] @ (base.mapping @ pi)
    assert np.allclose(reduced, torque, rtol=0, atol=1e-9 * np.abs(torque).max())
    assert len(set(base.names)) == base.rank
    assert all(name.split(".")[0] in arm.links for name in base.names)


def _heldout_rms(found: Identified, test: Sequence[Motion]) -> Float[Array, " n"]:
    """Torque error on runs that the fit never saw [N m]."""
    arm, loss = found.inertia.arm, found.loss.params
    errors = [m.tau - arm.inverse_dynamics(m.q, m.dq, m.ddq) - loss.torque(m.dq, m.ddq) for m in test]
    return np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0))


def test_wrong_inertias_are_recovered_in_torque(fits: dict[str, Identified], real: ArmModel) -> None:
    """On an unseen run the identified arm is within 0.1 N m of the truth on every joint, the URDF's up to 2 N m off.

    45 s of training with 0.3 N m of noise; `consistent` is no worse than `base` by more than a third.
    """
    test = _measured(real, [9], noise=0.0)
    errors = {mode: _heldout_rms(fit, test) for mode, fit in fits.items()}
    assert errors["nominal"].max() > 1.5
    assert errors["base"].max() < 0.1
    assert errors["consistent"].max() < 0.1
    assert np.all(errors["consistent"] < 1.33 * errors["base"])


def test_a_known_payload_is_not_taken_for_the_arm(tm5: ArmModel) -> None:
    """Runs with a reported payload on the exact arm: no base parameter is off by more than 4 deviations."""
    payload = Payload(2.0, (0.0, 0.0, 0.08))
    motions = made_motions(tm5, LOSS, [1, 2], 15.0, noise=0.3, payload=payload)
    fit = identify(FitSums.gather(motions, tm5, FitOptions(inertia="base"))).inertia
    assert np.abs(fit.change / fit.std).max() < 4.0


FREE = 12  # unknowns beside the links' numbers, the first few of them bounded


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_bodies_and_losses_stay_within_their_bounds_and_no_nearby_point_is_lower(seed: int) -> None:
    """Law: feasible, and on the way to any other feasible point the function rises."""
    rng = np.random.default_rng(seed)
    arm = ArmModel.load("tm5-900")
    links, scale = arm.inertial_parameters, 0.3 * parameter_scale(arm)
    size = len(links) + FREE
    rows = rng.standard_normal((3 * size, size)) * rng.lognormal(0.0, 2.0, size)
    information = rows.T @ rows
    information[: len(links), : len(links)] += np.eye(len(links))
    free = rng.standard_normal(size)
    bounded = len(links) + np.arange(6)
    assert not is_consistent(links + scale * free[: len(links)])
    found = solve_bounded(information, information @ free, bounded, links, scale)
    assert np.all(found[bounded] >= 0.0)
    assert is_consistent(links + scale * found[: len(links)])
    slope = information @ (found - free)
    for _ in range(20):
        other = free + rng.standard_normal(size)
        other[bounded] = np.abs(other[bounded])
        meant, ones = links + scale * other[: len(links)], np.eye(len(links))
        other[: len(links)] += solve_bounded(ones, 0.0 * links, (), meant, scale)
        assert slope @ (other - found) > -1e-5 * abs(slope) @ abs(other - found)


@pytest.mark.parametrize("seed", range(3))
def test_both_solvers_find_the_same_losses(seed: int) -> None:
    """Law: eliminating the free unknowns and bounding the rest is the program that CVXPY solves; slopes don't bind."""
    rng = np.random.default_rng(seed)
    table, target = rng.normal(size=(30, 9)) * np.exp(2.0 * rng.normal(size=9)), 10.0 * rng.normal(size=30)
    bounded = range(4, 9)
    both = np.column_stack([table, target])
    found = solve_partly_non_negative(both.T @ both, bounded)
    other = solve_bounded(table.T @ table, table.T @ target, bounded)
    scale = np.linalg.norm(table, axis=0)
    assert np.allclose(scale * found, scale * other, atol=1e-4 * np.abs(scale * found).max())
    slope = table.T @ (table @ found - target) / scale
    assert np.abs(slope[:4]).max() < 1e-9
    assert np.all(slope[4:] > -1e-9)
    assert np.all((found[4:] > 0) | (slope[4:] > 0))
    # An unknown without rows, free or bounded, stays zero and changes none of the others.
    wider = np.insert(both, [0, 6], 0.0, axis=1)
    again = solve_partly_non_negative(wider.T @ wider, range(5, 11))
    assert not again[[0, 7]].any()
    assert np.allclose(np.delete(again, [0, 7]), found, rtol=1e-9)


def test_condition_number_shows_poor_excitation(fits: dict[str, Identified], tm5: ArmModel, real: ArmModel) -> None:
    """Multisines on all joints: below 20. All joints in step on one sine: over 1000."""
    assert fits["base"].inertia.condition_number < 20.0
    time = np.arange(1500) / 100.0
    one = np.tile(time[:, None], (1, 6))
    states = (np.sin(0.7 * one), 0.7 * np.cos(0.7 * one), -0.49 * np.sin(0.7 * one))
    tau = real.inverse_dynamics(*states) + LOSS.torque(states[1], states[2])
    tau = tau + 0.3 * np.random.default_rng(1).standard_normal(tau.shape)
    poor = exact_motion(time, states, tau, tm5.joint_names)
    assert identify(FitSums.gather([poor], tm5, FitOptions(inertia="base"))).inertia.condition_number > 1000.0


def test_consistent_links_could_be_bodies(fits: dict[str, Identified]) -> None:
    """`consistent`: every pseudo-inertia is positive semidefinite; `base` on the same data is not."""
    assert is_consistent(fits["consistent"].inertia.arm.inertial_parameters)
    assert not is_consistent(fits["base"].inertia.arm.inertial_parameters)


def test_deviations_are_honest(fits: dict[str, Identified], real: ArmModel, tm5: ArmModel) -> None:
    """`base`: error of the base parameters over their reported deviation is 1 ± 0.3 in root mean square, 4 at most."""
    fit = fits["base"].inertia
    truth = fit.base.mapping @ (real.inertial_parameters - tm5.inertial_parameters)
    score = (fit.change - truth) / fit.std
    assert np.sqrt(np.mean(score**2)) == pytest.approx(1.0, abs=0.3)
    assert np.abs(score).max() < 4.0
