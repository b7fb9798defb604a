"""Where a model was fitted: how far each joint went, how fast, how hard.

And how well the model's torque is known there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.records import JsonRecord

# What is bounded, and its unit, which a sliding joint reads in metres.
QUANTITIES = ("position", "speed", "acceleration")
UNITS = ("rad", "rad/s", "rad/s2")
# Keys of the record, of each quantity.
KEYS = ("position_rad", "speed_rad_s", "acceleration_rad_s2")
# Least width of a range, by which what lies outside is divided.
LEAST_WIDTH = 1e-9


@dataclass(frozen=True, eq=False)
class TrainingRange:
    """The box of states that the training runs of n joints went through."""

    joints: tuple[str, ...]  # names of the joints
    # Least and largest position [rad], speed [rad/s] and acceleration [rad/s²], shape (3, n).
    low: Float[Array, "3 n"]
    high: Float[Array, "3 n"]
    # Half of the 95 % interval of each joint's torque inside that box, from the covariance of all
    # parameters and from friction that changes from run to run [N m]. Noise of the effort sensor is
    # not in it.
    torque_half_width: Float[Array, " n"]

    def __post_init__(self) -> None:
        for name in ("low", "high", "torque_half_width"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        n = len(self.joints)
        whole = all(
            bound.shape == (3, n) and np.isfinite(bound).all() for bound in (self.low, self.high)
        )
        if not whole or np.any(self.low > self.high):
            raise ValueError("the training range is not three pairs of bounds a joint")
        if self.torque_half_width.shape != (n,) or not np.all(self.torque_half_width >= 0.0):
            raise ValueError("a half width of the torque is missing or below zero")

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    def first(self, joints: int) -> TrainingRange:
        """The range of the first joints alone."""
        return TrainingRange(
            joints=self.joints[:joints],
            low=self.low[:, :joints],
            high=self.high[:, :joints],
            torque_half_width=self.torque_half_width[:joints],
        )

    def beyond(self, low: Float[Array, "3 n"], high: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
        """How far a motion's bounds lie outside, as a share of the range's width; zero inside.

        Args:
            low: Least position, speed and acceleration of each joint.
            high: Largest ones.
        """
        width = np.maximum(self.high - self.low, LEAST_WIDTH)
        outside = np.maximum(self.low - low, high - self.high)
        return np.maximum(outside, 0.0) / width

    def to_dict(self) -> dict[str, object]:
        """Its record in a model's folder.

        Returns:
            "joints", for each of `KEYS` a list of [low, high] a joint, and "torque_half_width_Nm".
        """
        record: dict[str, object] = {"joints": list(self.joints)}
        for key, low, high in zip(KEYS, self.low, self.high, strict=True):
            record[key] = np.column_stack([low, high]).tolist()
        return {**record, "torque_half_width_Nm": self.torque_half_width.tolist()}

    @classmethod
    def from_dict(cls, record: JsonRecord) -> TrainingRange:
        """What `to_dict` wrote.

        Raises:
            KeyError, ValueError: It is damaged.
        """
        bounds = np.array([record[key] for key in KEYS], dtype=float)
        if bounds.ndim != 3 or bounds.shape[2] != 2:
            raise ValueError("the training range is not three pairs of bounds a joint")
        half = np.array(record["torque_half_width_Nm"], dtype=float)
        joints = tuple(map(str, record["joints"]))
        return cls(joints, bounds[:, :, 0], bounds[:, :, 1], half)
