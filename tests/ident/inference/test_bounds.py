"""Bounds of what candidates add."""

import numpy as np
import pytest

from ident.diagnosis.diagnose import Analysis
from ident.inference.infer import Inferred


@pytest.mark.parametrize("joint", [None, 0, 2])
@pytest.mark.parametrize("count", [0, 2])
def test_the_best_candidate_is_the_one_that_adds_most(sprung: Analysis, count: int, joint: int | None) -> None:
    """Law: taking bounds first leaves no better candidate behind."""
    reached: Inferred = sprung.conclusion.inference.best
    search = reached.search
    chosen = list(reached.chosen)[:count]
    best = search.best(chosen, joint=joint)
    gains = search.gains(chosen, joint)
    ahead = [k for k in np.argsort(-gains) if gains[k] > 0.0]
    stands = [k for k in ahead if search._stands([*chosen, search.names.groups[k]], search.names.groups[k])]
    if best is None:
        assert not stands
    else:
        assert search.names.groups[stands[0]] is best[1]
