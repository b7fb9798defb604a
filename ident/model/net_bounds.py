"""The box of inputs that a joint's net was fitted in.

Beyond it the net says what it says at the edge: a net knows nothing of where it never was. On a
simulated arm whose runs left out went faster than the others, what it made up there was four times
the error that it was to take away.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arrays import Array, Bool, Float, freeze

# Share of the samples at either end that bound nothing: a smoother's overshoot is no place where
# the arm was.
TAILS = 0.001


@dataclass(frozen=True, eq=False)
class NetBounds:
    """Least and largest speed, acceleration and rigid torque that each joint's net is given."""

    # Shape (3, n): dq [rad/s], ddq [rad/s²], rigid torque [N m].
    low: Float[Array, "3 n"]
    high: Float[Array, "3 n"]

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        if self.low.shape != self.high.shape or self.low.ndim != 2 or len(self.low) != 3:
            raise ValueError("the net's bounds are not three pairs a joint")
        if not np.all(self.low <= self.high):
            raise ValueError("a bound of the net is missing, or the lower one is above the upper")

    @classmethod
    def of(cls, inputs: Float[Array, "3 T n"], counts: Bool[Array, "T n"]) -> NetBounds:
        """Bounds of the samples that count; of a joint without any, of all."""
        joints = inputs.shape[2]
        low, high = np.empty((2, 3, joints))
        for j in range(joints):
            rows = counts[:, j] if counts[:, j].any() else slice(None)
            low[:, j], high[:, j] = np.quantile(inputs[:, rows, j], [TAILS, 1.0 - TAILS], axis=1)
        return cls(low, high)

    def clip(
        self, dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"]
    ) -> tuple[Float[Array, "T n"], Float[Array, "T n"], Float[Array, "T n"]]:
        """Speed, acceleration and rigid torque, moved to the nearest edge if they lie outside."""
        low = self.low
        high = self.high
        return (
            np.clip(dq, low[0], high[0]),
            np.clip(ddq, low[1], high[1]),
            np.clip(rigid, low[2], high[2]),
        )

    def of_joints(self, joints: slice) -> NetBounds:
        """The bounds of some joints."""
        return NetBounds(self.low[:, joints], self.high[:, joints])

    def to_dict(self) -> dict[str, object]:
        """For the net's record."""
        return {"low": self.low.tolist(), "high": self.high.tolist()}

    @classmethod
    def from_dict(cls, record: dict[str, Any], n: int) -> NetBounds:
        """What `to_dict` wrote.

        Raises:
            KeyError, TypeError, ValueError: It is damaged, or not of n joints.
        """
        low = np.array(record["low"], dtype=float)
        high = np.array(record["high"], dtype=float)
        if low.shape != (3, n) or not (np.isfinite(low).all() and np.isfinite(high).all()):
            raise ValueError(f"the net's bounds are not three finite pairs for {n} joints")
        return cls(low, high)
