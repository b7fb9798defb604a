"""What chance does: to friction that wanders, to candidates where nothing is wrong, to intervals; signed squares."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from ident.arrays import Array, Bool
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.selection.profile import _interval
from ident.diagnosis.selection.settings import USUAL_SELECTION
from ident.regression.least_squares import solve_signed
from ident.regression.settings import USUAL_REGRESSION
from ident.regression.wandering import UNKNOWN, _innovations, log_odds_of_curve
from tests.ident.diagnosis.planted import search_of

RUNS, NOISE = 12, 0.004
OWN, STEPS = (0.0, 0.01, 0.02, 0.04), (0.0, 0.006, 0.0125, 0.025, 0.05)
WARMTH = [
    np.kron(np.exp(-np.arange(RUNS) / pace)[:, None], np.eye(2)) for pace in (1.0, 3.0, 10.0)
]  # viscous and Coulomb change as a gear warms up, at three paces


def odds_of_warmth(rng: np.random.Generator, course: Array, runs: int = RUNS) -> float:
    """Of warmth against a walk, where both levels of each run follow a course, and noise."""
    levels = np.repeat(course, 2) + NOISE * rng.standard_normal(2 * len(course))
    noise = np.tile(NOISE**2 * np.eye(2), (runs, 1, 1))
    return log_odds_of_curve(levels, noise, [law[: 2 * runs] for law in WARMTH], OWN, STEPS)


@pytest.mark.parametrize(("step", "own"), [(0.05, 0.0), (0.02, 0.0), (0.02, 0.02), (0.0, 0.0)])
def test_what_wanders_is_rarely_warmth(step: float, own: float) -> None:
    """Law: of random walks, with levels of each run's own or without, and of steady friction, few pass for warmth."""
    rng = np.random.default_rng(8)
    walks = np.cumsum(step * rng.standard_normal((60, RUNS)), axis=1) + own * rng.standard_normal((60, RUNS))
    odds = [odds_of_warmth(rng, walk) for walk in walks]
    assert np.mean(np.array(odds) >= USUAL_REGRESSION.wandering.least_nats) <= 0.15


def test_warmth_is_likelier_than_a_walk() -> None:
    """Law: a smooth fall by a tenth, far above the noise, is no wandering; of two runs nobody can tell."""
    rng, fall = np.random.default_rng(9), 0.1 * np.exp(-np.arange(RUNS) / 3.0)
    assert odds_of_warmth(rng, fall) > 2.0 * USUAL_REGRESSION.wandering.least_nats
    assert odds_of_warmth(rng, fall[:2], runs=2) < USUAL_REGRESSION.wandering.least_nats


def test_innovations_have_the_likelihood_of_the_walk() -> None:
    """Law: their squares and scale are those of the levels' covariance as a whole, a walk beside each run's own."""
    rng, own, step = np.random.default_rng(4), 0.03, np.array([[2.0, 1.0], [1.0, 1.0]]) * 1e-4
    noise = np.stack([root @ root.T for root in 0.02 * rng.standard_normal((RUNS, 2, 2))])
    order = np.arange(RUNS)
    whole = block_diag(*noise) + own**2 * np.eye(2 * RUNS) + np.kron(np.minimum(order[:, None], order), step)
    whole += UNKNOWN * np.kron(np.ones((RUNS, RUNS)), np.eye(2))
    signals = rng.standard_normal((2 * RUNS, 2))
    white, scale = _innovations(signals, noise, np.array([own]), step[None])
    assert white[0].T @ white[0] == pytest.approx(signals.T @ np.linalg.solve(whole, signals), rel=1e-6)
    assert 2.0 * scale[0] == pytest.approx(np.linalg.slogdet(whole)[1])


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
