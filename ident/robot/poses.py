"""Poses of links over many states at once: the forward kinematics of a chain, an array at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float


def compute_joint_poses(
    rotations: Float[Array, "n 3 3"],
    offsets: Float[Array, "n 3"],
    axes: Float[Array, "n 3"],
    sliding: Array,
    q: Float[Array, "T n"],
    wanted: Sequence[int],
) -> dict[int, tuple[Float[Array, "T 3 3"], Float[Array, "T 3"]]]:
    """Orientation and origin [m] of some joints' frames in the base frame, their own motion included.

    Args:
        rotations: Axes of each joint frame in its parent's, at zero.
        offsets: Origin of each joint frame in its parent's [m].
        axes: Joint axes in the joint frames, unit length.
        sliding: Whether each joint is prismatic.
        q: Positions [rad or m].
        wanted: Which joints, from 1 as Pinocchio counts them; 0 is the base.

    Source: Rodrigues' rotation, R (cos q + (1 − cos q) z zᵀ + sin q [z]×) about an axis z.
    """
    turn, origin = np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3))
    found = {0: (turn, origin)} if 0 in wanted else {}
    for i in range(max(wanted, default=0)):
        origin = origin + turn @ offsets[i]
        turn = turn @ rotations[i]
        if sliding[i]:
            origin = origin + q[:, i : i + 1] * (turn @ axes[i])
        else:
            x, y, z = axes[i]
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            s, c = np.sin(q[:, i])[:, None, None], np.cos(q[:, i])[:, None, None]
            turn = c * turn + (1.0 - c) * (turn @ np.outer(axes[i], axes[i])) + s * (turn @ cross)
        if i + 1 in wanted:
            found[i + 1] = turn, origin
    return found
