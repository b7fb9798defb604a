"""Columns of a foreign table that belong together, and what their names say.

Columns that differ only in a number or in a joint's name are a family, such as `actual_q_0` …
`actual_q_5`. The words of the family's name say what it holds. Names of Universal Robots' RTDE,
libfranka, ROS and LeRobot are among them.
"""

from __future__ import annotations

import re
import tomllib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ident.recordings.lerobot import ENDINGS, joint_name
from ident.recordings.session_toml import TIME_UNITS

WORDS = tomllib.loads(Path(__file__).with_name("words.toml").read_text(encoding="utf-8"))
TIMES = frozenset(WORDS["others"]["times"])
COMMANDS = frozenset(WORDS["others"]["commands"])
DERIVED = frozenset(WORDS["others"]["derived"])
MEASURED_AS = frozenset(WORDS["others"]["measured"])
# A shorter word of a channel ends no other by chance alone.
SHORTEST_GLUED = 5
# What a goal of each channel is.
COMMANDED = {
    "position": "position_command",
    "velocity": "velocity_command",
    "effort": "effort_command",
}
# What a word of what is derived weighs against one of what is measured.
DERIVED_WEIGHT = 3
PLACE = "#"
# What tells columns of one family apart: a number, or the letter of an axis.
NUMBER = re.compile(r"\d+|(?<![A-Za-z])[A-Z](?![A-Za-z])")
UNIT = re.compile(
    r"\s*[\[(]((?:°|deg|grad|degrees|rad|m?m|k?n[ ·]?m|n|m?a|%)(?:/s(?:\^?2|²)?)?)[\])]",
    re.IGNORECASE,
)
# A joint that slides has a force where the others have a torque.
FORCES = {"force": "torque", "Force": "Torque", "FORCE": "TORQUE"}

Members = dict[str, dict[str, str]]
"""By a family's template, the column of each label."""


@dataclass(frozen=True)
class ColumnFamily:
    """Columns of one quantity, one a joint."""

    template: str  # their common name, the place of the joint marked
    columns: tuple[str, ...]  # their names, in the joints' order
    labels: tuple[str, ...]  # what stands at the place: numbers or joints' names
    channel: str | None  # what they hold; None where their names don't say
    doubt: int  # words that speak against it; fewer is better

    @property
    def title(self) -> str:
        """Their common name, for people."""
        return self.template.replace(PLACE, "…")


def words_of(template: str) -> list[str]:
    """The words of a name, in lower case."""
    parted = re.sub(r"([a-z])([A-Z])", r"\1 \2", template)
    return [word for word in re.split(r"[^A-Za-z]+", parted.lower()) if word]


def judge_words(template: str) -> tuple[str | None, int]:
    """The channel that a name speaks of, and how much speaks against it."""
    name = template
    if ":" not in template:
        # Of a path the last step speaks that is more than the joint's place.
        speaking = [step for step in template.split("/") if words_of(step)]
        name = speaking[-1] if speaking else template
    words = words_of(name)
    if "current" in words and ("torque" in words or "effort" in words):
        words = [word for word in words if word != "current"]  # a torque made of the current
    commanded = any(word in COMMANDS or word.startswith("soll") for word in words)
    measured = not MEASURED_AS.isdisjoint(words)
    channel = _spoken_channel(words)
    if channel is None:
        if commanded:
            return "position_command", 0
        return ("position" if measured else None), 0
    doubt = DERIVED_WEIGHT * len(DERIVED.intersection(words)) - measured
    return (COMMANDED.get(channel) if commanded else channel), doubt


def _spoken_channel(words: list[str]) -> str | None:
    """The first channel that one of the words means, or ends with a word of (`Istwinkel`)."""
    for channel, known in WORDS["channels"].items():
        glued = tuple(word for word in known if len(word) >= SHORTEST_GLUED)
        if any(word in known or word.endswith(glued) for word in words):
            return str(channel)
    return None


def find_time(names: Sequence[str]) -> str | None:
    """The column whose name says time: one that says nothing else, before one that does."""
    plain_words = TIMES.union(TIME_UNITS)
    for name in names:
        words = words_of(name)
        if words and plain_words.issuperset(words):
            return name
    telling = TIMES - {"t"}
    return next((name for name in names if not telling.isdisjoint(words_of(name))), None)


