"""The arm's shapes: its collision geometry as the URDF gives it, and what stands in where it gives none.

Without a shape there is nothing to prove. A link that the URDF gives no `<collision>` is named, and the arm refused,
unless the user says what is to stand in for it: its visual shapes, or capsules or boxes fitted to the link's length.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import coal
import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from ident.errors import RobotError
from ident.recordings.recording import TelemetryIssue
from ident.robot.arm import ArmModel
from plan.errors import MethodError
from plan.geometry.boxes import Box
from plan.geometry.convex_parts import convex_parts
from plan.geometry.solids import Solid

StandIn = Literal["visual", "capsules", "boxes"]
STAND_INS: tuple[StandIn, ...] = get_args(StandIn)
# Links weigh at least as much as water: a capsule of that density is thicker than the link, and errs on the safe side.
DENSITY = 1000.0
# Thinnest limb that is believed [m].
LEAST_RADIUS = 0.02
# Lighter bodies without a shape or a picture are frames of reference, not parts [kg].
WEIGHTLESS = 1e-3


@dataclass(frozen=True, eq=False)
class ArmShapes:
    """Shapes of an arm's links.

    Attributes:
        boxes: The shapes, in the order of their links along the arm.
        bare: Links without collision geometry, for which something stands in.
        stand_in: What does.
        meshes: Links that are meshes: name, number of convex parts, and by how much these hold more than the mesh, as a
            share of its volume; None of an open mesh, which has none.
    """

    boxes: tuple[Box, ...]
    bare: tuple[str, ...] = ()
    stand_in: StandIn | None = None
    meshes: tuple[tuple[str, int, float | None], ...] = ()

    @property
    def issue(self) -> TelemetryIssue | None:
        """What is to be told of the links without a shape; None where all have one."""
        if not self.bare:
            return None
        return TelemetryIssue(
            "no_shape",
            (),
            "warning",
            f"no <collision> of {', '.join(self.bare)}: {WORDS[self.stand_in or 'visual']} stand in",
            "add <collision> to these links",
        )

    @property
    def coarser(self) -> str:
        """How meshes are taken, in words; empty where there are none."""
        if not self.meshes:
            return ""
        known = [(share, name) for name, _, share in self.meshes if share is not None]
        excess, worst = max(known, default=(0.0, ""))
        parts = f"{len(self.meshes)} meshes of links count as {sum(count for _, count, _ in self.meshes)} convex parts"
        return parts + (f", {worst} with {100 * excess:.1f} % more volume than its mesh" if worst else "")

    def to_dict(self) -> dict[str, Any]:
        """What stands in for which links, the issue that reports it, and the convex parts of meshes."""
        issue = self.issue
        names = ("link", "parts", "excess_volume_share")
        return {
            "stand_in": {"shapes": self.stand_in, "links": list(self.bare)},
            "issues": [] if issue is None else [issue.to_dict()],
            "link_meshes": [dict(zip(names, mesh, strict=True)) for mesh in self.meshes],
        }


# Before any shape was read.
NO_SHAPES = ArmShapes(())
WORDS: dict[StandIn, str] = {
    "visual": "their visual shapes",
    "capsules": "capsules fitted to the links' lengths",
    "boxes": "boxes fitted to the links' lengths",
}


def arm_shapes(arm: ArmModel, wanted: str | None = None) -> ArmShapes:
    """The shapes of all links that move, and of the base.

    Args:
        arm: The arm.
        wanted: What stands in for links without collision geometry.

    Raises:
        RobotError: A link has no collision geometry and nothing may stand in, or its meshes can't be read.
        MethodError: No such stand-in.
    """
    stand_in = next((one for one in STAND_INS if one == wanted), None)
    if stand_in is None and wanted is not None:
        raise MethodError("--shapes", f"{wanted!r} is unknown", f"use one of: {', '.join(STAND_INS)}")
    meshes: list[tuple[str, int, float | None]] = []
    found = _read(arm, arm.geometry.geometryObjects, meshes)
    bare = bare_links(arm)
    if not bare:
        return ArmShapes(tuple(_ordered(arm, found)), meshes=tuple(meshes))
    where = arm.source or arm.name
    if stand_in is None:
        remedy = f"add <collision> to them, or say what stands in: --shapes {', '.join(STAND_INS[:-1])} or boxes"
        raise RobotError(where, f"no_shape: no <collision> of {_list(bare)}, so nothing is known to keep clear", remedy)
    if stand_in == "visual":
        frames = [one for one in arm.visual_geometry.geometryObjects if _name(arm, one) in bare]
        made = _read(arm, frames, meshes)
        without = [name for name in bare if name not in {box.name for box in made}]
        if without:
            raise RobotError(where, f"no_shape: {_list(without)}: no <visual> either", "use --shapes capsules or boxes")
    else:
        made = [_limb(arm, name, stand_in) for name in bare]
    return ArmShapes(tuple(_ordered(arm, [*found, *made])), bare, stand_in, tuple(meshes))


def bare_links(arm: ArmModel) -> tuple[str, ...]:
    """Links without collision geometry: those that have a picture, and whole bodies that have none but weigh something.

    Frames of reference, which have neither shape nor picture nor mass, are no parts.
    """
    links = {link.get("name", ""): link for link in ET.fromstring(arm.urdf).findall("link")}
    carried = {frame.name: frame.parentJoint for frame in arm.model.frames if frame.type == pin.FrameType.BODY}
    shaped = {carried[name] for name, link in links.items() if link.find("collision/geometry") is not None}
    bodies = [(name, link, carried[name]) for name, link in links.items() if name in carried]
    found = []
    for name, link, joint in bodies:
        if link.find("collision/geometry") is not None:
            continue
        if link.find("visual/geometry") is not None:
            found.append(name)
        elif joint not in shaped and _mass(link) > WEIGHTLESS:
            found.append(name)
            shaped.add(joint)  # one name a body is enough
    order = {name: i for i, name in enumerate(carried)}
    return tuple(sorted(found, key=lambda name: order[name]))


def _mass(link: ET.Element) -> float:
    element = link.find("inertial/mass")
    return 0.0 if element is None else float(element.get("value", "0"))


def _list(names: tuple[str, ...] | list[str]) -> str:
    some = ", ".join(names[:6])
    return some if len(names) <= 6 else f"{some} and {len(names) - 6} more"


def _read(
    arm: ArmModel, objects: Sequence[pin.GeometryObject], meshes: list[tuple[str, int, float | None]]
) -> list[Box]:
    """Boxes round Pinocchio's geometry objects; the exact shape is kept, a mesh as convex parts, which are entered."""
    found = []
    for shape in objects:
        name, solid = _name(arm, shape), simple_solid(shape.geometry)
        rotation, centre = shape.placement.rotation.copy(), shape.placement.translation.copy()
        if solid is not None:
            found.append(Box.around(name, solid, shape.parentJoint, rotation, centre, shape.parentFrame))
            continue
        parts = convex_parts(_triangles(arm, shape))
        meshes.append((name, len(parts.corners), parts.excess))
        found.append(Box.around_parts(name, parts.corners, shape.parentJoint, rotation, centre, shape.parentFrame))
    return found


