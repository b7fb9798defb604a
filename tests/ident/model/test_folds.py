"""Laws of what a fit leaves out in turn."""

import numpy as np
import pytest

from ident.model.net_shrinkage import FOLDS, make_folds


@pytest.mark.parametrize("lengths", [(900, 400, 700), (500, 300, 800, 600, 450), (100,) * 12])
def test_whole_runs_are_left_out_where_there_are_three(lengths: tuple[int, ...]) -> None:
    """All samples of a run lie in one part, and there is more than one part."""
    parts, _ = make_folds(lengths, 2, np.random.default_rng(0))
    runs = np.repeat(np.arange(len(lengths)), lengths)
    assert all(len(np.unique(parts[runs == run])) == 1 for run in range(len(lengths)))
    assert len(np.unique(parts)) == min(FOLDS, len(lengths))


@pytest.mark.parametrize("lengths", [(900,), (900, 30), (5, 900, 411), (3,)])
def test_a_witness_lies_in_one_run(lengths: tuple[int, ...]) -> None:
    """No group goes on into the next run; of one run there are parts to leave out."""
    parts, groups = make_folds(lengths, 1, np.random.default_rng(0))
    runs = np.repeat(np.arange(len(lengths)), lengths)
    assert len(parts) == len(groups) == sum(lengths)
    assert all(len(np.unique(runs[groups == group])) == 1 for group in np.unique(groups))
    assert len(np.unique(parts)) == min(FOLDS, len(np.unique(groups))) or len(lengths) >= 3
