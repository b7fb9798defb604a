"""Which columns of a foreign table are which channels of which joints, by their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ident.errors import RecordingError
from ident.infer.by_data import find_rising
from ident.infer.families import (
    ColumnFamily,
    find_families,
    find_time,
    judge_words,
    named_in_rows,
)
from ident.infer.guess import ForeignTable, Reason, Signals
from ident.recordings.columns import listed
from ident.recordings.joint_names import map_by_ending
from ident.robot.arm import ArmModel

MEASURED = ("effort", "current")
# Channels that a session takes, beside position; torque comes first where there is current too.
FURTHER = (
    *("velocity", "effort", "current"),
    *("position_command", "velocity_command", "temperature"),
)


class Joints(NamedTuple):
    """The joints of a table."""

    labels: tuple[str, ...]  # of those that are taken
    names: tuple[str, ...]  # what they are called
    why: str
    # Whether they are called so by their places alone: nothing in the file names them.
    by_place: bool = False


def guess_by_name(table: ForeignTable, arm: ArmModel | None) -> Signals | None:
    """Finds the channels by the columns' names; None where no family of columns is a position.

    Raises:
        RecordingError: There is a position, but neither torque, current nor goal.
    """
    names = list(table.columns)
    # An angle that rises all the time is no clock.
    speaking = [name for name in names if judge_words(name)[0] is not None]
    clock = find_time(names) or find_rising(table, speaking)
    joints_of_robot = () if arm is None else arm.joint_names
    families = find_families([name for name in names if name != clock], joints_of_robot)
    position = _choose(families, "position", arm)
    unnamed = ""
    if position is None and arm is not None:
        position = _only_unnamed(families, arm)
        unnamed = "the only others of as many joints, "
    if position is None:
        return None
    count = len(position.columns)
    if arm is not None:
        count = min(count, arm.n)
    chosen = _choose_channels(table, families, position, arm, count)
    joints = _joints(position, arm, count, table.texts)
    columns = {channel: _ordered(family, joints.labels) for channel, family in chosen.items()}
    reasons = []
    if clock is not None:
        says_so = clock == find_time(names)
        said = "its name says so" if says_so else "the first column that rises evenly"
        reasons.append(Reason("time", repr(clock), said))
    for channel, family in chosen.items():
        span = f"{columns[channel][0]!r} to {columns[channel][-1]!r}"
        before = unnamed if family is position else ""
        reasons.append(Reason(channel, span, f"{before}named {family.title!r}"))
    reasons.append(Reason("joints", ", ".join(joints.names), joints.why))
    reasons += _other_arm(families, position)
    time = np.arange(len(table.columns[names[0]]), dtype=float)
    if clock is not None:
        time = table.columns[clock]
    tables = {}
    for channel, of_joints in columns.items():
        tables[channel] = np.column_stack([table.columns[name] for name in of_joints])
    return Signals(
        joints.names, columns, tables, clock, time, tuple(reasons), by_place=joints.by_place
    )


def _choose(
    families: Sequence[ColumnFamily], channel: str, arm: ArmModel | None, least: int = 2
) -> ColumnFamily | None:
    """The family of a channel against which least speaks, of so many columns at least.

    Of equal ones the first that has as many as the robot.
    """
    candidates = [
        family for family in families if family.channel == channel and len(family.columns) >= least
    ]
    if arm is not None:
        candidates.sort(key=lambda family: (family.doubt, len(family.columns) < arm.n))
    return candidates[0] if candidates else None


def _only_unnamed(families: Sequence[ColumnFamily], arm: ArmModel) -> ColumnFamily | None:
    """The only family of as many joints whose name says nothing, where there is a torque."""
    if not any(_choose(families, channel, arm, arm.n) for channel in MEASURED):
        return None
    others = {}
    for family in families:
        if family.channel is None and len(family.columns) >= arm.n:
            others[family.columns] = family
    return others.popitem()[1] if len(others) == 1 else None


def _choose_channels(
    table: ForeignTable,
    families: Sequence[ColumnFamily],
    position: ColumnFamily,
    arm: ArmModel | None,
    count: int,
) -> dict[str, ColumnFamily]:
    """The family of each channel that there is.

    Raises:
        RecordingError: There is neither torque, current nor goal.
    """
    chosen = {"position": position}
    for channel in FURTHER:
        family = _choose(families, channel, arm, count)
        if family is not None and not (channel == "current" and "effort" in chosen):
            chosen[channel] = family
    if chosen.keys().isdisjoint((*MEASURED, "position_command")):
        what = f"no columns are named as torque or current of the {count} joints"
        there = listed(list(table.columns))
        remedy = f"name them in [columns] of session.toml yourself; there are: {there}"
        raise RecordingError(table.source, what, remedy)
    return chosen


def _ordered(family: ColumnFamily, labels: Sequence[str]) -> tuple[str, ...]:
    """A family's columns in the order of the position's joints, where the labels are the same."""
    by_label = dict(zip(family.labels, family.columns, strict=True))
    if by_label.keys() >= set(labels):
        return tuple(by_label[label] for label in labels)
    return family.columns[: len(labels)]


def _other_arm(families: Sequence[ColumnFamily], position: ColumnFamily) -> list[Reason]:
    """That another family may be the position of another arm, if one may."""
    alike = (position.channel, position.doubt, len(position.columns))
    for other in families:
        shared = set(other.columns).intersection(position.columns)
        if (other.channel, other.doubt, len(other.columns)) == alike and not shared:
            remedy = "for that arm name its columns in a session of its own"
            return [Reason("arm", position.title, f"{other.title} are as many: {remedy}")]
    return []


def _joints(
    position: ColumnFamily, arm: ArmModel | None, count: int, texts: Mapping[str, str]
) -> Joints:
    """The joints of a table; see `Joints`."""
    said = named_in_rows(position.labels, texts)
    taken = [label for label, name in said.items() if arm is None or name in arm.joint_names]
    if taken:
        names = tuple(said[label] for label in taken)
        return Joints(tuple(taken), names, f"the rows name them: {', '.join(names)}")
    labels = position.labels[:count]
    numbered = all(label.isdecimal() for label in position.labels)
    if arm is None:
        if numbered:
            names = tuple(f"joint_{place + 1}" for place in range(count))
            return Joints(labels, names, "numbered by the file")
        return Joints(labels, labels, "named by the file")
    same_name = tuple(label for label in position.labels if label in arm.joint_names)
    matched = same_name  # a whole robot's log has more
    if not same_name and not numbered:
        matched = _match_names(position.labels, arm)
    if matched:
        return Joints(same_name or labels, matched[: arm.n], "the file's names are the robot's")
    why = f"the file's {', '.join(labels)} in the robot's order, base to tip"
    return Joints(labels, arm.joint_names[:count], why, by_place=True)


def _match_names(labels: Sequence[str], arm: ArmModel) -> tuple[str, ...]:
    """The robot's joint behind each label, where each is a part or an ending of one; else none."""
    matches = [_containing(label, arm) for label in labels]
    if all(len(names) == 1 for names in matches):
        joints = tuple(names[0] for names in matches)
        if len(set(joints)) == len(joints):
            return joints
    renamed = map_by_ending(labels, arm.joint_names)
    if renamed.keys() >= set(labels):
        return tuple(renamed[label] for label in labels)
    return ()


def _containing(label: str, arm: ArmModel) -> list[str]:
    """The robot's joints whose names contain a label."""
    return [name for name in arm.joint_names if label in name]
