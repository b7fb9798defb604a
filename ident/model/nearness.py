"""How the share of what was learnt falls with the distance from poses that were seen.

A joint's memory counts by

    share / (1 + d² / reach²),

d being the distance in joint space to the nearest of some poses of the training runs. Share and
reach are what blocks and runs left out ask for, of each joint: their rows lie at many distances
from the poses that were left, and least squares over all of them say how fast the benefit falls.
Where they all lie near, nothing says that it falls, and it does not.

Source: Stone 1974 (choice by cross-validation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, Int, freeze
from ident.model.joint_nets import ROWS

# Reaches that are tried [rad], the longest first; with the first a share never falls.
REACHES = (np.inf, *np.geomspace(8.0, 1.0 / 32.0, 9).tolist())
# Poses that are kept of the training runs.
POSES = 512
# Square of a distance that is as good as endless [rad²].
FAR = float(np.sqrt(np.finfo(float).max))


@dataclass(frozen=True, eq=False)
class Nearness:
    """Poses that training runs went through, and how far from them each joint's memory reaches."""

    poses: Float[Array, "k n"]  # [rad]
    reach: Float[Array, " n"]  # distance at which half of a share is left; endless: it never falls

    def __post_init__(self) -> None:
        for name in ("poses", "reach"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        has_rows = self.poses.ndim == 2 and len(self.poses) > 0
        if not has_rows or not np.isfinite(self.poses).all():
            raise ValueError("the poses that were seen are damaged")
        has_shape = self.reach.shape == self.poses.shape[1:]
        if not has_shape or not np.all(self.reach > 0.0):
            raise ValueError("a reach is missing or not above zero")

    @property
    def steepness(self) -> Float[Array, " n"]:
        """1 / reach² of each joint [1/rad²]."""
        return np.asarray(1.0 / self.reach**2)

    def fall(self, q: Float[Array, "T n"]) -> Float[Array, "T n"]:
        """What is left of each joint's share at some positions: from 1 down to 0."""
        if not self.steepness.any():
            return np.ones(q.shape)
        return fall(nearest_square(q, self.poses)[:, None], self.reach)


def fall(square: Float[Array, "*T"], reach: float | Float[Array, " n"]) -> Float[Array, "*T"]:
    """1 / (1 + d² / reach²).

    Args:
        square: Squares of distances [rad²].
        reach: Distance at which half is left [rad].
    """
    return np.asarray(1.0 / (1.0 + square / reach**2))


def nearest_square(q: Float[Array, "T n"], poses: Float[Array, "k n"]) -> Float[Array, " T"]:
    """Square of the distance from each position to the nearest pose [rad²]; `FAR` without any."""
    nearest = np.full(len(q), FAR)
    if not len(poses):
        return nearest
    size = (poses**2).sum(axis=1)
    for start in range(0, len(q), ROWS):
        rows = q[start : start + ROWS]
        across = size - 2.0 * rows @ poses.T
        squares = (rows**2).sum(axis=1)
        nearest[start : start + ROWS] = across.min(axis=1) + squares
    return np.maximum(nearest, 0.0)


def spread_poses(count: int) -> Int[Array, " k"]:
    """Numbers of at most `POSES` of so many rows, evenly spread over them."""
    return np.arange(0, count, max(1, -(-count // POSES)))


def nearest_left_out(q: Float[Array, "T n"], folds: Int[Array, " T"]) -> Float[Array, " T"]:
    """Square of the distance from each row to the nearest pose of other folds [rad²].

    Args:
        q: Positions.
        folds: Which rows are left out together.
    """
    places = spread_poses(len(q))
    square = np.zeros(len(q))
    for fold in np.unique(folds):
        asked = folds == fold
        seen = places[folds[places] != fold]
        square[asked] = nearest_square(q[asked], q[seen])
    return square


@dataclass(frozen=True, eq=False)
class LeftOut:
    """What was said of rows that were left out in one way."""

    torque: Float[Array, " T"]  # [N m]
    square: Float[Array, " T"]  # of their distance to the nearest pose that was seen [rad²]


def choose_share(ways: Sequence[LeftOut], left: Float[Array, " T"]) -> tuple[float, float]:
    """Share at no distance, and reach, that leave least squares of rows left out.

    The longest reach where they tell none apart.

    Args:
        ways: What was said of the rows, for each way of leaving out: all count alike.
        left: What there is to foretell [N m].

    Returns:
        The share, from 0 to 1, and the reach [rad].
    """
    chosen = (0.0, np.inf)
    least = np.inf
    for reach in REACHES:
        said = [of_way.torque * fall(of_way.square, reach) for of_way in ways]
        along = sum(float(torque @ left) for torque in said)
        size = sum(float(torque @ torque) for torque in said)
        share = float(np.clip(along / size, 0.0, 1.0)) if size > 0.0 else 0.0
        squares = share**2 * size - 2.0 * share * along
        if squares < least:
            chosen = (share, reach)
            least = squares
    return chosen
