"""ROS 2 bags: every storage, order of joints and spread over messages gives the same run."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from ident.errors import RecordingError
from ident.recordings.load import load_session
from ident.recordings.recording import Recording
from tests.ident.foreign import RECEIPT_NS, TYPES, write_bag
from tests.ident.foreign import stamped as header

JointState, Text = TYPES.types["sensor_msgs/msg/JointState"], TYPES.types["std_msgs/msg/String"]


def joint_state(run: Recording, row: int, joints: Iterable[str], stamped: bool = True, effort: bool = True) -> object:
    """One row of a run as a message that names some joints, in the given order."""
    columns = [run.joints.index(joint) for joint in joints]
    values = (run.position, run.velocity, run.effort)
    position, velocity, torque = (np.ascontiguousarray(v[row, columns]) for v in values if v is not None)
    return JointState(
        header=header(run.time[row] if stamped else 0.0),
        name=[run.joints[column] for column in columns],
        position=position,
        velocity=velocity,
        effort=torque if effort else np.empty(0),
    )


def rows_of(run: Recording, **options: bool) -> list[tuple[int, object]]:
    return [(round(run.time[k] * 1e9), joint_state(run, k, run.joints, **options)) for k in range(len(run))]


@pytest.mark.parametrize("storage", list(StoragePlugin))
@pytest.mark.parametrize("lone", [False, True], ids=["folder", "lone file"])
def test_a_bag_gives_back_the_run(storage: StoragePlugin, lone: bool, run: Recording, tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", rows_of(run), storage)
    if lone:
        (data,) = (file for file in path.iterdir() if file.suffix in (".db3", ".mcap"))
        path = data.rename(tmp_path / data.name)
    read = load_session(path).runs[0]
    assert read.issues == ()
    np.testing.assert_allclose(read.time, run.time, atol=1e-9)
    for channel, values in run.channels().items():
        np.testing.assert_array_equal(getattr(read, channel), values)


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
def test_a_log_of_the_mcap_library_gives_back_the_run(compression: str, run: Recording, tmp_path: Path) -> None:
    """Chunks as others write them, each compressed; messages by their definition in the file."""
    mcap, mcap_ros2 = pytest.importorskip("mcap.writer"), pytest.importorskip("mcap_ros2.writer")
    kind = "sensor_msgs/msg/JointState"
    with (tmp_path / "run.mcap").open("wb") as stream:
        writer = mcap_ros2.Writer(stream, compression=getattr(mcap.CompressionType, compression), chunk_size=4096)
        schema = writer.register_msgdef(kind, TYPES.generate_msgdef(kind, ros_version=2)[0])
        for k, time in enumerate(run.time):
            seconds, nanoseconds = divmod(round(time * 1e9), 10**9)
            message = {
                "header": {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": ""},
                "name": list(run.joints),
                "position": run.position[k].tolist(),
                "velocity": [] if run.velocity is None else run.velocity[k].tolist(),
                "effort": run.effort[k].tolist(),
            }
            writer.write_message("/joint_states", schema, message, RECEIPT_NS + k, RECEIPT_NS + k, k)
        writer.finish()
    read = load_session(tmp_path / "run.mcap").runs[0]
    assert read.issues == ()
    np.testing.assert_allclose(read.time, run.time, atol=1e-9)
    np.testing.assert_array_equal(read.position, run.position)
    np.testing.assert_array_equal(read.effort, run.effort)


@pytest.mark.parametrize("spread", [False, True])
def test_joints_may_come_in_any_order(spread: bool, run: Recording, tmp_path: Path) -> None:
    """Also over several messages of one stamp."""
    names = [("a", "b") if spread else ("ab",) if k % 2 else ("ba",) for k in range(len(run))]
    messages = [(2 * k + i, joint_state(run, k, one)) for k, own in enumerate(names) for i, one in enumerate(own)]
    read = load_session(write_bag(tmp_path / "bag", messages)).runs[0].select(("a", "b"))
    assert read.issues == ()
    np.testing.assert_array_equal(read.position, run.position)
    np.testing.assert_array_equal(read.effort, run.effort)


def test_a_slower_publisher_is_interpolated_and_told(run: Recording, tmp_path: Path) -> None:
    """Every second message of one joint is missing: linear interpolation of a sine is off by (ω dt)²/8 at most."""
    messages = [(k, joint_state(run, k, j)) for k in range(len(run) - 1) for j in "ab" if j == "a" or k % 2 == 0]
    read = load_session(write_bag(tmp_path / "bag", messages)).runs[0]
    assert [issue.severity for issue in read.issues] == ["note"]
    assert np.abs(read.position - run.at(slice(0, len(read))).position).max() < 0.02**2 / 8 * 1.01


def test_joints_without_torque_are_left_out_and_told(run: Recording, tmp_path: Path) -> None:
    """Fingers: position only, in messages of their own."""
    messages = [
        (2 * k + i, joint_state(run, k, joint, effort=joint == "a"))
        for k in range(len(run))
        for i, joint in enumerate("ab")
    ]
    read = load_session(write_bag(tmp_path / "bag", messages)).runs[0]
    assert read.joints == ("a",)
    assert read.issues[0].joints == ("b",)


def test_what_is_no_joint_state_is_refused(run: Recording, tmp_path: Path) -> None:
    """The message names the topics that are there, the right one first."""
    bag = write_bag(tmp_path / "other", rows_of(run), topic="/arm/joint_states")
    with pytest.raises(RecordingError, match=r"no topic /joint_states; .*: /arm/joint_states"):
        load_session(bag)
    assert len(load_session(bag, topic="/arm/joint_states").runs[0]) == len(run)
    text = write_bag(tmp_path / "text", [(0, Text(data="x"))], kind="std_msgs/msg/String")
    with pytest.raises(RecordingError, match=r"holds std_msgs/msg/String.*that are there: /joint_states"):
        load_session(text)
    with pytest.raises(RecordingError, match="no message on /joint_states"):
        load_session(write_bag(tmp_path / "none", []))
    with pytest.raises(RecordingError, match="no effort"):
        load_session(write_bag(tmp_path / "silent", rows_of(run, effort=False)))


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_a_broken_bag_is_refused(storage: StoragePlugin, run: Recording, tmp_path: Path) -> None:
    """Empty, of another kind, or cut short."""
    folder = write_bag(tmp_path / "bag", rows_of(run), storage)
    (data,) = (file for file in folder.iterdir() if file.suffix in (".db3", ".mcap"))
    cut = data.read_bytes()[: data.stat().st_size // 3]
    for content in (b"", b"SQLite format 3\x00 no such thing", b"\x89MCAP0\r\n no such thing", cut):
        data.write_bytes(content)
        for path in (folder, data) if content == cut else (data,):
            with pytest.raises(RecordingError, match="bag") as caught:
                load_session(path)
            assert "not a whole ROS 2 bag" in str(caught.value) or not content


@pytest.mark.real
@pytest.mark.parametrize("stem", ["panda/unisa_fer/panda_exciting_trajectory", "ur10_cb/ur10_exciting_trajectory"])
def test_a_real_bag_equals_the_table_made_from_it(stem: str, real_data: Path, tmp_path: Path) -> None:
    """To the nine digits that the table was written with."""
    bag = load_session(real_data / f"{stem}.db3").runs[0]
    names = {"q": "position", "dq": "velocity", "effort": "effort"}
    columns = [f'{short}_{joint} = "{joint}/{name}"' for short, name in names.items() for joint in bag.joints]
    settings = tmp_path / "session.toml"
    settings.write_text("\n".join(["[columns]", 't = "time"', *columns]))
    table = load_session(real_data / f"{stem}.csv", session_file=settings).runs[0]
    assert bag.joints == table.joints
    np.testing.assert_allclose(bag.time, table.time, atol=1e-7)
    for channel, values in table.channels().items():
        np.testing.assert_allclose(getattr(bag, channel), values, rtol=1e-8, atol=1e-8)
