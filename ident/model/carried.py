"""Effects that a model carries as they were found, beside fitted laws.

Friction's laws of one joint's states are fitted anew with the rest of a model
(`ident.laws.carried`). What acts on several joints, has a memory or changes what the log says
(springs, couplings, links, offsets, gains) is carried with the parameters that a diagnosis, or a
fit of its own, gave it: it is taken off the recordings before the rest is fitted, and comes back
whenever torque is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ident.arrays import Array, Float
from ident.laws.acting import KNOWN, Effect, acting_torque, read_log, undo_log
from ident.laws.motion import Arm, Losses, MovingArm
from ident.model.loss import LossParameters
from ident.model.sampling import sampling_interval
from ident.records import JsonTable
from ident.robot.arm import ArmModel


@dataclass(frozen=True)
class CarriedEffect:
    """One effect with its parameters."""

    effect: str  # its id, one of `ident.laws.acting.KNOWN`
    joint: int  # its joint's number from zero; -1 for the whole arm
    parameters: Mapping[str, float]
    # Ends of the 95 % intervals that whoever found it gave, by parameter.
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.effect not in KNOWN:
            raise ValueError(f"{self.effect!r} is no effect that a model carries")
        values = {name: float(value) for name, value in self.parameters.items()}
        if not np.isfinite(list(values.values())).all():
            raise ValueError(f"a parameter of {self.effect} is not finite")
        object.__setattr__(self, "parameters", values)

    @property
    def as_law(self) -> Effect:
        """What the laws take: id, joint's number (-1 of the whole arm) and parameters."""
        return self.effect, self.joint, dict(self.parameters)

    def to_dict(self) -> dict[str, object]:
        """Its record in model.toml.

        Returns:
            "effect" (id), "joint" (number, -1 of the whole arm), "parameters" by name, and where
            known "intervals": [low, high] by name.
        """
        record: dict[str, object] = {"effect": self.effect, "joint": self.joint}
        record["parameters"] = dict(self.parameters)
        if self.intervals:
            record["intervals"] = {name: list(ends) for name, ends in self.intervals.items()}
        return record

    @classmethod
    def from_dict(cls, record: JsonTable, joints: int) -> CarriedEffect:
        """Reads it back.

        Raises:
            KeyError, TypeError, ValueError: It is damaged.
        """
        joint = record["joint"]
        if not isinstance(joint, int) or not -1 <= joint < joints:
            raise ValueError(f"{record['effect']} is of joint {joint!r}, which the arm has not")
        ends = {
            name: (float(low), float(high))
            for name, (low, high) in record.get("intervals", {}).items()
        }
        return cls(str(record["effect"]), joint, dict(record["parameters"]), ends)


def describe_arm(arm: ArmModel) -> Arm:
    """The arm's chain in plain arrays."""
    chain = arm.chain
    return Arm(
        rotations=chain.rotations[:, 0],
        offsets=chain.offsets,
        axes=chain.axes,
        sliding=chain.sliding,
        links=arm.inertial_parameters.reshape(arm.n, 10),
        gravity=chain.gravity,
        gears=None if arm.gear_ratios is None else np.array(arm.gear_ratios),
        rated=np.array(arm.effort_limit),
    )


def moving_arm(
    arm: ArmModel,
    loss: LossParameters,
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    ddq: Float[Array, "T n"],
) -> MovingArm:
    """The arm along states, as the laws see it."""
    width = np.maximum(loss.transition_speed, 1e-4)
    losses = Losses(loss.motor_inertia, loss.viscous, loss.coulomb, width, np.zeros(arm.n))
    return MovingArm(describe_arm(arm), losses, q, dq, ddq, sampling_interval(q, dq) or 0.0)


def carried_torque(effects: Sequence[CarriedEffect], moving: MovingArm) -> Float[Array, "T n"]:
    """What the effects add to the torque that acts [N m].

    Raises:
        ValueError: One of them has a memory, and the states do not follow one another.
    """
    return np.asarray(acting_torque([effect.as_law for effect in effects], moving))


def as_logged(
    effects: Sequence[CarriedEffect], torque: Float[Array, "T n"], interval: float
) -> Float[Array, "T n"]:
    """What a log reads of a torque [N m]; lateness only along a motion.

    Args:
        effects: What the model carries; those of the log alone matter.
        torque: What acts.
        interval: Time from row to row [s]; 0 for states that don't follow one another.
    """
    return read_log(_in_log(effects, interval), torque, interval)


def as_acting(
    effects: Sequence[CarriedEffect], log: Float[Array, "T n"], interval: float
) -> Float[Array, "T n"]:
    """The torque behind a log [N m]: the inverse of `as_logged`, whose arguments it takes."""
    return undo_log(_in_log(effects, interval), log, interval)


def _in_log(effects: Sequence[CarriedEffect], interval: float) -> list[Effect]:
    along_motion = interval > 0.0
    return [effect.as_law for effect in effects if along_motion or effect.effect != "torque_delay"]
