"""Meshes of links as convex parts: nothing of a mesh is left out, little is added, and what is kept is taken up."""

from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from ident.arrays import Array
from ident.robot.arm import ArmModel
from plan.geometry.convex_parts import clip, convex_parts
from plan.geometry.scene import Scene
from plan.geometry.solids import Solid


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's cache that is empty."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "armgap" / "parts"


def prism(outline: list[tuple[float, float]], height: float) -> Array:
    """Triangles of the walls and of both ends of a prism over an outline that its first corner sees whole."""
    low = [np.array([x, y, 0.0]) for x, y in outline]
    high = [corner + np.array([0.0, 0.0, height]) for corner in low]
    found, count = [], len(outline)
    for k in range(count):
        after = (k + 1) % count
        found += [(low[k], low[after], high[after]), (low[k], high[after], high[k])]
    for k in range(1, count - 1):
        found += [(low[0], low[k + 1], low[k]), (high[0], high[k], high[k + 1])]
    return np.array(found)


# Seen whole from the inner corner of the bend.
BEND = prism([(0.1, 0.1), (0.1, 0.5), (0, 0.5), (0, 0), (0.5, 0), (0.5, 0.1)], 0.1)


def test_every_point_of_a_links_mesh_lies_inside_a_part() -> None:
    """UR10's forearm is bent: points all over its triangles touch one of its parts."""
    arm, rng = ArmModel.load("ur10"), np.random.default_rng(5)
    shape = next(one for one in arm.geometry.geometryObjects if "forearm" in one.name)
    corners = np.array(shape.geometry.vertices())
    numbers = [
        [corner[k] for k in range(3)] for corner in map(shape.geometry.tri_indices, range(shape.geometry.num_tris))
    ]
    triangles = corners[np.array(numbers)]
    parts = [Solid.hull(part).for_coal() for part in convex_parts(triangles)[0]]
    assert len(parts) > 1
    here, speck = coal.Transform3s.Identity(), coal.Sphere(1e-5)
    for triangle in triangles[rng.choice(len(triangles), 200)]:
        place = coal.Transform3s(np.eye(3), rng.dirichlet(np.ones(3)) @ triangle)
        request = coal.CollisionRequest()
        assert any(coal.collide(part, here, speck, place, request, coal.CollisionResult()) for part in parts)


def test_parts_are_kept_and_a_spoiled_file_is_made_anew(cache: Path) -> None:
    """The second time they come from the cache, as they were; a file that is no such thing is not believed."""
    corners, excess = convex_parts(BEND)
    (kept,) = cache.iterdir()
    for spoiled in (kept.read_bytes(), b"", b"PK\x03\x04 no archive"):
        kept.write_bytes(spoiled)
        again = convex_parts(BEND)
        assert again[1] == excess
        assert all(np.array_equal(*pair) for pair in zip(corners, again[0], strict=True))


def test_without_a_place_to_keep_them_parts_are_found_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null")
    assert len(convex_parts(BEND)[0]) == 2


def test_folded_positions_that_the_meshes_leave_free_are_not_refused() -> None:
    """UR10's hulls refuse three free positions in ten; its parts two in a hundred at most, and all that meet."""
    arm, rng = ArmModel.load("ur10"), np.random.default_rng(8)
    scene, data = Scene.build(arm), arm.model.createData()
    pairs = [frozenset(scene.names_of(p)) for p in range(len(scene.pairs))]
    objects = list(arm.geometry.geometryObjects)
    names = [str(arm.model.frames[one.parentFrame].name) for one in objects]
    wanted = [(a, b) for a in range(len(objects)) for b in range(a) if frozenset((names[a], names[b])) in pairs]
    q = rng.uniform(-np.pi, np.pi, (400, arm.n))
    meet = np.zeros(len(q), dtype=bool)
    for k, row in enumerate(q):
        pin.forwardKinematics(arm.model, data, row)
        at = [data.oMi[one.parentJoint] * one.placement for one in objects]
        poses = [coal.Transform3s(one.rotation, one.translation) for one in at]
        shapes = [(objects[a].geometry, poses[a], objects[b].geometry, poses[b]) for a, b in wanted]
        meet[k] = any(coal.collide(*sides, coal.CollisionRequest(), coal.CollisionResult()) for sides in shapes)
    exact = np.array([scene.distances(row) for row in q])
    refused = exact.min(axis=1) < 0.0
    assert refused[meet].all()
    assert refused[~meet].mean() <= 0.02
    # The compiled gap is never above the distance, and close to it where shapes are near.
    gaps = scene.gaps(q)
    assert (gaps <= exact + 1e-5).all()
    close = (exact > 0.0) & (exact < 0.04)
    assert np.abs(gaps - exact)[close].max() < 0.005
    # Bounds may stand for what is far, and the slope of the nearest parts is that of the distance.
    some = np.array([scene.near_distances(row, 0.05, 0.05) for row in q[:50]])
    assert np.abs(some - exact[:50])[exact[:50] < 0.1].max() < 1e-6
    rows, which = np.nonzero(close)
    slopes = scene.gradients(q[rows[:20]], which[:20])
    for row, pair, slope in zip(rows[:20], which[:20], slopes, strict=True):
        step = 1e-6 * rng.normal(size=arm.n)
        change = scene.distances(q[row] + step)[pair] - scene.distances(q[row] - step)[pair]
        assert change == pytest.approx(2.0 * slope @ step, abs=2e-8)


def test_a_cut_keeps_every_bit_of_the_surface_on_its_side() -> None:
    """Both sides of a cut have the area of the whole, and none of them passes the plane."""

    def area(triangles: Array) -> float:
        sides = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        return float(np.linalg.norm(np.cross(*sides), axis=1).sum() / 2)

    for axis, place in ((0, 0.13), (1, 0.1), (2, 0.077)):
        below, above = clip(BEND, axis, place)
        assert below[..., axis].max() <= place + 1e-12 <= above[..., axis].min() + 2e-12
        assert area(below) + area(above) == pytest.approx(area(BEND))
