"""Which columns of a foreign table are which channels of which joints: by their names, else by what their numbers say.

Columns that differ only in a number or in a joint's name are a family, such as `actual_q_0` … `actual_q_5`. The words
of the family's name say what it holds. Names of Universal Robots' RTDE, libfranka, ROS and LeRobot are among them.
"""

from __future__ import annotations

import re
import tomllib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

import numpy as np

from ident.arrays import Array
from ident.checks.effort import States, check_effort, collect_states, fit_signed
from ident.checks.filtered_run import USUAL_EFFORT
from ident.errors import RecordingError
from ident.infer.guess import ForeignTable, Reason, Signals
from ident.recordings.columns import listed, map_by_ending
from ident.recordings.lerobot import ENDINGS, joint_name
from ident.recordings.recording import Recording, Session
from ident.records import read_group
from ident.robot.arm import ArmModel

LIMIT = read_group(__file__, "unnamed")

WORDS = tomllib.loads(Path(__file__).with_name("words.toml").read_text(encoding="utf-8"))
TIMES, COMMANDS, DERIVED, MEASURED_AS = (
    frozenset(WORDS["others"][name]) for name in ("times", "commands", "derived", "measured")
)
# Words of a channel that may end another, for no short one does (`Istwinkel`).
GLUED = {name: tuple(one for one in known if len(one) > 4) for name, known in WORDS["channels"].items()}
COMMANDED = {"position": "position_command", "velocity": "velocity_command", "effort": "effort_command"}
PLACE = "#"
# What tells columns of one family apart: a number, or the letter of an axis.
NUMBER = re.compile(r"\d+|(?<![A-Za-z])[A-Z](?![A-Za-z])")
UNIT = re.compile(
    r"\s*[\[(]((?:°|deg|grad|degrees|rad|m?m|k?n[ ·]?m|n|m?a|%)(?:/s(?:\^?2|²)?)?)[\])]",
    re.IGNORECASE,
)
# A joint that slides has a force where the others have a torque.
FORCES = {"force": "torque", "Force": "Torque", "FORCE": "TORQUE"}


@dataclass(frozen=True)
class ColumnFamily:
    """Columns of one quantity, one a joint."""

    template: str  # their common name, the place of the joint marked
    columns: tuple[str, ...]  # their names, in the joints' order
    labels: tuple[str, ...]  # what stands at the place: numbers or joints' names
    channel: str | None  # what they hold; None where their names don't say
    doubt: int  # words that speak against it; fewer is better


def words_of(template: str) -> list[str]:
    """The words of a name, in lower case."""
    parted = re.sub(r"([a-z])([A-Z])", r"\1 \2", template)
    return [word for word in re.split(r"[^A-Za-z]+", parted.lower()) if word]


def judge_words(template: str) -> tuple[str | None, int]:
    """The channel that a name speaks of, and how much speaks against it."""
    words = words_of(template.rpartition("/")[2] or template) if ":" not in template else words_of(template)
    if "current" in words and ("torque" in words or "effort" in words):
        words = [word for word in words if word != "current"]  # a torque made of the current
    commanded = any(word in COMMANDS or word.startswith("soll") for word in words)
    measured = bool({*words} & MEASURED_AS)
    said = (
        name for name in GLUED if any(word in WORDS["channels"][name] or word.endswith(GLUED[name]) for word in words)
    )
    channel = next(said, None)
    if channel is None:
        return ("position_command" if commanded else "position" if measured else None), 0
    doubt = 3 * len({*words} & DERIVED) - measured
    return (COMMANDED.get(channel) if commanded else channel), doubt


def find_time(names: Sequence[str]) -> str | None:
    """The column whose name says time."""
    ranked = [(words_of(name), name) for name in names]
    plain = [name for words, name in ranked if words and all(word in (*TIMES, "s", "ms", "us", "ns") for word in words)]
    some = [name for words, name in ranked if set(words) & (TIMES - {"t"})]
    return next(iter([*plain, *some]), None)


def _find_rising(table: ForeignTable) -> str | None:
    """The first column that rises evenly; one that counts samples only where there is no other."""
    counter = None
    for name, values in table.columns.items():
        steps = np.diff(np.asarray(values, dtype=float))
        usual = float(np.median(steps)) if len(steps) else 0.0
        if usual > 0.0 and np.mean((steps > 0.0) & (np.abs(steps - usual) < LIMIT.even * usual)) > LIMIT.nearly_all:
            if np.any(steps != 1.0):
                return name
            counter = counter or name
    return counter


