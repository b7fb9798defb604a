"""How far an arm is from a singular position."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from ident.arrays import Array, Float, freeze
from ident.robot.arm import ArmModel
from plan.dynamics.chain import Chain


@njit(cache=True, fastmath=True, nogil=True)
def _jacobians(rot, off, axes, sliding, tip, q):  # type: ignore[no-untyped-def]
    """Geometric Jacobian of the tip at every position, base axes, shape (T, 6, n)."""
    count, n = q.shape
    out = np.zeros((count, 6, n))
    at, frame, r = np.zeros((n + 1, 3)), np.zeros((n + 1, 3, 3)), np.zeros((3, 3))
    for k in range(3):
        frame[0, k, k] = 1.0
    for t in range(count):
        for i in range(n):
            slides = sliding[i] > 0.5
            s = 0.0 if slides else np.sin(q[t, i])
            c = 0.0 if slides else 1.0 - np.cos(q[t, i])
            for k in range(3):
                for m in range(3):
                    r[k, m] = rot[i, 0, k, m] + s * rot[i, 1, k, m] + c * rot[i, 2, k, m]
            for k in range(3):
                at[i + 1, k] = at[i, k]
                for m in range(3):
                    at[i + 1, k] += frame[i, k, m] * off[i, m]
                    frame[i + 1, k, m] = frame[i, k, 0] * r[0, m] + frame[i, k, 1] * r[1, m] + frame[i, k, 2] * r[2, m]
            if slides:
                for k in range(3):
                    for m in range(3):
                        at[i + 1, k] += frame[i + 1, k, m] * axes[i, m] * q[t, i]
        for i in range(n):
            for k in range(3):
                axis = 0.0
                for m in range(3):
                    axis += frame[i + 1, k, m] * axes[i, m]
                if sliding[i] > 0.5:
                    out[t, k, i] = axis
                else:
                    out[t, 3 + k, i] = axis
            if sliding[i] < 0.5:
                for k in range(3):
                    k1, k2 = (k + 1) % 3, (k + 2) % 3
                    lever1, lever2 = at[n, k1] - at[i + 1, k1], at[n, k2] - at[i + 1, k2]
                    for m in range(3):
                        lever1 += frame[n, k1, m] * tip[m]
                        lever2 += frame[n, k2, m] * tip[m]
                    out[t, k, i] = out[t, 3 + k1, i] * lever2 - out[t, 3 + k2, i] * lever1
    return out


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
        jacobian = _jacobians(*self._chain.kinematics, self._tip, np.ascontiguousarray(q, dtype=float))
        if self.arm.n < 6:
            jacobian = jacobian[:, :3]
        else:
            jacobian[:, :3] /= self._reach
        if jacobian.shape[1] == jacobian.shape[2]:
            return np.abs(np.linalg.det(jacobian))
        gram = jacobian @ jacobian.transpose(0, 2, 1)
        return np.sqrt(np.maximum(np.linalg.det(gram), 0.0))

    @cached_property
    def _chain(self) -> Chain:
        return Chain.from_arm(self.arm)

    @cached_property
    def _reach(self) -> float:
        return float(np.linalg.norm(self._chain.offsets, axis=1).sum() + np.linalg.norm(self._tip))

    @cached_property
    def _tip(self) -> Float[Array, " 3"]:
        """Origin of the last link in the last joint's frame [m]; with a frozen wrist, that is the wrist's end."""
        frames = [frame for frame in self.arm.model.frames if frame.parentJoint == self.arm.n]
        return freeze(frames[-1].placement.translation)

    @cached_property
    def _largest(self) -> float:
        rng = np.random.default_rng(0)  # fixed: the scale is a property of the arm
        low, high = np.maximum(self.arm.lower, -np.pi), np.minimum(self.arm.upper, np.pi)
        return float(self._raw(rng.uniform(low, high, (2000, self.arm.n))).max())
