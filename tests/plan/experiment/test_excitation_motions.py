"""Motions that are proposed: within limits, distinguished from chance, and how far apart they bring two effects."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ident.arrays import Array, Float
from ident.effects.catalogue import find_effect
from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.trajectories.kinds import MotionLimits, plan_motions
from ident.trajectories.reference import TICK_S, ReferenceMotion, sampled
from plan.command_options import ExciteOptions
from plan.experiment.design import LEAST_RUNS, Designer
from plan.experiment.distance import Predictor
from plan.experiment.feasible import Feasibility, surroundings_of
from plan.experiment.hypotheses import AllGains, AllMasses, ask
from plan.experiment.result import minutes_to_odds, odds_of
from plan.experiment.run_set import FAMILIES, RunSet

PAIRS = (
    ("stribeck_friction,presliding_hysteresis", 9),
    pytest.param("joint_elasticity,torque_delay", 16, marks=pytest.mark.slow),
    pytest.param("stribeck_friction,nonlinear_viscous_friction", 32, marks=pytest.mark.slow),
    pytest.param("load_dependent_friction,position_dependent_friction", 16, marks=pytest.mark.slow),
    pytest.param("spring_torque,gravity_misalignment", 16, marks=pytest.mark.slow),
)
SCENE = """[[obstacle]]
name = "post"
size_m = [0.1, 0.1, 1.0]
xyz_m = [0.5, 0, 0.5]
[limits]
lower_deg = [-90, -60, -120, -90, -90, -90]
upper_deg = [90, 60, 120, 90, 90, 90]
speed_deg_s = [20, 20, 20, 20, 20, 20]
"""


@pytest.mark.parametrize("family", FAMILIES)
def test_runs_keep_limits_and_distance(feasible: Feasibility, family: str) -> None:
    """Limits of position, speed and torque hold, no link comes near another, runs start and end at home and at rest.

    Whichever run the diagnosis leaves out, the rest speak of every joint.
    """
    shares = np.random.default_rng(3).uniform(0.0, 1.0, RunSet.freedom(family, 3))
    run_set = RunSet.decode(family, shares, 1, feasible.limits, 0)
    runs = run_set.runs(LEAST_RUNS, feasible)
    assert len(runs) == LEAST_RUNS
    for run in runs:
        assert MotionLimits(feasible.limits.arm).stays_within(run.q, run.dq, run.ddq)
        assert feasible.clearance(run) > 0.0
        assert run.q[[0, -1]] == pytest.approx(np.stack([run_set.home] * 2), abs=1e-6)
        assert np.all(run.dq[[0, -1]] == 0.0)
        # Speeds and accelerations are those of the positions.
        assert np.diff(run.q, axis=0) / TICK_S == pytest.approx(0.5 * (run.dq[1:] + run.dq[:-1]), abs=0.02)
    middle = RunSet.decode(family, np.full(len(shares), 0.5), 1, feasible.limits, 0).runs(LEAST_RUNS, feasible)
    moved = np.array([np.ptp(run.q, axis=0) > 0.2 for run in middle])
    assert np.all(moved.sum(axis=0) >= 2)


def slow_move(start: Float[Array, " n"], goal: Float[Array, " n"]) -> ReferenceMotion:
    """From rest to rest on a straight line in 20 s."""
    s = np.linspace(0.0, 1.0, 20001)[:, None]
    return sampled("move", start + (goal - start) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def test_a_folded_arm_is_refused(whole: ArmModel) -> None:
    """Slow motion within all limits is refused where it folds the arm into itself; where it does not, it is allowed."""
    feasible = Feasibility(whole)
    limits = feasible.limits
    poses = np.random.default_rng(0).uniform(limits.lower, limits.upper, (200, 6))
    distances = [feasible.scene.proximity.distances(pose).min() for pose in poses]
    folded, free = (slow_move(limits.centre, poses[pick(distances)]) for pick in (np.argmin, np.argmax))
    assert min(distances) < 0.0
    assert limits.excess(folded.q, folded.dq, folded.ddq) < 1.0
    assert not feasible.allows(folded)
    assert feasible.clearance(folded) == 0.0
    short = slow_move(limits.centre, limits.centre + 0.02)
    assert feasible.allows(short)
    assert feasible.clearance(short) > 0.0
    # What is proven is no more than what a close look finds.
    assert feasible.clearance(free) <= max(0.0, min(feasible.scene.distances(q).min() for q in free.q[::200]))


def test_nothing_goes_below_the_base_plane_unless_told(whole: ArmModel) -> None:
    """A motion that dips under the base plane is allowed without a floor, and refused by default."""
    above, below = np.radians([0.0, 20.0, 30.0, 0.0, 0.0, 0.0]), np.radians([0.0, 100.0, 10.0, 0.0, 0.0, 0.0])
    dip = slow_move(above, below)
    free, floored = (
        Feasibility(whole, around=surroundings_of(whole, options))
        for options in (ExciteOptions(floor="none"), ExciteOptions())
    )
    assert free.allows(dip)
    assert free.clearance(dip) > 0.0
    assert not floored.allows(dip)
    assert floored.clearance(dip) == 0.0
    assert floored.clearance(slow_move(above, above + 0.01)) > 0.0
    assert "floor" in {box.name for box in floored.scene.obstacles}


def test_a_scene_narrows_what_is_allowed(whole: ArmModel, tmp_path: Path) -> None:
    """Obstacles, joint limits and top speed of a scene file are kept; the option's top speed as well."""
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    found, open_ = (
        Feasibility(whole, around=surroundings_of(whole, options))
        for options in (ExciteOptions(scene=path, top_speed=10.0), ExciteOptions())
    )
    assert np.degrees(found.limits.upper) == pytest.approx([90, 60, 120, 90, 90, 90])
    assert np.degrees(found.limits.speed) == pytest.approx(10.0)
    side, front = (np.radians([angle, 30.0, 60.0, 0.0, 0.0, 0.0]) for angle in (-80.0, 80.0))
    assert found.scene.distances(side).min() > 0.01
    assert found.clearance(slow_move(side, front)) == 0.0
    assert open_.clearance(slow_move(side, front)) > 0.0


@pytest.mark.parametrize(
    ("text", "floor", "words"),
    [
        ('robot = "ur10"\n', "0", "give its --robot"),
        ("[limits]\nlower_deg = [9, 0, 0, 0, 0, 0]\nupper_deg = [1, 1, 1, 1, 1, 1]", "0", "is not below"),
        ("[limits]\nlower_deg = [1, 2]\n", "0", "has 2 numbers, not 6"),
        ("[floor]\nheight_m = 99\nhigh = 1\n", "0", "unknown key 'high'"),
        ("", "low", "is no height"),
        ("", "nan", "is no height"),
    ],
)
def test_bad_surroundings(whole: ArmModel, tmp_path: Path, text: str, floor: str, words: str) -> None:
    """Another robot's scene, limits that contradict each other, and floors that are none."""
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(InputError, match=words):
        surroundings_of(whole, ExciteOptions(scene=tmp_path / "scene.toml", floor=floor))


@pytest.mark.parametrize(("pair", "evaluations"), PAIRS)
def test_proposed_motion_beats_chance(arm: ArmModel, pair: str, evaluations: int) -> None:
    """Even a short search finds motion that tells a tied pair apart better than random motion of equal length."""
    asked = ask(arm, pair, "joint_2", None)
    found = Designer(arm, asked, ExciteOptions(minutes=0.5, evaluations=evaluations)).best()
    assert found.status == "ready"
    proposed, by_chance = found.smallest
    assert proposed > by_chance
    assert found.clearance > 0.0


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
