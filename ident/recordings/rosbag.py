"""Bags of ROS 2 and ROS 1: sensor_msgs/JointState of one topic, as columns."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.recordings.bad_cells import screen_cells
from ident.recordings.columns import TIME, Table, native_names
from ident.recordings.recording import TelemetryIssue
from ident.recordings.ros_messages import Bag
from ident.recordings.session_toml import SessionFile

JOINT_STATE = "sensor_msgs/msg/JointState"
FIELDS = ("position", "velocity", "effort")


@dataclass
class Stream:
    """The messages that name the same joints: one publisher's."""

    stamps: list[int] = field(default_factory=list)
    receipts: list[int] = field(default_factory=list)
    values: dict[str, list[Float[Array, " n"]]] = field(default_factory=lambda: {name: [] for name in FIELDS})


def read_bag(path: Path, session_file: SessionFile, topic: str) -> tuple[Table, tuple[str, ...]]:
    """Reads the joint states of a bag.

    Time is the header's stamp, or the time of receipt where no message has a stamp. Joints may stand in any order
    and be spread over messages; those of slower or shifted publishers are interpolated to the fastest one's stamps.

    Args:
        path: A bag folder, or a lone .db3, .mcap or .bag file.
        session_file: Names of foreign joints.
        topic: The topic of the joint states.

    Returns:
        The table, and the columns' names before `[columns]`.

    Raises:
        RecordingError: Not a bag, a damaged one, or no joint states with torque on the topic.
    """
    streams = _read_streams(path, topic)
    tables = {joints: _to_columns(joints, stream, path) for joints, stream in streams.items()}
    columns, issues = _merge(tables, path)
    columns, dropped = _drop_torqueless(columns, path, topic)
    names = tuple(columns)
    chosen = native_names(names, session_file, path)
    screened = screen_cells({native: columns[names[index]] for index, native in chosen.items()}, path)
    return Table(screened.columns, (*issues, *dropped, *screened.issues)), names


def _read_streams(path: Path, topic: str) -> Mapping[tuple[str, ...], Stream]:
    """All messages of the topic, by the joints they name."""
    streams: dict[tuple[str, ...], Stream] = defaultdict(Stream)
    if path.is_file() and path.stat().st_size == 0:
        raise RecordingError(path, "is empty (0 bytes)", "record the bag again")
    try:
        with Bag(path) as bag:
            for _, receipt, message in bag.messages(_joint_state_connections(bag, path, topic)):
                stream, stamp = streams[tuple(message["name"])], message["header"]["stamp"]
                stream.stamps.append(int(stamp["sec"]) * 1_000_000_000 + int(stamp["nanosec"]))
                stream.receipts.append(receipt)
                for name in FIELDS:
                    stream.values[name].append(message[name])
    except RecordingError:
        raise
    except MemoryError:
        raise RecordingError(path, "a message in it claims to be larger than the memory", "record again") from None
    except Exception as error:  # sqlite, struct, zstandard, lz4, YAML and the reader each raise their own
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise RecordingError(
            path, f"not a whole ROS 2 bag ({reason})", "repair it (`ros2 bag reindex`, `mcap recover`) or record again"
        ) from None
    streams.pop((), None)
    if not streams:
        raise RecordingError(path, f"no message on {topic}", "give a bag in which the joint states were recorded")
    return streams


def _joint_state_connections(reader: Bag, path: Path, topic: str) -> list[Any]:
    found = [connection for connection in reader.connections if connection.topic == topic]
    usable = [connection for connection in found if connection.msgtype == JOINT_STATE]
    if usable:
        return usable
    what = f"topic {topic} holds {found[0].msgtype}, not {JOINT_STATE}" if found else f"no topic {topic}"
    states = sorted({c.topic for c in reader.connections if c.msgtype == JOINT_STATE})
    topics = sorted({c.topic for c in reader.connections})
    if states:
        raise RecordingError(path, what, f"choose the topic of the joint states: {', '.join(states)}")
    raise RecordingError(path, what, f"record {JOINT_STATE}; the topics that are there: {', '.join(topics) or 'none'}")


