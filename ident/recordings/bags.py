"""Bags of ROS 2 and ROS 1 as columns: sensor_msgs/JointState of one topic, or every number of any
topics.

Fields of any message are columns `/topic:field.place`; places of an array that belongs to names in
the same message (`name`, `joint_names`, …) are called by these names. ROS 2 bags that bring the
definitions of their messages are read whatever these are; others if ROS itself knows the type. ROS
1 bags (`.bag`) always bring them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RecordingError, first_line
from ident.recordings.bad_cells import held_columns
from ident.recordings.columns import TIME, NamedColumns, Table, joint_of
from ident.recordings.parquet import MOST_PLACES
from ident.recordings.recording import TelemetryIssue
from ident.recordings.ros_messages import Bag, Record
from ident.recordings.session_toml import SessionFile

JOINT_STATE = "sensor_msgs/msg/JointState"
FIELDS = ("position", "velocity", "effort")
SEPARATOR = ":"
# Fields that name the places of the arrays beside them.
NAMING = ("name", "names", "joint_names", "interface_names", "motor_names")
# A topic is of the joints if it speaks at least this share as often as the most talkative one.
LEAST_TALK = 0.05
Columns = dict[str, Float[Array, " T"]]


def open_bag(path: Path, settings: SessionFile | None, topic: str) -> NamedColumns:
    """The columns of a bag: its joint states, or the topics that `[columns]` names.

    Args:
        path: The bag.
        settings: What session.toml says; all topics if None.
        topic: That of the joint states.

    Raises:
        RecordingError: Not a bag, a damaged one, or no joint states with torque on the topic.
    """
    if settings is None:
        topics = load_topics(path)
        if not topics:
            remedy = "record it with a ROS that writes definitions"
            raise RecordingError(path, "no message in it can be read", remedy)
        least = max(1, LEAST_TALK * max(len(stream[TIME]) for stream in topics.values()))
        talking = [stream for stream in topics.values() if len(stream[TIME]) > least]
        return held_columns(merge(talking, [True] * len(talking), path)[0], path)
    fields = {
        name: native
        for name, native in settings.columns.items()
        if name.startswith("/") and SEPARATOR in name
    }
    if not fields:
        return _open_joint_states(path, topic)
    topics = load_topics(path, {name.partition(SEPARATOR)[0] for name in settings.columns})
    torque = {
        name.partition(SEPARATOR)[0]
        for name, field in fields.items()
        if field.endswith(("/effort", "/current"))
    }
    wanted = [not torque or name in torque for name in topics]
    merged, *_ = merge([*topics.values()], wanted, path)
    held = held_columns(merged, path)
    clock = held.names.index(TIME) if TIME in held.names else -1

    def read(chosen: Mapping[int, str]) -> Table:
        """The time of the torque's topic is the run's where no other is named."""
        return held.read(
            chosen if TIME in chosen.values() or clock < 0 else {**chosen, clock: TIME}
        )

    return NamedColumns(held.names, read, held.numbers)


def _read_messages(
    path: Path, choose: Callable[[Bag], Sequence[Any]], take: Callable[[Any, int, Record], None]
) -> None:
    """Hands out connection, time of receipt [ns] and content of the messages of some
    connections.
    """
    if path.is_file() and path.stat().st_size == 0:
        raise RecordingError(path, "is empty (0 bytes)", "record the bag again")
    try:
        with Bag(path) as bag:
            chosen = choose(bag)
            for connection, receipt, message in bag.messages(chosen) if chosen else ():
                take(connection, receipt, message)
    except RecordingError:
        raise
    except MemoryError:
        raise RecordingError(
            path, "a message in it claims to be larger than the memory", "record again"
        ) from None
    # sqlite, struct, zstandard, lz4, YAML and the reader each raise their own
    except Exception as error:
        remedy = "repair it (`ros2 bag reindex`, `mcap recover`) or record again"
        kind = "ROS 1" if path.suffix.lower() == ".bag" else "ROS 2"
        raise RecordingError(
            path, f"not a whole {kind} bag ({first_line(error)})", remedy
        ) from None


@dataclass
class Stream:
    """One publisher's messages: their stamps [ns], and each as a row of a table."""

    stamps: list[int] = field(default_factory=list)
    receipts: list[int] = field(default_factory=list)
    rows: list[Any] = field(default_factory=list)
    names: tuple[str, ...] = ()

    def take(self, message: Record, receipt: int, row: Any) -> None:
        """One more message.

        Args:
            message: Its content; a header's stamp counts, 0 without one.
            receipt: Time of receipt [ns].
            row: The row that it is.
        """
        header = message.get("header")
        stamp = header.get("stamp", {}) if isinstance(header, dict) else {}
        seconds = int(stamp.get("sec", 0))
        nanoseconds = int(stamp.get("nanosec", 0))
        self.stamps.append(seconds * 1_000_000_000 + nanoseconds)
        self.receipts.append(receipt)
        self.rows.append(row)

    @property
    def time(self) -> Float[Array, " T"]:
        """Time of the headers [s], or of receipt where no message has one: a single zero may be a
        clock's start.
        """
        return np.array(self.stamps if any(self.stamps) else self.receipts, dtype=np.int64) * 1e-9

    def of_joints(self, joints: Sequence[str], path: Path) -> Columns:
        """The messages as columns of joints, their time among them [s]; fields that they leave
        empty are left out.

        Raises:
            RecordingError: A joint is named twice.
        """
        if len(set(joints)) < len(joints):
            twice = next(joint for joint in joints if list(joints).count(joint) > 1)
            raise RecordingError(
                path, f"messages name the joint {twice!r} twice", "correct the publisher"
            )
        columns = {TIME: self.time}
        nothing = np.full(len(joints), np.nan)
        for name, values in zip(FIELDS, zip(*self.rows, strict=True), strict=True):
            if any(len(row) for row in values):
                table = np.array([row if len(row) == len(joints) else nothing for row in values])
                columns.update(
                    {f"{joint}/{name}": table[:, index] for index, joint in enumerate(joints)}
                )
        return columns

    def without_empty(self) -> tuple[Stream, int]:
        """The messages that fill every field that most of them fill, and the number of the others.

        Nodes that know a part of the state speak on the same topic: what they leave empty is no
        fault of those that know it.
        """
        lengths = [list(map(len, row)) for row in self.rows]
        filled = np.array(lengths) > 0
        usual = filled.mean(axis=0) > 0.5
        whole = np.asarray(filled[:, usual].all(axis=1))
        if whole.all() or not whole.any():
            return self, 0
        stamps_kept = [np.array(values)[whole].tolist() for values in (self.stamps, self.receipts)]
        rows = [row for row, is_whole in zip(self.rows, whole, strict=True) if is_whole]
        return Stream(stamps_kept[0], stamps_kept[1], rows, self.names), int((~whole).sum())


