"""Candidates that are part of another: some of its columns, for some of what they cost."""

from __future__ import annotations

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.regression.cross_validation import HeldOut
from ident.diagnosis.regression.least_squares import Prior, project
from ident.diagnosis.selection.search import Search
from ident.effects.catalogue import find_effect
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import analyse, at_joint

RANGE, AMPLITUDE = 0.006, 4.0  # [rad], [N m]


def stop_on_1(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """A slider that is held by one spring: 4 N m after 6 mrad, more than dry friction that turns round at once."""
    state, torque = 0.0, np.zeros(len(q))
    for k in range(1, len(q)):
        state = min(max(state + q[k, 0] - q[k - 1, 0], -RANGE), RANGE)
        torque[k] = AMPLITUDE * state / RANGE
    return at_joint(0, torque)


@pytest.fixture(scope="module")
def analysis(short_arm: ArmModel) -> Analysis:
    return analyse(short_arm, stop_on_1, [find_effect("presliding_hysteresis")])


def test_parts_have_columns_of_the_whole(analysis: Analysis) -> None:
    """Law: a part's ranges and columns are those of the whole at the same places; no column is made for it."""
    groups = [group for group in analysis.evidence.layout.groups if group.joint == 0]
    whole, parts = groups[0], groups[1:]
    ranges = dict(zip(whole.columns, whole.variant.shape.values(), strict=True))
    assert not whole.borrows
    assert len(parts) >= len(ranges)
    for part in parts:
        assert part.borrows
        assert part.key == whole.key
        assert list(part.variant.shape.values()) == [ranges[column] for column in part.columns]
    assert sum(len(own) for own in analysis.evidence.layout.own) == len({c for g in groups for c in g.columns}) * 3


def test_ranges_that_it_does_not_need_cost_a_build_up_nothing(analysis: Analysis) -> None:
    """Law: of a spring and slider of one range a part with it has more evidence than all ranges; the name's figures are
    those of all of them.
    """
    evidence = analysis.evidence
    prior = Prior.of(evidence, analysis.baseline.prior)
    search = Search(evidence, prior, HeldOut(evidence, prior))
    projection = project(evidence.gram(), evidence, prior)
    whole = next(group for group in evidence.layout.groups if group.joint == 0)
    score, best = search.best_by_key(projection)[whole.key]
    assert best.borrows
    assert RANGE in best.variant.shape.values()
    assert score > search.score_of(projection, whole) + 1.0
    assert analysis.diagnosis.findings[0].estimate.told.variant.shape == whole.variant.shape
