"""Which files make a session and whose joints they hold; what is written in binary tables is read back."""

import warnings
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ident.errors import RecordingError
from ident.recordings.joint_names import map_by_ending, match_joints
from ident.recordings.load import load_recording, load_session
from ident.recordings.recording import Payload, Recording, Session
from ident.recordings.save import write_recording, write_session


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
    assert load_session(tmp_path / "run.csv").payload.mass_kg == 1.0
    (tmp_path / "run.toml").write_text("[payload]\nmass_kg = 2\n")
    assert load_session(tmp_path / "run.csv").payload.mass_kg == 2.0  # type: ignore[union-attr]
    assert load_session(tmp_path / "run.csv", session_file=given).robot == "panda"
    assert load_session(tmp_path / "run.csv", session_file=given).payload is None


@pytest.mark.parametrize("name", ["../arm.urdf", "../arm.urdf:joint_6", "../arm.xacro", "../arm.xml:left_3"])
def test_a_robots_file_is_named_from_the_settings_folder_on(
    name: str, run: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: wherever a command is started, and whichever of the robot's arms is meant behind the path."""
    folder = tmp_path / "session"
    folder.mkdir()
    write_recording(run, folder / "run.csv")
    path, _, tip = name.partition(":")
    (folder / path).write_text("<robot/>")
    (folder / "session.toml").write_text(f'robot = "{name}"\n')
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    whole, _, end = str(load_session(folder).robot).partition(":")
    assert Path(whole).resolve() == tmp_path / Path(path).name
    assert end == tip


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


@pytest.mark.parametrize(("recorded", "robot", "expected"), MATCHES.values(), ids=MATCHES)
def test_joints_come_in_the_robots_order(
    recorded: tuple[str, ...], robot: tuple[str, ...], expected: dict[str, tuple[str, ...]]
) -> None:
    """What is renamed, left out or missing is reported."""
    session, issues = match_joints(session_with(*recorded), robot)
    assert session.joints == tuple(name for name in robot if name not in expected.get("joints_locked", ()))
    place = [recorded.index(name if name in recorded else name.replace("panda", "fer")) for name in session.joints]
    np.testing.assert_array_equal(session.runs[0].position[0], place)
    assert {issue.issue: set(issue.joints) for issue in issues} == {name: set(one) for name, one in expected.items()}


def test_a_mapping_covers_the_whole_robot_or_is_none() -> None:
    assert map_by_ending(("j1", "j2"), ("arm_1", "arm_2")) == {"j1": "arm_1", "j2": "arm_2"}
    assert map_by_ending(("j1", "j2"), ("arm_1", "arm_2", "arm_3")) == {}
    assert map_by_ending(("left_j1", "right_j1"), ("j1",)) == {}, "two recorded joints fit: neither is taken"
    with pytest.raises(RecordingError, match=r'"elbow/position" = "panda_joint1/position"'):
        match_joints(session_with("elbow", "wrist"), PANDA)


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_what_is_written_is_read_back_bit_for_bit(suffix: str, run: Recording, tmp_path: Path) -> None:
    write_recording(run, tmp_path / f"run{suffix}")
    read = load_recording(tmp_path / f"run{suffix}")
    np.testing.assert_array_equal(read.time, run.time)
    assert read.channels().keys() == run.channels().keys()
    for channel, values in run.channels().items():
        np.testing.assert_array_equal(getattr(read, channel), values)


def test_a_session_survives_a_round_trip(run: Recording, tmp_path: Path) -> None:
    """Runs, payload, robot and the rest of session.toml; a gain that is in the effort is not applied again."""
    later = run.replace(name="run2", time=run.time + 10.0, current=run.effort / 7.0)
    session = Session(
        "s",
        (run, later),
        payload=Payload(1.5, (0.0, 0.1, 0.2)),
        robot="panda",
        metadata={"origin": "made up", "operator": "MK"},
    )
    write_session(session, tmp_path / "out")
    read = load_session(tmp_path / "out")
    assert [r.name for r in read.runs] == ["run", "run2"]
    expected = (read.payload, read.robot, read.metadata, read.common_clock)
    assert expected == (session.payload, "panda", {"origin": "made up", "operator": "MK"}, True)
    np.testing.assert_array_equal(read.runs[1].effort, run.effort)


def test_single_precision_and_timestamps_become_seconds(run: Recording, tmp_path: Path) -> None:
    table = pa.table(
        {
            "time": pa.array((run.time * 1e9).astype("int64"), pa.timestamp("ns")),
            "a/position": pa.array(run.position[:, 0], pa.float32()),
            "a/effort": pa.array(np.arange(400)),
        }
    )
    pq.write_table(table, tmp_path / "run.parquet")
    read = load_recording(tmp_path / "run.parquet")
    np.testing.assert_allclose(read.time, run.time, atol=1e-9)
    np.testing.assert_allclose(read.position[:, 0], run.position[:, 0], atol=1e-6)


def test_npz_holds_native_columns_or_stacked_arrays(run: Recording, tmp_path: Path) -> None:
    np.savez(tmp_path / "stacked.npz", time=run.time, position=run.position, effort=run.effort, joints=["a", "b"])
    columns = {f"{j}/{c}": getattr(run, c)[:, k] for k, j in enumerate("ab") for c in ("position", "effort")}
    np.savez(tmp_path / "columns.npz", time=run.time, **columns)
    for name in ("stacked", "columns"):
        read = load_recording(tmp_path / f"{name}.npz")
        np.testing.assert_array_equal(read.position, run.position)
        np.testing.assert_array_equal(read.effort, run.effort)


@pytest.mark.parametrize("suffix", [".parquet", ".csv", ".npz"])
def test_an_interface_that_the_arm_lacks_is_left_out_with_a_note(suffix: str, run: Recording, tmp_path: Path) -> None:
    """Law: a velocity channel without any number, as ros2_control logs it, is no fault of the rest."""
    lacking, path = run.replace(velocity=np.full(run.position.shape, np.nan)), tmp_path / f"run{suffix}"
    if suffix == ".npz":
        channels = {**lacking.channels(), "time": run.time, "joints": np.array(run.joints)}
        np.savez(path, **channels)
    else:
        write_recording(lacking, path)
    read = load_recording(path)
    assert read.velocity is None
    assert [(issue.issue, issue.severity) for issue in read.issues] == [("missing_channel", "note")]
    np.testing.assert_array_equal(read.effort, run.effort)


def test_an_archive_with_an_array_twice_is_refused(run: Recording, tmp_path: Path) -> None:
    """Law: of two arrays of one name, which a zip may hold, none is the right one."""
    path = tmp_path / "run.npz"
    np.savez(path, time=run.time, position=run.position, effort=run.effort, joints=["a", "b"])
    with warnings.catch_warnings(), zipfile.ZipFile(path, "a") as archive:
        warnings.simplefilter("ignore")
        archive.writestr("effort.npy", archive.read("effort.npy"))
    with pytest.raises(RecordingError, match=r"holds 'effort.npy' twice"):
        load_recording(path)


@pytest.mark.parametrize("name", ["run.parquet", "run.npz"])
@pytest.mark.parametrize("content", [b"", b"PAR1 no such thing", b"PK\x03\x04 no such thing"])
def test_a_broken_file_is_refused(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=name):
        load_session(tmp_path)


def test_tables_that_make_no_recording_are_refused(run: Recording, tmp_path: Path) -> None:
    for samples, expected in ((1, "column a/position: holds no numbers"), (0, "has no samples")):
        texts = pa.array(["x"] * samples, pa.string())
        table = {"time": np.zeros(samples), "a/position": texts, "a/effort": np.zeros(samples)}
        pq.write_table(pa.table(table), tmp_path / "text.parquet")
        with pytest.raises(RecordingError, match=expected):
            load_recording(tmp_path / "text.parquet")
    whole = {"time": run.time, "position": run.position, "effort": run.effort, "joints": np.array(["a", "b"])}
    for change, expected in (
        ({"joints": None}, "no array joints"),
        ({"joints": np.array(["a", "a"])}, "names 'a' twice"),
        ({"time": run.time[:3]}, "equally long"),
        ({"effort": run.effort[:, :1]}, "has shape"),
        ({"joints": np.array(["a", "b"], dtype=object)}, "plain arrays"),
        ({"effort": None}, "missing column a/effort"),
    ):
        arrays = {key: value for key, value in {**whole, **change}.items() if value is not None}
        np.savez(tmp_path / "run.npz", **arrays)
        with pytest.raises(RecordingError, match=expected):
            load_recording(tmp_path / "run.npz")
