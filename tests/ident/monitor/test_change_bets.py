"""The evidence of a change: laws of a test that may be looked at after every session."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.monitor.e_process import LEAST_BEFORE, MOST_GROWTH, ChangeBets, prior_weight


def evidence(values: np.ndarray) -> np.ndarray:
    bets = ChangeBets()
    return np.array([bets.add(float(value)) for value in values])


def test_the_weights_of_all_changes_add_up_to_one() -> None:
    """Up to the tail, which is their number's reciprocal."""
    late = 100_000
    total = prior_weight(np.arange(LEAST_BEFORE, late)).sum()
    assert total == pytest.approx(1.0, abs=1e-3)
    assert total < 1.0


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


def test_on_average_the_evidence_of_nothing_does_not_grow() -> None:
    """A supermartingale: its mean after 8 sessions is at most one."""
    rng = np.random.default_rng()
    last = np.array([evidence(rng.standard_normal(8))[-1] for _ in range(2000)])
    assert last.mean() <= 1.0 + 4.0 * last.std() / np.sqrt(len(last))


def test_a_change_is_told_and_dated() -> None:
    """Five spreads after 20 sessions: beyond any level in use within ten sessions, dated to the session."""
    rng = np.random.default_rng(2)
    bets = ChangeBets()
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


def test_values_that_never_change_are_no_change() -> None:
    """No spread at all, as of a counter: no division by zero, no evidence."""
    assert evidence(np.full(10, 3.7)).max() <= 1.0
