"""What the arm carries, and on which of its frames it hangs: the URDF's tip frame, if nothing else is said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import Array
from ident.errors import RobotError
from ident.recordings.recording import Payload
from plan.geometry.solids import Box

if TYPE_CHECKING:  # a scene file is read before anything heavy is loaded
    import pinocchio as pin

    from ident.robot.arm import ArmModel

# Where bodies of what is carried begin to be numbered: none of them is a neighbour of a link, or of another of them.
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
    """The frame in which a tool is usually given: by its name, or as far out as the links beyond the last joint go.

    They go no farther than to where they fork, and not beyond the joints of a gripper.
    """
    frames = arm.model.frames
    bodies = [k for k, frame in enumerate(frames) if frame.type.name == "BODY" and frame.parentJoint == arm.n]
    by_name = {str(frames[k].name): k for k in bodies}
    for word in TIPS:
        for name in by_name:
            if name == word or name.endswith(("_" + word, "/" + word, "-" + word)):
                return name
    at = by_name[arm.links[-1]]
    while True:
        beyond = [k for k in bodies if frames[frames[k].parentFrame].parentFrame == at]
        if len(beyond) != 1 or frames[frames[beyond[0]].parentFrame].name in arm.locked_joints:
            return str(frames[at].name)
        at = beyond[0]


def find_frame(arm: ArmModel, link: str | None, key: str) -> pin.Frame:
    """The frame of a link, or any other frame of the arm; the tip frame without a name.

    Raises:
        RobotError: The arm has no frame of that name.
    """
    name = find_tip(arm) if link is None else link
    found = [frame for frame in arm.model.frames if frame.name == name]
    if not found:
        known = ", ".join(dict.fromkeys(frame.name for frame in arm.model.frames if frame.name != "universe"))
        raise RobotError(arm.source or arm.name, f"{key}: no link {name!r}", f"use one of: {known}")
    return found[-1]


def hang(
    arm: ArmModel, carried: Sequence[Carried], payload: Payload | None, link: str | None
) -> tuple[tuple[Carried, ...], Payload | None, tuple[dict[str, object], ...]]:
    """What is carried, each with the name of its frame; a payload in that of the last link; and both for results.

    Args:
        arm: The arm.
        carried: Shapes.
        payload: Mass, its centre in the frame of `link`.
        link: That frame; the tip frame if None.

    Raises:
        RobotError: No such frame, or one of the payload that the last joint does not move.
    """
    named = tuple(replace(one, link=str(find_frame(arm, one.link, f"{one.box.name}: link").name)) for one in carried)
    found: list[dict[str, object]] = [{"name": one.box.name, "link": one.link} for one in named]
    if payload is None:
        return named, None, tuple(found)
    frame = find_frame(arm, link, "payload.link")
    if frame.parentJoint != arm.n:
        what = f"payload.link: {frame.name!r} is not moved by the last joint, {arm.joint_names[-1]}"
        raise RobotError(arm.source or arm.name, what, f"name a link beyond it, such as {find_tip(arm)}")
    com = frame.placement.act(np.array(payload.com_m, dtype=float))
    placed = replace(payload, com_m=(float(com[0]), float(com[1]), float(com[2])))
    mass = {"mass_kg": payload.mass_kg, "com_m": list(payload.com_m)}  # as it was given
    return named, placed, (*found, {"name": "payload", "link": str(frame.name), **mass})


def place_carried(arm: ArmModel, links: Sequence[Box], carried: Sequence[Carried]) -> list[Box]:
    """The arm's shapes and what it carries, each in the frame of the joint that moves it, from the base on.

    Raises:
        RobotError: A shape hangs on, or may touch, a link that is none of the arm's.
    """
    known = list(dict.fromkeys(box.name for box in links))
    placed = []
    for number, one in enumerate(carried):
        for name in one.touches:
            if name not in known:
                what = f"touches: no link {name!r} with a shape"
                raise RobotError(arm.source or arm.name, what, f"links: {', '.join(known)}")
        frame = find_frame(arm, one.link, f"{one.box.name}: link")
        turn, place, box = frame.placement.rotation, frame.placement.translation, one.box
        at: tuple[Array, Array] = (turn @ box.rotation, turn @ box.centre + place)
        placed.append(Box(box.name, frame.parentJoint, *at, box.solid, CARRIED + 2 * number))
    return sorted([*links, *placed], key=lambda box: box.joint)
