"""Columns with names: families of columns become channels, their labels become the robot's joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.errors import RecordingError
from ident.infer.guess import ForeignTable, Reason, Signals
from ident.infer.names import ColumnFamily, find_families, find_time
from ident.recordings.columns import listed
from ident.recordings.joint_names import map_by_ending
from ident.robot.arm import ArmModel

# Channels that a session takes, beside position; torque comes first where there is current too.
FURTHER = ("velocity", "effort", "current", "position_command", "velocity_command", "temperature")


def guess_by_name(table: ForeignTable, arm: ArmModel | None) -> Signals | None:
    """Finds the channels by the columns' names; None where no family of columns is a position.

    Raises:
        RecordingError: There is a position, but neither torque nor current.
    """
    names = list(table.columns)
    clock = find_time(names)
    families = find_families([name for name in names if name != clock], () if arm is None else arm.joint_names)
    position = _choose(families, "position", arm)
    if position is None:
        return None
    count = len(position.columns) if arm is None else min(len(position.columns), arm.n)
    chosen = {"position": position}
    for channel in FURTHER:
        family = _choose(families, channel, arm, count)
        if family is not None and not (channel == "current" and "effort" in chosen):
            chosen[channel] = family
    if not {"effort", "current"} & set(chosen):
        goals = "; an arm that logs goal and position only is for `ident servo`" if "position_command" in chosen else ""
        raise RecordingError(
            table.source,
            f"no columns are named as torque or current of the {count} joints",
            f"name them in [columns] of session.toml yourself{goals}; there are: {listed(names)}",
        )
    joints, why = _joints(position, arm, count)
    columns = {}
    for channel, family in chosen.items():  # in the order of the position's joints, where the labels are the same
        own, wanted = dict(zip(family.labels, family.columns, strict=True)), position.labels[:count]
        columns[channel] = tuple(own[one] for one in wanted) if {*wanted} <= {*own} else family.columns[:count]
    reasons = [
        Reason(
            channel,
            f"{columns[channel][0]!r} to {columns[channel][-1]!r}",
            f"named {family.template.replace('#', '…')!r}",
        )
        for channel, family in chosen.items()
    ]
    time = np.arange(len(table.columns[names[0]]), dtype=float) if clock is None else table.columns[clock]
    if clock is not None:
        reasons.insert(0, Reason("time", repr(clock), "its name says so"))
    reasons.append(Reason("joints", ", ".join(joints), why))
    tables = {channel: np.column_stack([table.columns[name] for name in own]) for channel, own in columns.items()}
    return Signals(joints, columns, tables, clock, time, tuple(reasons))


def _choose(families: list[ColumnFamily], channel: str, arm: ArmModel | None, least: int = 2) -> ColumnFamily | None:
    """The family of a channel against which least speaks; of equal ones the first that has as many as the robot."""
    own = [family for family in families if family.channel == channel and len(family.columns) >= least]
    if arm is not None:
        own.sort(key=lambda family: (family.doubt, len(family.columns) < arm.n))
    return own[0] if own else None


def _joints(position: ColumnFamily, arm: ArmModel | None, count: int) -> tuple[tuple[str, ...], str]:
    labels = position.labels[:count]
    if arm is None:
        names = tuple(f"joint_{i + 1}" for i in range(count)) if position.are_numbers else labels
        return names, "numbered by the file" if position.are_numbers else "named by the file"
    robot = arm.joint_names
    if not position.are_numbers:
        matched = _match(position.labels, robot)
        if matched is not None:
            return matched[:count], "the file's names are the robot's"
    return robot[:count], f"the file's {', '.join(labels)} in the robot's order, base to tip"


def _match(labels: Sequence[str], robot: Sequence[str]) -> tuple[str, ...] | None:
    """The robot's joints that labels speak of, if each speaks of one."""
    if set(labels) <= set(robot):
        return tuple(labels)
    inside = [[name for name in robot if label in name] for label in labels]
    if all(len(found) == 1 for found in inside) and len({found[0] for found in inside}) == len(labels):
        return tuple(found[0] for found in inside)
    renamed = map_by_ending(labels, robot)
    return tuple(renamed[label] for label in labels) if set(labels) <= set(renamed) else None
