"""The arm's shapes: its collision geometry as the URDF gives it, and what stands in where it gives
none.

Without a shape there is nothing to prove. A link that the URDF gives no `<collision>` is named, and
the arm refused, unless the user says what is to stand in for it: its visual shapes, or capsules or
boxes fitted to the link's length. Meshes of links count as convex parts, see `convex_parts`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import coal
import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from ident.errors import InputError, RobotError
from ident.recordings.recording import TelemetryIssue
from ident.robot.arm import ArmModel
from plan.geometry.convex_parts import convex_parts
from plan.geometry.solids import Box, Solid, mesh_triangles

StandIn = Literal["visual", "capsules", "boxes"]
STAND_INS: tuple[StandIn, ...] = get_args(StandIn)
WORDS: dict[StandIn, str] = {
    "visual": "their visual shapes",
    "capsules": "capsules fitted to the links' lengths",
    "boxes": "boxes fitted to the links' lengths",
}
# Links weigh at least as much as water: a capsule of that density is thicker than the link, and
# errs on the safe side [kg/m³].
DENSITY = 1000.0
# Thinnest limb that is believed [m].
LEAST_RADIUS = 0.02
# Lighter bodies without a shape or a picture are frames of reference, not parts [kg].
WEIGHTLESS = 1e-3
# Links that are named where several have no shape; the others are counted.
NAMED = 6

Mesh = tuple[str, int, float | None]
"""A link that is a mesh: its name, number of convex parts, and by how much these hold more than the
mesh, as a share of its volume; None of an open mesh, which has none."""


@dataclass(frozen=True, eq=False)
class ArmShapes:
    """Shapes of an arm's links."""

    boxes: tuple[Box, ...]  # the shapes, in the order of their links along the arm
    bare: tuple[str, ...]  # links without collision geometry, for which something stands in
    stand_in: StandIn | None  # what does
    meshes: tuple[Mesh, ...]  # links that are meshes

    @property
    def issue(self) -> TelemetryIssue | None:
        """What is to be reported of the links without a shape; None where all have one."""
        if not self.bare:
            return None
        links = ", ".join(self.bare)
        shapes = WORDS[self.stand_in or "visual"]
        evidence = f"no <collision> of {links}: {shapes} stand in"
        remedy = "add <collision> to these links"
        return TelemetryIssue("no_shape", (), "warning", evidence, remedy)

    @property
    def coarser(self) -> str:
        """How meshes are taken, in words; empty where there are none."""
        if not self.meshes:
            return ""
        known = [(share, name) for name, _, share in self.meshes if share is not None]
        excess, worst = max(known, default=(0.0, ""))
        total = sum(count for _, count, _ in self.meshes)
        words = f"{len(self.meshes)} meshes of links count as {total} convex parts"
        percent = f"{100.0 * excess:.1f}"
        if float(percent) != 0.0:
            words += f", {worst} with {percent} % more volume than its mesh"
        return words

    def to_dict(self) -> dict[str, Any]:
        """What stands in for which links, the issue that reports it, and meshes' convex parts.

        Returns:
            "stand_in": its "shapes" and "links"; "issues": a list, empty where there is none;
            "link_meshes": a list of "link", "parts", "excess_volume_share".
        """
        names = ("link", "parts", "excess_volume_share")
        issues = []
        if self.issue is not None:
            issues.append(self.issue.to_dict())
        return {
            "stand_in": {"shapes": self.stand_in, "links": list(self.bare)},
            "issues": issues,
            "link_meshes": [dict(zip(names, mesh, strict=True)) for mesh in self.meshes],
        }


def arm_shapes(arm: ArmModel, wanted: str | None = None) -> ArmShapes:
    """The shapes of all links that move, and of the base.

    Args:
        arm: The arm.
        wanted: What stands in for links without collision geometry.

    Raises:
        RobotError: A link has no collision geometry and nothing may stand in, or its meshes can't
            be read.
        InputError: No such stand-in.
    """
    stand_in = _stand_in(wanted)
    meshes: list[Mesh] = []
    boxes = _read(arm, arm.geometry.geometryObjects, meshes)
    bare = bare_links(arm)
    if bare:
        boxes += _in_place_of(arm, bare, stand_in, meshes)
    # Base to tip, and bodies numbered in that order: Pinocchio lists frames so.
    frames = sorted({box.body for box in boxes})
    boxes.sort(key=lambda box: box.body)
    numbered = tuple(replace(box, body=frames.index(box.body)) for box in boxes)
    return ArmShapes(numbered, bare, stand_in if bare else None, tuple(meshes))


def _stand_in(wanted: str | None) -> StandIn | None:
    """The stand-in of a name.

    Raises:
        InputError: No such stand-in.
    """
    for stand_in in STAND_INS:
        if stand_in == wanted:
            return stand_in
    if wanted is not None:
        known = ", ".join(STAND_INS)
        raise InputError("--shapes", f"{wanted!r} is unknown", f"use one of: {known}")
    return None


def _in_place_of(
    arm: ArmModel, bare: tuple[str, ...], stand_in: StandIn | None, meshes: list[Mesh]
) -> list[Box]:
    """What stands in for links without collision geometry.

    Raises:
        RobotError: Nothing may stand in, or one of the links has no visual shape either.
    """
    where = arm.source or arm.name
    if stand_in is None:
        what = f"no_shape: no <collision> of {_list(bare)}, so nothing is known to keep clear"
        names = ", ".join(STAND_INS[:-1])
        remedy = f"add <collision> to them, or say what stands in: --shapes {names} or boxes"
        raise RobotError(where, what, remedy)
    if stand_in != "visual":
        return [_limb(arm, name, stand_in == "capsules") for name in bare]
    visual = arm.visual_geometry.geometryObjects
    boxes = _read(arm, [shape for shape in visual if _name(arm, shape) in bare], meshes)
    shaped = {box.name for box in boxes}
    without = tuple(name for name in bare if name not in shaped)
    if without:
        what = f"no_shape: {_list(without)}: no <visual> either"
        raise RobotError(where, what, "use --shapes capsules or boxes")
    return boxes


