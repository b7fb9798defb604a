"""Files as other tools write them: their own columns reach a recording through [columns], or by their own names."""

import json
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rosbags.rosbag1 import Writer as OldWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

from ident.api.daily import new
from ident.errors import RecordingError
from ident.recordings.load import load_session
from ident.recordings.parquet import count_values, read_footer
from ident.recordings.recording import Recording
from tests.ident.foreign import RECEIPT_NS, TYPES, lerobot, mapped, places, stamped, write_states, write_topics


@pytest.mark.parametrize(
    "names", [["a.pos", "main_b.pos"], [["a", "b"]], {"motors": ["a", "b"]}], ids=["list", "nested", "axes"]
)
def test_a_lerobot_data_set_is_a_session_of_episodes(names: Any, run: Recording, tmp_path: Path) -> None:
    """Lists become joints by the features' names; the features' meanings are the channels."""
    columns = {"observation.state": run.position, "observation.effort": run.effort, "action": run.position + 0.1}
    session = load_session(lerobot(tmp_path / "set", names, *[columns | {"timestamp": run.time}] * 2))
    assert [one.name for one in session.runs] == ["episode_000000", "episode_000001"]
    assert session.joints == ("a", "b")
    for one in session.runs:
        np.testing.assert_allclose(one.time, run.time, atol=1e-6)
        np.testing.assert_allclose(one.effort, run.effort, atol=1e-6)
        np.testing.assert_allclose(one.position_command - one.position, 0.1, atol=1e-6)


def test_a_stated_unit_is_believed_of_a_lerobot_data_set(run: Recording, tmp_path: Path) -> None:
    """Law: large angles are taken as degrees only where session.toml says nothing; what a note advises works."""
    columns = {"observation.state": 50.0 * run.position, "observation.effort": run.effort, "timestamp": run.time}
    folder = lerobot(tmp_path / "set", ["a.pos", "b.pos"], columns)
    guessed = load_session(folder).runs[0]
    (folder / "session.toml").write_text('angle_unit = "rad"\n')
    stated = load_session(folder).runs[0]
    assert [issue.issue for issue in guessed.issues] == ["units_degrees"]
    assert not stated.issues
    np.testing.assert_allclose(guessed.position, np.radians(stated.position), rtol=1e-6)


@pytest.mark.parametrize(("kind", "names"), [("so101_follower", ["a.pos", "b.pos"]), ("so100", ["main_a", "main_b"])])
def test_shares_of_a_range_are_not_read_as_degrees(kind: str, names: list[str], run: Recording, tmp_path: Path) -> None:
    """Law: of a robot whose log is normalised they are refused, by `ident new` too; stated degrees are believed."""
    shares = 90.0 * run.position / np.abs(run.position).max()
    columns = {"observation.state": shares, "observation.effort": run.effort, "timestamp": run.time}
    folder = lerobot(tmp_path / "set", names, columns)
    info = json.loads((folder / "meta/info.json").read_text())
    (folder / "meta/info.json").write_text(json.dumps(info | {"robot_type": kind}))
    if names[0].endswith(".pos"):
        for read in (load_session, new):
            with pytest.raises(RecordingError, match="shares of each joint's range"):
                read(folder)
    (folder / "session.toml").write_text('angle_unit = "deg"\n')
    np.testing.assert_allclose(load_session(folder).runs[0].position, np.radians(shares), rtol=1e-5)


CALIBRATION = {
    "shoulder_pan": {"id": 1, "drive_mode": 0, "homing_offset": -41, "range_min": 745, "range_max": 3345},
    "gripper": {"id": 6, "drive_mode": 0, "homing_offset": 12, "range_min": 2040, "range_max": 3500},
}


def shares_of(run: Recording, folder: Path, share: float = 90.0) -> tuple[Path, np.ndarray]:
    """A data set of an SO-101 that logs shares of its range, and these."""
    shares = share * run.position / np.abs(run.position).max()
    columns = {"observation.state": shares, "observation.effort": run.effort, "timestamp": run.time}
    lerobot(folder, ["shoulder_pan.pos", "gripper.pos"], columns)
    info = json.loads((folder / "meta/info.json").read_text())
    (folder / "meta/info.json").write_text(json.dumps(info | {"robot_type": "so101_follower"}))
    (folder / "so101.json").write_text(json.dumps(CALIBRATION))
    (folder / "session.toml").write_text('lerobot_calibration = "so101.json"\n')
    return folder, shares


