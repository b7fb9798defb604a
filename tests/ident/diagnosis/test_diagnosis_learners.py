"""What learns from residuals: each sees what the others are blind to, and none sees anything in noise."""

from __future__ import annotations

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.gap.learners import Learner, neighbours, trees
from ident.diagnosis.gap.settings import USUAL_TREES
from ident.diagnosis.gap.trees import _held_out
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import analyse, at_joint

SAMPLES = 2400
ALL = {"trees": trees, "neighbours": neighbours}


def _explained(learner: Learner, x: Array, y: Array) -> tuple[float, bool]:
    """Share of the mean square that is foretold on folds that were never seen, and whether that is sure."""
    fold = np.arange(len(y)) * 40 // len(y) % USUAL_TREES.folds
    left, sure = _held_out(x, y, fold, USUAL_TREES, learner)
    return 1.0 - left / float(np.mean(y**2)), sure


@pytest.mark.parametrize("name", ALL)
def test_noise_teaches_nothing(name: str) -> None:
    """Law: of ten draws of noise none is foretold for sure, whoever learns."""
    rng = np.random.default_rng(11)
    for _ in range(10):
        x, y = rng.normal(size=(SAMPLES, 1)), rng.normal(size=SAMPLES)
        assert not _explained(ALL[name](USUAL_TREES), x, y)[1]


def test_neighbours_see_teeth_that_trees_do_not() -> None:
    """Bound: a wave of 70 periods a radian, as large as its noise, is foretold by neighbours of the angle."""
    rng = np.random.default_rng(12)
    angle = np.concatenate([np.linspace(0.0, 1.0, 1200), np.linspace(1.0, 0.0, 1200)])[:, None]
    y = np.sqrt(2.0) * np.sin(440.0 * angle[:, 0]) + rng.normal(size=SAMPLES)
    share, sure = _explained(neighbours(USUAL_TREES), angle, y)
    assert sure
    assert share > 0.2
    assert _explained(trees(USUAL_TREES), angle, y)[0] < 0.5 * share


def test_a_gap_that_trees_are_blind_to_is_told(short_arm: ArmModel) -> None:
    """Law: teeth at one joint, no name for them at hand: there is a gap, at that joint and of its state."""

    def teeth(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
        return at_joint(1, 1.2 * np.sin(60.0 * q[:, 1]))

    diagnosis = analyse(short_arm, teeth, []).diagnosis
    assert diagnosis.verdict == "none_of_catalogue"
    assert diagnosis.gap["joint_2"].unexplained == "state"
    assert max(diagnosis.details.leftover) == diagnosis.details.leftover[1] > 1.0
