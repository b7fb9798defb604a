"""Folders and files as sessions: order, settings, clocks; and recorded joints against the robot's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ident.errors import RecordingError
from ident.recordings.columns import map_by_ending, match_joints
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.recordings.save import write_recording


@pytest.mark.parametrize("pause", [10.0, 0.0])
def test_runs_come_in_file_name_order(pause: float, run: Recording, tmp_path: Path) -> None:
    """On one clock; clocks that restart are reported."""
    for name, start in (("b", pause), ("a", 0.0), ("c", 2 * pause)):
        write_recording(run.replace(time=run.time + start), tmp_path / f"{name}.parquet")
    (tmp_path / "README.txt").write_text("not a recording")
    session = load_session(tmp_path)
    assert [each.name for each in session.runs] == ["a", "b", "c"]
    assert session.common_clock == bool(pause)
    assert [(issue.issue, issue.severity) for issue in session.issues()] == [("clock_restarts", "note")] * (not pause)
    assert session.samples == 1200
    assert session.duration == pytest.approx(3 * 3.99)


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


PANDA = tuple(f"panda_joint{i}" for i in range(1, 8))
FER = tuple(f"fer_joint{i}" for i in (3, 1, 2, 4, 5, 6, 7))
MATCHES = {
    "equal names in another order": (("c", "a", "b"), ("a", "b", "c"), {}),
    "other beginnings": (FER, PANDA, {"joints_renamed": PANDA}),
    "fingers": (
        (*FER, "fer_finger_joint1"),
        PANDA,
        {"joints_renamed": PANDA, "joints_left_out": ("fer_finger_joint1",)},
    ),
    "one is not recorded": (PANDA[:6], PANDA, {"joints_locked": PANDA[6:]}),
}


def session_with(*joints: str) -> Session:
    values = np.tile(np.arange(float(len(joints))), (5, 1))
    return Session("s", (Recording("r", joints, np.arange(5.0), values, values),))


@pytest.mark.parametrize(("recorded", "robot", "told"), MATCHES.values(), ids=MATCHES)
def test_joints_come_in_the_robots_order(
    recorded: tuple[str, ...], robot: tuple[str, ...], told: dict[str, tuple[str, ...]]
) -> None:
    """What is renamed, left out or missing is reported."""
    session, issues = match_joints(session_with(*recorded), robot)
    assert session.joints == tuple(name for name in robot if name not in told.get("joints_locked", ()))
    place = [recorded.index(name if name in recorded else name.replace("panda", "fer")) for name in session.joints]
    np.testing.assert_array_equal(session.runs[0].position[0], place)
    assert {issue.issue: set(issue.joints) for issue in issues} == {name: set(one) for name, one in told.items()}


def test_a_mapping_covers_the_whole_robot_or_is_none() -> None:
    assert map_by_ending(("j1", "j2"), ("arm_1", "arm_2")) == {"j1": "arm_1", "j2": "arm_2"}
    assert map_by_ending(("j1", "j2"), ("arm_1", "arm_2", "arm_3")) == {}
    assert map_by_ending(("left_j1", "right_j1"), ("j1",)) == {}, "two recorded joints fit: neither is taken"
    with pytest.raises(RecordingError, match=r'"elbow/position" = "panda_joint1/position"'):
        match_joints(session_with("elbow", "wrist"), PANDA)
