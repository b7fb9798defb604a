"""Scenes of all kinds of obstacles that the tests of geometry share."""

from functools import cache

import numpy as np
from scipy.spatial import ConvexHull

from ident.robot.arm import ArmModel
from plan.geometry.scene import Scene
from plan.geometry.solids import Box, Solid
from tests.plan.worlds import MONITOR, random_rotation, three_joints

KINDS = ("box", "sphere", "capsule", "cylinder", "hull", "surface")
TASK = 'robot = "tm5-900"\n[task]\nstart_deg = [50, 0, -120]\ngoal_deg = [80, 30, -90]\nduration_s = 0.65\n'
CUBE = """v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 1 3 2\nf 1 4 3\nf 5 6 7\nf 5 7 8\nf 1 2 6\nf 1 6 5\nf 2 3 7\nf 2 7 6\nf 3 4 8\nf 3 8 7\nf 4 1 5\nf 4 5 8\n"""
# Radius of a scanned point [m].
RADIUS = 0.02


def a_solid(kind: str, rng: np.random.Generator) -> Solid:
    """A shape of a kind, 5 to 25 cm large."""
    if kind == "box":
        return Solid.simple("box", *rng.uniform(0.03, 0.12, 3))
    if kind == "sphere":
        return Solid.simple("sphere", rng.uniform(0.03, 0.12))
    if kind in ("capsule", "cylinder"):
        return Solid.simple("capsule" if kind == "capsule" else "cylinder", *rng.uniform(0.03, 0.12, 2))
    points = rng.normal(size=(20, 3)) * 0.06
    hull = ConvexHull(points)
    return Solid.hull(points) if kind == "hull" else Solid.surface(points, hull.simplices)


def a_scene(arm: ArmModel, count: int, seed: int) -> Scene:
    """Obstacles of all kinds round an arm."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        place = rng.uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 1.2])
        if np.hypot(*place[:2]) > 0.3:
            kind = KINDS[len(found) % len(KINDS)]
            solid, rotation = a_solid(kind, rng), random_rotation(rng)
            found.append(Box(f"{kind} {len(found)}", 0, rotation, place, solid))
    return Scene.build(arm, found)


def scanned(seed: int, count: int = 3000) -> np.ndarray:
    """Points on balls round the arm."""
    rng = np.random.default_rng(seed)
    angle, middles = rng.uniform(-np.pi, np.pi, 8), np.empty((8, 3))
    middles[:, 0], middles[:, 1], middles[:, 2] = 0.6 * np.cos(angle), 0.6 * np.sin(angle), rng.uniform(0.2, 1.0, 8)
    around = rng.normal(size=(count, 3))
    around *= 0.12 / np.linalg.norm(around, axis=1, keepdims=True)
    points: np.ndarray = middles[rng.integers(8, size=count)] + around
    return points


@cache
def scene_of(name: str) -> Scene:
    """One box, all kinds of shapes round either arm, or a cloud."""
    if name == "box":
        return Scene.build(three_joints(), [MONITOR])
    if name in ("shapes", "panda"):
        return a_scene(three_joints(), 12, 0) if name == "shapes" else a_scene(ArmModel.load("panda"), 6, 1)
    rotation = random_rotation(np.random.default_rng(1))
    box = Box("scan", 0, rotation, np.zeros(3), Solid.cloud(scanned(0) @ rotation, RADIUS))
    return Scene.build(three_joints(), [box])
