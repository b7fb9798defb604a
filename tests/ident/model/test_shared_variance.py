"""Tests of variances that joints share: what little is known of one is lent by the others, as far as they are alike."""

import numpy as np
import pytest

from ident.arrays import Array
from ident.model.run_effects import USUAL_SPREAD, share_variance


def _squares(rng: np.random.Generator, spread: Array, dof: int) -> Array:
    return (spread**2 * rng.chisquare(dof, len(spread)))[None]


def test_what_is_not_known_is_taken_from_the_others() -> None:
    """A variance without any data is that of the others, be it far from what is usual."""
    rng = np.random.default_rng(1)
    squares, dof = _squares(rng, np.full(12, 0.1), 3), np.full(12, 3.0)
    squares[0, 0], dof[0] = 0.0, 0.0
    assert np.sqrt(share_variance(squares, dof).moderate(squares, dof)[0]) == pytest.approx(0.1, rel=0.4)


def test_nothing_known_is_what_is_usual() -> None:
    """Without data of any joint the spread is of the order of the usual one."""
    squares, dof = np.zeros((1, 6)), np.zeros(6)
    found = np.sqrt(share_variance(squares, dof).moderate(squares, dof))
    assert np.all((found > USUAL_SPREAD) & (found < 30 * USUAL_SPREAD))


def test_joints_that_are_alike_lend_more() -> None:
    """More degrees of freedom where all have one variance than where they differ by a hundred times."""
    rng = np.random.default_rng(2)
    dof = np.full(12, 9.0)
    alike, unlike = (
        share_variance(_squares(rng, spread, 9), dof).freedom
        for spread in (np.full(12, 0.03), np.geomspace(0.003, 0.3, 12))
    )
    assert alike > 3 * unlike
    assert unlike < 4.0


def test_moderated_variances_are_nearer_to_the_truth() -> None:
    """Of three degrees of freedom each, the mean error of the logarithm falls by more than two fifths."""
    rng = np.random.default_rng(3)
    own, shared = [], []
    for _ in range(20):
        spread = 0.02 * np.exp(0.2 * rng.standard_normal(12))
        squares, dof = _squares(rng, spread, 3), np.full(12, 3.0)
        own.append(np.abs(np.log(squares[0] / 3.0 / spread**2)))
        shared.append(np.abs(np.log(share_variance(squares, dof).moderate(squares, dof) / spread**2)))
    assert np.mean(shared) < 0.6 * np.mean(own)


def test_hypotheses_are_weighed_by_what_they_explain() -> None:
    """Under the hypothesis that fits, all variances are alike: it takes nearly all weight, a costly one none."""
    rng = np.random.default_rng(4)
    right, wrong = _squares(rng, np.full(10, 0.02), 8), _squares(rng, np.geomspace(0.001, 0.4, 10), 8)
    weights = share_variance(np.concatenate([right, wrong]), np.full(10, 8.0)).weights.sum(axis=1)
    assert weights[0] > 0.999
    told = share_variance(np.concatenate([right, right]), np.full(10, 8.0), np.array([0.0, 20.0])).weights.sum(axis=1)
    assert told[1] < 1e-6
