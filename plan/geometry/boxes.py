"""Shapes of the arm's links and of obstacles, each with the oriented box around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float, freeze
from plan.geometry.solids import Solid


@dataclass(frozen=True, eq=False)
class Box:
    """A shape fixed to a joint of the arm, or to the world, by the box around it.

    Attributes:
        name: Name of the link or obstacle.
        joint: Number of the joint that carries it, 1 to n; 0 for the world.
        rotation: Its axes in the joint frame.
        centre: Its centre in the joint frame [m].
        half: Half edge lengths [m].
        body: Order of its link along the arm; -1 for an obstacle.
        solid: What it is exactly; the box itself if not given.
    """

    name: str
    joint: int
    rotation: Float[Array, "3 3"]
    centre: Float[Array, " 3"]
    half: Float[Array, " 3"]
    body: int = -1
    solid: Solid = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        for field in ("rotation", "centre", "half"):
            object.__setattr__(self, field, freeze(np.asarray(getattr(self, field), dtype=float)))
        if self.solid is None:
            object.__setattr__(self, "solid", Solid.simple("box", *self.half))

    @classmethod
    def around(
        cls,
        name: str,
        solid: Solid,
        joint: int = 0,
        rotation: Float[Array, "3 3"] | None = None,
        centre: Float[Array, " 3"] | None = None,
        body: int = -1,
    ) -> Box:
        """The box around a solid, whose axes and centre are the solid's own."""
        axes, place = np.eye(3) if rotation is None else rotation, np.zeros(3) if centre is None else centre
        return cls(name, joint, axes, place, solid.half, body, solid)

    @classmethod
    def around_parts(
        cls, name: str, parts: Sequence[Float[Array, "k 3"]], joint: int, rotation: Array, centre: Array, body: int
    ) -> Box:
        """Convex parts by their corners, which are given in axes of their own, placed in the joint frame like these."""
        points = np.concatenate(parts)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        solid = Solid.hull(points - middle, [part - middle for part in parts] if len(parts) > 1 else ())
        return cls.around(name, solid, joint, rotation, centre + rotation @ middle, body)

    @cached_property
    def parts(self) -> tuple[Box, ...]:
        """Its convex parts, each a shape by itself; itself alone if it has none."""
        if not self.solid.parts:
            return (self,)
        place = self.joint, self.rotation, self.centre, self.body
        return tuple(Box.around_parts(self.name, [part], *place) for part in self.solid.parts)

    @property
    def corners(self) -> Float[Array, "8 3"]:
        """Corners in the joint frame [m]."""
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
        return self.centre + (signs * self.half) @ self.rotation.T

    @property
    def farthest(self) -> float:
        """Farthest that a point of it can be from the joint frame's origin [m]."""
        ball = float(np.linalg.norm(self.centre)) + self.solid.radius
        return min(ball, float(np.linalg.norm(self.corners, axis=1).max()))
