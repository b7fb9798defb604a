"""Folders and files as sessions: order, settings, clocks, and what can't be one session."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ident.errors import RecordingError
from ident.recordings.load import load_session
from ident.recordings.recording import Recording
from ident.recordings.save import write_recording


def test_runs_come_in_file_name_order_on_one_clock(run: Recording, tmp_path: Path) -> None:
    for name, start in (("b", 10.0), ("a", 0.0), ("c", 20.0)):
        write_recording(run.replace(time=run.time + start), tmp_path / f"{name}.parquet")
    (tmp_path / "README.txt").write_text("not a recording")
    session = load_session(tmp_path)
    assert [each.name for each in session.runs] == ["a", "b", "c"]
    assert session.common_clock
    assert session.issues() == ()
    assert session.samples == 1200
    assert session.duration == pytest.approx(3 * 3.99)


def test_clocks_that_restart_are_told(run: Recording, tmp_path: Path) -> None:
    for name in "ab":
        write_recording(run, tmp_path / f"{name}.parquet")
    session = load_session(tmp_path)
    assert not session.common_clock
    assert [(issue.issue, issue.severity) for issue in session.issues()] == [("clock_restarts", "note")]


def test_of_one_run_in_two_formats_one_is_read(run: Recording, tmp_path: Path) -> None:
    """Else a held-out run would be a copy of a fitted one."""
    for suffix in (".csv", ".parquet"):
        write_recording(run, tmp_path / f"run{suffix}")
    session = load_session(tmp_path)
    assert [each.source.suffix for each in session.runs if each.source] == [".parquet"]
    assert session.issues()[0].issue == "duplicate_run"


def test_settings_stand_beside_a_single_file_or_are_given(run: Recording, tmp_path: Path) -> None:
    write_recording(run, tmp_path / "run.csv")
    (tmp_path / "session.toml").write_text("[payload]\nmass_kg = 1\n")
    given = tmp_path / "other"
    given.write_text('robot = "panda"\n')
    session = load_session(tmp_path / "run.csv")
    assert session.payload is not None
    assert session.payload.mass_kg == 1.0
    (tmp_path / "run.toml").write_text("[payload]\nmass_kg = 2\n")
    assert load_session(tmp_path / "run.csv").payload.mass_kg == 2.0  # type: ignore[union-attr]
    assert load_session(tmp_path / "run.csv", session_file=given).robot == "panda"
    assert load_session(tmp_path / "run.csv", session_file=given).payload is None


def test_runs_have_the_same_joints_in_the_first_ones_order(run: Recording, tmp_path: Path) -> None:
    write_recording(run, tmp_path / "a.parquet")
    write_recording(run.select(("b", "a")), tmp_path / "b.parquet")
    session = load_session(tmp_path)
    np.testing.assert_array_equal(session.runs[1].position, run.position)
    write_recording(run.select(("b",)), tmp_path / "c.parquet")
    with pytest.raises(RecordingError, match=r"c.parquet: has other joints than a: a"):
        load_session(tmp_path)


def test_what_is_no_session_is_refused(tmp_path: Path) -> None:
    (tmp_path / "table.xls").write_bytes(b"")
    for path, expected in (
        (tmp_path / "nowhere", "no such file"),
        (tmp_path, "holds no runs"),
        (tmp_path / "table.xls", "unknown kind of file '.xls'"),
    ):
        with pytest.raises(RecordingError, match=expected):
            load_session(path)
    with pytest.raises(RecordingError, match="can't be read"):
        load_session(tmp_path, session_file=tmp_path / "no.toml")


@pytest.mark.real
def test_all_ur10e_logs_are_read(real_data: Path, ur10e_toml: Path) -> None:
    """17 runs without a header; those of a folder come from several days."""
    folders = [real_data / "ur10e" / name for name in ("identification", "jointwise", "validation")]
    sessions = [load_session(folder, session_file=ur10e_toml) for folder in folders]
    assert [len(session.runs) for session in sessions] == [10, 6, 1]
    assert [session.common_clock for session in sessions] == [False, False, True]
    table = np.loadtxt(folders[2] / "ur-20_01_17-ptp_10_points.csv", delimiter=",")
    run = sessions[2].runs[0]
    np.testing.assert_array_equal(run.time, table[:, 0])
    np.testing.assert_array_equal(run.position, table[:, 1:7])
    np.testing.assert_allclose(run.effort[:, 0], 14.87 * table[:, 13], rtol=1e-15)