def find_families(names: Sequence[str], joints: Sequence[str]) -> list[ColumnFamily]:
    """Families of columns."""
    members: dict[str, dict[str, str]] = defaultdict(dict)
    # Joints' names, and what is left of them without the word joint -> the joint's place.
    shorts = {name: i for i, name in enumerate(joints)}
    for i, name in enumerate(joints):
        shorts.setdefault(re.sub(r"_?joint_?", "", name, flags=re.IGNORECASE) or name, i)
    shorts = {name: i for name, i in shorts.items() if len(name) > 1 and not name.isdecimal()}
    for name in names:
        for template, label in _readings(UNIT.sub("", name), shorts):
            members[template].setdefault(label, name)
    for template in list(members):
        for force, torque in FORCES.items():
            twin = template.replace(force, torque)
            if twin != template and twin in members and not {*members[twin]} & {*members[template]}:
                members[twin] |= members.pop(template)
                break
    found = []
    for template, by_label in members.items():
        labels = list(by_label)
        if all(label.isdecimal() for label in labels):
            labels.sort(key=int)
            if [int(label) - int(labels[0]) for label in labels] != list(range(len(labels))):
                continue
        elif shorts and all(label in shorts for label in labels):
            labels.sort(key=lambda label: shorts[label])
        if len(labels) > 1:
            own = tuple(by_label[label] for label in labels)
            channel, doubt = judge_words(template)
            unit = "".join(UNIT.findall(own[0])[:1]).lower()
            channel = channel or next((name for name, known in WORDS["units"].items() if unit in known), None)
            found.append(ColumnFamily(template, own, tuple(labels), channel, doubt))
    return sorted(found, key=lambda family: family.doubt)


def _readings(name: str, shorts: dict[str, int]) -> list[tuple[str, str]]:
    """All ways to see a joint in a column's name: (template, label)."""
    found = []
    for short in sorted(shorts, key=len, reverse=True):
        if short in name:
            found.append((name.replace(short, PLACE, 1), short))
            break
    found += [(f"{name[: run.start()]}{PLACE}{name[run.end() :]}", run.group()) for run in NUMBER.finditer(name)]
    ending = next((one for one in ENDINGS if name.endswith(one)), "")
    head, dot, label = name.removesuffix(ending).rpartition(".")
    if dot and not label.isdecimal():
        found.append((f"{head}.{PLACE}{ending}", joint_name(label)))
        if judge_words(label)[0]:  # a drive's trace names the axis first: `Z.ActPos`, `A2.ActPos`
            found.append((f"{PLACE}.{label}", head))
    if "/" in name and ":" not in name:
        joint, _, channel = name.rpartition("/")
        found.append((f"{PLACE}/{channel}", joint))
    return found


MEASURED = ("effort", "current")
# Channels that a session takes, beside position; torque comes first where there is current too.
FURTHER = ("velocity", "effort", "current", "position_command", "velocity_command", "temperature")


def guess_by_name(table: ForeignTable, arm: ArmModel | None) -> Signals | None:
    """Finds the channels by the columns' names; None where no family of columns is a position.

    Raises:
        RecordingError: There is a position, but neither torque, current nor goal.
    """
    names = list(table.columns)
    clock = find_time(names) or _find_rising(table)
    families = find_families([name for name in names if name != clock], () if arm is None else arm.joint_names)
    position, unnamed = _choose(families, "position", arm), ""
    if position is None and arm is not None and any(_choose(families, one, arm, arm.n) for one in MEASURED):
        others = {one.columns: one for one in families if one.channel is None and len(one.columns) >= arm.n}
        position, unnamed = others.popitem()[1] if len(others) == 1 else None, "the only others of as many joints, "
    if position is None:
        return None
    count = len(position.columns) if arm is None else min(len(position.columns), arm.n)
    chosen = {"position": position}
    for channel in FURTHER:
        family = _choose(families, channel, arm, count)
        if family is not None and not (channel == "current" and "effort" in chosen):
            chosen[channel] = family
    if not {*MEASURED, "position_command"} & set(chosen):
        what = f"no columns are named as torque or current of the {count} joints"
        remedy = f"name them in [columns] of session.toml yourself; there are: {listed(names)}"
        raise RecordingError(table.source, what, remedy)
    wanted, joints, why = _joints(position, arm, count, table.texts)
    columns = {}
    for channel, family in chosen.items():  # in the order of the position's joints, where the labels are the same
        own = dict(zip(family.labels, family.columns, strict=True))
        columns[channel] = tuple(own[one] for one in wanted) if {*wanted} <= {*own} else family.columns[: len(wanted)]
    time = np.arange(len(table.columns[names[0]]), dtype=float) if clock is None else table.columns[clock]
    said = "its name says so" if clock == find_time(names) else "the first column that rises evenly"
    reasons = [] if clock is None else [Reason("time", repr(clock), said)]
    for channel, family in chosen.items():
        span = f"{columns[channel][0]!r} to {columns[channel][-1]!r}"
        why_so = unnamed if family is position else ""
        reasons.append(Reason(channel, span, f"{why_so}named {family.template.replace('#', '…')!r}"))
    reasons.append(Reason("joints", ", ".join(joints), why))
    alike = (position.channel, position.doubt, len(position.columns))
    for other in families:
        if (other.channel, other.doubt, len(other.columns)) == alike and not {*other.columns} & {*position.columns}:
            mine, theirs = (one.template.replace(PLACE, "…") for one in (position, other))
            why = f"{theirs} are as many: for that arm name its columns in a session of its own"
            reasons.append(Reason("arm", mine, why))
            break
    tables = {channel: np.column_stack([table.columns[name] for name in own]) for channel, own in columns.items()}
    return Signals(joints, columns, tables, clock, time, tuple(reasons))


