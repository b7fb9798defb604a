"""Recordings as other tools write them, shared by the tests: LeRobot's data sets, bags of ROS, mappings of columns."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ident.recordings.recording import Recording

TYPES = get_typestore(Stores.ROS2_HUMBLE)
RECEIPT_NS = 1_700_000_000_000_000_000


def mapped(folder: Path, columns: dict[str, str]) -> Path:
    """A session.toml with a mapping of columns."""
    lines = [f"{json.dumps(foreign)} = {json.dumps(native)}" for foreign, native in columns.items()]
    path = folder / "session.toml"
    path.write_text("\n".join(["[columns]", *lines]) + "\n")
    return path


def places(*arrays: tuple[str, str], mark: str = ".") -> dict[str, str]:
    """The mapping of both places of arrays (name, channel) to the joints a and b."""
    return {f"{name}{mark}{i}": f"{'ab'[i]}/{channel}" for name, channel in arrays for i in (0, 1)}


def lerobot(folder: Path, names: Any, *episodes: Mapping[str, np.ndarray]) -> Path:
    """A LeRobot data set of version 3.0: episodes one after the other in one file, columns of fixed-size lists.

    Args:
        folder: Where it is made.
        names: What its features name their numbers.
        episodes: Column -> its numbers, one row a sample, and `timestamp`.
    """
    (folder / "meta").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    table: dict[str, Any] = {
        "episode_index": np.repeat(np.arange(len(episodes)), [len(one["timestamp"]) for one in episodes])
    }
    features: dict[str, Any] = {}
    for name in episodes[0]:
        values = np.concatenate([one[name] for one in episodes])
        size = values.shape[1] if values.ndim == 2 else 1
        features[name] = {"dtype": "float32", "shape": [size], "names": names if values.ndim == 2 else None}
        flat = pa.array(values.astype("f4").ravel())
        table[name] = pa.FixedSizeListArray.from_arrays(flat, size) if values.ndim == 2 else values
    info = {"codebase_version": "v3.0", "fps": 125, "total_episodes": len(episodes), "features": features}
    (folder / "meta/info.json").write_text(json.dumps(info))
    pq.write_table(pa.table(table), folder / "data/chunk-000/file-000.parquet")
    return folder


def stamped(seconds: float) -> Any:
    """A header of a time."""
    header, time = (TYPES.types[name] for name in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    nanoseconds = round(seconds * 1e9)
    return header(stamp=time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9), frame_id="")


def write_bag(
    folder: Path,
    messages: Iterable[tuple[int, object]],
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    topic: str = "/joint_states",
    kind: str = "sensor_msgs/msg/JointState",
) -> Path:
    """A bag of ROS 2 with messages (time of receipt [ns], content) on one topic."""
    return write_topics(folder, {topic: (kind, messages)}, storage)


def write_topics(
    folder: Path,
    topics: Mapping[str, tuple[str, Iterable[tuple[int, object]]]],
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    types: Any = TYPES,
) -> Path:
    """A bag of ROS 2: topic -> kind and messages."""
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        for topic, (kind, messages) in topics.items():
            connection = writer.add_connection(topic, kind, typestore=types)
            for receipt, message in messages:
                writer.write(connection, RECEIPT_NS + receipt, types.serialize_cdr(message, kind))
    return folder


def write_states(
    folder: Path, topic: str, run: Recording, channels: Sequence[tuple[str, str]], storage: StoragePlugin
) -> Path:
    """A bag of a type that ROS does not ship, its definition in the bag: fields (name, channel of the run)."""
    kind, types = "made_up/msg/State", get_typestore(Stores.ROS2_HUMBLE)
    fields = "".join(f"float64[{len(run.joints)}] {name}\n" for name, _ in channels)
    types.register(get_types_from_msg(f"std_msgs/Header header\n{fields}", kind))
    messages = [
        (k, types.types[kind](stamped(time), *(getattr(run, channel)[k] for _, channel in channels)))
        for k, time in enumerate(run.time)
    ]
    return write_topics(folder, {topic: (kind, messages)}, storage, types)
