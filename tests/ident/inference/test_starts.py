"""The starts of the search for causes, and the sets that are left of what foretells nothing."""

import numpy as np
import pytest

from ident.diagnosis.diagnose import Analysis
from ident.inference.infer import Inferred
from ident.inference.revision import evidence_of
from ident.inference.search import rest_of
from ident.inference.unseen import without_unforetelling
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group


def best_of(analysis: Analysis) -> Inferred:
    return analysis.conclusion.inference.best


def scorer_of(reached: Inferred) -> HeldOut:
    return HeldOut(evidence_of(reached.model), reached.model.prior())


def anything(reached: Inferred, seed: int, count: int = 6) -> list[Group]:
    """Candidates of different names at random, none of which happens once or is in the set."""
    rng = np.random.default_rng(seed)
    groups = reached.search.names.groups
    chosen: dict[object, Group] = {}
    for k in rng.permutation(len(groups)):
        group = groups[k]
        if not group.effect.event and reached.member(group.key) is None:
            chosen.setdefault(group.key, group)
    return list(chosen.values())[:count]


@pytest.mark.parametrize("seed", range(4))
def test_each_of_what_stays_foretells_something(sprung: Analysis, seed: int) -> None:
    """Law: without any one of what stays, the rest foretells unseen parts worse."""
    reached = best_of(sprung)
    scorer = scorer_of(reached)
    left = without_unforetelling(scorer, [*reached.chosen, *anything(reached, seed)])
    whole = scorer.score(left).misfit.sum()
    for group in left:
        assert scorer.score(rest_of(left, group)).misfit.sum() > whole


@pytest.mark.parametrize("seed", range(4))
def test_what_was_planted_stays(sprung: Analysis, seed: int) -> None:
    """Law: the planted spring stays, whatever stands beside it."""
    reached = best_of(sprung)
    spring = next(group for group in reached.chosen if group.effect.id == "spring_torque")
    left = without_unforetelling(scorer_of(reached), [*anything(reached, seed), spring])
    assert spring in left


def test_what_happens_once_is_not_asked_of_other_parts(sprung: Analysis) -> None:
    """Law: no part that a fit never saw can speak of what happened once, so it stays."""
    reached = best_of(sprung)
    push = next(group for group in reached.search.names.groups if group.effect.event)
    assert push in without_unforetelling(scorer_of(reached), [*reached.chosen, push])


def test_candidates_are_of_the_likeliest_set_that_has_them(sprung: Analysis) -> None:
    """Law: each effect that any start leads to is a candidate once, in the likeliest set that has it."""
    inference = sprung.conclusion.inference
    nats = [reached.log_evidence for reached in inference.reached]
    assert nats == sorted(nats, reverse=True)
    keys = {group.key for reached in inference.reached for group in reached.chosen}
    assert inference.candidates.keys() == keys
    for key, likeliest in inference.candidates.items():
        having = [reached for reached in inference.reached if reached.member(key) is not None]
        assert likeliest is having[0]
