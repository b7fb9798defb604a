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


@pytest.mark.parametrize("count", [0, 2])
def test_signed_candidates_add_what_a_set_with_them_is_worth(sprung: Analysis, count: int) -> None:
    """Law: of candidates whose coefficients can't be negative, too, gains are what they add when they are put in."""
    reached: Inferred = sprung.conclusion.inference.best
    search = reached.search
    # What is wrong with the arm stays to be explained.
    named = {group.key for group in reached.chosen}
    others = [group for group in search.names.groups if group.key not in named]
    free = {group.key: group for group in others if not group.signed}
    chosen = list(free.values())[:count]
    gains = search.gains(chosen)
    before = search.nats(chosen)
    seen = 0
    for k, group in enumerate(search.names.groups):
        if not group.signed or not np.isfinite(gains[k]):
            continue
        added = search.nats([*chosen, group]) - before
        if gains[k] > 0.0:
            seen += 1
            assert gains[k] == pytest.approx(added, rel=1e-5, abs=1e-3)
        else:
            assert added < 1e-3
    assert seen
