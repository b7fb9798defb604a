"""Sums of some columns by fold, as held-out scores use them."""

import numpy as np
import pytest

from ident.diagnosis.diagnose import Analysis
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group
from ident.regression.gram import Evidence
from tests.ident.diagnosis.planted import analyse, load_arm, spring_on_3


@pytest.fixture(scope="module")
def sprung() -> Analysis:
    """A spring across the third joint."""
    return analyse(load_arm(), spring_on_3)


def evidence_of(analysis: Analysis) -> Evidence:
    return analysis.conclusion.evidence


def some_groups(analysis: Analysis, count: int = 4) -> list[Group]:
    return list(analysis.conclusion.fine.search.names.groups[:count])


@pytest.mark.parametrize("joint", range(3))
def test_folds_add_up(sprung: Analysis, joint: int) -> None:
    """Law: without friction of its own in each run, folds add up to all blocks, and leave the rest."""
    evidence = evidence_of(sprung)
    evidence = evidence.with_run_spread(np.full(len(evidence.spread), 1e-9))
    places = np.arange(0, len(evidence.layout.local[joint]), 3)
    without, of_fold = evidence.fold_sums(joint, places)
    whole = evidence.free[joint].over()[np.ix_(places, places)]
    np.testing.assert_allclose(of_fold.sum(axis=0), whole, rtol=1e-6, atol=1e-6 * np.abs(whole).max())
    np.testing.assert_allclose(without, whole - of_fold, rtol=1e-6, atol=1e-6 * np.abs(whole).max())


@pytest.mark.parametrize("joint", range(3))
def test_columns_are_a_part_of_all(sprung: Analysis, joint: int) -> None:
    """Law: sums of some columns are those of all columns there."""
    evidence = evidence_of(sprung)
    everything = np.arange(len(evidence.layout.local[joint]))
    some = everything[1::4]
    whole = evidence.fold_sums(joint, everything)
    parts = evidence.fold_sums(joint, some)
    for of_some, of_all in zip(parts, whole, strict=True):
        scale = np.abs(of_all).max()
        np.testing.assert_allclose(of_some, of_all[:, some[:, None], some], rtol=1e-7, atol=1e-9 * scale)


def test_scores_do_not_depend_on_what_was_expected(sprung: Analysis) -> None:
    """Law: models are scored alike whether their columns were expected or come one by one."""
    conclusion = sprung.conclusion
    groups = some_groups(sprung)
    plain = HeldOut(conclusion.evidence, conclusion.prior)
    ready = HeldOut(conclusion.evidence, conclusion.prior, expected=tuple(groups))
    for count in (0, 1, len(groups)):
        chosen = groups[:count]
        np.testing.assert_allclose(plain.score(chosen).misfit, ready.score(chosen).misfit, rtol=1e-9)


def test_another_belief_counts_the_same_sums(sprung: Analysis) -> None:
    """Law: a scorer with another belief says what one that was made with it says."""
    conclusion = sprung.conclusion
    tight = conclusion.prior.tightened(50.0)
    shared = HeldOut(conclusion.evidence, conclusion.prior).believing(tight)
    made = HeldOut(conclusion.evidence, tight)
    np.testing.assert_allclose(shared.score().misfit, made.score().misfit, rtol=1e-12)