def test_shares_become_angles_by_the_calibration(run: Recording, tmp_path: Path) -> None:
    """Law: 100 is half of a joint's range of counts, a gripper's 100 all of it; 4096 counts are a turn."""
    folder, shares = shares_of(run, tmp_path / "set")
    read = load_session(folder).runs[0]
    turns = shares * np.array([2600.0 / 200.0, 1460.0 / 100.0]) / 4096.0
    np.testing.assert_allclose(read.position, 2.0 * np.pi * turns, rtol=1e-5)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (json.dumps({"elbow_flex": CALIBRATION["gripper"]}), "has no motor 'shoulder_pan'"),
        (json.dumps({**CALIBRATION, "gripper": {"range_min": 5}}), "gripper has no range"),
        (json.dumps({"shoulder_pan": 3}), "shoulder_pan has no range"),
        ("[]", "no JSON object"),
    ],
)
def test_a_file_that_is_no_calibration_is_refused(run: Recording, tmp_path: Path, text: str, what: str) -> None:
    folder, _ = shares_of(run, tmp_path / "set")
    (folder / "so101.json").write_text(text)
    with pytest.raises(RecordingError, match=what):
        load_session(folder)


def test_more_than_the_whole_range_is_no_share(run: Recording, tmp_path: Path) -> None:
    """Degrees, for which somebody gives a calibration, are not scaled in silence."""
    folder, _ = shares_of(run, tmp_path / "set", 150.0)
    with pytest.raises(RecordingError, match="no shares of a range"):
        load_session(folder)


def test_a_lerobot_data_set_of_version_2_has_a_file_for_each_episode(run: Recording, tmp_path: Path) -> None:
    """Version 2.1: lists of any length, `episode_000001.parquet`; a column that stands twice is refused."""
    folder = lerobot(tmp_path / "set", ["a.pos", "b.pos"], {"observation.state": run.position, "timestamp": run.time})
    info = json.loads((folder / "meta/info.json").read_text())
    info["features"]["observation.effort"] = {"dtype": "float32", "shape": [2], "names": ["a.effort", "b.effort"]}
    (folder / "meta/info.json").write_text(json.dumps(info | {"codebase_version": "v2.1", "total_episodes": 2}))
    (folder / "data/chunk-000/file-000.parquet").unlink()
    for episode in (0, 1):
        columns = {"observation.state": run.position + episode, "observation.effort": run.effort}
        table = {name: pa.array([row.astype("f4") for row in rows]) for name, rows in columns.items()}
        table |= {"timestamp": pa.array(run.time.astype("f4")), "episode_index": pa.array(np.full(len(run), episode))}
        pq.write_table(pa.table(table), folder / f"data/chunk-000/episode_{episode:06}.parquet")
    session = load_session(folder)
    assert [one.name for one in session.runs] == ["episode_000000", "episode_000001"]
    for episode, one in enumerate(session.runs):
        np.testing.assert_allclose(one.position, run.position + episode, atol=1e-6)
        np.testing.assert_allclose(one.effort, run.effort, rtol=1e-6)
    table = pq.read_table(file := next(folder.rglob("*.parquet")))
    pq.write_table(table.append_column("timestamp", table.column("timestamp")), file)
    with pytest.raises(RecordingError, match="'timestamp' stands twice"):
        load_session(folder)


def test_values_are_counted_as_arrow_counts_them(tmp_path: Path) -> None:
    """Law: over row groups, texts, lists and empty columns; a damaged footer raises ValueError and ends no process."""
    lists = pa.array([[1.0, 2.0], [], [3.0], None, [4.0, 5.0, 6.0]] * 100)
    names = pa.array(["a", "b", None, "d", "e"] * 100)
    table = pa.table({"x": np.arange(500.0), "list": lists, "name": names, "yes": [True] * 500})
    path = tmp_path / "table.parquet"
    pq.write_table(table, path, row_group_size=7)
    groups = [pq.ParquetFile(path).metadata.row_group(i) for i in range(72)]
    with path.open("rb") as stream:
        assert count_values(read_footer(stream)) == sum(one.column(j).num_values for one in groups for j in range(4))
    good, rng = path.read_bytes(), np.random.default_rng(0)
    length = int.from_bytes(good[-8:-4], "little")
    for _ in range(100):
        damaged = bytearray(good)
        damaged[-8 - int(rng.integers(1, length))] = int(rng.integers(256))
        with suppress(ValueError):
            assert isinstance(count_values(read_footer(BytesIO(damaged))), int)


def test_lerobot_features_without_names_are_mapped_by_place(run: Recording, tmp_path: Path) -> None:
    """`observation.state.0` is the first number; without a mapping nobody knows which joint that is."""
    columns = {"observation.state": run.position, "observation.effort": run.effort, "timestamp": run.time}
    folder = lerobot(tmp_path / "set", None, columns, columns)
    with pytest.raises(RecordingError, match=r"observation\.state\.0"):
        load_session(folder)
    mapped(folder, places(("observation.state", "position"), ("observation.effort", "effort")))
    np.testing.assert_allclose(load_session(folder).runs[1].position, run.position, atol=1e-6)


