"""Boxes apart and overlapping: the compiled loop against Coal and against the axis theorem written out plainly."""

from itertools import product

import coal
import numpy as np
import pytest

from plan.geometry.compiled import compile_bodies
from plan.geometry.separation import BAND, body_gap
from plan.geometry.solids import Box
from tests.plan.worlds import random_rotation

OrientedBox = tuple[np.ndarray, np.ndarray, np.ndarray]


def signed_separation(first: OrientedBox, second: OrientedBox) -> float:
    """The compiled loop's answer [m]."""
    bodies = compile_bodies([Box("", 0, *one) for one in (first, second)])
    return float(body_gap(0, 1, bodies, np.zeros(3), 1e9))


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
    for _ in range(2000):
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
    assert near > 50


def test_parallel_boxes() -> None:
    """Aligned boxes, whose edge axes vanish, give the plain gap along a face."""
    a = (np.eye(3), np.zeros(3), np.array([0.1, 0.2, 0.3]))
    b = (np.eye(3), np.array([0.5, 0.0, 0.0]), np.array([0.1, 0.1, 0.1]))
    assert signed_separation(a, b) == pytest.approx(0.3)
    inside = (np.eye(3), np.array([0.15, 0.0, 0.0]), np.array([0.1, 0.1, 0.1]))
    assert signed_separation(a, inside) == pytest.approx(-0.05)
