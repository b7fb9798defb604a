"""What the proposed motions keep to, and that they are worth it."""

from __future__ import annotations

import numpy as np
import pytest

from ident.arm import ArmModel
from ident.plant.limits import Limits
from ident.plant.shapes import TICK_S, Motion
from plan.excitation.excite import excite
from plan.excitation.families import FAMILIES
from plan.excitation.feasible import MARGIN, Feasibility
from plan.excitation.programme import Programme
from plan.excitation.question import ask

PAIRS = (
    ("joint_elasticity,torque_delay", 16),
    ("stribeck_friction,presliding_hysteresis", 16),
    pytest.param("stribeck_friction,nonlinear_viscous_friction", 32, marks=pytest.mark.slow),
    ("load_dependent_friction,position_dependent_friction", 16),
    ("spring_torque,gravity_misalignment", 16),
    ("torque_offset,asymmetric_friction", 16),
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
        assert Limits(feasible.limits.arm).stays_within(run.q, run.dq, run.ddq)
        assert feasible.clearance(run) > 0.0
        assert run.q[[0, -1]] == pytest.approx(np.stack([programme.home] * 2), abs=1e-6)
        assert np.all(run.dq[[0, -1]] == 0.0)
        # Speeds and accelerations are those of the positions.
        assert np.diff(run.q, axis=0) / TICK_S == pytest.approx(0.5 * (run.dq[1:] + run.dq[:-1]), abs=0.02)


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


def test_a_folded_arm_is_refused(feasible: Feasibility) -> None:
    """A motion that folds the arm into itself is not allowed, and no distance of it can be proven."""
    whole = Feasibility(ArmModel.load("tm5-900"))
    s = np.linspace(0.0, 1.0, 3001)[:, None] ** 2 * (3.0 - 2.0 * np.linspace(0.0, 1.0, 3001)[:, None])
    goal = np.array([0.0, 0.0, whole.limits.upper[2], whole.limits.upper[3], 0.0, 0.0])
    q = s * goal
    folded = Motion("folded", q, np.gradient(q, TICK_S, axis=0), np.zeros_like(q))
    assert whole.scene is not None
    nearest = min(whole.scene.proximity.clearance(state) for state in q[::50])
    assert (whole.clearance(folded) > 0.0) == (nearest > 0.1 * MARGIN)
    assert not whole.allows(folded) or nearest > 0.0


@pytest.mark.parametrize(("pair", "evaluations"), PAIRS)
def test_proposed_motion_beats_chance(arm: ArmModel, pair: str, evaluations: int) -> None:
    """Even a short search finds motion that tells a tied pair apart better than random motion of equal length."""
    found = excite(arm, ask(arm, pair, "joint_2", None), minutes=0.5, evaluations=evaluations)
    assert found.status == "ready"
    proposed, by_chance = found.smallest
    assert proposed > by_chance
    assert found.clearance is not None
    assert found.clearance > 0.0
