"""Laws of the search for a size: few trials on a power law, a bracket on a threshold, no size outside the bounds."""

import numpy as np
import pytest

from ident.simulation.visibility import find_size


def search(law, wanted, start=1.0, small=1e-3, large=1e3, tolerance=0.04):
    """The size found, what it shows, and all sizes tried."""
    tried = []

    def shown(size):
        tried.append(size)
        return law(size)

    return *find_size(shown, wanted, start, (small, large), tolerance), tried


def test_what_shows_in_proportion_is_found_by_two_trials():
    size, seen, tried = search(lambda s: 2.0 * s, wanted=0.3)
    assert len(tried) == 2
    assert (size, seen) == (0.15, 0.3)


@pytest.mark.parametrize("power", [0.5, 1.5, 2.0])
def test_another_power_takes_a_few_trials(power):
    _, seen, tried = search(lambda s: 0.2 * s**power, wanted=3.0)
    assert seen == pytest.approx(3.0, rel=0.04)
    assert len(tried) <= 4


def test_where_less_shows_more_the_search_goes_the_other_way():
    size, seen, tried = search(lambda s: 5.0 / s, wanted=1.0, small=1e3, large=1e-3)
    assert (size, seen) == (5.0, 1.0)
    assert len(tried) == 2


@pytest.mark.parametrize("start", [0.02, 60.0])
def test_a_threshold_is_bracketed(start):
    """Nothing below one, then ever more: no power law, and no information below."""
    _, seen, tried = search(lambda s: max(s - 1.0, 0.0), wanted=0.5, start=start)
    assert seen == pytest.approx(0.5, rel=0.04)
    assert len(tried) <= 10


def test_a_stalled_arm_shows_without_limit_and_bounds_the_search():
    _, seen, _ = search(lambda s: 0.1 * s if s < 40.0 else np.inf, wanted=3.5, start=100.0)
    assert seen == pytest.approx(3.5, rel=0.04)


def test_out_of_reach_the_bound_is_tried_and_nothing_more():
    size, seen, tried = search(lambda s: 0.1 * s, wanted=3.0, large=20.0)
    assert tried == [1.0, 20.0]
    assert (size, seen) == (20.0, 2.0)


def test_a_quiet_bound_ends_the_search():
    """Even the smallest size shows too much."""
    size, _, tried = search(lambda s: 1.0 + s, wanted=0.5, small=0.1)
    assert size == 0.1
    assert len(tried) <= 4


def test_sizes_have_four_digits():
    size, _, tried = search(lambda s: s, wanted=np.pi)
    assert size == 3.142
    assert all(float(f"{one:.4g}") == one for one in tried)