def _open_joint_states(path: Path, topic: str) -> NamedColumns:
    """Joints may stand in any order and be spread over messages.

    Those of slower or shifted publishers are interpolated to the fastest one's stamps.
    """

    def choose(bag: Bag) -> list[Any]:
        connections = [connection for connection in bag.connections if connection.topic == topic]
        usable = [connection for connection in connections if connection.msgtype == JOINT_STATE]
        if usable:
            return usable
        what = (
            f"topic {topic} holds {connections[0].msgtype}, not {JOINT_STATE}"
            if connections
            else f"no topic {topic}"
        )
        states = sorted({c.topic for c in bag.connections if c.msgtype == JOINT_STATE})
        if states:
            raise RecordingError(
                path, what, f"choose the topic of the joint states: {', '.join(states)}"
            )
        topics = ", ".join(sorted({c.topic for c in bag.connections})) or "none"
        raise RecordingError(
            path, what, f"record {JOINT_STATE}; the topics that are there: {topics}"
        )

    streams: dict[tuple[str, ...], Stream] = defaultdict(Stream)

    def take(_: object, receipt: int, message: Record) -> None:
        streams[tuple(message["name"])].take(message, receipt, [message[name] for name in FIELDS])

    _read_messages(path, choose, take)
    streams.pop((), None)
    if not streams:
        raise RecordingError(
            path, f"no message on {topic}", "give a bag in which the joint states were recorded"
        )
    screened = {key: stream.without_empty() for key, stream in streams.items()}
    tables = {key: stream.of_joints(key, path) for key, (stream, _) in screened.items()}
    publishers, silent_rows = _publishers(tables)
    empty = silent_rows + sum(count for _, count in screened.values())
    with_effort = [_has_effort(labels) for labels in publishers]
    columns, others = merge(publishers, with_effort, path)
    issues = []
    if empty:
        evidence = (
            f"{path.name}: {empty} messages on {topic} leave fields empty that the others fill; "
            "left out"
        )
        issues.append(TelemetryIssue("missing_channel", (), "note", evidence, "none needed"))
    for apart in (tuple(dict.fromkeys(map(joint_of, names))) for names in others):
        evidence = f"{path.name}: {', '.join(apart)} come in messages of their own, interpolated"
        issues.append(TelemetryIssue("jitter", apart, "note", evidence, "none needed"))
    joints = [joint_of(name) for name in columns if name.endswith("/position")]
    silent = []
    for joint in joints:
        effort = columns.get(f"{joint}/effort", np.nan)
        if np.isnan(effort).all():
            silent.append(joint)
    if len(silent) == len(joints):
        what = f"the messages on {topic} have no {'effort' if joints else 'position'}"
        raise RecordingError(path, what, "let the driver publish position and effort")
    if silent:  # fingers, say
        columns = {name: values for name, values in columns.items() if joint_of(name) not in silent}
        evidence = f"{path.name}: no effort of {', '.join(silent)}; left out"
        remedy = "record effort of every joint"
        issues.append(TelemetryIssue("missing_channel", tuple(silent), "note", evidence, remedy))
    return held_columns(columns, path, tuple(issues))