def bare_links(arm: ArmModel) -> tuple[str, ...]:
    """Links without collision geometry.

    Those that have a picture, and whole bodies that have none but weigh something. Frames of
    reference, which have neither shape nor picture nor mass, are no parts.
    """
    links = {link.get("name", ""): link for link in ET.fromstring(arm.urdf).findall("link")}
    joints = {}
    for frame in arm.model.frames:
        if frame.type == pin.FrameType.BODY:
            joints[frame.name] = frame.parentJoint
    shaped = {joints[name] for name, link in links.items() if _has_collision(link)}
    bare = []
    for name, link in links.items():
        if name not in joints or _has_collision(link):
            continue
        if link.find("visual/geometry") is not None:
            bare.append(name)
        elif joints[name] not in shaped and _mass(link) > WEIGHTLESS:
            bare.append(name)
            shaped.add(joints[name])  # a single name is enough for a body
    return tuple(sorted(bare, key=list(joints).index))


def _has_collision(link: ET.Element) -> bool:
    """Whether a link has collision geometry."""
    return link.find("collision/geometry") is not None


def _mass(link: ET.Element) -> float:
    """Mass of a link [kg]."""
    mass = link.find("inertial/mass")
    if mass is None:
        return 0.0
    return float(mass.get("value", "0"))


def _list(names: tuple[str, ...]) -> str:
    """Some names in words."""
    words = ", ".join(names[:NAMED])
    if len(names) > NAMED:
        words += f" and {len(names) - NAMED} more"
    return words


def _name(arm: ArmModel, shape: pin.GeometryObject) -> str:
    """Name of the link that a shape belongs to."""
    return str(arm.model.frames[shape.parentFrame].name)


def _read(arm: ArmModel, shapes: Sequence[pin.GeometryObject], meshes: list[Mesh]) -> list[Box]:
    """Boxes round Pinocchio's geometry objects.

    The exact shape is kept, a mesh as convex parts, which are entered into `meshes`.

    Raises:
        RobotError: A mesh has no triangle, or one that is not finite.
    """
    boxes = []
    for shape in shapes:
        name = _name(arm, shape)
        joint = shape.parentJoint
        rotation = shape.placement.rotation.copy()
        centre = shape.placement.translation.copy()
        body = shape.parentFrame
        solid = simple_solid(shape.geometry)
        if solid is not None:
            boxes.append(Box(name, joint, rotation, centre, solid, body))
            continue
        parts, excess = convex_parts(_triangles(arm, shape))
        meshes.append((name, len(parts), excess))
        boxes.append(Box.around_parts(name, parts, joint, rotation, centre, body))
    return boxes


def _triangles(arm: ArmModel, shape: pin.GeometryObject) -> Float[Array, "m 3 3"]:
    """Corners of a mesh's triangles [m].

    Raises:
        RobotError: It has no triangle, or one that is not finite.
    """
    mesh = shape.geometry
    points = np.empty((0, 3))
    if hasattr(mesh, "vertices"):
        points = np.array(mesh.vertices())
    if len(points) < 3 or not np.isfinite(points).all():
        what = f"{_name(arm, shape)}: the mesh {shape.meshPath} has no finite triangle"
        raise RobotError(arm.source or arm.name, what, "mend or replace that mesh")
    return points[mesh_triangles(mesh)]


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


def _limb(arm: ArmModel, link: str, round_: bool) -> Box:
    """A capsule or a box as thick as the link's mass lets it be, from its joint to its end."""
    model = arm.model
    body = model.getFrameId(link, pin.FrameType.BODY)
    joint = int(model.frames[body].parentJoint)
    end = _far_end(arm, joint)
    length = float(np.linalg.norm(end))
    radius = _limb_radius(float(model.inertias[joint].mass), length)
    axis = np.array([0.0, 0.0, 1.0])
    if length > 1e-9:
        axis = end / length
    across = np.eye(3)[int(np.argmin(np.abs(axis)))]
    side = np.cross(across, axis)
    side /= np.linalg.norm(side)
    rotation = np.column_stack([side, np.cross(axis, side), axis])
    if round_:
        solid = Solid.simple("capsule", radius, length / 2)
    else:
        solid = Solid.simple("box", radius, radius, length / 2 + radius)
    return Box(link, joint, rotation, end / 2, solid, body)


def _far_end(arm: ArmModel, joint: int) -> Float[Array, " 3"]:
    """Where the body of a joint ends, in that joint's frame [m].

    That is the next joint, or else its farthest frame, or twice as far as its centre of mass.
    """
    model = arm.model
    if joint < arm.n:
        return np.array(model.jointPlacements[joint + 1].translation)
    frames = [frame for frame in model.frames if frame.parentJoint == joint]
    ends = [frame.placement.translation for frame in frames]
    ends.append(2.0 * model.inertias[joint].lever)
    return np.array(max(ends, key=np.linalg.norm))


def _limb_radius(mass: float, length: float) -> float:
    """Radius of a capsule of that length between its ends, at the density of water [m]."""
    roots = np.roots([4.0 / 3.0, length, 0.0, -mass / (DENSITY * np.pi)])
    real = roots[np.isreal(roots)].real
    return max(float(real.max()), LEAST_RADIUS)