def _choose(families: list[ColumnFamily], channel: str, arm: ArmModel | None, least: int = 2) -> ColumnFamily | None:
    """The family of a channel against which least speaks; of equal ones the first that has as many as the robot."""
    own = [family for family in families if family.channel == channel and len(family.columns) >= least]
    if arm is not None:
        own.sort(key=lambda family: (family.doubt, len(family.columns) < arm.n))
    return own[0] if own else None


def named_in_rows(labels: Sequence[str], texts: Mapping[str, str]) -> dict[str, str]:
    """Joint's name by its label, where rows hold the names: `name0` beside `position0`; empty where they don't."""
    found: dict[str, dict[str, str]] = defaultdict(dict)
    for column, text in texts.items():
        for template, label in _readings(column, {}):
            found[template][label] = text
    for by_label in found.values():
        names = [by_label.get(label, "") for label in labels]
        if all(names) and len(set(names)) == len(names):
            return dict(zip(labels, names, strict=True))
    return {}


def _joints(
    position: ColumnFamily, arm: ArmModel | None, count: int, texts: Mapping[str, str]
) -> tuple[tuple[str, ...], tuple[str, ...], str]:
    """Labels of the joints that are taken, what they are called, and why."""
    said = named_in_rows(position.labels, texts)
    kept = [label for label, name in said.items() if arm is None or name in arm.joint_names]
    if kept:
        names = tuple(said[label] for label in kept)
        return tuple(kept), names, f"the rows name them: {', '.join(said[label] for label in kept)}"
    labels, numbered = position.labels[:count], all(label.isdecimal() for label in position.labels)
    if arm is None:
        names = tuple(f"joint_{i + 1}" for i in range(count)) if numbered else labels
        return labels, names, "numbered by the file" if numbered else "named by the file"
    own = tuple(label for label in position.labels if label in arm.joint_names)  # a whole robot's log has more
    matched = own
    if not own and not numbered:
        inside = [[name for name in arm.joint_names if label in name] for label in position.labels]
        renamed = map_by_ending(position.labels, arm.joint_names)
        if all(len(found) == 1 for found in inside) and len({found[0] for found in inside}) == len(inside):
            matched = tuple(found[0] for found in inside)
        elif set(position.labels) <= set(renamed):
            matched = tuple(renamed[label] for label in position.labels)
    if matched:
        return own or labels, matched[: arm.n], "the file's names are the robot's"
    robot = arm.joint_names[:count]
    return labels, robot, f"the file's {', '.join(labels)} in the robot's order, base to tip"


HINT = "name its columns in [columns] of session.toml yourself"
ONE_TABLE = f"put them side by side in one table or .npz (time, position, velocity, effort); without velocity, {HINT}"


def guess_by_data(table: ForeignTable, arm: ArmModel) -> Signals:
    """Finds time, position, velocity and torque among columns without names.

    Raises:
        RecordingError: No columns move as this robot's joints do.
    """
    names, values = list(table.columns), np.column_stack(list(table.columns.values()))
    rising = _find_rising(table)
    clock = None if rising is None else names.index(rising)
    time = np.arange(len(values), dtype=float) if clock is None else values[:, clock]
    start = 0 if clock is None else clock + 1
    count = (len(names) - start) // arm.n
    blocks = [np.arange(start + k * arm.n, start + (k + 1) * arm.n) for k in range(count)]
    if count < LIMIT.fewest_channels:
        least = LIMIT.fewest_channels * arm.n
        what = f"columns of numbers: {len(names)}; position, velocity and torque of {arm.n} joints are {least}"
        raise RecordingError(table.source, what, ONE_TABLE)
    pair = _find_motion(values, blocks, time)
    if pair is None:
        what = f"no {arm.n} columns are the derivative of {arm.n} others"
        raise RecordingError(table.source, what, HINT)
    position, velocity, match = pair
    reasons = [] if clock is None else [Reason("time", f"column {names[clock]}", "the first column that rises evenly")]
    seen = f"columns {_span(names, blocks[velocity])} are their derivative (correlation {match:.3f})"
    reasons.append(Reason("position", f"columns {_span(names, blocks[position])}", seen))
    rest = [k for k in range(count) if k not in (position, velocity)]
    torque, channel, why = _find_torque(values, blocks, rest, (position, velocity), time, arm)
    if torque is None:
        raise RecordingError(table.source, "no columns follow the torque that this robot needs", HINT)
    reasons.append(Reason(channel, f"columns {_span(names, blocks[torque])}", why))
    chosen = {"position": position, "velocity": velocity, channel: torque}
    columns = {name: tuple(names[i] for i in blocks[k]) for name, k in chosen.items()}
    tables = {name: values[:, blocks[k]] for name, k in chosen.items()}
    return Signals(arm.joint_names, columns, tables, rising, time, tuple(reasons))


