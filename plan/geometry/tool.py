"""What the arm carries, and on which of its frames it hangs.

That is the URDF's tip frame, if nothing else is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ident.errors import RobotError
from ident.recordings.recording import Payload
from plan.geometry.solids import Box

if TYPE_CHECKING:  # a scene file is read before anything heavy is loaded
    import pinocchio as pin

    from ident.robot.arm import ArmModel

# Where bodies of what is carried begin to be numbered: none of them is a neighbour of a link, or of
# another of them.
CARRIED = 1000
# Names by which makers mean where a tool is fixed, or where it acts, the first before the last.
TIPS = ("tcp", "tool0", "tool_frame", "flange")


@dataclass(frozen=True, eq=False)
class Carried:
    """A shape that the arm carries."""

    box: Box  # the shape in its link's frame
    link: str | None = None  # that link or frame; the arm's tip frame if None
    touches: tuple[str, ...] = ()  # links that it may touch


def find_tip(arm: ArmModel) -> str:
    """The frame in which a tool is usually given: by its name, or else the farthest out.

    That is as far out as the links beyond the last joint go.

    They go no farther than to where they fork, and not beyond the joints of a gripper.
    """
    frames = arm.model.frames
    bodies = []
    for number, frame in enumerate(frames):
        if frame.type.name == "BODY" and frame.parentJoint == arm.n:
            bodies.append(number)
    by_name = {str(frames[number].name): number for number in bodies}
    for word in TIPS:
        endings = ("_" + word, "/" + word, "-" + word)
        for name in by_name:
            if name == word or name.endswith(endings):
                return name
    tip = by_name[arm.links[-1]]
    while True:
        beyond = [body for body in bodies if _parent_body(arm, body) == tip]
        if len(beyond) != 1 or _joint_name(arm, beyond[0]) in arm.locked_joints:
            return str(frames[tip].name)
        tip = beyond[0]


def _parent_body(arm: ArmModel, body: int) -> int:
    """Frame of the body on whose joint a body hangs."""
    frames = arm.model.frames
    return int(frames[frames[body].parentFrame].parentFrame)


def _joint_name(arm: ArmModel, body: int) -> str:
    """Name of the joint on which a body hangs."""
    frames = arm.model.frames
    return str(frames[frames[body].parentFrame].name)


def find_frame(arm: ArmModel, link: str | None, key: str) -> pin.Frame:
    """The frame of a link, or any other frame of the arm; the tip frame without a name.

    Raises:
        RobotError: The arm has no frame of that name.

    Args:
        arm: The arm.
        link: A frame's name; None for the tip.
        key: The scene file's key that named it, for the message.
    """
    name = find_tip(arm) if link is None else link
    frames = arm.model.frames
    named = [frame for frame in frames if frame.name == name]
    if not named:
        names = dict.fromkeys(frame.name for frame in frames if frame.name != "universe")
        remedy = f"use one of: {', '.join(names)}"
        raise RobotError(arm.source or arm.name, f"{key}: no link {name!r}", remedy)
    return named[-1]


def hang(
    arm: ArmModel, carried: Sequence[Carried], payload: Payload | None, link: str | None
) -> tuple[tuple[Carried, ...], Payload | None, tuple[dict[str, object], ...]]:
    """What is carried, each with the name of its frame; a payload in that of the last link.

    And both as results tell them.

    Args:
        arm: The arm.
        carried: Shapes.
        payload: Mass, its centre in the frame of `link`.
        link: That frame; the tip frame if None.

    Raises:
        RobotError: No such frame, or one of the payload that the last joint does not move.
    """
    named = []
    told: list[dict[str, object]] = []
    for shape in carried:
        frame = find_frame(arm, shape.link, f"{shape.box.name}: link")
        named.append(replace(shape, link=str(frame.name)))
        told.append({"name": shape.box.name, "link": str(frame.name)})
    if payload is None:
        return tuple(named), None, tuple(told)
    frame = find_frame(arm, link, "payload.link")
    if frame.parentJoint != arm.n:
        last = arm.joint_names[-1]
        what = f"payload.link: {frame.name!r} is not moved by the last joint, {last}"
        remedy = f"name a link beyond it, such as {find_tip(arm)}"
        raise RobotError(arm.source or arm.name, what, remedy)
    x, y, z = frame.placement.act(np.array(payload.com_m, dtype=float))
    placed = replace(payload, com_m=(float(x), float(y), float(z)))
    told.append(
        {
            "name": "payload",
            "link": str(frame.name),
            # As they were given.
            "mass_kg": payload.mass_kg,
            "com_m": list(payload.com_m),
        }
    )
    return tuple(named), placed, tuple(told)


def place_carried(arm: ArmModel, links: Sequence[Box], carried: Sequence[Carried]) -> list[Box]:
    """The arm's shapes and what it carries, each in the frame of the joint that moves it.

    From the base on.

    Raises:
        RobotError: A shape hangs on, or may touch, a link that is none of the arm's.
    """
    known = list(dict.fromkeys(box.name for box in links))
    placed = []
    for number, shape in enumerate(carried):
        for name in shape.touches:
            if name not in known:
                what = f"touches: no link {name!r} with a shape"
                remedy = f"links: {', '.join(known)}"
                raise RobotError(arm.source or arm.name, what, remedy)
        frame = find_frame(arm, shape.link, f"{shape.box.name}: link")
        turn = frame.placement.rotation
        place = frame.placement.translation
        box = shape.box
        rotation = turn @ box.rotation
        centre = turn @ box.centre + place
        body = CARRIED + 2 * number
        placed.append(Box(box.name, frame.parentJoint, rotation, centre, box.solid, body))
    return sorted([*links, *placed], key=lambda box: box.joint)
