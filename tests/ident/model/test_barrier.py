"""The search for figures within their bounds: its place meets the conditions of a least value."""

from __future__ import annotations

import numpy as np
import pytest

from ident.model.barrier import PseudoInertias, minimise
from ident.model.consistency import _bodies, _solve_in_general, is_consistent, pseudo_inertia, solve_bounded
from ident.model.inertia import parameter_scale
from ident.robot.arm import ArmModel

FREE = 12  # unknowns beside the links' numbers, the first few of them bounded


def _drawn(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Normal equations whose solution no body could have, and whose bounded figures are negative here and there."""
    rng = np.random.default_rng(seed)
    arm = ArmModel.load("tm5-900")
    links, scale = arm.inertial_parameters, 0.3 * parameter_scale(arm)
    size = len(links) + FREE
    rows = rng.standard_normal((3 * size, size)) * rng.lognormal(0.0, 2.0, size)
    information = rows.T @ rows
    information[: len(links), : len(links)] += np.eye(len(links))
    wanted = np.concatenate([rng.standard_normal(len(links)), rng.standard_normal(FREE)])
    return information, information @ wanted, len(links) + np.arange(6), links, scale


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_its_place_is_at_least_as_low_as_a_general_solvers_and_within_all_bounds(seed: int) -> None:
    information, score, bounded, links, scale = _drawn(seed)
    free = np.linalg.solve(information, score)
    assert not is_consistent(links + scale * free[: len(links)])
    found = minimise(information, score, free, bounded, _bodies(links, scale))
    assert found is not None
    other = _solve_in_general(information, score, bounded, links, scale)

    def value(x: np.ndarray) -> float:
        return float(x @ (0.5 * information @ x - score)) - float(free @ (0.5 * information @ free - score))

    assert value(found) <= value(other) * (1.0 + 1e-6) + 1e-6
    assert np.all(found[bounded] > 0.0)
    assert is_consistent(links + scale * found[: len(links)])


def test_the_conditions_of_a_least_value_hold_without_bodies() -> None:
    """The slope is zero where no bound binds, and points out of the bounds where one does."""
    rng = np.random.default_rng(5)
    rows = rng.standard_normal((40, 15))
    information, bounded = rows.T @ rows, np.arange(10)
    wanted = rng.standard_normal(15)
    found = solve_bounded(information, information @ wanted, bounded)
    slope = information @ (found - wanted)
    binding = np.isin(np.arange(15), bounded) & (found < 1e-6)
    assert binding.any()
    assert np.all(np.abs(slope[~binding]) < 1e-5)
    assert np.all(slope[binding] > 0.0)


def test_bodies_are_changed_to_what_is_wanted() -> None:
    arm = ArmModel.load("panda")
    links = arm.inertial_parameters
    bodies: PseudoInertias = _bodies(links, parameter_scale(arm))
    rng = np.random.default_rng(2)
    roots = rng.standard_normal((arm.n, 4, 4))
    wanted = roots @ roots.transpose(0, 2, 1)
    assert np.allclose(bodies.at(bodies.change_to(wanted)), wanted)
    assert np.allclose(bodies.start, pseudo_inertia(links.reshape(-1, 10)))
