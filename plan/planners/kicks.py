"""Motions beside one at which a descent has ended, from which another may end lower.

Obstacles, and the modulus of power, part what motions cost into many basins that lie close to one
another. A descent ends in the basin where it began; one that begins a little beside its end may
find the next.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from plan.planners.descent import Course
from plan.planners.transcription import DEGREE, Grid

# How far a motion is moved aside where it is moved most, between these [rad].
AMPLITUDES = (0.4, 1.5)
# How long the part is that is moved: standard deviations of a bell, as shares of the duration.
WIDTHS = (0.1, 0.35)


def move_aside(course: Course, rng: np.random.Generator) -> Float[Array, " d"]:
    """Variables of a motion a part of which is moved aside, or comes earlier or later.

    Args:
        course: Where a descent has ended.
        rng: Source of randomness.
    """
    local = course.local
    grid = local.grid
    places = _places(grid)
    bell = np.exp(-(((places - rng.uniform()) / rng.uniform(*WIDTHS)) ** 2))
    if rng.uniform() < 0.5:
        direction = np.tile(rng.normal(size=local.n), (grid.free, 1))
    else:
        coefficients = local.split(course.x)[0]
        direction = np.gradient(coefficients, axis=0)[grid.held : -grid.held]
        direction = direction * rng.choice([-1.0, 1.0])
    moved = bell[:, None] * direction
    low, high = np.log(AMPLITUDES)
    moved *= np.exp(rng.uniform(low, high)) / max(float(np.abs(moved).max()), 1e-12)
    x = course.x.copy()
    x[: moved.size] += moved.reshape(-1)
    lowest, highest = local.bounds
    return np.clip(x, lowest, highest)


def _places(grid: Grid) -> Float[Array, " F"]:
    """Where each free coefficient acts most, as a share of the duration."""
    padded = np.concatenate([np.zeros(DEGREE - 1), grid.knots, np.ones(DEGREE - 1)])
    windows = np.lib.stride_tricks.sliding_window_view(padded, DEGREE)
    return windows.mean(axis=1)[grid.held : -grid.held]
