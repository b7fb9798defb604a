"""Which joints of a robot are an arm, and which are fingers, a head, wheels or another arm."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator

from ident.robot.urdf_elements import (
    children_of_links,
    is_moving,
    link_of,
    moving_joints,
    name_of,
)

# A branch with more joints than a finger has is another arm.
MOST_FINGER_JOINTS = 4


class _Tree:
    """A robot's joints by the links that they hang from."""

    def __init__(self, root: ET.Element) -> None:
        self.children = children_of_links(root)
        child_links = {link_of(joint, "child") for joint in root.findall("joint")}
        bases = (link.get("name") for link in root.findall("link"))
        self.base = next((name for name in bases if name not in child_links), None)

    def beyond(self, joint: ET.Element) -> list[ET.Element]:
        """Joints that hang from a joint's link."""
        return self.children.get(link_of(joint, "child"), [])

    def moving_from(self, joint: ET.Element) -> list[str]:
        """Names of the joints that move, from one of them on."""
        names = []
        coming = [joint]
        while coming:
            element = coming.pop()
            if is_moving(element):
                names.append(name_of(element))
            coming += reversed(self.beyond(element))
        return names

    def length(self, joint: ET.Element) -> int:
        """The most moving joints one after the other, from one of them on."""
        longest = 0
        coming = [(joint, 0)]
        while coming:
            element, before = coming.pop()
            so_far = before + is_moving(element)
            longest = max(longest, so_far)
            coming += [(child, so_far) for child in self.beyond(element)]
        return longest


def gripper_joints(root: ET.Element) -> list[str]:
    """Names of the joints beside and beyond the arm, by which it is no longer a chain.

    Fingers, a head, wheels. At a fork the arm goes on in the branch that is as long as an arm (more
    than `MOST_FINGER_JOINTS` joints one after the other). Where no branch is, or the joints before
    the fork are an arm already, they are fingers. Empty where which branch is the arm can't be
    known: several are long enough, or none is and they begin at the base.
    """
    tree = _Tree(root)
    beside: list[str] = []
    arm_joints = 0
    link = tree.base
    while link is not None:
        alive = [joint for joint in tree.children.get(link, []) if tree.moving_from(joint)]
        onward = alive
        if len(alive) > 1:
            long = [joint for joint in alive if tree.length(joint) > MOST_FINGER_JOINTS]
            if arm_joints and (not long or arm_joints > MOST_FINGER_JOINTS):
                return [*beside, *_names(tree, alive)]
            if len(long) != 1:
                return []
            onward = long
        beside += _names(tree, [joint for joint in alive if joint not in onward])
        if not onward:
            return beside
        arm_joints += is_moving(onward[0])
        link = link_of(onward[0], "child")
    return beside


def _names(tree: _Tree, joints: list[ET.Element]) -> Iterator[str]:
    """Names of the joints that move in some branches."""
    for joint in joints:
        yield from tree.moving_from(joint)


def arm_tips(text: str) -> list[str]:
    """The last joint of each arm of a robot of several, longest first.

    Fingers at an arm's end are none of it.
    """
    root = ET.fromstring(text)
    chains = [joints_to_base(root, joint) for joint in moving_joints(root)]
    branches = Counter(names[1] for names in chains if len(names) > 1)
    arms = [_without_fingers(names, branches) for names in chains if names[0] not in branches]
    arms.sort(key=len, reverse=True)
    return list(dict.fromkeys(names[0] for names in arms))


def _without_fingers(names: list[str], branches: Counter[str]) -> list[str]:
    """A chain, from its last joint to the base, without the fingers at its end.

    Args:
        names: Of its joints.
        branches: How many joints hang from each joint of the robot.
    """
    start = 0
    for place, name in enumerate(names[1:], start=1):
        forks = branches[name] > 1
        if forks and place - start <= MOST_FINGER_JOINTS < len(names) - place:
            start = place
    return names[start:]


def joints_to_base(root: ET.Element, joint: ET.Element) -> list[str]:
    """Names of the moving joints from one of them back to the base, itself first if it moves."""
    above = {link_of(element, "child"): element for element in root.findall("joint")}
    names: list[str] = []
    current: ET.Element | None = joint
    while current is not None:
        if is_moving(current):
            names.append(name_of(current))
        current = above.get(link_of(current, "parent"))
    return names
