"""Laws of scenes: gaps, distances and gradients, sweeps, and motions proven free; pairs that are checked."""

from itertools import pairwise, product

import coal
import numpy as np
import pytest

from plan.geometry.clearance_proof import prove_clearance
from plan.geometry.compiled import compile_bodies
from plan.geometry.scene import Scene
from plan.geometry.separation import BAND, body_gap
from plan.geometry.solids import Box
from plan.spline import Splines
from tests.plan.geometry.worlds import KINDS, scene_of
from tests.plan.worlds import GOAL, MONITOR, START, problem, random_rotation

# How far a compiled gap may lie below the distance near contact [m]: a thinned hull gives away 2 mm a side.
SHORT = {"box": 5e-4, "shapes": 4.3e-3, "panda": 4.3e-3, "cloud": 1e-4}


def random_motions(seed: int, batch: int, dof: int = 3) -> Splines:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.5, 1.5, (batch, 1, dof)) + np.cumsum(rng.normal(size=(batch, 4, dof)) * 0.2, axis=1)
    return Splines(points, np.full((batch, 3), 0.3))


def test_neighbours_and_the_fixed_base_are_not_pairs() -> None:
    """No link is checked against the one it is joined to, nor across a shoulder; the obstacle against all that move."""
    scene = scene_of("box")
    names = {scene.pair_name(i) for i in range(len(scene.pairs))}
    assert not names & {"link_2 and link_1", "link_2 and link_0", "link_0 and monitor"}
    assert names >= {"link_3 and link_0", "link_6 and link_2"} | {f"link_{k} and monitor" for k in range(1, 7)}


@pytest.mark.parametrize("name", SHORT)
def test_gaps_equal_coal(name: str) -> None:
    """No gap is above the exact distance; near contact they are as good as the same; both see the same collisions."""
    scene = scene_of(name)
    low, high = np.maximum(scene.arm.lower, -2.5), np.minimum(scene.arm.upper, 2.5)
    q = np.random.default_rng(2).uniform(low, high, (150, scene.arm.n))
    ours, exact = scene.gaps(q), np.array([scene.distances(row) for row in q])
    assert np.all((ours <= exact + 1e-6)[exact > 0.0])
    near = (exact > 0.0) & (exact < 0.045)
    assert near.sum() > 10
    assert (exact - ours)[near].max() < SHORT[name]
    assert np.all((ours < 0.0)[exact < -1e-6])
    assert (exact < 0.0).sum() > 2
    least, together = ours.min(axis=1), scene.separation(q)
    close = (least > 0.0) & (least < 0.045)
    assert together[close] == pytest.approx(least[close], abs=1e-4)  # beyond, both are bounds, each its own
    assert np.array_equal(together < 0.0, least < 0.0)
    some = np.array([scene.near_distances(row, 0.02, 0.2) for row in q[:50]])
    assert np.all((some <= exact[:50] + 1e-6)[exact[:50] > 0.0])
    asked = (exact[:50] > 0.0) & (exact[:50] < 0.02)  # inside a mesh only the exact distance knows
    assert some[asked] == pytest.approx(exact[:50][asked], abs=2e-6)


def test_far_and_unwanted_pairs_may_be_left_out() -> None:
    """What is asked for depends on nothing that is asked beside it; gaps up to 5 cm not on what counts as far."""
    scene, rng = scene_of("shapes"), np.random.default_rng(3)
    q = rng.uniform(-2.5, 2.5, (100, 3))
    whole, some = scene.gaps(q), scene.gaps(q, 0.06)
    near = whole <= 0.05
    assert 0 < near.sum() < near.size
    assert np.array_equal(some[near], whole[near])
    assert np.all(some[~near] > 0.05)
    assert np.all(some <= np.array([scene.proximity.distances(row) for row in q]) + 1e-6)
    wanted = rng.random(whole.shape) < 0.3
    chosen = scene.gaps(q, 0.2, wanted)
    assert (wanted & near).sum() > 10
    assert chosen[wanted & near] == pytest.approx(whole[wanted & near], abs=1e-12)
    assert np.all(chosen[~wanted] == 0.2)
    assert np.all(chosen[wanted & (whole > 0.2)] > 0.049)


