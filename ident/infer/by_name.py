"""Columns with names: families of columns become channels, their labels become the robot's joints.

Columns that differ only in a number or in a joint's name are a family, such as `actual_q_0` … `actual_q_5`. The words
of the family's name say what it holds. Names of Universal Robots' RTDE, libfranka, ROS and LeRobot are among them.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.errors import RecordingError
from ident.infer.guess import ForeignTable, Reason, Signals
from ident.recordings.columns import listed
from ident.recordings.joint_names import map_by_ending
from ident.recordings.lerobot import ENDINGS, joint_name
from ident.robot.arm import ArmModel

# Words -> the channel that they speak of, in the order in which they count.
WORDS: dict[str, tuple[str, ...]] = {
    "acceleration": ("qdd", "ddq", "acc", "acceleration", "accelerations", "accel"),
    "velocity": ("qd", "dq", "vel", "velocity", "velocities", "speed", "speeds", "qdot"),
    "temperature": ("temp", "temps", "temperature", "temperatures"),
    "effort": ("tau", "torque", "torques", "effort", "efforts", "moment", "moments"),
    "current": ("current", "currents", "curr", "amps"),
    "position": ("q", "pos", "position", "positions", "angle", "angles", "theta", "joints", "state"),
}
COMMANDS = "target cmd command commanded commands desired des d ref reference setpoint goal action sent control"
# What is derived from the torque, not the torque: estimates of contact, residuals, models.
DERIVED = "ext external hat model residual error tcp tool cartesian dtau gravity std window max min raw pose wrench"
TIMES = ("time", "timestamp", "t", "stamp", "secs", "seconds", "duration", "clock", "timestamps")
COMMANDED = {"position": "position_command", "velocity": "velocity_command", "effort": "effort_command"}
PLACE = "#"


@dataclass(frozen=True)
class ColumnFamily:
    """Columns of one quantity, one a joint.

    Attributes:
        template: Their common name, the place of the joint marked.
        columns: Their names, in the joints' order.
        labels: What stands at the place: numbers or joints' names.
        channel: What they hold; None where their names don't say.
        doubt: Words that speak against it; fewer is better.
    """

    template: str
    columns: tuple[str, ...]
    labels: tuple[str, ...]
    channel: str | None
    doubt: int

    @property
    def are_numbers(self) -> bool:
        """Whether joints are numbered, not named."""
        return all(label.isdecimal() for label in self.labels)


def words_of(template: str) -> list[str]:
    """The words of a name, in lower case."""
    parted = re.sub(r"([a-z])([A-Z])", r"\1 \2", template)
    return [word for word in re.split(r"[^A-Za-z]+", parted.lower()) if word]


def judge_words(template: str) -> tuple[str | None, int]:
    """The channel that a name speaks of, and how much speaks against it."""
    words = words_of(template.rpartition("/")[2] or template) if ":" not in template else words_of(template)
    if "current" in words and ("torque" in words or "effort" in words):
        words = [word for word in words if word != "current"]  # a torque made of the current
    channel = next((name for name, known in WORDS.items() if set(words) & set(known)), None)
    if channel is None:
        return ("position_command", 0) if "action" in words else (None, 0)
    doubt = 3 * len({*words} & {*DERIVED.split()}) - ("actual" in words or "measured" in words)
    if {*words} & {*COMMANDS.split()}:
        return COMMANDED.get(channel), doubt
    return channel, doubt


def find_time(names: Sequence[str]) -> str | None:
    """The column whose name says time."""
    ranked = [(words_of(name), name) for name in names]
    plain = [name for words, name in ranked if words and all(word in (*TIMES, "s", "ms", "us", "ns") for word in words)]
    some = [name for words, name in ranked if set(words) & (set(TIMES) - {"t"})]
    return next(iter([*plain, *some]), None)


def find_families(names: Sequence[str], joints: Sequence[str]) -> list[ColumnFamily]:
    """Families of columns.

    Args:
        names: All columns.
        joints: The robot's joints; empty where there is no robot.
    """
    members: dict[str, dict[str, str]] = defaultdict(dict)
    # Joints' names, and what is left of them without the word joint -> the joint's place.
    shorts = {name: i for i, name in enumerate(joints)}
    for i, name in enumerate(joints):
        shorts.setdefault(re.sub(r"_?joint_?", "", name, flags=re.IGNORECASE) or name, i)
    shorts = {name: i for name, i in shorts.items() if len(name) > 1 and not name.isdecimal()}
    for name in names:
        for template, label in _readings(name, shorts):
            members[template].setdefault(label, name)
    found = [
        family for template, by_label in members.items() if (family := _family(template, by_label, shorts)) is not None
    ]
    return sorted(found, key=lambda family: family.doubt)


def _readings(name: str, shorts: dict[str, int]) -> list[tuple[str, str]]:
    """All ways to see a joint in a column's name: (template, label)."""
    found = []
    for short in sorted(shorts, key=len, reverse=True):
        if short in name:
            found.append((name.replace(short, PLACE, 1), short))
            break
    found += [(f"{name[: run.start()]}{PLACE}{name[run.end() :]}", run.group()) for run in re.finditer(r"\d+", name)]
    ending = next((one for one in ENDINGS if name.endswith(one)), "")
    head, dot, label = name.removesuffix(ending).rpartition(".")
    if dot and not label.isdecimal():
        found.append((f"{head}.{PLACE}{ending}", joint_name(label)))
    if "/" in name and ":" not in name:
        joint, _, channel = name.rpartition("/")
        found.append((f"{PLACE}/{channel}", joint))
    return found


def _family(template: str, by_label: dict[str, str], shorts: dict[str, int]) -> ColumnFamily | None:
    labels = list(by_label)
    if all(label.isdecimal() for label in labels):
        labels.sort(key=int)
        if [int(label) - int(labels[0]) for label in labels] != list(range(len(labels))):
            return None
    elif shorts and all(label in shorts for label in labels):
        labels.sort(key=lambda label: shorts[label])
    if len(labels) < 2:
        return None
    channel, doubt = judge_words(template)
    return ColumnFamily(template, tuple(by_label[label] for label in labels), tuple(labels), channel, doubt)


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
