"""What a discrepancy explains of folds that it was not fitted to, and bounds of what candidates add."""

from dataclasses import replace

import numpy as np
import pytest

from ident.diagnosis.diagnose import Analysis
from ident.inference.components import ModelSums
from ident.inference.infer import Inferred
from ident.inference.sums import SessionSums

VARIANCE = 1e-2


def flexible_model(analysis: Analysis) -> ModelSums:
    """The sums of the likeliest set, each joint's discrepancy with one and the same variance."""
    model = analysis.conclusion.inference.best.model
    blocks = model.components.discrepancy.shape[1]
    return model.with_discrepancy({j: np.full(blocks, VARIANCE) for j in range(len(model.whole))})


def with_torque(model: ModelSums, joint: int, of_fold: np.ndarray) -> ModelSums:
    """The same where the torque that the discrepancy sees at a joint is its own columns times some
    coefficients, fold by fold.

    Args:
        model: The sums.
        joint: The joint.
        of_fold: Coefficients, shape (F, m).
    """
    evidence = model.sums.evidence
    places = evidence.layout.flexible_places[joint]
    flexible = [np.zeros_like(sums) for sums in evidence.flexible]
    flexible[joint][:, :, places] = evidence.flexible[joint][:, :, places]
    along = np.einsum("fmk,fk->fm", flexible[joint][:, :, places], of_fold)
    flexible[joint][:, :, -1] = along
    other = replace(evidence, flexible=tuple(flexible))
    return ModelSums(SessionSums(other), model.names, model.baseline, model.components)


@pytest.mark.parametrize("joint", [0, 2])
def test_what_repeats_is_foretold(sprung: Analysis, joint: int) -> None:
    """Law: one function in all folds lowers the squares of each; one that turns its sign is worse than none."""
    model = flexible_model(sprung)
    folds, columns, _ = model.sums.evidence.flexible[joint].shape
    used = np.arange(columns)
    torque_alone = np.zeros(len(model.sums.evidence.layout.local[joint]))
    torque_alone[-1] = 1.0
    same = np.random.default_rng(3).normal(size=columns)
    repeating = with_torque(model, joint, np.tile(same, (folds, 1)))
    turning = with_torque(model, joint, np.outer((-1.0) ** np.arange(folds), same))
    assert repeating._foretold(joint, used, torque_alone) > 0.0
    assert turning._foretold(joint, used, torque_alone) < 0.0


def test_no_more_than_all_is_foretold(sprung: Analysis) -> None:
    """Law: shares are at most one, and nothing is foretold of a joint without a discrepancy."""
    model = flexible_model(sprung)
    assert (model.foretold_share(()) <= 1.0).all()
    blocks = model.components.discrepancy.shape[1]
    none = model.with_discrepancy({0: np.zeros(blocks)})
    assert none.foretold_share(())[0] == 0.0


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
