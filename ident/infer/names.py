"""What columns' names say: which channel, which joint.

Columns that differ only in a number or in a joint's name are a family, such as `actual_q_0` … `actual_q_5`. The words
of the family's name say what it holds. Names of Universal Robots' RTDE, libfranka, ROS and LeRobot are among them.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from ident.recordings.lerobot import ENDINGS, joint_name

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
    shorts = _short_names(joints)
    for name in names:
        for template, label in _readings(name, shorts):
            members[template].setdefault(label, name)
    found = [
        family for template, by_label in members.items() if (family := _family(template, by_label, shorts)) is not None
    ]
    return sorted(found, key=lambda family: family.doubt)


def _short_names(joints: Sequence[str]) -> dict[str, int]:
    """Joints' names and what is left of them without the word joint -> the joint's place."""
    shorts = {name: i for i, name in enumerate(joints)}
    for i, name in enumerate(joints):
        shorts.setdefault(re.sub(r"_?joint_?", "", name, flags=re.IGNORECASE) or name, i)
    return {name: i for name, i in shorts.items() if len(name) > 1 and not name.isdecimal()}


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
