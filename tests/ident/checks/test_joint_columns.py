"""Laws of columns under other joints' names, and of joints that were not recorded."""

from pathlib import Path

import numpy as np
import pytest

from ident.checks.inspection import inspect_alone as found
from ident.checks.report import TelemetryReport
from ident.errors import RecordingError
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from tests.ident.checks.faults import changed


@pytest.mark.parametrize("channels", [("effort",), ("position", "velocity")])
@pytest.mark.parametrize("pair", [(1, 2), (4, 5), (0, 3)])
def test_columns_under_another_joints_name_are_found(
    pair: tuple[int, int], channels: tuple[str, ...], session: Session, arm: ArmModel
) -> None:
    order, swapped = np.arange(6), session
    order[list(pair)] = pair[::-1]
    for channel in channels:
        swapped = changed(swapped, channel, lambda values: values[:, order])
    (issue,) = found(swapped, arm).find("columns_swapped")
    assert issue.severity == "fatal"
    assert set(issue.joints) == {session.joints[j] for j in pair}


def test_one_joints_columns_alone_while_others_moved_are_refused(session: Session, arm: ArmModel) -> None:
    seen, *_ = found(session.replace(runs=[run.select(["joint_3"]) for run in session.runs]), arm).find("joints_locked")
    assert seen.severity == "fatal"
    assert "may have moved" in seen.evidence


def test_a_joint_that_is_not_recorded_and_stood_still_is_not_suspected(session: Session, arm: ArmModel) -> None:
    """Law: gravity and inertia of joints that move together are the model's, no sum of single angles' waves."""
    still, rng = arm.locked(["joint_6"]), np.random.default_rng(3)

    def bent(run: Recording) -> Recording:
        """The run's path with elbow and wrist bending wide, under the model's torque with the last joint still."""
        waves = np.sin(run.time[:, None] * rng.uniform(0.7, 2.3, 5) + rng.uniform(0.0, 6.0, 5))
        q = np.array([1.5, 1.2, 1.5, 1.4, 1.2]) * waves
        dq = np.gradient(q, run.time, axis=0)
        effort = still.inverse_dynamics(q, dq, np.gradient(dq, run.time, axis=0))
        return run.select(arm.joint_names[:5]).replace(position=q, velocity=dq, effort=effort)

    seen = found(session.replace(runs=[bent(run) for run in session.runs]), arm).find("joints_locked")
    assert [one.severity for one in seen] == ["note"]


def test_nothing_is_written_where_nothing_is_left(session: Session, arm: ArmModel, tmp_path: Path) -> None:
    run: Recording = session.runs[0]
    empty = run.at(slice(0, 0))
    with pytest.raises(RecordingError, match="nothing that can be used is left"):
        TelemetryReport(session.replace(runs=[run, empty]), (), arm).mend(tmp_path / "mended")
    assert not (tmp_path / "mended").exists()
