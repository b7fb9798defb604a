"""Where a model was fitted: how far each joint went, how fast, how hard; and how well its torque is known there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.model.identification import Identified
from ident.model.joint_estimate import quantile
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel

# What is bounded, and its unit, which a sliding joint reads in metres.
QUANTITIES = ("position", "speed", "acceleration")
UNITS = ("rad", "rad/s", "rad/s2")
KEYS = tuple(f"{name}_{unit.replace('/', '_')}" for name, unit in zip(QUANTITIES, UNITS, strict=True))
# Share of the samples at either end that bound nothing: a smoother's overshoot is no place where the arm was.
TAILS = 0.001
# States at which the torque's interval is looked at, and the share of them that it holds for.
STATES, COVERED = 2000, 0.95


@dataclass(frozen=True, eq=False)
class TrainingRange:
    """The box of states that the training runs of n joints went through."""

    joints: tuple[str, ...]  # names of the joints
    # Least and largest position [rad], speed [rad/s] and acceleration [rad/s²], shape (3, n).
    low: Float[Array, "3 n"]
    high: Float[Array, "3 n"]
    # Half of the 95 % interval of each joint's torque inside that box, from the covariance of all parameters and from
    # friction that changes from run to run [N m]. Noise of the effort sensor is not in it.
    torque_half_width: Float[Array, " n"]

    def __post_init__(self) -> None:
        for name in ("low", "high", "torque_half_width"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        n = len(self.joints)
        parts = (self.low, self.high)
        if any(part.shape != (3, n) or not np.isfinite(part).all() for part in parts) or np.any(self.low > self.high):
            raise ValueError("the training range is not three pairs of bounds a joint")
        if self.torque_half_width.shape != (n,) or not np.all(self.torque_half_width >= 0.0):
            raise ValueError("a half width of the torque is missing or below zero")

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    def first(self, joints: int) -> TrainingRange:
        """The range of the first joints alone."""
        low, high = self.low[:, :joints], self.high[:, :joints]
        return TrainingRange(self.joints[:joints], low, high, self.torque_half_width[:joints])

    def beyond(self, low: Float[Array, "3 n"], high: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
        """How far a motion's bounds lie outside, as a share of the range's width; zero inside."""
        width = np.maximum(self.high - self.low, 1e-9)
        return np.maximum(np.maximum(self.low - low, high - self.high), 0.0) / width

    def to_dict(self) -> dict[str, Any]:
        """The record of a model's folder."""
        bounds = {key: np.column_stack([self.low[k], self.high[k]]).tolist() for k, key in enumerate(KEYS)}
        return {"joints": list(self.joints), **bounds, "torque_half_width_Nm": self.torque_half_width.tolist()}

    @classmethod
    def from_dict(cls, record: dict[str, Any]) -> TrainingRange:
        """What `to_dict` wrote.

        Raises:
            KeyError, ValueError: It is damaged.
        """
        bounds = np.array([record[key] for key in KEYS], dtype=float)
        if bounds.ndim != 3 or bounds.shape[2] != 2:
            raise ValueError("the training range is not three pairs of bounds a joint")
        half = np.array(record["torque_half_width_Nm"], dtype=float)
        return cls(tuple(map(str, record["joints"])), bounds[:, :, 0], bounds[:, :, 1], half)


def find_training_range(motions: Sequence[Motion], nominal: ArmModel, found: Identified) -> TrainingRange:
    """The range of training runs, and how well the torque that was identified from them is known there.

    Args:
        motions: The runs.
        nominal: The arm whose base parameters were identified.
        found: What was identified.
    """
    parts = [np.stack([m.q[m.coarse], m.dq[m.coarse], m.ddq[m.coarse]]) for m in motions]
    states = np.concatenate(parts, axis=1)
    low, high = np.quantile(states, [TAILS, 1.0 - TAILS], axis=1)
    even = np.unique(np.linspace(0, states.shape[1] - 1, STATES).astype(int))
    variance = np.concatenate(list(_torque_variance(states[:, even], nominal, found)))
    half = np.sqrt(np.quantile(variance, COVERED, axis=0))
    return TrainingRange(nominal.joint_names, low, high, half * float(np.median(quantile(found.estimate.dof))))


def _torque_variance(
    states: Float[Array, "3 T n"], nominal: ArmModel, found: Identified
) -> Iterator[Float[Array, "t n"]]:
    """Variance of each joint's torque at some states [N² m²], a thousand of them at a time."""
    figures, base = found.estimate, found.inertia.base
    kept = np.arange(figures.rank)
    for part in np.array_split(states, -(-states.shape[1] // 1000), axis=1):
        q, dq, ddq = part
        regressor = nominal.regressor(q, dq, ddq, base.columns)
        sign = np.tanh(dq / np.maximum(found.loss.params.transition_speed, 1e-9))
        losses = np.stack([ddq, dq, sign, np.ones_like(dq)], axis=-1)[..., : figures.per_joint]
        out = np.empty(dq.shape)
        for j in range(dq.shape[1]):
            index = np.concatenate([kept, figures.index(j)])
            x = np.concatenate([regressor[:, j], losses[:, j]], axis=1)
            out[:, j] = np.sum((x @ figures.covariance[np.ix_(index, index)]) * x, axis=1)
            run = found.spread[j] * np.array([found.loss.params.viscous[j], found.loss.params.coulomb[j]])
            out[:, j] += (run[0] * dq[:, j]) ** 2 + (run[1] * sign[:, j]) ** 2
        yield out
