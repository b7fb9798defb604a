"""Scenes: which pairs are checked, distances and gradients, sweeps, and motions proven free."""

import numpy as np
import pytest

from ident.robot.arm import ArmModel
from plan.geometry.arm_shapes import arm_shapes
from plan.geometry.boxes import Box
from plan.geometry.clearance_proof import prove_clearance
from plan.geometry.scene import Scene
from plan.spline import Splines
from tests.plan.worlds import GOAL, MONITOR, START, problem, three_joints


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene.build(three_joints(), [MONITOR])


def random_motions(seed: int, batch: int, aside: np.ndarray | float = 0.0) -> Splines:
    rng = np.random.default_rng(seed)
    ends = np.stack([np.repeat(end[None], batch, 0) for end in (START, GOAL)], axis=1)
    vias = ends.mean(axis=1)[:, None] + aside + rng.normal(size=(batch, 2, 3)) * 0.3
    points = np.concatenate([ends[:, :1], vias, ends[:, 1:]], axis=1)
    return Splines(points, rng.uniform(0.2, 0.5, (batch, 3)))


def test_boxes_enclose_meshes() -> None:
    """A mesh's box holds every vertex of the mesh."""
    arm = ArmModel.load("ur10")
    boxes = arm_shapes(arm).boxes
    for box, shape in zip(boxes, arm.geometry.geometryObjects, strict=True):
        if hasattr(shape.geometry, "vertices"):
            points = shape.geometry.vertices() @ shape.placement.rotation.T + shape.placement.translation
            inside = np.abs((points - box.centre) @ box.rotation)
            assert np.all(inside <= box.half + 1e-6)


def test_neighbours_are_not_pairs(scene: Scene) -> None:
    """No link is checked against the one it is joined to, nor across a shoulder whose axes meet."""
    names = {scene.pair_name(i) for i in range(len(scene.pairs))}
    assert "link_2 and link_1" not in names
    assert "link_2 and link_0" not in names
    assert {"link_3 and link_0", "link_6 and link_2", "link_3 and monitor"} <= names


def test_obstacle_is_checked_against_every_moving_link(scene: Scene) -> None:
    """Six moving boxes, one obstacle: six pairs; the fixed base is left out."""
    names = [scene.pair_name(i) for i in range(len(scene.pairs)) if "monitor" in scene.pair_name(i)]
    assert len(names) == 6
    assert "link_0 and monitor" not in names


def test_gaps_equal_coal(scene: Scene) -> None:
    """Compiled gaps are Coal's distances where boxes are near or overlap, and never above them."""
    q = np.random.default_rng(0).uniform(-3, 3, (1500, 3))
    ours, exact = scene.gaps(q), np.array([scene.proximity.distances(row) for row in q])
    near = ours < 0.05
    assert near.sum() > 300
    assert np.abs(ours - exact)[near].max() < 5e-4
    assert np.all(ours <= exact + 1e-6)


def test_gradient_equals_finite_differences(scene: Scene) -> None:
    """The witness points' gradient is the distance's derivative to 1e-5 m/rad, at 60 places where it has one."""
    rng, checked, h = np.random.default_rng(2), 0, 1e-5

    def slopes(q: np.ndarray, pair: int, step: float) -> np.ndarray:
        here = scene.proximity.distances(q)[pair]
        return np.array([(scene.proximity.distances(q + step * e)[pair] - here) / step for e in np.eye(3)])

    while checked < 60:
        q, pair = rng.uniform(-2, 2, 3), int(rng.integers(len(scene.pairs)))
        if not 0.005 < scene.proximity.distances(q)[pair] < 0.3:
            continue
        forward, backward = slopes(q, pair, h), slopes(q, pair, -h)
        if np.abs(forward - backward).max() > 1e-4:
            continue  # a kink: the nearest points jump here
        assert np.abs(scene.gradients(q[None], np.array([pair]))[0] - (forward + backward) / 2).max() < 1e-5
        checked += 1


def test_sweep_finds_what_dense_samples_find(scene: Scene) -> None:
    """The skipping sweep calls the same motions short of the margin as 600 samples do, and sees depth to 3 cm."""
    motions = random_motions(3, 60)
    gap, shortfall = scene.sweep(motions, 0.01)
    q = motions.states(np.linspace(0, 1, 200))[0]
    dense = scene.separation(q.reshape(-1, 3)).reshape(60, -1).min(axis=1)
    clear = np.abs(dense - 0.01) > 1e-3
    assert np.array_equal((gap < 0.01)[clear], (dense < 0.01)[clear])
    assert np.array_equal(shortfall > 0, gap < 0.01)
    assert np.abs(gap - dense)[dense < 0.01].max() < 0.03


def test_proof_bounds_dense_distances(scene: Scene) -> None:
    """The proven clearance lies within 2 mm below the least of 2000 exact ones; no collision is missed."""
    motions, free = random_motions(4, 12, np.radians([-16.0, 3.0, 12.0])), 0
    for i in range(12):
        one = Splines(motions.points[i : i + 1], motions.durations[i : i + 1])
        proof = prove_clearance(scene, one)
        if proof.seen > 1e-3:  # what is asked for is proven, however little lies above it
            asked = proof.seen - 5e-5
            assert asked <= prove_clearance(scene, one, asked=asked).proven <= proof.seen
        q = one.at(np.linspace(0, float(one.total[0]), 2000))[0]
        least = min(scene.proximity.distances(row).min() for row in q)
        assert proof.collision_free == (least > 0) or abs(least) < 1e-3
        if proof.collision_free:
            free += 1
            assert proof.proven <= least + 1e-9
            assert proof.proven > min(least - 2e-3, 0.5 * least) - 1e-9
    assert 0 < free < 12


def test_proof_sees_between_samples() -> None:
    """A thin plate that is passed between two of three samples is found all the same."""
    plate = Box("plate", 0, np.eye(3), [0.04, -0.47, 0.6], [0.02, 0.02, 0.0005])
    task = problem(plate)
    motion = task.decode(task.initial)
    assert all(task.scene.distances(q).min() > 0.0 for q in (START, GOAL))
    assert not prove_clearance(task.scene, motion, samples=2).collision_free


def test_levers_bound_the_change_of_gaps(scene: Scene) -> None:
    """No pair's distance changes faster than its levers say."""
    rng = np.random.default_rng(5)
    for _ in range(200):
        q, step = rng.uniform(-2, 2, 3), rng.normal(size=3) * 1e-3
        change = np.abs(scene.proximity.distances(q + step) - scene.proximity.distances(q))
        assert np.all(change <= scene.levers @ np.abs(step) + 1e-6)


def test_gaps_that_are_not_wanted_are_left_out(scene: Scene) -> None:
    """Law: what is asked for does not depend on what is asked beside it; the rest has the gap that does not matter."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-3.0, 3.0, (300, scene.arm.n))
    whole = scene.gaps(q)
    wanted = rng.random(whole.shape) < 0.3
    some = scene.gaps(q, 0.2, wanted)
    near = wanted & (whole < 0.05)
    assert near.sum() > 10
    assert some[near] == pytest.approx(whole[near], abs=1e-12)
    assert np.all(some[~wanted] == 0.2)
    assert np.all(some[wanted & (whole > 0.2)] > 0.049)
