"""The bounded least squares beside CVXPY: an independent solver of the same problem reaches no lower value."""

import cvxpy as cp
import numpy as np
import pytest

from ident.arrays import Array
from ident.model.bodies import pseudo_inertia, solve_bounded
from ident.robot.arm import ArmModel
from ident.robot.tolerance import parameter_scale
from tests.ident.made_up import random_states

UNIT = pseudo_inertia(np.eye(10))


def reference(information: Array, score: Array, bounded: list[int], links: Array, scale: Array) -> float:
    """The least value by CVXPY, each link a body: its pseudo-inertia is positive semidefinite."""
    size = np.sqrt(np.diag(information))
    scaled, right = information / np.outer(size, size), score / size
    x = cp.Variable(len(score))
    bodies = []
    for link in range(len(links) // 10):
        own = np.arange(10 * link, 10 * link + 10)
        slopes = UNIT * (scale[own] / size[own])[:, None, None]
        matrix = pseudo_inertia(links[own]) + sum(x[int(k)] * slope for k, slope in zip(own, slopes, strict=True))
        frame = np.diag(1.0 / np.sqrt([scale[own[4]], scale[own[4]], scale[own[4]], scale[own[0]]]))
        bodies.append(frame @ matrix @ frame >> 0)
    value = 0.5 * cp.quad_form(x, cp.psd_wrap(scaled)) - right @ x
    problem = cp.Problem(cp.Minimize(value), [*bodies, x[bounded] >= 0])
    problem.solve(solver="CLARABEL")
    return float(problem.value)


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_other_solver_finds_a_lower_value(tm5: ArmModel, seed: int) -> None:
    """Law: on random targets, half of them no bodies, both values agree to a thousandth."""
    rng = np.random.default_rng(seed)
    scale, links, n = parameter_scale(tm5), tm5.inertial_parameters, tm5.n
    states = random_states(rng, 60, n)
    speed = states[1]
    rows = tm5.regressor(*states).reshape(-1, 10 * n) * scale
    damping = np.zeros((len(speed), n, n))
    damping[:, np.arange(n), np.arange(n)] = speed
    columns = np.hstack([rows, damping.reshape(-1, n)])
    truth = rng.standard_normal(columns.shape[1]) * 0.5
    torque = columns @ truth + 0.1 * rng.standard_normal(len(columns))
    information = columns.T @ columns + 1e-2 * np.eye(columns.shape[1])
    score = columns.T @ torque
    bounded = list(range(10 * n, 11 * n))
    found = solve_bounded(information, score, bounded, links, scale)
    value = float(0.5 * found @ information @ found - score @ found)
    least = reference(information, score, bounded, links, scale)
    assert found[bounded].min() >= 0.0
    assert value == pytest.approx(least, rel=1e-3)
