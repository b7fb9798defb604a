"""The simplest set that explains: what explains most comes first, and what is left is noise."""

import numpy as np
import pytest

from ident.diagnosis.diagnose import Analysis
from ident.inference.components import ModelSums
from ident.inference.infer import Inferred
from ident.inference.simple import SimplestSet, with_misfit


def simplest_of(analysis: Analysis) -> SimplestSet:
    return analysis.conclusion.inference.simplest


def best_of(analysis: Analysis) -> Inferred:
    return analysis.conclusion.inference.best


def test_what_was_planted_comes_first(sprung: Analysis, slowed: Analysis) -> None:
    """Law: with one cause, the first effect is that cause, and no other explains as much alone."""
    for analysis, effect in ((sprung, "spring_torque"), (slowed, "stribeck_friction")):
        simplest = simplest_of(analysis)
        first = simplest.chosen[0]
        assert first.effect.id == effect
        assert simplest.alone[first.key] == pytest.approx(simplest.nats[0], rel=0.05)
        assert simplest.most_like(first) == pytest.approx(simplest.alone[first.key])


def test_what_is_left_is_noise(sprung: Analysis) -> None:
    """Law: beside its set, each joint's rows have the dispersion that they were divided by."""
    simplest = simplest_of(sprung)
    again = with_misfit(simplest.model, simplest.chosen)
    before = simplest.model.components.dispersion
    np.testing.assert_allclose(again.components.dispersion, before, rtol=0.2)
    assert (before >= 1.0).all()


def test_another_dispersion_is_that_of_a_model_made_with_it(sprung: Analysis) -> None:
    """Law: sums that are divided anew are those of a model that was made with these components."""
    model = best_of(sprung).model
    rng = np.random.default_rng(3)
    dispersion = rng.uniform(1.0, 50.0, len(model.components.dispersion))
    divided = model.with_dispersion(dispersion)
    made = ModelSums(model.sums, model.names, model.baseline, divided.components)
    np.testing.assert_allclose(divided.gram, made.gram, rtol=1e-9, atol=1e-9)
    assert divided.log_evidence(()) == pytest.approx(made.log_evidence(()), rel=1e-9)


@pytest.mark.parametrize("walk", [0.0, 0.6])
def test_other_friction_is_that_of_a_model_made_with_it(sprung: Analysis, walk: float) -> None:
    """Law: sums in which the friction of one joint varies otherwise are those of a model that was made so."""
    model = best_of(sprung).model
    changed = model.with_friction({1: (0.07, walk)})
    assert changed.components.friction[1] == 0.07
    assert changed.components.walk[1] == walk
    assert model.components.friction[1] != 0.07
    made = ModelSums(model.sums, model.names, model.baseline, changed.components)
    np.testing.assert_allclose(changed.gram, made.gram, rtol=1e-8, atol=1e-6)
    chosen = best_of(sprung).chosen
    assert changed.log_evidence(chosen) == pytest.approx(made.log_evidence(chosen), rel=1e-9)
    assert changed.log_evidence(chosen) != pytest.approx(model.log_evidence(chosen), rel=1e-6)


def test_a_name_outside_the_set_adds_what_it_would_add_last(sprung: Analysis) -> None:
    """Law: of what did not come, the gain beside the whole set is told; nothing that came is in it."""
    simplest = simplest_of(sprung)
    keys = {group.key for group in simplest.chosen}
    assert not keys & set(simplest.last)
    outside = next(key for key in simplest.last if key not in keys)
    assert simplest.step_of(outside) is None
    assert simplest.nats_in_turn(outside) == simplest.last[outside]
