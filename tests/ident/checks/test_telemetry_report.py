"""The report: what a command prints, refuses and writes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from faults import spoil_column

from ident.checks import inspect, inspect_sessions
from ident.errors import InputError, RecordingError
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.recordings.save import write_recording, write_session
from ident.robot.arm import ArmModel


def test_the_report_is_json_with_the_worst_first(clean: Session, arm: ArmModel) -> None:
    session = spoil_column(clean, "effort", 0, np.negative)
    session = spoil_column(session, "position", 3, lambda q: np.where(np.arange(len(q)) == 444, q + 5.0, q))
    data = json.loads(json.dumps(inspect(session, arm).to_dict()))
    assert [issue["severity"] for issue in data["telemetry"]] == ["fatal", "note"]
    assert set(data["telemetry"][0]) == {"issue", "joints", "severity", "evidence", "remedy"}
    assert (data["fit"], data["runs"], data["joints"]) == (False, 5, list(arm.joint_names))


def test_bad_cells_are_refused_by_name_and_mended_on_request(clean: Session, arm: ArmModel, tmp_path: Path) -> None:
    """One line names file, line and column; the mended copy is the session without that row, and is accepted."""
    write_session(clean, tmp_path / "session")
    path = tmp_path / "session/run0.parquet"
    write_recording(clean.runs[0], path.with_suffix(".csv"))
    path.unlink()
    lines = path.with_suffix(".csv").read_text().splitlines()
    cells = lines[100].split(",")
    lines[100] = ",".join([cells[0], "O.5", *cells[2:]])
    path.with_suffix(".csv").write_text("\n".join(lines))
    report = inspect(load_session(tmp_path / "session"), arm)
    with pytest.raises(InputError, match=r"run0.csv, line 101, column joint_1/position: 'O.5'") as caught:
        report.require_fit()
    assert "\n" not in str(caught.value)
    assert "--mend" in caught.value.remedy
    report.mend(tmp_path / "mended")
    again = inspect(load_session(tmp_path / "mended"), arm)
    assert again.issues == ()
    assert again.session.samples == clean.samples - 1


def test_a_robot_with_more_joints_gets_them_locked(clean: Session, arm: ArmModel) -> None:
    report = inspect(clean.replace(runs=[run.select(arm.joint_names[:5]) for run in clean.runs]), arm)
    assert report.arm is not None
    assert report.arm.joint_names == arm.joint_names[:5]
    assert [issue.issue for issue in report.issues] == ["joints_locked"]


def test_sessions_together_need_the_same_joints(clean: Session, arm: ArmModel) -> None:
    fewer = clean.replace(runs=[run.select(arm.joint_names[:5]) for run in clean.runs])
    with pytest.raises(RecordingError, match="other joints"):
        inspect_sessions([clean, fewer], arm)


def test_another_robots_joints_are_refused(clean: Session) -> None:
    with pytest.raises(RecordingError, match="none of the robot's"):
        inspect(clean, ArmModel.load("ur10"))
