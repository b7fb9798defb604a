"""What chance does: to candidates where nothing is wrong, and to intervals; signed squares."""

import numpy as np
import pytest

from ident.arrays import Array, Bool
from ident.diagnosis.diagnose import Analysis
from ident.inference.profile import DROP, profile_interval
from ident.regression.factors import solve_signed
from tests.ident.diagnosis.planted import all_evidence, scorer_of


def problem(seed: int) -> tuple[Array, Array, Bool]:
    """Normal equations of 20 to 80 columns that nearly depend on one another, and of units far apart."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(20, 80))
    mixing = np.eye(size) + rng.normal(size=(size, size)) * 10.0 ** rng.uniform(-1, 1)
    columns = rng.normal(size=(400, size)) @ mixing * 10.0 ** rng.uniform(-2, 2, size)
    signed = rng.random(size) < rng.choice([0.1, 0.5, 0.9, 1.0])
    return columns.T @ columns, columns.T @ (columns @ rng.normal(size=size) + rng.normal(size=400)), signed


@pytest.mark.parametrize("seed", range(60))
def test_no_step_that_is_allowed_makes_it_better(seed: int) -> None:
    matrix, target, signed = problem(seed)
    found = solve_signed(matrix, target, signed)
    unit = 1.0 / np.sqrt(np.diag(matrix))
    slope = unit * (matrix @ found - target)  # the conditions of Karush, Kuhn and Tucker, in units of one size
    small = 1e-6 * np.linalg.norm(unit * target)
    assert (found[signed] >= 0.0).all()
    assert (np.abs(slope[~signed]) < small).all()
    assert (slope[signed] > -small).all()
    assert (np.abs(slope[signed & (found > 0.0)]) < small).all()


def test_useless_columns_do_not_gain_on_held_out_runs(healthy: Analysis) -> None:
    """Law: where nothing is wrong, candidates lose log score on runs that they were not fitted to, on the average, and
    the error of no joint falls by 2 %.
    """
    held_out = scorer_of(healthy)
    before = held_out.score()
    gains, falls = [], []
    for group in all_evidence(healthy).layout.groups[::4]:
        after = held_out.score([group])
        gains.append(after.gain_over(before)[0])
        falls.append(np.max(1.0 - after.rms / before.rms))
    assert np.mean(gains) < 0.0
    assert max(falls) < 0.02


@pytest.mark.parametrize("middle", [0.02, 0.05, 0.08])
def test_profile_of_a_parabola(middle: float) -> None:
    """Law: a profile that is a parabola in log x has its maximum and its 95 % ends exactly, wherever the grid lies."""
    x = np.log(np.array([0.005, 0.01, 0.03, 0.06, 0.15, 0.3]))
    width = 0.7
    found = profile_interval(x, 5.0 - 0.5 * ((x - np.log(middle)) / width) ** 2, DROP)
    reach = width * np.sqrt(2 * DROP)
    assert found.value == pytest.approx(middle, rel=1e-9)
    assert found.low <= middle * np.exp(-reach) * (1 + 1e-9)
    assert found.high >= middle * np.exp(reach) * (1 - 1e-9)
    assert np.log(found.high / found.low) == pytest.approx(2 * reach, rel=1e-6)