def _name(arm: ArmModel, shape: pin.GeometryObject) -> str:
    return str(arm.model.frames[shape.parentFrame].name)


def _triangles(arm: ArmModel, shape: pin.GeometryObject) -> Float[Array, "m 3 3"]:
    """Corners of a mesh's triangles [m].

    Raises:
        RobotError: It has none, or one that is not finite.
    """
    model = shape.geometry
    points = np.array(model.vertices()) if hasattr(model, "vertices") else np.empty((0, 3))
    if len(points) < 3 or not np.isfinite(points).all():
        raise RobotError(
            arm.source or arm.name,
            f"link {_name(arm, shape)}: the mesh {shape.meshPath} has no finite triangle",
            "mend or replace that mesh",
        )
    corners = [[corner[k] for k in range(3)] for corner in map(model.tri_indices, range(model.num_tris))]
    return points[np.array(corners, dtype=np.int64).reshape(-1, 3)]


def simple_solid(geometry: coal.CollisionGeometry) -> Solid | None:
    """The solid of one of Coal's simple shapes; None for a mesh."""
    if isinstance(geometry, coal.Box):
        return Solid.simple("box", *geometry.halfSide)
    if isinstance(geometry, coal.Sphere):
        return Solid.simple("sphere", geometry.radius)
    if isinstance(geometry, coal.Capsule):
        return Solid.simple("capsule", geometry.radius, geometry.halfLength)
    if isinstance(geometry, coal.Cylinder):
        return Solid.simple("cylinder", geometry.radius, geometry.halfLength)
    return None


def _ordered(arm: ArmModel, boxes: list[Box]) -> list[Box]:
    """Base to tip, and bodies numbered in that order: Pinocchio lists frames so."""
    frames = sorted({box.body for box in boxes})
    ranked = sorted(boxes, key=lambda box: box.body)
    return [Box(b.name, b.joint, b.rotation, b.centre, b.half, frames.index(b.body), b.solid) for b in ranked]


def _limb(arm: ArmModel, link: str, stand_in: StandIn) -> Box:
    """A capsule or a box from a link's joint to the next, as thick as its mass lets it be."""
    number = arm.model.getFrameId(link, pin.FrameType.BODY)
    joint = int(arm.model.frames[number].parentJoint)
    a, b = np.zeros(3), _far_end(arm, joint)
    length = float(np.linalg.norm(b - a))
    radius = _radius(float(arm.model.inertias[joint].mass), length)
    axis = (b - a) / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    rotation = _turn_to(axis)
    if stand_in == "capsules":
        solid = Solid.simple("capsule", radius, length / 2)
    else:
        solid = Solid.simple("box", radius, radius, length / 2 + radius)
    return Box.around(link, solid, joint, rotation, (a + b) / 2, number)


def _far_end(arm: ArmModel, joint: int) -> Float[Array, " 3"]:
    """Where a link ends: at the next joint, at its farthest frame, or twice as far as its centre of mass [m]."""
    model = arm.model
    if joint < arm.n:
        return np.array(model.jointPlacements[joint + 1].translation)
    ends = [np.array(frame.placement.translation) for frame in model.frames if frame.parentJoint == joint]
    ends.append(2.0 * np.array(model.inertias[joint].lever))
    return max(ends, key=lambda end: float(np.linalg.norm(end)))


def _radius(mass: float, length: float) -> float:
    """Radius of a capsule of a mass and a length between its ends, at the density of water [m]."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        filled = DENSITY * np.pi * middle**2 * (length + 4.0 * middle / 3.0)
        low, high = (middle, high) if filled < mass else (low, middle)
    return max(high, LEAST_RADIUS)


def _turn_to(axis: Float[Array, " 3"]) -> Float[Array, "3 3"]:
    """A rotation whose third column is a given unit vector."""
    side = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(side, axis)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(axis, first), axis])