@pytest.mark.parametrize("kind", ["npz", "npz of rows", "parquet"])
def test_arrays_of_two_dimensions_are_columns(kind: str, run: Recording, tmp_path: Path) -> None:
    """Samples may stand in rows or in columns; Parquet holds lists."""
    turned = run.position.T if kind == "npz of rows" else run.position
    arrays = {"t": run.time, "q": turned, "tau": run.effort, "model": np.arange(3)}
    if kind == "parquet":  # only the lists that are named are read
        table = {"t": run.time, "q": list(run.position), "tau": list(run.effort), "note": ["x"] * len(run)}
        pq.write_table(pa.table(table), tmp_path / "run.parquet")
    else:
        np.savez(tmp_path / "run.npz", **arrays)  # type: ignore[arg-type]
    mapped(tmp_path, {"t": "time", **places(("q", "position"), ("tau", "effort"))})
    read = load_session(tmp_path).runs[0]
    np.testing.assert_array_equal(read.time, run.time)
    np.testing.assert_array_equal(read.position, run.position)


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_fields_of_other_messages_are_columns(storage: StoragePlugin, run: Recording, tmp_path: Path) -> None:
    """A type that ROS does not ship, its definition in the bag: `/franka_states:q.0`."""
    channels = (("q", "position"), ("dq", "velocity"), ("tau_J", "effort"))
    write_states(tmp_path / "bag", "/franka_states", run.replace(time=run.time + 5.0), channels, storage)
    mapped(tmp_path, places(*((f"/franka_states:{name}", channel) for name, channel in channels)))
    read = load_session(tmp_path).runs[0]
    np.testing.assert_allclose(read.time - 5.0, run.time, atol=1e-6)
    np.testing.assert_array_equal(read.position, run.position)
    np.testing.assert_array_equal(read.effort, run.effort)


def test_effort_may_come_in_another_topic(run: Recording, tmp_path: Path) -> None:
    """Positions by JointState at half the rate, effort as a bare array: on the clock of the effort."""
    state, array, layout = (
        TYPES.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Float64MultiArray", "std_msgs/msg/MultiArrayLayout")
    )
    received, empty = [round(time * 1e9) for time in run.time], np.empty(0)
    states = [
        (received[k], state(stamped(0.0), ["b", "a"], run.position[k, ::-1].copy(), empty, empty))
        for k in range(0, len(run), 2)
    ]
    torques = [(received[k], array(layout(dim=[], data_offset=0), run.effort[k])) for k in range(len(run))]
    topics = {
        "/joint_states": ("sensor_msgs/msg/JointState", states),
        "/torques": ("std_msgs/msg/Float64MultiArray", torques),
    }
    write_topics(tmp_path / "bag", topics)
    positions = {f"/joint_states:position.{j}": f"{j}/position" for j in "ab"}
    mapped(tmp_path, {**positions, **places(("/torques:data", "effort"))})
    read = load_session(tmp_path).runs[0].select(("a", "b"))
    assert len(read) == len(run) - 1  # the last torque comes after the last position
    np.testing.assert_array_equal(read.effort, run.effort[:-1])
    assert np.abs(read.position - run.position[:-1]).max() < 0.02**2 / 8 * 1.01


def write_old_bag(path: Path, run: Recording) -> None:
    """A run as JointState in a bag of ROS 1."""
    types = get_typestore(Stores.ROS1_NOETIC)
    known, kind = types.types, "sensor_msgs/msg/JointState"
    header, time = known["std_msgs/msg/Header"], known["builtin_interfaces/msg/Time"]
    with OldWriter(path) as writer:
        topic = writer.add_connection("/joint_states", kind, typestore=types)
        for k in range(len(run)):
            nanoseconds = round(run.time[k] * 1e9)
            message = known[kind](
                header(seq=k, stamp=time(nanoseconds // 10**9, nanoseconds % 10**9), frame_id=""),
                list(run.joints),
                run.position[k],
                np.empty(0),
                run.effort[k],
            )
            writer.write(topic, RECEIPT_NS + nanoseconds, types.serialize_ros1(message, kind))


def test_a_bag_of_ros_1_gives_back_the_run(run: Recording, tmp_path: Path) -> None:
    """The same JointState in the older bag."""
    write_old_bag(tmp_path / "run.bag", run)
    read = load_session(tmp_path / "run.bag").runs[0]
    np.testing.assert_allclose(read.time, run.time, atol=1e-9)
    np.testing.assert_array_equal(read.position, run.position)
