"""Bags of any messages: every number of a topic is a column `/topic:field.place`.

Places of an array that belongs to names in the same message (`name`, `joint_names`, …) are called by these names.
ROS 2 bags that bring the definitions of their messages are read whatever these are; others if ROS itself knows the
type. ROS 1 bags (`.bag`) always bring them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.recordings.bad_cells import screen_cells
from ident.recordings.columns import TIME, Table, native_names
from ident.recordings.ros_messages import Bag, Record
from ident.recordings.session_toml import SessionFile
from ident.recordings.spread import MOST_PLACES

SEPARATOR = ":"
# Fields that name the places of the arrays beside them.
NAMING = ("name", "names", "joint_names", "interface_names", "motor_names")
TORQUES = ("/effort", "/current")


@dataclass
class Topic:
    """The numbers of one topic: a row a message; only messages with the first one's fields count."""

    names: tuple[str, ...] = ()
    stamps: list[int] = field(default_factory=list)
    receipts: list[int] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)

    @property
    def time(self) -> Float[Array, " T"]:
        """Time of the headers [s], or of receipt where no message has one."""
        clock = self.stamps if any(self.stamps) else self.receipts
        return np.array(clock, dtype=np.int64) * 1e-9


def names_topics(session_file: SessionFile) -> bool:
    """Whether `[columns]` speaks of fields of topics."""
    return any(name.startswith("/") and SEPARATOR in name for name in session_file.columns)


def read_topics(path: Path, session_file: SessionFile) -> tuple[Table, tuple[str, ...]]:
    """Reads the fields of topics that `[columns]` names, on the clock of the torque's topic.

    Raises:
        RecordingError: Not a bag, or a topic or field is not there.
    """
    wanted = {name.partition(SEPARATOR)[0] for name in session_file.columns}
    topics = load_topics(path, wanted)
    torque = {name.partition(SEPARATOR)[0] for name, native in session_file.columns.items() if native.endswith(TORQUES)}
    columns = join_topics(topics, torque or wanted)
    names = tuple(columns)
    chosen = native_names(names, session_file, path)
    table = {native: columns[names[index]] for index, native in chosen.items()}
    if TIME not in table and columns:
        table[TIME] = columns[TIME]
    return screen_cells(table, path), names


def load_topics(path: Path, wanted: set[str] | None = None) -> dict[str, Topic]:
    """The numbers of some topics, or of all whose messages can be read.

    Raises:
        RecordingError: Not a bag, or a damaged one.
    """
    found: dict[str, Topic] = defaultdict(Topic)
    try:
        with Bag(path) as bag:
            connections = [one for one in bag.connections if wanted is None or one.topic in wanted]
            for connection, receipt, message in bag.messages(connections) if connections else ():
                _take(found[connection.topic], message, receipt)
    except Exception as error:  # sqlite, struct, zstandard, lz4, YAML and the reader each raise their own
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise RecordingError(path, f"not a whole bag ({reason})", "record it again") from None
    return {name: topic for name, topic in found.items() if topic.names}


def _take(topic: Topic, message: Record, receipt: int) -> None:
    fields = list(_numbers(message, "", ()))
    names = tuple(name for name, _ in fields)
    if not topic.names:
        topic.names = names
    if names != topic.names or not names:
        return
    header = message.get("header")
    stamp = header.get("stamp", {}) if isinstance(header, dict) else {}
    topic.stamps.append(int(stamp.get("sec", 0)) * 1_000_000_000 + int(stamp.get("nanosec", 0)))
    topic.receipts.append(receipt)
    topic.rows.append([value for _, value in fields])


def _numbers(message: Record, prefix: str, labels: Sequence[str]) -> Iterator[tuple[str, float]]:
    """Every number of a message with its dotted name; headers, texts and large arrays are passed over."""
    own = next((tuple(message[name]) for name in message if name in NAMING and _is_names(message[name])), labels)
    for name, value in message.items():
        if name != "header" and name not in NAMING:
            yield from _flat(value, f"{prefix}{name}", own)


def _is_names(values: Any) -> bool:
    return isinstance(values, list) and bool(values) and all(isinstance(value, str) for value in values)


def _flat(value: Any, name: str, labels: Sequence[str]) -> Iterator[tuple[str, float]]:
    if isinstance(value, np.generic):
        yield name, float(value)
    elif isinstance(value, dict):
        yield from _numbers(value, f"{name}.", labels)
    elif isinstance(value, np.ndarray | list) and len(value) <= MOST_PLACES:
        own = labels if len(set(labels)) == len(value) else [str(i) for i in range(len(value))]
        for label, one in zip(own, value, strict=True):
            yield from _flat(one, f"{name}.{label}", ())


def join_topics(topics: dict[str, Topic], leading: set[str]) -> dict[str, Float[Array, " T"]]:
    """All topics on one clock, that of the most talkative of the leading ones; the others are interpolated.

    Args:
        topics: Their numbers.
        leading: Topics whose clock may be taken: those of the torque.
    """
    ranked = sorted(topics, key=lambda name: (name in leading, len(topics[name].rows)), reverse=True)
    if not ranked:
        return {}
    clock = topics[ranked[0]].time
    inside = np.ones(len(clock), dtype=bool)
    columns: dict[str, Float[Array, " T"]] = {TIME: clock}
    for name in ranked:
        topic = topics[name]
        time, table = topic.time, np.array(topic.rows)
        order = np.argsort(time, kind="stable")
        same = np.array_equal(time, clock)
        inside &= same | ((clock >= time[order[0]]) & (clock <= time[order[-1]]))
        for place, column in enumerate(topic.names):
            values = table[:, place]
            columns[f"{name}{SEPARATOR}{column}"] = values if same else np.interp(clock, time[order], values[order])
    return {name: values[inside] for name, values in columns.items()}
