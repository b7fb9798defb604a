"""How far an arm is from a singular position."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.robot.arm import ArmModel
from plan.dynamics.placement import frame_states, random_positions


@dataclass(frozen=True, eq=False)
class Manipulability:
    """Yoshikawa's measure √det(J Jᵀ) of the tip, as a share of its largest value over the joints' range.

    J holds the tip's velocity, and its turning too from six joints on (levers measured in the arm's reach, so that
    both parts have one unit). Zero is singular. With fewer than three joints there is nothing to lose: 1 throughout.
    """

    arm: ArmModel

    def __call__(self, q: Float[Array, "T n"]) -> Float[Array, " T"]:
        """Share of the best manipulability at each position."""
        if self.arm.n < 3:
            return np.ones(len(q))
        return self._raw(q) / self._largest

    def _raw(self, q: Float[Array, "T n"]) -> Float[Array, " T"]:
        chain, n = self.arm.chain, self.arm.n
        linear, angular = frame_states(chain, np.ascontiguousarray(q, dtype=float), n, np.eye(3), self._tip)[2:]
        reach = np.linalg.norm(chain.offsets, axis=1).sum() + np.linalg.norm(self._tip)
        jacobian = linear if n < 6 else np.concatenate([linear / reach, angular], axis=2)
        if jacobian.shape[1] == jacobian.shape[2]:
            return np.abs(np.linalg.det(jacobian))
        return np.sqrt(np.maximum(np.linalg.det(jacobian.transpose(0, 2, 1) @ jacobian), 0.0))

    @cached_property
    def _tip(self) -> Float[Array, " 3"]:
        """Origin of the last link in the last joint's frame [m]; with a frozen wrist, that is the wrist's end."""
        frames = [frame for frame in self.arm.model.frames if frame.parentJoint == self.arm.n]
        return freeze(frames[-1].placement.translation)

    @cached_property
    def _largest(self) -> float:
        return float(self._raw(random_positions(self.arm, 2000)).max())
