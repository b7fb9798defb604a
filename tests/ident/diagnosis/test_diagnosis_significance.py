"""What chance does: to friction that wanders, to candidates where nothing is wrong, to intervals."""

import numpy as np
import pytest

from ident.arrays import Array, Bool, Float
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.regression.least_squares import solve_signed
from ident.diagnosis.regression.wandering import chance_of_curve
from ident.diagnosis.selection.profile import _interval
from ident.diagnosis.selection.settings import USUAL_SELECTION
from tests.ident.diagnosis.planted import search_of

RUNS, NOISE = 12, 0.004
LAWS = [
    np.kron(np.exp(-np.arange(RUNS) / constant)[:, None], np.eye(2)) for constant in (1.0, 3.0, 10.0)
]  # viscous and Coulomb change as a gear warms up, at three paces


def levels(rng: np.random.Generator, curve: Float[Array, " R"]) -> Float[Array, " s"]:
    """Both levels of each run: a common course, and noise."""
    return np.repeat(curve, 2) + NOISE * rng.standard_normal(2 * RUNS)


def chance(rng: np.random.Generator, curve: Float[Array, " R"]) -> float:
    spread: Array = NOISE**2 * np.eye(2 * RUNS)
    return chance_of_curve(levels(rng, curve), spread, LAWS, rng)


def test_what_wanders_is_taken_for_warmth_as_rarely_as_told() -> None:
    """Law: of random walks, of levels of each run's own and of steady friction, few come below one in ten."""
    rng = np.random.default_rng(8)
    for step, own in ((0.05, 0.0), (0.0, 0.05), (0.0, 0.0)):
        found = [
            chance(rng, np.cumsum(step * rng.standard_normal(RUNS)) + own * rng.standard_normal(RUNS))
            for _ in range(25)
        ]
        assert np.mean(np.array(found) <= 0.1) <= 0.28  # P(Binomial(25, 0.1) > 7) = 0.2 %


def test_warmth_is_found() -> None:
    """Law: a smooth fall by a tenth, far above the noise, is no wandering."""
    rng = np.random.default_rng(9)
    assert chance(rng, 0.1 * np.exp(-np.arange(RUNS) / 3.0)) <= 0.01


def test_few_runs_tell_nothing() -> None:
    assert (
        chance_of_curve(np.array([0.1, 0.1, 0.0, 0.0]), 1e-6 * np.eye(4), [LAWS[0][:4]], np.random.default_rng(0))
        == 1.0
    )


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
    held_out = search_of(healthy).held_out
    before = held_out.score()
    gains, falls = [], []
    for group in healthy.evidence.layout.groups[::4]:
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
    found = _interval(x, 5.0 - 0.5 * ((x - np.log(middle)) / width) ** 2, USUAL_SELECTION.interval_fall)
    reach = width * np.sqrt(2 * USUAL_SELECTION.interval_fall)
    assert found.value == pytest.approx(middle, rel=1e-9)
    assert found.low <= middle * np.exp(-reach) * (1 + 1e-9)
    assert found.high >= middle * np.exp(reach) * (1 - 1e-9)
    assert np.log(found.high / found.low) == pytest.approx(2 * reach, rel=1e-6)
