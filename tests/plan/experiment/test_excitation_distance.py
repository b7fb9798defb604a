"""Laws of the distance between models."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ident.effects.catalogue import find_effect
from ident.trajectories.kinds import plan_motions
from ident.trajectories.reference import ReferenceMotion
from plan.experiment.distance import Predictor
from plan.experiment.feasible import Feasibility
from plan.experiment.hypotheses import AllGains, AllMasses
from plan.experiment.result import minutes_to_odds, odds_of
from plan.experiment.run_set import FAMILIES, RunSet

STRIBECK, VISCOUS = (find_effect("stribeck_friction"), 1), (find_effect("nonlinear_viscous_friction"), 1)
Runs = list[ReferenceMotion]


@pytest.fixture(scope="module")
def random_runs(predictor: Predictor) -> Runs:
    return list(plan_motions(predictor.arm, ("spline",), 4, 8.0, np.random.default_rng(1)))


@pytest.fixture(scope="module")
def runs_of(feasible: Feasibility) -> Callable[[str], Runs]:
    """Two runs of a family, its figures in the middle of their ranges."""

    def make(family: str) -> Runs:
        shares = np.full(RunSet.freedom(family, feasible.limits.arm.n), 0.5)
        return RunSet.decode(family, shares, 1, feasible.limits, 0).runs(2, feasible)

    return make


def test_a_rival_takes_something_away_and_a_model_all_of_itself(predictor: Predictor, random_runs: Runs) -> None:
    """Nothing is farther from a rival than from the baseline, which is a part of it; nor is it told from itself."""
    view = predictor.look(random_runs, [STRIBECK, VISCOUS, STRIBECK])
    assert view.distance(0, None) > 1.0
    assert 0.0 < view.distance(0, 1) < view.distance(0, None)
    assert view.distance(0, 2) < 1e-5 * view.distance(0, None)


def test_distance_grows_with_duration_and_falls_with_noise(predictor: Predictor, random_runs: Runs) -> None:
    """Four times the motion, or half the noise, tells four times as much; the URDF's word is given once."""
    loud = Predictor(predictor.arm, predictor.baseline, 2.0 * predictor.noise)
    cases = (predictor, random_runs), (predictor, random_runs * 4), (loud, random_runs)
    once, longer, louder = (one.look(runs, [STRIBECK, VISCOUS]).distance(0, 1) for one, runs in cases)
    assert longer == pytest.approx(4.0 * once, rel=0.05)
    assert louder == pytest.approx(once / 4.0, rel=0.05)


def test_sizes_follow_the_diagnosis(predictor: Predictor, random_runs: Runs) -> None:
    """An effect found twice as large is four times as far from its rival; a stiffer joint is nearer."""

    def distance(effect: str, figure: str, value: float) -> float:
        view = predictor.look(random_runs, [(find_effect(effect), 1), VISCOUS], {effect: {figure: value}})
        return view.distance(0, 1)

    small, large = (distance("stribeck_friction", "amplitude_Nm", value) for value in (2.0, 4.0))
    assert large == pytest.approx(4.0 * small, rel=1e-6)
    soft, stiff = (distance("joint_elasticity", "stiffness_Nm_rad", value) for value in (6e3, 12e3))
    assert stiff == pytest.approx(soft / 4.0, rel=1e-6)


@pytest.mark.parametrize("family", FAMILIES)
def test_exact_twins_stay_together(predictor: Predictor, runs_of: Callable[[str], Runs], family: str) -> None:
    """Gains and masses that are all too large by one share are the same log, whatever the arm does."""
    view = predictor.look(runs_of(family), [(AllGains(), 0), (AllMasses(), 0)])
    assert view.distance(0, None) > 0.1
    assert view.distance(0, 1) < 1e-5 * view.distance(0, None)
    assert view.distance(1, 0) < 1e-5 * view.distance(1, None)


def test_odds_and_minutes_agree() -> None:
    """At the minutes that 20 : 1 take, the odds are 20 : 1; without a distance they never are."""
    minutes = minutes_to_odds(5.0, 60.0)
    assert odds_of(5.0 * minutes) == pytest.approx(20.0)
    assert minutes_to_odds(0.0, 60.0) is None
