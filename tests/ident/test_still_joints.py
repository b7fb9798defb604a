"""A joint that is logged and stands in all runs, as a hand's, is no reason to refuse a fit."""

import json
from pathlib import Path

import numpy as np
import pytest

from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.recordings.recording import Recording, Session
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from ident.sessions import lock_still, open_sessions
from tests.ident.made_up import made_session

LEFT = 5


def standing(arm: ArmModel, still: dict[int, tuple[float, float]]) -> Session:
    """Two runs with friction, some joints standing at an angle each [rad]."""

    def at(run: Recording, place: int) -> Recording:
        position = run.position.copy()
        for joint, angles in still.items():
            position[:, joint] = angles[place]
        dq = np.gradient(position, run.time, axis=0)
        ddq = np.gradient(dq, run.time, axis=0)
        torque = arm.inverse_dynamics(position, dq, ddq) + 8.0 * dq + 5.0 * np.tanh(dq / 0.01)
        noise = np.random.default_rng(place).standard_normal(torque.shape)
        return run.replace(position=position, velocity=None, effort=torque + 0.05 * noise)

    made = made_session(arm, lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq), [1, 2], duration=10.0)
    return made.replace(runs=[at(run, place) for place, run in enumerate(made.runs)])


@pytest.mark.parametrize("still", [{5: (0.3, 0.3)}, {0: (-0.8, -0.8)}, {3: (0.7, 0.7), 5: (0.1, 0.1)}], ids=str)
def test_a_joint_that_stands_is_locked_where_it_stood(still: dict[int, tuple[float, float]], arm: ArmModel) -> None:
    """Law: the torque of the others is what it was, and the joint is named."""
    opened = open_sessions(standing(arm, still), arm, learning=False, accept=("insufficient_excitation",))
    locked = lock_still(opened)
    names = [arm.joint_names[joint] for joint in still]
    assert locked.arm.locked_joints == pytest.approx({arm.joint_names[j]: q for j, (q, _) in still.items()})
    assert [list(issue.joints) for issue in locked.issues if issue.issue == "joints_locked"] == [names]
    others = [joint for joint in range(arm.n) if joint not in still]
    for whole, part in zip(opened.motions, locked.motions, strict=True):
        torque = arm.inverse_dynamics(whole.q, whole.dq, whole.ddq)[:, others]
        np.testing.assert_allclose(locked.arm.inverse_dynamics(part.q, part.dq, part.ddq), torque, atol=0.05)
    assert lock_still(locked) is locked


def test_a_joint_that_stands_elsewhere_from_run_to_run_is_not_locked(arm: ArmModel) -> None:
    """Law: no one angle of it is the arm's."""
    session = standing(arm, {LEFT: (0.1, 0.6)})
    opened = open_sessions(session, arm, learning=False, accept=("insufficient_excitation",))
    assert lock_still(opened) is opened


def test_a_model_knows_its_arm_again_though_a_joint_is_locked_off_neutral(arm: ArmModel, tmp_path: Path) -> None:
    """Law: recordings of the whole robot are scored by a model of the joints that moved."""
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(arm.urdf)
    folder = tmp_path / "session"
    folder.mkdir()
    write_session(standing(arm, {LEFT: (0.3, 0.3)}), folder)
    (folder / "session.toml").write_text(f"robot = {json.dumps(str(urdf))}\n")
    opened = lock_still(open_sessions([folder], str(urdf), learning=False, accept=("insufficient_excitation",)))
    loss = LossParameters(*(np.full(LEFT, value) for value in (0.1, 8.0, 5.0, 0.0, 0.02)))
    HybridModel(*[opened.arm] * 3, loss).save(tmp_path / "model")
    model = HybridModel.load(tmp_path / "model")
    assert open_sessions([folder], model, learning=False, accept=("insufficient_excitation",)).motions
