"""SRDF files: the pairs of links that a robot's maker says need not be checked."""

from __future__ import annotations

from pathlib import Path

import pinocchio as pin

from ident.robot.arm import ArmModel
from ident.safe_read import read_text, read_xml
from plan.errors import SceneError


def read_disabled(path: Path, arm: ArmModel) -> dict[frozenset[str], str]:
    """Pairs of links that an SRDF file leaves out of checks, and the reason that it gives.

    Raises:
        SceneError: Not an SRDF file, or that of another robot.
    """
    if not path.exists():
        raise SceneError(path, "no such SRDF file", "give its path, from the scene file on")
    text = read_text(path, "give an SRDF file", SceneError)
    root = read_xml(text, path, "give an SRDF file", SceneError)
    if root.tag != "robot":
        raise SceneError(path, f"the root element is <{root.tag}>, not <robot>", "give an SRDF file")
    if root.get("name") != arm.name:
        raise SceneError(
            path, f"it is the SRDF of {root.get('name')!r}, the robot is {arm.name!r}", "give this robot's SRDF"
        )
    links = {frame.name for frame in arm.model.frames if frame.type == pin.FrameType.BODY}
    found = {}
    for element in root.findall("disable_collisions"):
        pair = [element.get("link1", ""), element.get("link2", "")]
        unknown = [name for name in pair if name not in links]
        if unknown:
            raise SceneError(path, f"the robot has no link {unknown[0]!r}", "give this robot's SRDF")
        found[frozenset(pair)] = f"left out by {path.name}: {element.get('reason', 'no reason given')}"
    return found
