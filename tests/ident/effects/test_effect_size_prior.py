"""What an effect's size costs its name: laws of the Occam factor."""

from __future__ import annotations

import numpy as np
import pytest

from ident.arrays import Array
from ident.effects.base import SessionContext
from ident.effects.catalogue import find_effect
from ident.effects.intervals import SizePrior

DEVIATION = np.array([0.5, 2.0])


def normal(coefficients: Array) -> float:
    """Log density of two normal figures of the deviations above."""
    return float(np.sum(-0.5 * (coefficients / DEVIATION) ** 2 - np.log(DEVIATION * np.sqrt(2 * np.pi))))


def test_the_cost_is_the_exact_one_where_all_is_normal() -> None:
    """Law: ½ gain − cost is log N(y; 0, s² J² + J) − log N(y; 0, J) of the scores y = J ĉ (Gaussian evidence)."""
    rng = np.random.default_rng(3)
    root = rng.standard_normal((2, 2))
    information, estimate = root @ root.T + 0.2 * np.eye(2), np.array([0.7, -1.2])
    scores = information @ estimate
    spread = information + information @ np.diag(DEVIATION**2) @ information
    exact = 0.5 * scores @ np.linalg.solve(information, scores) - 0.5 * scores @ np.linalg.solve(spread, scores)
    exact -= 0.5 * (np.linalg.slogdet(spread)[1] - np.linalg.slogdet(information)[1])
    cost = SizePrior(DEVIATION, normal).cost(estimate, information)
    assert 0.5 * estimate @ information @ estimate - cost == pytest.approx(exact, abs=1e-9)


def test_what_recordings_say_nothing_of_costs_nothing() -> None:
    """Law: a wild estimate of a figure without information, even a negative one of noise, costs no more than none."""
    prior = SizePrior(DEVIATION, normal)
    told = np.diag([30.0, 0.0])
    assert prior.cost(np.array([0.4, 1e3]), told) == pytest.approx(prior.cost(np.array([0.4, 0.0]), told))
    noisy = np.diag([30.0, -5.0])
    assert prior.cost(np.array([0.4, 1e3]), noisy) == pytest.approx(prior.cost(np.zeros(2), told), abs=1.0)


def test_a_last_link_of_twice_its_weight_carries_something(session: SessionContext) -> None:
    """Law: the more weight the last link gains, the more it speaks for a load; of half as much again, against one."""
    load, link = find_effect("payload"), find_effect("link_inertial_error")
    joints = {load: 0, link: session.n - 1}
    own = float(session.runs[0].arm.inertial_parameters[-10])

    def odds(share: float) -> float:
        told = {}
        for effect, joint in joints.items():
            prior = effect.size_prior(session, joint, effect.variants(session, joint)[0])
            assert prior is not None
            told[effect] = prior.log_density(share * own * np.array([1.0, 0.0, 0.0, 0.03]))
        return told[load] - told[link]

    growing = [odds(share) for share in (0.5, 1.0, 2.0)]
    assert np.all(np.diff(growing) > 0.0)
    assert growing[0] < 0.0 < growing[-1]
