"""Point clouds as obstacles: exact, thinned on the safe side, refused where broken."""

from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData, PlyElement
from pypcd4 import PointCloud

from ident.errors import InputError
from plan.geometry.clouds import thin_points
from plan.geometry.scene import Scene
from plan.geometry.solids import Box, Solid
from plan.problem.task_file import load_task
from plan.solving.set_up import set_up
from tests.plan.geometry.worlds import CUBE, RADIUS, TASK, scanned
from tests.plan.worlds import three_joints


@pytest.fixture(scope="module")
def balls() -> Scene:
    """The cloud's balls one by one."""
    ball = Solid.simple("sphere", RADIUS)
    return Scene.build(three_joints(), [Box(str(i), 0, np.eye(3), p, ball) for i, p in enumerate(scanned(0)[:150])])


def test_a_cloud_is_its_balls(balls: Scene) -> None:
    """Gaps, exact distances and gradients of a cloud, near and far, are those of its balls as single obstacles."""
    points = scanned(0)[:150]
    together = Scene.build(three_joints(), [Box("scan", 0, np.eye(3), np.zeros(3), Solid.cloud(points, RADIUS))])
    q = np.random.default_rng(2).uniform(-2.0, 2.0, (60, 3))
    assert together.separation(q, most=0.045) == pytest.approx(balls.separation(q, most=0.045), abs=1e-4)
    first, near, far = len(together.boxes) - 1, 0, 0
    for row in q:
        one, many = together.distances(row), balls.distances(row)
        for mine in np.flatnonzero(together.pairs[:, 0] == first):
            single = np.flatnonzero((balls.pairs[:, 1] == together.pairs[mine, 1]) & (balls.pairs[:, 0] >= first))
            best = int(single[np.argmin(many[single])])
            assert (one[mine] < 0.0) == (many[best] < 0.0)
            if -RADIUS / 2 < many[best] < 0.5 and np.sort(many[single])[1] > many[best] + 1e-4:
                near, far = near + (many[best] < 0.045), far + (many[best] > 0.06)
                assert one[mine] == pytest.approx(many[best], abs=1e-7)
                ours, theirs = (s.gradients(row[None], np.array([p])) for s, p in ((together, mine), (balls, best)))
                assert ours == pytest.approx(theirs, abs=1e-6)
    assert near > 20
    assert far > 20


def test_thinning_holds_every_ball() -> None:
    """Fewer balls, grown by what is reported, hold all balls of the many; where there are few nothing changes."""
    points = scanned(6, 20_000)
    few, lost = thin_points(points, 1500)
    assert len(few) <= 1500
    nearest = np.min(np.linalg.norm(points[::40, None] - few[None], axis=2), axis=1)
    assert 0.0 < nearest.max() <= lost + 1e-12
    assert lost < 0.05
    same, none = thin_points(points[:100], 1500)
    assert none == 0.0
    assert np.array_equal(same, np.unique(points[:100], axis=0))


def _write(path: Path, points: np.ndarray) -> None:
    if path.suffix == ".ply":
        rows = np.array([tuple(p) for p in points], dtype=[(axis, "f4") for axis in "xyz"])
        PlyData([PlyElement.describe(rows, "vertex")]).write(str(path))
    elif path.suffix == ".pcd":
        PointCloud.from_xyz_points(points.astype(np.float32)).save(path)
    else:
        np.save(path, points)


@pytest.mark.parametrize("name", ["scan.ply", "scan.pcd", "scan.npy"])
def test_clouds_of_all_files_are_the_same(tmp_path: Path, name: str) -> None:
    """The same points come out of every kind of file; millimetres by a scale."""
    points = np.round(scanned(8, 40), 3)
    _write(tmp_path / name, 1000.0 * points)
    path = tmp_path / "scene.toml"
    path.write_text(f'{TASK}[[obstacle]]\ncloud = "{name}"\nradius_m = 0.01\nscale = 0.001\n')
    (box,) = load_task(path).obstacles
    assert box.solid.kind == "cloud"
    found = box.centre + box.solid.points
    assert np.sort(found, axis=0) == pytest.approx(np.sort(points, axis=0), abs=1e-6)
    scene = set_up(load_task(path)).scene
    assert "link_3 and obstacle 1" in {scene.pair_name(i) for i in range(len(scene.pairs))}


def test_what_is_carried_is_convex(tmp_path: Path) -> None:
    """A mesh that is carried counts by its hull, and a cloud can't be carried: the arm's own bodies are convex."""
    (tmp_path / "cube.obj").write_text(CUBE)
    _write(tmp_path / "scan.npy", scanned(10, 40))
    path = tmp_path / "scene.toml"
    path.write_text(f'{TASK}[[attached]]\nfile = "cube.obj"\nscale = 0.05\nxyz_m = [0, 0, 0.3]\n')
    scene = set_up(load_task(path)).scene
    assert scene.boxes[-1].solid.kind == "hull"
    q = np.random.default_rng(11).uniform(-2.0, 2.0, (20, 3))
    exact = np.array([scene.distances(row) for row in q])
    assert np.all(scene.gaps(q) <= exact + 1e-6)
    path.write_text(f'{TASK}[[attached]]\ncloud = "scan.npy"\nradius_m = 0.01\nxyz_m = [0, 0, 0.3]\n')
    with pytest.raises(InputError, match="cloud can't be carried"):
        load_task(path)
