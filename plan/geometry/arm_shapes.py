"""The arm's shapes: its collision geometry as the URDF gives it, and what stands in where it gives none.

Without a shape there is nothing to prove. A link that the URDF gives no `<collision>` is named, and the arm refused,
unless the user says what is to stand in for it: its visual shapes, or capsules or boxes fitted to the link's length.

Meshes of links count as convex parts: a bent link's hull fills its bend, and many positions of a folded arm with it. A
mesh is cut by planes along its axes, each time where the hulls of both sides lose the most volume together, until a cut
brings next to nothing. Every triangle is cut with it, so each lies inside a part, whatever the mesh is like.
"""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, get_args

import coal
import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float, freeze
from ident.errors import InputError, RobotError
from ident.files import atomic_write
from ident.recordings.recording import TelemetryIssue
from ident.robot.arm import ArmModel
from ident.safe_read import read_arrays
from ident.user_cache import user_cache
from plan.geometry.solids import Box, Solid, hull_points, mesh_triangles

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

# Places of cuts, as shares of the length along each axis; least gain of one, as a share of the whole hull's volume.
PLACES, LEAST = np.linspace(0.1, 0.9, 9), 0.02
MOST = 16
# Triangles by which cuts are chosen, at most; area vectors of a closed surface add up to this share of it, or less.
ENOUGH, CLOSED = 3000, 1e-3
# Changes with the way of cutting, so that parts that were kept before are not taken up.
VERSION = b"3"


def convex_parts(triangles: Float[Array, "m 3 3"]) -> tuple[list[Float[Array, "k 3"]], float | None]:
    """Parts whose hulls hold every triangle; kept in the user's cache by the triangles' content.

    Args:
        triangles: Corners of each [m].

    Returns:
        Corners of each part [m]; and by how much the parts hold more than the mesh, as a share of its volume, None of
        an open mesh.
    """
    triangles = np.ascontiguousarray(triangles, dtype=float)
    folder, name = user_cache(), f"{hashlib.sha256(VERSION + triangles.tobytes()).hexdigest()}.npz"
    kept = None if folder is None else folder / "parts" / name
    with suppress(InputError, ValueError, KeyError, TypeError):  # what can't be read is made anew
        arrays = read_arrays(kept, "remove it") if kept is not None and kept.is_file() else {}
        share = float(arrays["excess"])
        return np.split(arrays["corners"], arrays["ends"]), None if np.isnan(share) else share
    corners, excess = _cut(triangles)
    if kept is not None:
        ends = np.cumsum([len(part) for part in corners])[:-1]
        with suppress(OSError, InputError), atomic_write(kept) as file:  # nobody may write everywhere
            np.savez(file, corners=np.concatenate(corners), ends=ends, excess=np.array(excess, dtype=float))
    return corners, excess


def _cut(triangles: Array) -> tuple[list[Array], float | None]:
    """Corners of the parts, and by how much they hold more than the mesh: as of `convex_parts`.

    Where to cut is chosen by hulls of few corners; of all corners only the last parts' are made.
    """
    volume = _enclosed(triangles)
    whole = _hull_volume(_farthest(triangles.reshape(-1, 3)))
    parts = [triangles]
    cuts = [_best_cut(triangles)] if volume is None or whole > (1.0 + LEAST) * volume else []
    while cuts and len(parts) < MOST:
        worst = max(range(len(parts)), key=lambda k: cuts[k][0])
        gain, axis, place = cuts[worst]
        if gain <= LEAST * whole:
            break
        sides = clip(parts[worst], axis, place)
        parts[worst : worst + 1] = sides
        cuts[worst : worst + 1] = [_best_cut(side) for side in sides]
    hulls = [_hull(part) for part in parts]
    corners = [corners for corners, _ in hulls]
    if volume is None:
        return corners, None
    held = sum(held for _, held in hulls)
    return corners, max(held / volume - 1.0, 0.0)