def _find_motion(values: Array, blocks: list[Array], time: Array) -> tuple[int, int, float] | None:
    """Blocks of position, itself no derivative, and velocity; of several the noisier, for commands have no noise."""
    found, step, half = [], LIMIT.stride, LIMIT.stride // 2
    for p, v in permutations(range(len(blocks)), 2):
        q, dq = values[:, blocks[p]], values[:, blocks[v]]
        derived = (q[step:] - q[:-step]) / np.maximum(time[step:] - time[:-step], 1e-12)[:, None]
        middle = dq[half : len(dq) - step + half]
        moving = derived.std(axis=0) > 1e-9 * max(float(np.abs(derived).max()), 1e-300)
        if moving.any():
            one, other = (values[:, moving] - values[:, moving].mean(axis=0) for values in (derived, middle))
            scale = np.maximum(one.std(axis=0) * other.std(axis=0), 1e-300)
            match = float(np.median((one * other).mean(axis=0) / scale))
            found.append((match, _noise(dq), p, v))
    good = [one for one in found if one[0] > LIMIT.same_motion]
    best = max((one for one in good if one[2] not in {v for *_, v in good}), key=lambda one: one[1], default=None)
    return None if best is None else (best[2], best[3], best[0])


def _find_torque(
    values: Array, blocks: list[Array], rest: list[int], motion: tuple[int, int], time: Array, arm: ArmModel
) -> tuple[int | None, str, str]:
    """The block that follows the model's torque but is no model itself, its channel, and why."""
    position, velocity = (values[:, blocks[k]] for k in motion)
    found: list[tuple[float, float, int, str, str]] = []
    for k in rest:
        run = Recording("guess", arm.joint_names, time, position, values[:, blocks[k]], velocity=velocity)
        session = Session("guess", (run,))
        states = collect_states(session, arm)
        if states is None or not states.alive.any():
            continue
        explained, scale = follow(states)
        computed = any(issue.issue == "effort_is_model" for issue in check_effort(session, arm, states))
        if computed or explained <= USUAL_EFFORT.follows:
            continue
        channel = "effort" if USUAL_EFFORT.scale_low < scale < USUAL_EFFORT.scale_high else "current"
        why = f"the robot's gravity, inertia and friction explain {100.0 * explained:.0f} % of them"
        why += f", gravity at {scale:.2g} times"
        found.append((explained, _noise(values[:, blocks[k]]), k, channel, f"{why} its size"))
    best = max(found, default=None)
    if best is None:
        return None, "", ""
    # What is commanded follows the model as well as what is measured: only the measured one is noisy.
    alike = [one for one in found if one[0] > best[0] - LIMIT.as_good]
    _, _, k, channel, why = max(alike, key=lambda one: one[1])
    others = ", ".join(f"{blocks[one[2]][0] + 1} to {blocks[one[2]][-1] + 1}" for one in alike if one[2] != k)
    return k, channel, f"{why}; {others} as well, but smoother: a command" if others else why


def _noise(table: Array) -> float:
    """Second differences against the spread, the median over columns."""
    rough = np.abs(np.diff(table, 2, axis=0)).mean(axis=0)
    return float(np.median(rough / np.maximum(table.std(axis=0), 1e-300)))


def follow(states: States) -> tuple[float, float]:
    """How much of the torque the model explains, whatever its sign, and at what scale; medians over heavy joints."""
    heavy, alive = (np.flatnonzero(one) for one in (states.heavy & states.alive, states.alive))
    joints = map(int, heavy if len(heavy) else alive)
    fits = [max(fit_signed(states, j, sign) for sign in (1.0, -1.0)) for j in joints]
    return float(np.median([fit.explained for fit in fits])), float(np.median([fit.gravity for fit in fits]))


def _span(names: list[str], block: Array) -> str:
    return f"{names[block[0]]} to {names[block[-1]]}"