def test_gradients_equal_finite_differences() -> None:
    """The witness points' gradient is the distance's derivative for every kind of shape, and for two links."""
    scene, rng, checked, h = scene_of("shapes"), np.random.default_rng(3), dict.fromkeys((*KINDS, "link"), 0), 1e-5
    for _ in range(500):
        q, pair = rng.uniform(-2, 2, 3), int(rng.integers(len(scene.pairs)))
        kind = "link" if scene.own[pair] else scene.boxes[scene.pairs[pair][0]].solid.kind
        if checked[kind] > 3 or not 0.01 < scene.distances(q)[pair] < 0.3:
            continue
        steps = [scene.proximity.distances(q + sign * h * e)[pair] for e in np.eye(3) for sign in (1, 0, -1)]
        forward, backward = np.diff(np.reshape(steps, (3, 3)), axis=1).T / -h
        if np.abs(forward - backward).max() < 1e-4:  # no kink
            assert np.abs(scene.gradients(q[None], np.array([pair]))[0] - (forward + backward) / 2).max() < 2e-5
            checked[kind] += 1
    assert min(checked.values()) > 0


@pytest.mark.parametrize("name", ["box", "shapes"])
def test_sweeps_find_what_dense_samples_find(name: str) -> None:
    """The skipping sweep calls the same motions short of the margin as dense samples do, and sees how deep."""
    scene, motions = scene_of(name), random_motions(5, 60)
    beyond, shortfall = scene.sweep(motions, 0.01)
    q = motions.states(np.linspace(0, 1, 200))[0]
    dense = scene.separation(q.reshape(-1, 3)).reshape(60, -1).min(axis=1) - 0.01
    clear = np.abs(dense) > 1e-3
    assert np.array_equal((beyond < 0.0)[clear], (dense < 0.0)[clear])
    assert np.array_equal(shortfall > 0.0, beyond < 0.0)
    assert np.abs(beyond - dense)[dense < 0.0].max() < 0.02
    assert 5 < (beyond < 0.0).sum() < 55


@pytest.mark.parametrize("name", ["box", "shapes", "cloud"])
def test_proven_clearance_bounds_dense_distances(name: str) -> None:
    """It lies within 2 mm below the least of dense exact ones; what is asked is proven; no collision is missed."""
    scene, motions, free = scene_of(name), random_motions(4, 8), 0
    for i in range(len(motions.points)):
        one = Splines(motions.points[i : i + 1], motions.durations[i : i + 1])
        proof = prove_clearance(scene, one, samples=40)
        least = min(float(scene.distances(row).min()) for row in one.at(np.linspace(0.0, 0.9, 250))[0])
        assert proof.collision_free == (least > 0.0) or abs(least) < 1e-3
        if proof.collision_free:
            free += 1
            assert min(least - 2e-3, 0.5 * least) - 1e-9 < proof.proven <= least + 1e-9
        if name == "box" and proof.seen > 1e-3:  # what is asked for is proven, however little lies above it
            asked = proof.seen - 5e-5
            assert asked <= prove_clearance(scene, one, asked=asked).proven <= proof.seen
    assert 0 < free < 8


def test_a_motion_cut_into_many_sections_is_looked_at_no_more_often() -> None:
    """Law: a proof's work goes by the motion, not by its sections: a controller's curve has one a tick."""
    scene = scene_of("box")
    motions = random_motions(4, 8)
    proven = 0
    for i in range(len(motions.points)):
        motion = Splines(motions.points[i : i + 1], motions.durations[i : i + 1])
        knots = np.concatenate([[0.0], np.cumsum(motion.durations[0])])
        ticks = np.unique(np.concatenate([np.linspace(a, b, 101) for a, b in pairwise(knots)]))
        cut = Splines(motion.at(ticks)[0][None], np.diff(ticks)[None])
        whole = prove_clearance(scene, motion, samples=40)
        parted = prove_clearance(scene, cut, samples=40)
        assert parted.collision_free == whole.collision_free
        if whole.collision_free:
            proven += 1
            assert parted.proven == pytest.approx(whole.proven, abs=2e-4)
            assert parted.checks <= 1.2 * whole.checks
    assert proven > 0


