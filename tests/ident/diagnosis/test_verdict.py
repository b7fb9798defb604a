"""From probabilities to a verdict."""

from typing import Any, cast

import numpy as np
import pytest

from ident.diagnosis.verdict import decide, score_outside


@pytest.mark.parametrize(
    ("names", "left", "verdict"),
    [
        (0, (0.0, 0.1), "no_gap"),
        (0, (0.2, 0.5), "none_of_catalogue"),
        (2, (0.49, 0.0), "named"),
        (1, (0.0, 0.9), "partial"),
        (0, (), "no_gap"),
    ],
)
def test_a_verdict_says_what_is_likelier_than_not(names: int, left: tuple[float, ...], verdict: str) -> None:
    """Law: names, and what has none, count where each is likelier than not."""
    some = cast(Any, [object()] * names)
    assert decide(some, np.array(left)) == verdict


@pytest.mark.parametrize(("names", "verdict"), [(0, "not_testable"), (1, "named")])
def test_where_nothing_was_judged_silence_is_no_verdict(names: int, verdict: str) -> None:
    """Law: a model that was held against no sample has not been found good."""
    assert decide(cast(Any, [object()] * names), np.zeros(6), judged=0) == verdict


def test_sessions_rank_by_the_likeliest_cause_without_a_name() -> None:
    """Law: the score lies between zero and one, and rises with any joint's probability."""
    quiet, odd = (score_outside(np.array(left)) for left in ((0.1, 0.2), (0.1, 0.8)))
    assert 0.0 <= quiet < odd <= 1.0
    assert score_outside(np.zeros(0)) == 0.0