def _to_columns(joints: Sequence[str], stream: Stream, path: Path) -> dict[str, Float[Array, " T"]]:
    """One publisher's messages as columns, its time among them [s]; fields that it leaves empty are left out."""
    if len(set(joints)) < len(joints):
        twice = next(joint for joint in joints if list(joints).count(joint) > 1)
        raise RecordingError(path, f"messages name the joint {twice!r} twice", "correct the publisher")
    # All stamps zero: the publisher never set them. A single zero may be the start of a simulated clock.
    clock = stream.stamps if any(stream.stamps) else stream.receipts
    columns = {TIME: np.array(clock, dtype=np.int64) * 1e-9}
    for name in FIELDS:
        values = stream.values[name]
        if all(len(row) == 0 for row in values):
            continue
        nothing = np.full(len(joints), np.nan)
        table = np.array([row if len(row) == len(joints) else nothing for row in values])
        columns.update({f"{joint}/{name}": table[:, index] for index, joint in enumerate(joints)})
    return columns


def _merge(
    tables: Mapping[tuple[str, ...], dict[str, Float[Array, " T"]]], path: Path
) -> tuple[dict[str, Float[Array, " T"]], list[TelemetryIssue]]:
    """Brings all publishers to the time of the one with torque that speaks most often."""
    merged = _join_same_joints(tables)

    def rank(columns: Mapping[str, Float[Array, " T"]]) -> tuple[bool, int]:
        return any(name.endswith("/effort") for name in columns), len(columns[TIME])

    first, *others = sorted(merged, key=rank, reverse=True)
    issues, clock = [], first[TIME]
    for other in others:
        names = [name for name in other if name != TIME and name not in first]
        first.update({name: _interpolate(clock, other[TIME], other[name]) for name in names})
        if not np.array_equal(clock, other[TIME]):
            joints = tuple(dict.fromkeys(name.rpartition("/")[0] for name in names))
            evidence = f"{path.name}: {', '.join(joints)} come in messages of their own, interpolated"
            issues.append(TelemetryIssue("jitter", joints, "note", evidence, "none needed"))
    inside = np.ones(len(clock), dtype=bool)
    for other in others:
        inside &= (clock >= other[TIME].min()) & (clock <= other[TIME].max())
    if not inside.any():
        raise RecordingError(path, "its publishers never speak at the same time", "record all joints together")
    return {name: values[inside] for name, values in first.items()}, issues


def _join_same_joints(
    tables: Mapping[tuple[str, ...], dict[str, Float[Array, " T"]]],
) -> list[dict[str, Float[Array, " T"]]]:
    """Messages that name the same joints in another order are one stream."""
    groups: dict[frozenset[str], list[dict[str, Float[Array, " T"]]]] = defaultdict(list)
    for joints, columns in tables.items():
        groups[frozenset(joints)].append(columns)
    joined = []
    for group in groups.values():
        common = [name for name in group[0] if all(name in columns for columns in group)]
        whole = {name: np.concatenate([columns[name] for columns in group]) for name in common}
        # One publisher's order is kept as it is: time that runs backwards is for the telemetry check to find.
        order = np.argsort(whole[TIME], kind="stable") if len(group) > 1 else slice(None)
        joined.append({name: values[order] for name, values in whole.items()})
    return joined


def _interpolate(clock: Float[Array, " T"], time: Float[Array, " S"], values: Float[Array, " S"]) -> Float[Array, " T"]:
    if np.array_equal(clock, time):
        return values
    order = np.argsort(time, kind="stable")
    return np.interp(clock, time[order], values[order])


def _drop_torqueless(
    columns: dict[str, Float[Array, " T"]], path: Path, topic: str
) -> tuple[dict[str, Float[Array, " T"]], list[TelemetryIssue]]:
    """Leaves out joints without any torque (fingers, say); told, and refused if it is all of them."""
    joints = [name.rpartition("/")[0] for name in columns if name.endswith("/position")]
    silent = [j for j in joints if f"{j}/effort" not in columns or np.isnan(columns[f"{j}/effort"]).all()]
    if not joints or len(silent) == len(joints):
        missing = "position" if not joints else "effort"
        raise RecordingError(
            path, f"the messages on {topic} have no {missing}", "let the driver publish position and effort"
        )
    if not silent:
        return columns, []
    kept = {name: values for name, values in columns.items() if name.rpartition("/")[0] not in silent}
    evidence = f"{path.name}: no effort of {', '.join(silent)}; left out"
    return kept, [TelemetryIssue("missing_channel", tuple(silent), "note", evidence, "record effort of every joint")]