def find_families(names: Sequence[str], joints: Sequence[str]) -> list[ColumnFamily]:
    """Families of columns, those first against which least speaks.

    Args:
        names: Of the columns.
        joints: Names of the robot's joints; none if it is not known.
    """
    places = _joint_places(joints)
    members: Members = defaultdict(dict)
    for name in names:
        for template, label in _readings(UNIT.sub("", name), places):
            members[template].setdefault(label, name)
    _join_forces(members)
    families = []
    for template, by_label in members.items():
        labels = _in_order(list(by_label), places)
        if len(labels) > 1:
            columns = tuple(by_label[label] for label in labels)
            families.append(_as_family(template, columns, labels))
    return sorted(families, key=lambda family: family.doubt)


def _joint_places(joints: Sequence[str]) -> dict[str, int]:
    """Joints' names, and what is left of them without the word joint -> the joint's place."""
    places = {name: place for place, name in enumerate(joints)}
    for place, name in enumerate(joints):
        short = re.sub(r"_?joint_?", "", name, flags=re.IGNORECASE)
        places.setdefault(short or name, place)
    several = {name: place for name, place in places.items() if len(name) > 1}
    return {name: place for name, place in several.items() if not name.isdecimal()}


def _join_forces(members: Members) -> None:
    """Puts forces of sliding joints beside the torques of the others, in place."""
    for template in list(members):
        for force, torque in FORCES.items():
            twin = template.replace(force, torque)
            if twin == template or twin not in members:
                continue
            if members[twin].keys().isdisjoint(members[template]):
                members[twin] |= members.pop(template)
                break


def _in_order(labels: list[str], places: Mapping[str, int]) -> list[str]:
    """Labels in the joints' order; none where they are numbers with gaps."""
    if all(label.isdecimal() for label in labels):
        labels = sorted(labels, key=int)
        numbers = [int(label) - int(labels[0]) for label in labels]
        return labels if numbers == list(range(len(labels))) else []
    if places and all(label in places for label in labels):
        return sorted(labels, key=lambda label: places[label])
    return labels


def _as_family(template: str, columns: tuple[str, ...], labels: Sequence[str]) -> ColumnFamily:
    """A family, by its words, else by its unit."""
    channel, doubt = judge_words(template)
    if channel is None:
        unit = "".join(UNIT.findall(columns[0])[:1]).lower()
        channel = next((name for name, known in WORDS["units"].items() if unit in known), None)
    return ColumnFamily(template, columns, tuple(labels), channel, doubt)


def _readings(name: str, places: Mapping[str, int]) -> list[tuple[str, str]]:
    """All ways to see a joint in a column's name: (template, label)."""
    readings = []
    for joint in sorted(places, key=len, reverse=True):
        if joint in name:
            readings.append((name.replace(joint, PLACE, 1), joint))
            break
    readings += [(_without(name, run), run.group()) for run in NUMBER.finditer(name)]
    ending = next((ending for ending in ENDINGS if name.endswith(ending)), "")
    head, dot, label = name.removesuffix(ending).rpartition(".")
    if dot and not label.isdecimal():
        readings.append((f"{head}.{PLACE}{ending}", joint_name(label)))
        if judge_words(label)[0]:  # a drive's trace names the axis first: `Z.ActPos`, `A2.ActPos`
            readings.append((f"{PLACE}.{label}", head))
    if "/" in name and ":" not in name:
        joint, _, channel = name.rpartition("/")
        readings.append((f"{PLACE}/{channel}", joint))
    return readings


def _without(name: str, run: re.Match[str]) -> str:
    """A name with the place of a joint in it marked."""
    return f"{name[: run.start()]}{PLACE}{name[run.end() :]}"


def named_in_rows(labels: Sequence[str], texts: Mapping[str, str]) -> dict[str, str]:
    """Joint's name by its label, where rows hold the names: `name0` beside `position0`.

    Args:
        labels: Of the joints.
        texts: Columns that hold one and the same text.

    Returns:
        Empty where they don't.
    """
    members: Members = defaultdict(dict)
    for column, text in texts.items():
        for template, label in _readings(column, {}):
            members[template][label] = text
    for by_label in members.values():
        names = [by_label.get(label, "") for label in labels]
        if all(names) and len(set(names)) == len(names):
            return dict(zip(labels, names, strict=True))
    return {}
