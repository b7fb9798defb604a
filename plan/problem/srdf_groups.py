"""Groups of joints and named states of an SRDF file, as a scene file uses them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from ident.errors import InputError
from ident.robot.arm import ArmModel
from plan.geometry.pairs import read_srdf
from plan.problem.scene_keys import SceneTable


@dataclass(frozen=True)
class SrdfGroups:
    """What an SRDF file says of joints."""

    joints: Mapping[str, tuple[str, ...]]  # of each group, those of the arm, base to tip
    # Positions of joints [rad or m] of each named state, by its group and name.
    states: Mapping[tuple[str, str], Mapping[str, float]]

    def __str__(self) -> str:
        words = [
            f"{name} ({len(joints)}: {', '.join(joints)})"
            for name, joints in self.joints.items()
            if joints
        ]
        return "; ".join(words) or "none"


def read_groups(path: Path, arm: ArmModel) -> SrdfGroups:
    """Groups and states of a robot's SRDF.

    Raises:
        InputError: Not an SRDF file, that of another robot, or a state whose value is no number.
    """
    root = read_srdf(path, arm)
    elements = {str(group.get("name")): group for group in root.findall("group")}
    joints = {name: _joints_of(name, elements, arm, ()) for name in elements}
    states = {}
    for state in root.findall("group_state"):
        values = {}
        for joint in state.findall("joint"):
            values[str(joint.get("name"))] = _value(path, joint)
        states[str(state.get("group")), str(state.get("name"))] = values
    ordered = {}
    for name, members in joints.items():
        ordered[name] = tuple(joint for joint in arm.joint_names if joint in members)
    return SrdfGroups(ordered, states)


def _value(path: Path, joint: ElementTree.Element) -> float:
    """The position that a state gives a joint [rad or m]."""
    try:
        value = float(joint.get("value", ""))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        what = f"the state's {joint.get('name')} has the value {joint.get('value')!r}"
        raise InputError(path, what, "give a number")
    return value


def _joints_of(
    name: str, elements: Mapping[str, ElementTree.Element], arm: ArmModel, above: tuple[str, ...]
) -> set[str]:
    """Joints that a group names, or that its chains and its other groups hold."""
    if name in above or name not in elements:
        return set()
    group = elements[name]
    members = {str(joint.get("name")) for joint in group.findall("joint")}
    moved = {str(frame.name): int(frame.parentJoint) for frame in arm.model.frames}
    for chain in group.findall("chain"):
        base = str(chain.get("base_link"))
        tip = str(chain.get("tip_link"))
        if tip in moved:
            members |= set(arm.joint_names[moved.get(base, 0) : moved[tip]])
    for inner in group.findall("group"):
        members |= _joints_of(str(inner.get("name")), elements, arm, (*above, name))
    return members


def give_states(top: SceneTable, arm: ArmModel) -> None:
    """Puts the angles of named states in place of their names, and looks at how many joints of
    which group move.

    Raises:
        InputError: There is no SRDF, it has no such group or state, or a group's joints are not as
        many as angles.
    """
    task = top.table("task")
    if "srdf" not in top:
        key = next(key for key in ("group", "start_state", "goal_state") if key in task)
        raise task.fault(key, "needs an SRDF", 'add srdf = "…" at the top of the file')
    groups = read_groups(top.file.parent / top["srdf"], arm)
    name = task["group"]
    if name is not None and name not in groups.joints:
        raise task.fault(
            "group",
            f"is {name!r}, which the SRDF does not have",
            f"use one of: {', '.join(groups.joints)}",
        )
    entry = dict(task.entry)
    for end in ("start", "goal"):
        if f"{end}_state" in task:
            joints, values = _state(task, f"{end}_state", name, groups)
            entry[f"{end}_deg"] = _given(arm, joints, values)
            del entry[f"{end}_state"]
            name = name or _group_of(joints, groups)
    top.entry = {**top.entry, "task": entry}
    start = entry.get("start_deg")
    count = len(start) if isinstance(start, list) else 0
    _require_group(task, name, count, groups, arm)


def _state(
    task: SceneTable, key: str, group: str | None, groups: SrdfGroups
) -> tuple[tuple[str, ...], Mapping[str, float]]:
    """Joints and values of a named state."""
    named = task[key]
    fitting = [pair for pair in groups.states if pair[1] == named and group in (None, pair[0])]
    if not fitting:
        names = (
            ", ".join(sorted({state for of, state in groups.states if group in (None, of)}))
            or "none"
        )
        raise task.fault(key, f"is {named!r}, which the SRDF does not have", f"use one of: {names}")
    if len(fitting) > 1:
        owners = ", ".join(of for of, _ in fitting)
        raise task.fault(
            key, f"{named!r} is a state of several groups ({owners})", "name task.group"
        )
    values = groups.states[fitting[0]]
    joints = groups.joints.get(fitting[0][0], ())
    missing = [joint for joint in joints if joint not in values]
    if missing or not joints:
        what = f"{named!r} says nothing of {', '.join(missing) or 'a joint of this arm'}"
        raise task.fault(key, what, "give the angles")
    return joints, values


def _given(arm: ArmModel, joints: tuple[str, ...], values: Mapping[str, float]) -> list[float]:
    """Positions as a scene file has them: degrees, of joints that slide metres."""
    slides = dict(zip(arm.joint_names, arm.sliding_joints, strict=True))
    return [values[joint] if slides[joint] else math.degrees(values[joint]) for joint in joints]


def _group_of(joints: tuple[str, ...], groups: SrdfGroups) -> str | None:
    """The first group of just these joints."""
    return next((name for name, members in groups.joints.items() if members == joints), None)


def _require_group(
    task: SceneTable, name: str | None, count: int, groups: SrdfGroups, arm: ArmModel
) -> None:
    """Raises InputError where the angles are not those of a group.

    Or, if none is named, of the arm or of any group.
    """
    if name is not None:
        joints = groups.joints[name]
        if joints != arm.joint_names[: len(joints)]:
            first = arm.joint_names[0]
            what = f"{name!r} has the joints {', '.join(joints)}, the arm begins with {first}"
            raise task.fault("group", what, "use a group of the arm's first joints")
        if count != len(joints):
            what = (
                f"has {count} angles, group {name!r} has {len(joints)} joints: {', '.join(joints)}"
            )
            raise task.fault("start_deg", what, f"give {len(joints)}")
        return
    sizes = {
        len(joints) for joints in groups.joints.values() if joints == arm.joint_names[: len(joints)]
    }
    if any(groups.joints.values()) and count and count not in {arm.n, *sizes}:
        what = f"has {count} angles, the arm has {arm.n} joints, and the SRDF the groups {groups}"
        raise task.fault(
            "start_deg", what, "give as many angles as the arm or a group has, or name task.group"
        )
