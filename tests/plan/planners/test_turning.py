"""Torque where joints turn round: what nodes walk past is found, and its slopes are those of finite differences."""

from dataclasses import replace

import numpy as np
import pytest

from plan.planners import local_model
from plan.planners.local_model import LocalModel
from plan.planners.sequential import begin_course
from tests.plan.worlds import problem


@pytest.fixture
def local(monkeypatch: pytest.MonkeyPatch) -> LocalModel:
    monkeypatch.setattr(local_model, "WATCHED_SHARE", 0.0)
    return begin_course(replace(problem(), objective="time", free="both")).local


def bent(local: LocalModel) -> np.ndarray:
    """Variables of a motion on which joints turn round."""
    rng, x = np.random.default_rng(0), local.join(local.grid.fit(local.problem.decode(local.problem.initial)), 0.6)
    x[:-1] += 0.1 * rng.normal(size=len(x) - 1)
    return x


def shares(local: LocalModel, x: np.ndarray) -> np.ndarray:
    """Torque at the turns as shares of the limits."""
    coefficients, duration = local.split(x)
    turns, at, first = local._turns(coefficients, *local.grid.states(coefficients, duration)[1:], duration)
    return np.abs(turns.torque(local.problem.model, at)) / local._turn_limit(turns, first)  # type: ignore[arg-type]


def test_slopes_equal_finite_differences(local: LocalModel) -> None:
    """Also where the place moves with the motion."""
    x = bent(local)
    coefficients, duration = local.split(x)
    rows = local._turn_rows(coefficients, local.grid.states(coefficients, duration), duration)
    assert len(rows.room) > 2 * 2 * local.n
    assert 1.0 - rows.room == pytest.approx(shares(local, x))
    along = np.random.default_rng(1).normal(size=len(x))
    slopes = (shares(local, x + 1e-6 * along) - shares(local, x - 1e-6 * along)) / 2e-6
    off = np.abs(rows.matrix @ along - slopes) / (1.0 + np.abs(slopes))
    assert np.median(off) < 1e-3
    assert off.max() < 0.1


def test_no_peak_where_a_joint_turns_is_missed(local: LocalModel) -> None:
    """At ten thousand places the torque near a turn is nowhere above what was found at the turns."""
    x = bent(local)
    splines = local.splines(x)
    q, dq, ddq = (part[0] for part in splines.states(np.linspace(0.0, 1.0, 1000)))
    tau = np.abs(local.problem.model.torque(q[None], dq[None], ddq[None])[0])
    coefficients, duration = local.split(x)
    turns, at, _ = local._turns(coefficients, *local.grid.states(coefficients, duration)[1:], duration)
    found = np.abs(turns.torque(local.problem.model, at))  # type: ignore[arg-type]
    for j in range(local.n):
        slow = np.abs(dq[:, j]) < 0.02
        assert tau[slow, j].max() < 1.02 * found[turns.joints == j].max()


def test_a_joint_that_waits_does_not_turn(local: LocalModel) -> None:
    """Creeping to and fro slower than friction takes to change sides is no turn: no limit jumps with it."""
    x = bent(local)
    moved = x[:-1].reshape(-1, local.n)
    moved[:, 0] = local.problem.start[0] + 1e-6 * np.random.default_rng(2).normal(size=len(moved))
    coefficients, duration = local.split(x)
    _, dq, ddq = local.grid.states(coefficients, duration)
    assert (dq[:-1, 0] * dq[1:, 0] < 0.0).any()
    turns = local._turns(coefficients, dq, ddq, duration)[0]
    assert 0 not in turns.joints[turns.inside]
    assert {1, 2} & set(turns.joints[turns.inside])
