"""The box of inputs that a joint's net was fitted in, and the range of torques that it gave there.

Beyond the box the net says what it says at the edge: a net knows nothing of where it never was. On
a simulated arm whose runs left out went faster than the others, what it made up there was four
times the error that it was to take away.

Within the box are corners where it never was either, a slow joint that accelerates fast under a
heavy load, say. On a real KUKA LWR4+, fitted to one motion twice, a net that had seen 0.4 N m at
the most gave 12 N m in another motion, inside its box. A net never says more than it said where it
was fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float, freeze
from ident.records import JsonRecord

# Share of the samples at either end that bound nothing: a smoother's overshoot is no place where
# the arm was.
TAILS = 0.001
# What bounds no torque [N m]; it is finite in single precision.
UNBOUNDED = 1e30


@dataclass(frozen=True, eq=False)
class NetBounds:
    """Least and largest speed, acceleration and rigid torque that each joint's net is given."""

    # Shape (3, n): dq [rad/s], ddq [rad/s²], rigid torque [N m].
    low: Float[Array, "3 n"]
    high: Float[Array, "3 n"]
    # Least and largest torque that each joint's net gives [N m]; no bound if None.
    least: Float[Array, " n"] | None = None
    most: Float[Array, " n"] | None = None

    def __post_init__(self) -> None:
        joints = np.shape(self.low)[-1]
        if self.least is None:
            object.__setattr__(self, "least", np.full(joints, -UNBOUNDED))
        if self.most is None:
            object.__setattr__(self, "most", np.full(joints, UNBOUNDED))
        for name in ("low", "high", "least", "most"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        is_table = self.low.ndim == 2 and len(self.low) == 3
        if self.low.shape != self.high.shape or not is_table:
            raise ValueError("the net's bounds are not three pairs a joint")
        if not np.all(self.low <= self.high):
            raise ValueError("a bound of the net is missing, or the lower one is above the upper")
        least, most = self.torques
        if least.shape != most.shape or not np.all(least <= most):
            raise ValueError("a bound of the net's torque is missing, or above the upper one")

    @classmethod
    def of(cls, inputs: Float[Array, "3 T n"], counts: Bool[Array, "T n"]) -> NetBounds:
        """Bounds of the samples that count; of a joint without any, of all.

        Args:
            inputs: Speed [rad/s], acceleration [rad/s²] and rigid torque [N m].
            counts: Samples that count, by joint.
        """
        joints = inputs.shape[2]
        low, high = np.empty((2, 3, joints))
        for j in range(joints):
            rows = counts[:, j] if counts[:, j].any() else slice(None)
            moving = inputs[:, rows, j]
            low[:, j], high[:, j] = np.quantile(moving, [TAILS, 1.0 - TAILS], axis=1)
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

    @property
    def torques(self) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Least and largest torque of each joint [N m]."""
        assert self.least is not None
        assert self.most is not None
        return self.least, self.most

    def clip_torque(self, torque: Float[Array, "T n"]) -> Float[Array, "T n"]:
        """Torque of each joint, moved to the nearest of what its net may say [N m]."""
        return np.clip(torque, *self.torques)

    def with_torques(self, said: Float[Array, "T n"], counts: Bool[Array, "T n"]) -> NetBounds:
        """These bounds, with the range of torques that nets gave at the samples that count.

        Args:
            said: The nets' torques [N m].
            counts: Samples that count; of a joint without any, all do.
        """
        ends = np.zeros((2, said.shape[1]))
        for j in range(said.shape[1]):
            rows = counts[:, j] if counts[:, j].any() else slice(None)
            ends[:, j] = np.quantile(said[rows, j], [TAILS, 1.0 - TAILS])
        return NetBounds(self.low, self.high, ends[0], ends[1])

    def of_joints(self, joints: slice) -> NetBounds:
        """The bounds of some joints."""
        least, most = self.torques
        return NetBounds(
            self.low[:, joints],
            self.high[:, joints],
            least[joints],
            most[joints],
        )

    def to_dict(self) -> dict[str, object]:
        """Its part of the net's record.

        Returns:
            "low" and "high": speed, acceleration and rigid torque of each joint, three lists;
            "least_Nm" and "most_Nm": one number a joint.
        """
        least, most = self.torques
        return {
            "low": self.low.tolist(),
            "high": self.high.tolist(),
            "least_Nm": least.tolist(),
            "most_Nm": most.tolist(),
        }

    @classmethod
    def from_dict(cls, record: JsonRecord, n: int) -> NetBounds:
        """What `to_dict` wrote.

        Raises:
            KeyError, TypeError, ValueError: It is damaged, or not of n joints.
        """
        low = np.array(record["low"], dtype=float)
        high = np.array(record["high"], dtype=float)
        is_finite = np.isfinite(low).all() and np.isfinite(high).all()
        if low.shape != (3, n) or not is_finite:
            raise ValueError(f"the net's bounds are not three finite pairs for {n} joints")
        if "least_Nm" not in record:  # as it was written before there were any
            return cls(low, high)
        least = np.array(record["least_Nm"], dtype=float)
        most = np.array(record["most_Nm"], dtype=float)
        is_finite = np.isfinite(least).all() and np.isfinite(most).all()
        if least.shape != (n,) or not is_finite:
            raise ValueError(f"the net's torques are not two finite bounds for {n} joints")
        return cls(low, high, least, most)
