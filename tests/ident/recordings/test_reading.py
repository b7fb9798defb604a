"""Folders and files as sessions: order, settings, clocks, blocks; and recorded joints against the robot's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ident.errors import RecordingError
from ident.recordings.joint_names import map_by_ending, match_joints
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session, blocks, count_blocks
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


def session_of(*durations: float) -> Session:
    runs = []
    for k, duration in enumerate(durations):
        time = np.arange(0.0, duration, 0.01)
        runs.append(Recording(f"r{k}", ("a",), time, time[:, None], time[:, None]))
    return Session("s", tuple(runs))


@pytest.mark.parametrize("durations", [(20.0,), (3.0, 12.0), (5.0, 5.0, 5.0, 5.0, 5.0, 5.0), (9.0, 1.0)])
def test_blocks_are_a_partition(durations: tuple[float, ...]) -> None:
    session = session_of(*durations)
    cut = blocks(session)
    assert len(cut) >= 5
    assert sum(len(block) for block in cut) == session.samples
    joined = np.concatenate([block.position[:, 0] for block in cut])
    np.testing.assert_array_equal(joined, np.concatenate([run.position[:, 0] for run in session.runs]))


def test_enough_runs_are_left_whole() -> None:
    session = session_of(5.0, 5.0, 5.0, 5.0, 5.0)
    assert blocks(session) == session.runs


def test_no_block_is_shorter_than_the_shortest() -> None:
    assert len(blocks(session_of(6.0))) == 3
    assert count_blocks(session_of(7.0)) == 4
    assert count_blocks(session_of(7.6)) == 5
    assert count_blocks(session_of(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)) == 0


PANDA = tuple(f"panda_joint{i}" for i in range(1, 8))


def session_with(*joints: str) -> Session:
    values = np.tile(np.arange(float(len(joints))), (5, 1))
    return Session("s", (Recording("r", joints, np.arange(5.0), values, values),))


def test_equal_names_come_in_the_robots_order() -> None:
    session, issues = match_joints(session_with("c", "a", "b"), ("a", "b", "c"))
    assert session.joints == ("a", "b", "c")
    np.testing.assert_array_equal(session.runs[0].position[0], [1.0, 2.0, 0.0])
    assert issues == ()


def test_names_that_differ_in_their_beginning_match_and_that_is_told() -> None:
    session, issues = match_joints(session_with(*(f"fer_joint{i}" for i in (3, 1, 2, 4, 5, 6, 7))), PANDA)
    assert session.joints == PANDA
    assert session.runs[0].position[0, 2] == 0.0
    assert [(issue.issue, issue.severity) for issue in issues] == [("joints_renamed", "note")]


def test_fingers_are_left_out_also_where_names_are_mapped() -> None:
    recorded = (*(f"fer_joint{i}" for i in range(1, 8)), "fer_finger_joint1", "fer_finger_joint2")
    session, issues = match_joints(session_with(*recorded), PANDA)
    assert session.joints == PANDA
    assert {issue.issue for issue in issues} == {"joints_renamed", "joints_left_out"}


def test_a_joint_that_is_not_recorded_is_told() -> None:
    session, issues = match_joints(session_with(*PANDA[:6]), PANDA)
    assert session.joints == PANDA[:6]
    assert [(issue.issue, issue.joints) for issue in issues] == [("joints_locked", PANDA[6:])]


def test_a_mapping_covers_the_whole_robot_or_is_none() -> None:
    assert map_by_ending(("j1", "j2"), ("arm_1", "arm_2")) == {"j1": "arm_1", "j2": "arm_2"}
    assert map_by_ending(("j1", "j2"), ("arm_1", "arm_2", "arm_3")) == {}
    assert map_by_ending(("left_j1", "right_j1"), ("j1",)) == {}, "two recorded joints fit: neither is taken"


def test_other_joints_are_refused_with_the_line_to_write() -> None:
    with pytest.raises(RecordingError, match=r'"elbow/position" = "panda_joint1/position"'):
        match_joints(session_with("elbow", "wrist"), PANDA)
