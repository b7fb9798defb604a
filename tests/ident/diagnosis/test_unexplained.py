"""What is left at a joint beside the names: when it is something that has no name."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ident.diagnosis.gap.ceiling import Ceiling
from ident.diagnosis.selection.criteria import SearchResults
from ident.diagnosis.verdict import find_unexplained, score_outside

NOISE = 1.0


def leftover(first: float, last: float) -> float:
    """How far an error stands out at the first of three joints, of which a flexible function sees all above the noise;

    `first` and `last` are its errors before anything was named and beside the names [N m].
    """

    def score(rms: float) -> Any:
        return SimpleNamespace(rms=np.array([rms, NOISE, NOISE]), typical_rms=np.array([rms, NOISE, NOISE]))

    evidence = SimpleNamespace(
        whitening=SimpleNamespace(innovation=np.full(3, NOISE), level=np.full(3, NOISE)),
        weights=np.ones((1, 3)),
        floor=np.full(3, NOISE),
    )
    ceilings = [Ceiling(NOISE, last, "state", True)] + [Ceiling(NOISE, NOISE, None, False)] * 2
    found = cast(SearchResults, SimpleNamespace(ladder=(score(first), score(last))))
    return float(find_unexplained(found, ceilings, cast(Any, evidence)).leftover[0])


@pytest.mark.parametrize("size", [3.0, 10.0, 100.0])
def test_what_a_law_that_is_off_by_a_tenth_leaves_is_no_other_cause(size: float) -> None:
    assert leftover(np.hypot(size, NOISE), np.hypot(0.1 * size, NOISE)) <= 1.0


@pytest.mark.parametrize("size", [3.0, 10.0, 100.0])
def test_what_a_law_that_is_off_by_a_third_leaves_is_reported(size: float) -> None:
    assert leftover(np.hypot(size, NOISE), np.hypot(0.34 * size, NOISE)) > 1.0


def test_the_same_error_is_unexplained_where_no_name_closed_anything() -> None:
    error = float(np.hypot(1.0, NOISE))
    assert leftover(error, error) > 1.0 >= leftover(10.0, error)


def test_names_that_cannot_be_distinguished_are_in_the_catalogue_together() -> None:
    nothing = np.zeros(3)
    alone, tied = (cast(Any, SimpleNamespace(probability=p, class_probability=0.9)) for p in (0.9, 0.3))
    unsure = cast(Any, SimpleNamespace(probability=0.3, class_probability=0.3))
    assert score_outside("named", [alone], 1.0, nothing) == score_outside("named", [tied], 1.0, nothing)
    assert score_outside("named", [unsure], 1.0, nothing) > score_outside("named", [tied], 1.0, nothing)
