"""Laws of the evaluation: energy error, torque RMSE and R² by rung, joint and run."""

import json
from collections.abc import Sequence

import numpy as np
import pytest

from ident.arrays import Array
from ident.command_options import FitOptions
from ident.fitting.fit import fit_hybrid
from ident.model.evaluation import RunTrace, evaluate, score_runs
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.motion.motion import Motion
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel
from tests.ident.made_up import exact_motion, made_motions

LOSS = LossParameters(*(np.full(6, value) for value in (0.1, 8.0, 6.0, 0.0, 0.02)))


def _runs(arm: ArmModel, seeds: Sequence[int], payload: Payload | None = None) -> list[Motion]:
    return made_motions(arm, LOSS, seeds, 8.0, noise=0.1, payload=payload)


@pytest.fixture(scope="module")
def model(arm: ArmModel) -> HybridModel:
    return fit_hybrid(_runs(arm, [1, 2]), arm, FitOptions(net="none", inertia="consistent")).model


def _swing(error: Sequence[float], names: tuple[str, ...] = ("a", "b"), resting: int | None = None) -> RunTrace:
    """Joints on q = sin(2πt / 4) for 8 s; the model's torque is the measured one plus viscous errors C dq."""
    time = np.arange(801) / 100.0
    omega = np.pi / 2
    q = np.tile(np.sin(omega * time)[:, None], (1, len(names)))
    dq, ddq = np.tile(omega * np.cos(omega * time)[:, None], (1, len(names))), -(omega**2) * q
    if resting is not None:
        q[:, resting], dq[:, resting], ddq[:, resting] = 0.3, 0.0, 0.0
    tau = 5.0 * q
    motion = exact_motion(time, (q, dq, ddq), tau, names)
    rungs = {"analytic": tau - np.array(error) * 2 * dq, "loss": tau - np.array(error) * dq}
    return RunTrace(motion, rungs)


def test_energy_error_of_a_known_torque_error() -> None:
    """A model that lacks C dq is short of ∫ C dq² dt: C ω² T / 2 = 9.87 C joules here, to 1e-5, and negative."""
    score = score_runs("s", [_swing([2.0, 0.5])])
    work = (np.pi / 2) ** 2 * 8.0 / 2
    assert np.allclose(score.energy_error[:, 0], [[-4 * work, -work], [-2 * work, -work / 2]], rtol=1e-5)


def test_rmse_of_a_known_torque_error() -> None:
    """An error C dq has RMSE C ω / √2 (within 1 %: where the joint is at rest is left out); joints pool by squares."""
    score = score_runs("s", [_swing([2.0, 0.5])])
    expected = np.array([2.0, 0.5]) * (np.pi / 2) / np.sqrt(2)
    assert np.allclose(score.rmse_mean[1, :2], expected, rtol=0.01)
    assert score.rmse_mean[1, 2] == pytest.approx(np.sqrt(np.mean(score.rmse_mean[1, :2] ** 2)))


def test_a_single_run_has_no_spread() -> None:
    """Of what runs differ by it tells nothing: null and why, not zero."""
    one, two = (score_runs("s", [_swing([2.0, 0.5])] * count).to_dict() for count in (1, 2))
    for key in ("energy_error_J", "torque_rmse_Nm"):
        assert {cell for row in one[key]["std"].values() for cell in row.values()} == {None}
        assert "single run" in one[key]["std_missing"]
        assert None not in two[key]["std"]["loss"].values()
        assert "std_missing" not in two[key]


def test_a_joint_that_never_moves_does_not_spoil_the_rest() -> None:
    """Its RMSE and R² are NaN (null in JSON), its energy error zero; the total is over the joints that move."""
    score = score_runs("s", [_swing([2.0, 0.5], resting=1), _swing([1.0, 0.5], resting=1)])
    assert np.all(np.isnan(score.rmse_mean[:, 1]))
    assert np.all(np.isnan(score.rmse_std[:, 1]))
    assert np.all(np.isnan(score.r2[:, 1]))
    assert np.all(score.energy_error[..., 1] == 0.0)
    assert np.allclose(score.rmse_mean[:, 2], score.rmse_mean[:, 0])
    assert score.rest_rmse[0, 1] == pytest.approx(0.0, abs=1e-9)
    record = json.loads(json.dumps(score.to_dict(), allow_nan=False))
    assert record["torque_rmse_Nm"]["mean"]["loss"]["b"] is None
    assert record["torque_rmse_Nm"]["mean"]["loss"]["a"] > 0.0


def test_torque_at_rest_is_scored_apart(arm: ArmModel) -> None:
    """3 N m of stiction on a joint at rest show in the error at rest only."""
    trace = _swing([0.0, 0.0], resting=1)
    tau: Array = trace.motion.tau + np.array([0.0, 3.0])
    motion = trace.motion
    held = exact_motion(motion.time, (motion.q, motion.dq, motion.ddq), tau, motion.joints)
    score = score_runs("s", [RunTrace(held, trace.rungs)])
    assert score.rest_rmse[1, 1] == pytest.approx(3.0, rel=1e-6)
    assert score.rmse_mean[1, 0] == pytest.approx(0.0, abs=1e-9)


def test_tables_have_a_row_a_session_and_a_column_a_joint(arm: ArmModel, model: HybridModel) -> None:
    """Sessions with and without payload, rungs as the model's ladder, joints and a total: the paper's tables' shape."""
    groups = [("E1", _runs(arm, [11, 12])), ("E2", _runs(arm, [13])), ("load", _runs(arm, [14], Payload(1.0)))]
    result = evaluate(model, groups, "mine")
    assert [score.name for score in result.sessions] == ["E1", "E2", "load"]
    assert [score.payload_kg for score in result.sessions] == [0.0, 0.0, 1.0]
    assert result.pooled.name == "E1 + E2"
    assert result.pooled.runs == ("run_11", "run_12", "run_13")
    assert len(result.traces) == 4
    for score in (*result.sessions, result.pooled):
        assert score.rungs == ("analytic", "inertia", "loss")
        assert score.energy_mean.shape == score.rmse_mean.shape == score.rest_rmse.shape == (3, 7)
        assert score.r2.shape == (3, 6)
        assert score.energy_error.shape == (3, len(score.runs), 6)
    record = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert list(record["sessions"][0]["energy_error_J"]["mean"]["loss"]) == [*arm.joint_names, "total"]