def _enclosed(triangles: Array) -> float | None:
    """Volume that a mesh encloses [m³]; None of an open or a flat one."""
    a, b, c = (triangles[:, k] for k in range(3))
    areas = np.cross(b - a, c - a)
    if np.linalg.norm(areas.sum(axis=0)) > CLOSED * np.linalg.norm(areas, axis=1).sum():
        return None
    cones = np.einsum("ij,ij->i", a - a[0], np.cross(b - a[0], c - a[0]))
    return float(abs(cones.sum()) / 6.0) or None


def _hull(triangles: Float[Array, "m 3 3"]) -> tuple[Float[Array, "k 3"], float]:
    """Corners of the hull of some triangles, and its volume [m³]; flat ones have none, and a little thickness."""
    points = triangles.reshape(-1, 3)
    hull = _quick_hull(points)
    if hull is None:
        return hull_points(np.unique(points, axis=0)), 0.0
    return points[hull.vertices], float(hull.volume)


def _hull_volume(points: Float[Array, "k 3"]) -> float:
    """Volume of the hull of some points [m³]; zero where they are flat."""
    hull = _quick_hull(points)
    return 0.0 if hull is None else float(hull.volume)


def _quick_hull(points: Float[Array, "k 3"]) -> ConvexHull | None:
    """Qhull's hull of some points; None where they are flat, or too few."""
    from scipy.spatial import ConvexHull, QhullError  # slow to load, and only meshes need it

    try:
        return ConvexHull(points)
    except (QhullError, ValueError):
        return None


