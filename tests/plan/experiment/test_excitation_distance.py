"""Laws of the distance between models."""

from __future__ import annotations

import numpy as np
import pytest

from ident.effects.catalogue import find_effect
from ident.robot.arm import ArmModel
from ident.trajectories.kinds import plan_motions
from ident.trajectories.reference import ReferenceMotion
from plan.experiment.distance import look
from plan.experiment.families import FAMILIES
from plan.experiment.feasible import Feasibility
from plan.experiment.foresight import Eye
from plan.experiment.indistinguishable import AllGains, AllMasses
from plan.experiment.result import minutes_to_odds, odds_of
from plan.experiment.run_set import Programme

STRIBECK, VISCOUS = find_effect("stribeck_friction"), find_effect("nonlinear_viscous_friction")


@pytest.fixture(scope="module")
def random_runs(eye: Eye) -> list[ReferenceMotion]:
    return list(plan_motions(eye.arm, ("spline",), 4, 8.0, np.random.default_rng(1)))


def programme(family: str, feasible: Feasibility, joint: int = 1) -> list[ReferenceMotion]:
    """Two runs of a family, its figures in the middle of their ranges."""
    shares = np.full(Programme.freedom(family, feasible.limits.arm.n), 0.5)
    return Programme.decode(family, shares, joint, feasible, 0).runs(2, feasible)


def test_a_model_is_no_distance_from_itself(eye: Eye, random_runs: list[ReferenceMotion]) -> None:
    """Visible though it is, an effect can't be told from itself."""
    view = look(eye, random_runs, [(STRIBECK, 1), (STRIBECK, 1)])
    assert view.distance(0, None) > 1.0
    assert view.distance(0, 1) < 1e-5 * view.distance(0, None)


def test_a_rival_takes_something_away(eye: Eye, random_runs: list[ReferenceMotion]) -> None:
    """No effect is farther from a rival, which the baseline is a part of, than from the baseline alone."""
    view = look(eye, random_runs, [(STRIBECK, 1), (VISCOUS, 1)])
    assert 0.0 < view.distance(0, 1) < view.distance(0, None)


def test_distance_grows_with_duration(eye: Eye, random_runs: list[ReferenceMotion]) -> None:
    """The same motion four times over tells four times as much; the URDF's word is given once, which costs a little."""
    once = look(eye, random_runs, [(STRIBECK, 1), (VISCOUS, 1)]).distance(0, 1)
    four = look(eye, random_runs * 4, [(STRIBECK, 1), (VISCOUS, 1)]).distance(0, 1)
    assert four == pytest.approx(4.0 * once, rel=0.05)


def test_distance_falls_with_the_noise(eye: Eye, random_runs: list[ReferenceMotion]) -> None:
    """Twice the noise leaves a quarter of the odds' logarithm, but for the URDF's word."""
    loud = Eye(eye.arm, eye.baseline, 2.0 * eye.noise)
    near, far = (look(one, random_runs, [(STRIBECK, 1), (VISCOUS, 1)]).distance(0, 1) for one in (loud, eye))
    assert near == pytest.approx(far / 4.0, rel=0.05)


def test_sizes_follow_the_diagnosis(eye: Eye, random_runs: list[ReferenceMotion]) -> None:
    """An effect found twice as large is four times as far from its rival; a stiffer joint is nearer."""

    def distance(effect: str, figure: str, value: float) -> float:
        view = look(eye, random_runs, [(find_effect(effect), 1), (VISCOUS, 1)], {effect: {figure: value}})
        return view.distance(0, 1)

    small, large = (distance("stribeck_friction", "amplitude_Nm", value) for value in (2.0, 4.0))
    assert large == pytest.approx(4.0 * small, rel=1e-6)
    soft, stiff = (distance("joint_elasticity", "stiffness_Nm_rad", value) for value in (6e3, 12e3))
    assert stiff == pytest.approx(soft / 4.0, rel=1e-6)


@pytest.mark.parametrize("family", FAMILIES)
def test_exact_twins_stay_together_in_every_motion(eye: Eye, feasible: Feasibility, family: str) -> None:
    """Gains and masses that are all too large by one share are the same log, whatever the arm does."""
    view = look(eye, programme(family, feasible), [(AllGains(), 0), (AllMasses(), 0)])
    assert view.distance(0, None) > 0.1
    assert view.distance(0, 1) < 1e-5 * view.distance(0, None)
    assert view.distance(1, 0) < 1e-5 * view.distance(1, None)


def test_a_payload_hides_the_last_link() -> None:
    """What is wrong with the last link is a payload for all that motion tells."""
    eye = Eye.of(ArmModel.load("tm5-900"))
    runs = plan_motions(eye.arm, ("spline",), 2, 8.0, np.random.default_rng(1))
    view = look(eye, runs, [(find_effect("link_inertial_error"), 5), (find_effect("payload"), 0)])
    assert view.distance(0, None) > 0.01
    assert view.distance(0, 1) < 0.1 * view.distance(0, None)


def test_what_a_motion_cannot_show_has_no_distance(eye: Eye) -> None:
    """A joint that stands still says nothing of its friction, and the reason is kept."""
    still = plan_motions(eye.arm, ("spline",), 1, 4.0, np.random.default_rng(1))[0]
    frozen = ReferenceMotion("still", *(np.repeat(part[:1], len(part), 0) for part in (still.q, still.dq, still.ddq)))
    view = look(eye, [frozen], [(STRIBECK, 1), (VISCOUS, 1)])
    assert view.between() == dict.fromkeys(view.between(), 0.0)
    assert "covers only" in view.candidates[0].silent


def test_wider_motion_tells_more_of_the_inertias(eye: Eye, feasible: Feasibility) -> None:
    """All joints over wide poses inform the base parameters more than one joint's slow swing."""
    wide, slow = (look(eye, programme(family, feasible)).information() for family in ("wide", "slow"))
    assert wide > slow > 0.0


def test_odds_and_minutes_agree() -> None:
    """At the minutes that 20 : 1 take, the odds are 20 : 1; without a distance they never are."""
    minutes = minutes_to_odds(5.0, 60.0)
    assert minutes is not None
    assert odds_of(5.0 * minutes) == pytest.approx(20.0)
    assert minutes_to_odds(0.0, 60.0) is None