def _publishers(tables: Mapping[tuple[str, ...], Columns]) -> tuple[list[Columns], int]:
    """Messages that name the same joints in another order are one publisher's.

    Of those the ones count that hold as many channels as any: another node's that hold fewer tell
    nothing more.

    Returns:
        The publishers, and the number of messages that are left out.
    """
    groups: dict[frozenset[str], list[Columns]] = defaultdict(list)
    for joints, columns in tables.items():
        groups[frozenset(joints)].append(columns)
    joined = []
    left_out = 0
    for every in groups.values():
        most = max(map(len, every))
        group = [columns for columns in every if len(columns) == most]
        left_out += sum(len(columns[TIME]) for columns in every if len(columns) < most)
        of_all = set(group[0]).intersection(*group[1:])
        whole = {}
        for name in group[0]:
            if name in of_all:
                whole[name] = np.concatenate([columns[name] for columns in group])
        # One publisher's order is kept as it is: time that runs backwards is for the telemetry
        # check to find.
        order = np.argsort(whole[TIME], kind="stable") if len(group) > 1 else slice(None)
        joined.append({name: values[order] for name, values in whole.items()})
    return joined, left_out


def load_topics(path: Path, wanted: set[str] | None = None) -> dict[str, Columns]:
    """Time and numbers of some topics, or of all whose messages can be read.

    Only messages with the fields of a topic's first one count.

    Args:
        path: The bag.
        wanted: Names of the topics; all if None.

    Returns:
        By topic its columns: `time` [s] of the headers or of receipt, and the topic's fields.

    Raises:
        RecordingError: Not a bag, or a damaged one.
    """
    streams: dict[str, Stream] = defaultdict(Stream)

    def choose(bag: Bag) -> list[Any]:
        return [
            connection
            for connection in bag.connections
            if wanted is None or connection.topic in wanted
        ]

    def take(connection: Any, receipt: int, message: Record) -> None:
        fields = list(_numbers(message, "", ()))
        topic = streams[connection.topic]
        names = tuple(name for name, _ in fields)
        topic.names = topic.names or names
        if names and names == topic.names:
            topic.take(message, receipt, [value for _, value in fields])

    _read_messages(path, choose, take)
    topics = {}
    for name, stream in streams.items():
        table = np.array(stream.rows).T
        if stream.names and len(table):
            columns = [f"{name}{SEPARATOR}{field}" for field in stream.names]
            topics[name] = {TIME: stream.time, **dict(zip(columns, table, strict=True))}
    return topics


def _numbers(message: Record, prefix: str, labels: Sequence[str]) -> Iterator[tuple[str, float]]:
    """Every number of a message with its dotted name; headers, texts and large arrays are passed
    over.
    """
    naming = (
        value
        for name, value in message.items()
        if name in NAMING and isinstance(value, list) and value
    )
    for labels_of_message in naming:
        if all(isinstance(value, str) for value in labels_of_message):
            labels = tuple(labels_of_message)
            break
    for name, value in message.items():
        if name != "header" and name not in NAMING:
            yield from _flat(value, f"{prefix}{name}", labels)


def _flat(value: Any, name: str, labels: Sequence[str]) -> Iterator[tuple[str, float]]:
    if isinstance(value, np.generic):
        yield name, float(value)
    elif isinstance(value, dict):
        yield from _numbers(value, f"{name}.", labels)
    elif isinstance(value, np.ndarray | list) and len(value) <= MOST_PLACES:
        are_unique = len(set(labels)) == len(value)
        names = labels if are_unique else [str(i) for i in range(len(value))]
        for label, entry in zip(names, value, strict=True):
            yield from _flat(entry, f"{name}.{label}", ())


def _has_effort(labels: Iterable[str]) -> bool:
    """Whether one of a publisher's columns is an effort."""
    return any(name.endswith("/effort") for name in labels)


def merge(
    streams: Sequence[Columns], leading: Sequence[bool], path: Path
) -> tuple[Columns, list[list[str]]]:
    """All streams on one clock, that of the most talkative leading one (of the torque); the others
    are interpolated.

    Returns:
        The columns while all of them speak, and the names of those that each other stream gave by
        interpolation.

    Raises:
        RecordingError: There is no such time.
    """
    ranked = sorted(
        range(len(streams)), key=lambda k: (leading[k], len(streams[k][TIME])), reverse=True
    )
    if not ranked:
        return {}, []
    merged = dict(streams[ranked[0]])
    others = []
    clock = merged[TIME]
    inside = np.ones(len(clock), dtype=bool)
    for stream in (streams[k] for k in ranked[1:]):
        names = [name for name in stream if name not in merged]
        time = stream[TIME]
        if np.array_equal(clock, time):
            merged.update({name: stream[name] for name in names})
            continue
        order = np.argsort(time, kind="stable")
        for name in names:
            merged[name] = np.interp(clock, time[order], stream[name][order])
        inside &= (clock >= time.min()) & (clock <= time.max())
        others.append(names)
    if not inside.any():
        raise RecordingError(
            path, "its publishers never speak at the same time", "record all joints together"
        )
    return {name: values[inside] for name, values in merged.items()}, others