def _best_cut(triangles: Array) -> tuple[float, int, float]:
    """Volume that the best cut takes off the hull [m³], its axis and its place [m].

    Along each axis the mesh is cut into slabs once. Of each slab only the corners that lie farthest
    in some direction count: to choose a cut that is enough, and a hull of few corners is quick.

    Args:
        triangles: Corners of each [m].
    """
    best = (0.0, 0, 0.0)
    some = triangles[:: max(1, len(triangles) // ENOUGH)]
    felt = _hull_volume(_farthest(some.reshape(-1, 3)))
    if felt == 0.0:
        return best
    low, high = (pick(some.reshape(-1, 3), axis=0) for pick in (np.min, np.max))
    for axis in range(3):
        places, slabs, rest = low[axis] + PLACES * (high[axis] - low[axis]), [], some
        for place in places:
            below, rest = clip(rest, axis, place)
            slabs.append(_farthest(below.reshape(-1, 3)))
        slabs.append(_farthest(rest.reshape(-1, 3)))
        for number, place in enumerate(places, start=1):
            sides = np.concatenate(slabs[:number]), np.concatenate(slabs[number:])
            if all(len(side) for side in sides):
                held = sum(_hull_volume(_farthest(side)) for side in sides)
                best = max(best, (felt - held, axis, float(place)))
    return best


def _farthest(points: Float[Array, "k 3"]) -> Float[Array, "m 3"]:
    """Of some points those that lie farthest in any of the directions in which hulls are felt."""
    if len(points) == 0:
        return points
    return points[np.unique(np.argmax(_directions() @ points.T, axis=1))]


@cache
def _directions(on_spiral: int = 86) -> Float[Array, "k 3"]:
    """Unit vectors evenly all round: the axes both ways, and so many on a spiral from pole to pole."""
    number = np.arange(on_spiral) + 0.5
    height = 1.0 - 2.0 * number / on_spiral
    turn = np.pi * (1.0 + np.sqrt(5.0)) * number
    level = np.sqrt(1.0 - height**2)
    spiral = np.stack([level * np.cos(turn), level * np.sin(turn), height], axis=1)
    return freeze(np.concatenate([np.eye(3), -np.eye(3), spiral]))


def clip(triangles: Float[Array, "m 3 3"], axis: int, place: float) -> tuple[Array, Array]:
    """The triangles below and above a plane, those that cross it cut in three."""
    above = triangles[:, :, axis] > place
    count = above.sum(axis=1)
    sides = [[triangles[count == 0]], [triangles[count == 3]]]
    for side in (0, 1):  # those with one corner alone on this side
        crossing = count == (1 if side else 2)
        corners, rows = triangles[crossing], np.arange(int(crossing.sum()))
        alone = np.argmax(above[crossing] == bool(side), axis=1)
        tip, left, right = (corners[rows, (alone + k) % 3] for k in range(3))
        on_left, on_right = (
            tip + ((place - tip[:, axis]) / (end[:, axis] - tip[:, axis]))[:, None] * (end - tip)
            for end in (left, right)
        )
        sides[side].append(np.stack([tip, on_left, on_right], axis=1))
        sides[1 - side] += [np.stack([on_left, left, right], axis=1), np.stack([on_left, right, on_right], axis=1)]
    return np.concatenate(sides[0]), np.concatenate(sides[1])


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
    """Shapes of an arm's links."""

    boxes: tuple[Box, ...]  # the shapes, in the order of their links along the arm
    bare: tuple[str, ...]  # links without collision geometry, for which something stands in
    stand_in: StandIn | None  # what does
    # Links that are meshes: name, number of convex parts, and by how much these hold more than the mesh, as a share of
    # its volume; None of an open mesh, which has none.
    meshes: tuple[tuple[str, int, float | None], ...]

    @property
    def issue(self) -> TelemetryIssue | None:
        """What is to be reported of the links without a shape; None where all have one."""
        if not self.bare:
            return None
        evidence = f"no <collision> of {', '.join(self.bare)}: {WORDS[self.stand_in or 'visual']} stand in"
        return TelemetryIssue("no_shape", (), "warning", evidence, "add <collision> to these links")

    @property
    def coarser(self) -> str:
        """How meshes are taken, in words; empty where there are none."""
        if not self.meshes:
            return ""
        known = [(share, name) for name, _, share in self.meshes if share is not None]
        excess, worst = max(known, default=(0.0, ""))
        parts = f"{len(self.meshes)} meshes of links count as {sum(count for _, count, _ in self.meshes)} convex parts"
        share = f"{100.0 * excess:.1f}"
        return parts + (f", {worst} with {share} % more volume than its mesh" if float(share) else "")

    def to_dict(self) -> dict[str, Any]:
        """What stands in for which links, the issue that reports it, and the convex parts of meshes."""
        names = ("link", "parts", "excess_volume_share")
        return {
            "stand_in": {"shapes": self.stand_in, "links": list(self.bare)},
            "issues": [] if self.issue is None else [self.issue.to_dict()],
            "link_meshes": [dict(zip(names, mesh, strict=True)) for mesh in self.meshes],
        }


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
        InputError: No such stand-in.
    """
    stand_in = next((one for one in STAND_INS if one == wanted), None)
    if stand_in is None and wanted is not None:
        raise InputError("--shapes", f"{wanted!r} is unknown", f"use one of: {', '.join(STAND_INS)}")
    meshes: list[tuple[str, int, float | None]] = []
    found, bare, where = _read(arm, arm.geometry.geometryObjects, meshes), bare_links(arm), arm.source or arm.name
    if bare and stand_in is None:
        remedy = f"add <collision> to them, or say what stands in: --shapes {', '.join(STAND_INS[:-1])} or boxes"
        raise RobotError(where, f"no_shape: no <collision> of {_list(bare)}, so nothing is known to keep clear", remedy)
    if bare and stand_in == "visual":
        found += _read(arm, [one for one in arm.visual_geometry.geometryObjects if _name(arm, one) in bare], meshes)
        without = tuple(name for name in bare if name not in {box.name for box in found})
        if without:
            raise RobotError(where, f"no_shape: {_list(without)}: no <visual> either", "use --shapes capsules or boxes")
    elif bare:
        found += [_limb(arm, name, stand_in == "capsules") for name in bare]
    # Base to tip, and bodies numbered in that order: Pinocchio lists frames so.
    frames = sorted({box.body for box in found})
    ordered = (replace(box, body=frames.index(box.body)) for box in sorted(found, key=lambda box: box.body))
    return ArmShapes(tuple(ordered), bare, stand_in if bare else None, tuple(meshes))


def bare_links(arm: ArmModel) -> tuple[str, ...]:
    """Links without collision geometry: those that have a picture, and whole bodies that have none but weigh something.

    Frames of reference, which have neither shape nor picture nor mass, are no parts.
    """
    links = {link.get("name", ""): link for link in ET.fromstring(arm.urdf).findall("link")}
    carried = {frame.name: frame.parentJoint for frame in arm.model.frames if frame.type == pin.FrameType.BODY}
    shaped = {carried[name] for name, link in links.items() if link.find("collision/geometry") is not None}
    found = []
    for name, link in links.items():
        if name not in carried or link.find("collision/geometry") is not None:
            continue
        mass = link.find("inertial/mass")
        if link.find("visual/geometry") is not None:
            found.append(name)
        elif carried[name] not in shaped and mass is not None and float(mass.get("value", "0")) > WEIGHTLESS:
            found.append(name)
            shaped.add(carried[name])  # one name a body is enough
    return tuple(sorted(found, key=list(carried).index))


def _list(names: tuple[str, ...]) -> str:
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def _name(arm: ArmModel, shape: pin.GeometryObject) -> str:
    return str(arm.model.frames[shape.parentFrame].name)


def _read(
    arm: ArmModel, objects: Sequence[pin.GeometryObject], meshes: list[tuple[str, int, float | None]]
) -> list[Box]:
    """Boxes round Pinocchio's geometry objects; the exact shape is kept, a mesh as convex parts, which are entered.

    Raises:
        RobotError: A mesh has no triangle, or one that is not finite.
    """
    found = []
    for shape in objects:
        name, solid, model = _name(arm, shape), simple_solid(shape.geometry), shape.geometry
        place = shape.parentJoint, shape.placement.rotation.copy(), shape.placement.translation.copy()
        if solid is not None:
            found.append(Box(name, *place, solid, shape.parentFrame))
            continue
        points = np.array(model.vertices()) if hasattr(model, "vertices") else np.empty((0, 3))
        if len(points) < 3 or not np.isfinite(points).all():
            what = f"link {name}: the mesh {shape.meshPath} has no finite triangle"
            raise RobotError(arm.source or arm.name, what, "mend or replace that mesh")
        parts, excess = convex_parts(points[mesh_triangles(model)])
        meshes.append((name, len(parts), excess))
        found.append(Box.around_parts(name, parts, *place, shape.parentFrame))
    return found


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
    """A capsule or a box as thick as the link's mass lets it be, from its joint to where it ends.

    That is the next joint, or else its farthest frame, or twice as far as its centre of mass.
    """
    model = arm.model
    number = model.getFrameId(link, pin.FrameType.BODY)
    joint = int(model.frames[number].parentJoint)
    inertia = model.inertias[joint]
    ends = [frame.placement.translation for frame in model.frames if frame.parentJoint == joint]
    if joint < arm.n:
        ends = [model.jointPlacements[joint + 1].translation]
    else:
        ends.append(2.0 * inertia.lever)
    end = np.array(max(ends, key=np.linalg.norm))
    length = float(np.linalg.norm(end))
    # A capsule of that length between its ends, at the density of water.
    roots = np.roots([4.0 / 3.0, length, 0.0, -float(inertia.mass) / (DENSITY * np.pi)])
    radius = max(float(roots[np.isreal(roots)].real.max()), LEAST_RADIUS)
    axis = end / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    side = np.cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis)
    side /= np.linalg.norm(side)
    rotation = np.column_stack([side, np.cross(axis, side), axis])
    solid = Solid.simple("box", radius, radius, length / 2 + radius)
    if round_:
        solid = Solid.simple("capsule", radius, length / 2)
    return Box(link, joint, rotation, end / 2, solid, number)
