"""What the proposed motions keep to, and that they are worth it."""

from __future__ import annotations

import numpy as np
import pytest

from ident.arrays import Array, Float
from ident.robot.arm import ArmModel
from ident.trajectories.limits import MotionLimits
from ident.trajectories.reference import TICK_S, ReferenceMotion, sampled
from plan.experiment.design import LEAST_RUNS, excite
from plan.experiment.families import FAMILIES
from plan.experiment.feasible import Feasibility
from plan.experiment.foresight import Eye
from plan.experiment.hypotheses import ask
from plan.experiment.run_set import Programme
from plan.experiment.search import BASELINE, ProgrammeSearch
from plan.options import ExciteOptions

PAIRS = (
    ("stribeck_friction,presliding_hysteresis", 9),
    pytest.param("joint_elasticity,torque_delay", 16, marks=pytest.mark.slow),
    pytest.param("stribeck_friction,nonlinear_viscous_friction", 32, marks=pytest.mark.slow),
    pytest.param("load_dependent_friction,position_dependent_friction", 16, marks=pytest.mark.slow),
    pytest.param("spring_torque,gravity_misalignment", 16, marks=pytest.mark.slow),
)


@pytest.mark.parametrize("family", FAMILIES)
def test_runs_keep_limits_and_distance(feasible: Feasibility, family: str) -> None:
    """Position, speed and torque stay within limits, no link comes near another, start and end are home at rest."""
    rng = np.random.default_rng(3)
    shares = rng.uniform(0.0, 1.0, Programme.freedom(family, feasible.limits.arm.n))
    programme = Programme.decode(family, shares, 1, feasible, 0)
    runs = programme.runs(3, feasible)
    assert runs
    for run in runs:
        assert MotionLimits(feasible.limits.arm).stays_within(run.q, run.dq, run.ddq)
        assert feasible.clearance(run) > 0.0
        assert run.q[[0, -1]] == pytest.approx(np.stack([programme.home] * 2), abs=1e-6)
        assert np.all(run.dq[[0, -1]] == 0.0)
        # Speeds and accelerations are those of the positions.
        assert np.diff(run.q, axis=0) / TICK_S == pytest.approx(0.5 * (run.dq[1:] + run.dq[:-1]), abs=0.02)


@pytest.mark.parametrize("family", FAMILIES)
def test_every_joint_moves_in_two_runs(feasible: Feasibility, family: str) -> None:
    """Whichever run the diagnosis leaves out, the rest speak of every joint."""
    shares = np.full(Programme.freedom(family, 3), 0.5)
    runs = Programme.decode(family, shares, 1, feasible, 0).runs(LEAST_RUNS, feasible)
    assert len(runs) == LEAST_RUNS
    moved = np.array([np.ptp(run.q, axis=0) > 0.2 for run in runs])
    assert np.all(moved.sum(axis=0) >= 2)


def test_the_same_seed_makes_the_same_motion(feasible: Feasibility) -> None:
    """Chance comes from the seed alone, run by run."""
    shares = np.full(Programme.freedom("wide", 3), 0.5)
    first, again = (Programme.decode("wide", shares, 1, feasible, 5).run(1, feasible) for _ in range(2))
    other = Programme.decode("wide", shares, 1, feasible, 6).run(1, feasible)
    assert first is not None
    assert again is not None
    assert other is not None
    assert np.array_equal(first.q, again.q)
    assert not np.array_equal(first.q[:2000], other.q[:2000])


def test_a_folded_arm_is_refused() -> None:
    """Slow motion within all limits is refused where it folds the arm into itself; where it does not, it is allowed."""
    whole = Feasibility(ArmModel.load("tm5-900"))
    limits = whole.limits
    poses = np.random.default_rng(0).uniform(limits.lower, limits.upper, (200, 6))
    distances = [whole.scene.proximity.distances(pose).min() for pose in poses]
    folded, free = (slow_move(limits.centre, poses[pick(distances)]) for pick in (np.argmin, np.argmax))
    assert min(distances) < 0.0
    assert limits.excess(folded.q, folded.dq, folded.ddq) < 1.0
    assert not whole.allows(folded)
    assert whole.clearance(folded) == 0.0
    short = slow_move(limits.centre, limits.centre + 0.02)
    assert whole.allows(short)
    assert whole.clearance(short) > 0.0
    # What is proven is no more than what a close look finds.
    assert whole.clearance(free) <= max(0.0, min(whole.scene.proximity.distances(q).min() for q in free.q[::200]))


def slow_move(start: Float[Array, " n"], goal: Float[Array, " n"]) -> ReferenceMotion:
    """From rest to rest on a straight line in 20 s."""
    s = np.linspace(0.0, 1.0, 20001)[:, None]
    return sampled("move", start + (goal - start) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


@pytest.mark.parametrize(("pair", "evaluations"), PAIRS)
def test_proposed_motion_beats_chance(arm: ArmModel, pair: str, evaluations: int) -> None:
    """Even a short search finds motion that tells a tied pair apart better than random motion of equal length."""
    found = excite(arm, ask(arm, pair, "joint_2", None), ExciteOptions(minutes=0.5, evaluations=evaluations))
    assert found.status == "ready"
    proposed, by_chance = found.smallest
    assert proposed > by_chance
    assert found.clearance is not None
    assert found.clearance > 0.0


@pytest.mark.slow
def test_what_only_one_effect_can_show_is_said(arm: ArmModel) -> None:
    """Asymmetric friction that grows with speed shows in motion; a pure offset is a special case of it in motion."""
    question = ask(arm, "torque_offset,asymmetric_friction", "joint_2", None)
    found = excite(arm, question, ExciteOptions(minutes=0.5, evaluations=16))
    assert found.status == "one_sided"
    assert found.tellable == (("asymmetric_friction", "torque_offset"),)
    assert found.distances[("torque_offset", "asymmetric_friction")] < 1.0
    assert found.smallest[0] == found.distances[("asymmetric_friction", "torque_offset")] > found.smallest[1]
    assert found.set_up is not None
    assert "brakes" in found.set_up
    assert found.to_dict()["told_by_motion"] == ["asymmetric_friction against torque_offset"]


def test_random_motion_is_a_start_like_any_other(eye: Eye, feasible: Feasibility, arm: ArmModel) -> None:
    """However short the search, the usual random motion is judged, and stays in to the end."""
    question = ask(arm, "stribeck_friction,presliding_hysteresis", "joint_2", None)
    ranked = ProgrammeSearch(eye, feasible, question, evaluations=len(FAMILIES)).best()
    assert BASELINE in {trial.family for trial in ranked}
    assert [trial.rate for trial in ranked] == sorted((trial.rate for trial in ranked), reverse=True)
    assert len({trial.family for trial in ranked}) == len(ranked)
