"""The evidence of a change: laws of a test that may be looked at after every session."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.monitor.alarms import LEAST_BEFORE, MOST_GROWTH, EProcess, prior_weight


def evidence(values: np.ndarray) -> np.ndarray:
    bets = EProcess()
    return np.array([bets.add(float(value)) for value in values])


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e3))
@settings(max_examples=20, deadline=None)
def test_neither_unit_nor_zero_matter(shift: float, scale: float) -> None:
    """Evidence depends on the maximal invariant alone: that is why no spread needs to be known."""
    values = np.random.default_rng(5).standard_normal(15)
    np.testing.assert_allclose(evidence(shift + scale * values), evidence(values), rtol=1e-4)


def test_however_often_one_looks_false_alarms_stay_below_the_level() -> None:
    """Ville's inequality at 20 %, after every one of 40 sessions, by 400 histories of normal days."""
    rng = np.random.default_rng()
    level, count = 0.2, 400
    reached = sum(bool((evidence(rng.standard_normal(40)) >= 1.0 / level).any()) for _ in range(count))
    assert reached / count <= level + 3.0 * np.sqrt(level * (1.0 - level) / count)
    # A supermartingale: its mean after 8 sessions is at most one; the weights of all changes add up to one.
    last = np.array([evidence(rng.standard_normal(8))[-1] for _ in range(2000)])
    assert last.mean() <= 1.0 + 4.0 * last.std() / np.sqrt(len(last))
    assert 0.999 < prior_weight(np.arange(LEAST_BEFORE, 100_000)).sum() < 1.0


def test_a_change_is_told_and_dated() -> None:
    """Five spreads after 20 sessions: beyond any level in use within ten sessions, dated to the session."""
    rng = np.random.default_rng(2)
    bets = EProcess()
    for value in [*rng.standard_normal(20), *(5.0 + rng.standard_normal(10))]:
        bets.add(float(value))
    assert bets.evidence > 1e4
    assert bets.before == 20


def test_one_odd_session_raises_no_alarm() -> None:
    """However far off, it multiplies the evidence by `MOST_GROWTH` at most, and the next ones take that back."""
    rng = np.random.default_rng(3)
    values = rng.standard_normal(30)
    values[15] = 1e6
    found = evidence(values)
    assert found[15] <= MOST_GROWTH * found[14] + 1.0
    assert found[-1] < MOST_GROWTH
    assert evidence(np.full(10, 3.7)).max() <= 1.0  # no spread at all, as of a counter
