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
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.recordings.bad_cells import screen_cells
from ident.recordings.columns import TIME, Table, native_names
from ident.recordings.session_toml import SessionFile
from ident.recordings.spread import MOST_PLACES

SEPARATOR = ":"
# Fields that name the places of the arrays beside them.
NAMING = ("name", "names", "joint_names", "interface_names", "motor_names")
TORQUES = ("/effort", "/current")
TYPES = get_typestore(Stores.ROS2_HUMBLE)


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
    deaf: set[str] = set()
    try:
        with AnyReader([path], default_typestore=TYPES) as reader:
            connections = [one for one in reader.connections if wanted is None or one.topic in wanted]
            for connection, receipt, raw in reader.messages(connections) if connections else ():
                if connection.topic in deaf:
                    continue
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                except Exception:  # a type that nobody defines: told by its absence from the columns
                    deaf.add(connection.topic)
                    continue
                _take(found[connection.topic], message, receipt)
    except Exception as error:  # sqlite, struct, zstandard, lz4, YAML and the reader each raise their own
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise RecordingError(path, f"not a whole bag ({reason})", "record it again") from None
    return {name: topic for name, topic in found.items() if topic.names}


def _take(topic: Topic, message: Any, receipt: int) -> None:
    fields = list(_numbers(message, "", ()))
    names = tuple(name for name, _ in fields)
    if not topic.names:
        topic.names = names
    if names != topic.names or not names:
        return
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    seconds = 0 if stamp is None else stamp.sec * 1_000_000_000 + stamp.nanosec
    topic.stamps.append(seconds)
    topic.receipts.append(receipt)
    topic.rows.append([value for _, value in fields])


def _numbers(message: Any, prefix: str, labels: Sequence[str]) -> Iterator[tuple[str, float]]:
    """Every number of a message with its dotted name; headers, texts and large arrays are passed over."""
    fields = [name for name in message.__dataclass_fields__ if not name.startswith("__")]
    naming = [name for name in fields if name in NAMING and _is_names(message, name)]
    own = tuple(getattr(message, naming[0])) if naming else labels
    for name in fields:
        value = getattr(message, name)
        if name != "header" and name not in NAMING:
            yield from _flat(value, f"{prefix}{name}", own)


def _is_names(message: Any, name: str) -> bool:
    values = getattr(message, name)
    return isinstance(values, list) and bool(values) and all(isinstance(value, str) for value in values)


def _flat(value: Any, name: str, labels: Sequence[str]) -> Iterator[tuple[str, float]]:
    if isinstance(value, bool | int | float | np.number):
        yield name, float(value)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.ndim == 1 and len(value) <= MOST_PLACES:
        own = labels if len(set(labels)) == len(value) else [str(i) for i in range(len(value))]
        yield from ((f"{name}.{label}", float(one)) for label, one in zip(own, value, strict=True))
    elif isinstance(value, list) and value and hasattr(value[0], "__dataclass_fields__") and len(value) <= MOST_PLACES:
        own = labels if len(set(labels)) == len(value) else [str(i) for i in range(len(value))]
        for label, one in zip(own, value, strict=True):
            yield from _numbers(one, f"{name}.{label}.", ())
    elif hasattr(value, "__dataclass_fields__"):
        yield from _numbers(value, f"{name}.", labels)


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