def test_levers_bound_the_change_of_gaps() -> None:
    """No pair's distance changes faster than its levers say."""
    scene, rng = Scene.build(scene_of("box").arm, [MONITOR]), np.random.default_rng(5)
    for _ in range(200):
        q, step = rng.uniform(-2, 2, 3), rng.normal(size=3) * 1e-3
        change = np.abs(scene.proximity.distances(q + step) - scene.proximity.distances(q))
        assert np.all(change <= scene.levers @ np.abs(step) + 1e-6)


OrientedBox = tuple[np.ndarray, np.ndarray, np.ndarray]


def signed_separation(first: OrientedBox, second: OrientedBox) -> float:
    """The compiled loop's answer [m]."""
    bodies = compile_bodies([Box("", 0, *one) for one in (first, second)])
    return float(body_gap(0, 1, bodies, np.zeros(3), 1e9, BAND))


def theorem(first: OrientedBox, second: OrientedBox) -> float:
    """Largest gap over the 15 axes, from the corners' projections; no algebra shared with the package."""
    ra, rb = first[0], second[0]
    signs = np.array(list(product([-1, 1], repeat=3)))
    corners = [t + (signs * h) @ r.T for r, t, h in (first, second)]
    axes = [*ra.T, *rb.T]
    axes += [np.cross(a, b) for a in ra.T for b in rb.T]
    gaps = []
    for axis in axes:
        length = np.linalg.norm(axis)
        if length > 1e-5:
            a, b = (points @ axis / length for points in corners)
            gaps.append(max(a.min() - b.max(), b.min() - a.max()))
    return max(gaps)


def random_pair(rng: np.random.Generator, apart: float) -> tuple[OrientedBox, OrientedBox]:
    boxes = [(random_rotation(rng), rng.normal(size=3) * apart, rng.uniform(0.02, 0.3, 3)) for _ in range(2)]
    return boxes[0], boxes[1]


def coal_distance(first: OrientedBox, second: OrientedBox) -> float:
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    shapes = [(coal.Box(*(2 * h)), coal.Transform3s(r, t)) for r, t, h in (first, second)]
    return float(coal.distance(*shapes[0], *shapes[1], request, result))


@pytest.mark.parametrize("apart", [0.3, 0.15])
def test_separation_is_that_of_coal_and_of_the_theorem(apart: float) -> None:
    """All three call the same pairs overlapping, unless they touch to a micrometre.

    Under penetration the largest gap over the axes is minus the depth, to 1e-4 m of Coal's iteration; apart it is the
    distance to 0.1 mm where that is within the band, and farther it never exceeds it.
    """
    rng, overlap, near = np.random.default_rng(0), [], 0
    for _ in range(800):
        pair = random_pair(rng, apart)
        plain, ours, exact = theorem(*pair), signed_separation(*pair), coal_distance(*pair)
        if abs(plain) < 1e-6:
            continue
        assert (ours < 0) == (plain < 0) == (exact < 0)
        overlap.append(plain < 0)
        if plain < 0:
            assert ours == pytest.approx(plain, abs=1e-9)
        near += 0 < exact < BAND
        assert ours <= exact + (1e-6 if exact > 0 else 1e-4)
        assert exact >= BAND or ours == pytest.approx(exact, abs=1e-4)
    assert 0.1 < np.mean(overlap) < 0.9  # the check would say nothing if all pairs were alike
    assert near > 20


def test_proof_sees_between_samples() -> None:
    """A thin plate that is passed between two of three samples is found all the same."""
    plate = Box("plate", 0, np.eye(3), [0.04, -0.47, 0.6], [0.02, 0.02, 0.0005])
    task = problem(plate)
    motion = task.decode(task.initial)
    assert all(task.scene.distances(q).min() > 0.0 for q in (START, GOAL))
    assert not prove_clearance(task.scene, motion, samples=2).collision_free


def test_parallel_boxes() -> None:
    """Aligned boxes, whose edge axes vanish, give the plain gap along a face."""
    a = (np.eye(3), np.zeros(3), np.array([0.1, 0.2, 0.3]))
    b = (np.eye(3), np.array([0.5, 0.0, 0.0]), np.array([0.1, 0.1, 0.1]))
    assert signed_separation(a, b) == pytest.approx(0.3)
    inside = (np.eye(3), np.array([0.15, 0.0, 0.0]), np.array([0.1, 0.1, 0.1]))
    assert signed_separation(a, inside) == pytest.approx(-0.05)
