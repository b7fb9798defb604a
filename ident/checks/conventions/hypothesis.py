"""A reading of a log and a URDF: order, direction, zero, unit, signs, gravity, masses.

All of it is one hypothesis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.arrays import Array, Float

# A zero is off by quarters of a turn [rad]: what lies between is for a diagnosis to find.
QUARTER = 0.5 * math.pi
ZEROS = (0.0, QUARTER, math.pi, -QUARTER)  # angles of 0 to 3 quarters, the shorter way round [rad]
# Factors that make radians of what a log may hold, by the unit's name; also of radians that were
# read as degrees.
UNITS = {"deg": math.radians(1.0), "turns": math.tau, "rad": math.degrees(1.0)}
# Factors that make a joint's angle of one that is counted elsewhere in its drive.
GEARS = (0.5, 2.0)
# Gravity is where the URDF's base has it.
AS_STATED = "stated"
# No gravity is in the effort.
COMPENSATED = "compensated"


@dataclass(frozen=True)
class Hypothesis:
    """How to read a log of n joints.

    The URDF's angle of joint j is

        q_j = a_j + share_j · a_(j-1),
        a_j = direction_j · gear_j · unit_j · position[order_j] + zero_j,

    and its torque direction_j · effort_sign_j · effort[effort_order_j].
    """

    order: tuple[int, ...]  # column of the log that is each joint's position
    effort_order: tuple[int, ...]  # column of the log that is each joint's effort
    direction: tuple[int, ...]  # 1, or -1 where the log's axis turns the other way
    quarters: tuple[int, ...]  # quarters of a turn between both zeros, 0 to 3
    # Of each joint's position: empty for what the log states, or a key of `UNITS`.
    unit: tuple[str, ...]
    effort_sign: tuple[int, ...]  # 1, or -1 where the log's torque alone has the other sign
    gear: tuple[float, ...]  # of each joint's position: 1, or one of `GEARS`
    # Of the position of the joint before that is part of each joint's angle: 0, 1 or -1.
    share: tuple[int, ...]
    # `stated`, `compensated`, or a vector in the base's frame [m/s²].
    gravity: str | tuple[float, float, float] = AS_STATED
    mass_factor: float = 1.0  # what all masses of the URDF are to be multiplied with
    # Joint -> what its effort is of a torque in N m, where it alone is in another unit.
    effort_scale: tuple[tuple[int, float], ...] = ()
    # Mass [kg] and first moment [kg m], in the last link's frame, of a body that the URDF lacks;
    # negative where it has one that is not on the arm. None for none.
    body: tuple[float, float, float, float] | None = None
    # Ten numbers a link in place of the URDF's, where its masses and centres are guesses; None for
    # the URDF's.
    parameters: tuple[float, ...] | None = None

    @classmethod
    def as_it_is(cls, count: int) -> Hypothesis:
        """The reading of a log of `count` joints that changes nothing."""
        plain = tuple(range(count))
        ones = (1,) * count
        zeros = (0,) * count
        return cls(
            order=plain,
            effort_order=plain,
            direction=ones,
            quarters=zeros,
            unit=("",) * count,
            effort_sign=ones,
            gear=(1.0,) * count,
            share=zeros,
        )

    @property
    def motion(self) -> tuple[Any, ...]:
        """The fields that motion depends on: order, direction, quarters, unit, gear and share."""
        return (
            self.order,
            self.direction,
            self.quarters,
            self.unit,
            self.gear,
            self.share,
        )

    @property
    def changes(self) -> tuple[str, ...]:
        """Names of the conventions that it changes; empty where it reads the log as it is."""
        plain = tuple(range(len(self.order)))
        names = []
        if self.order != plain:
            names.append("order")
        if self.effort_order != self.order:
            names.append("effort_order")
        names += _of_joints("direction", [sign < 0 for sign in self.direction])
        names += _of_joints("zero", self.quarters)
        is_common = all(self.unit) and len(set(self.unit)) == 1
        names += ["unit"] if is_common else _of_joints("unit", self.unit)
        names += _of_joints("gear", [factor != 1.0 for factor in self.gear])
        names += _of_joints("share", self.share)
        flipped = [sign < 0 for sign in self.effort_sign]
        names += ["effort_sign"] if all(flipped) else _of_joints("effort_sign", flipped)
        if self.gravity != AS_STATED:
            names.append("gravity")
        if self.mass_factor != 1.0:
            names.append("mass_factor")
        names += [f"effort_scale {joint}" for joint, _ in self.effort_scale]
        if self.body is not None:
            names.append("body")
        if self.parameters is not None:
            names.append("masses")
        return tuple(names)

    def angles(self, position: Float[Array, "T n"], sliding: Array) -> Float[Array, "T n"]:
        """The URDF's angles of the log's positions [rad or m]; a slide has no unit and no turns."""
        (angles,) = states_as([self], (position,), sliding)
        return angles[0]

    def with_shares(self, angles: Float[Array, "T n"]) -> Float[Array, "T n"]:
        """Angles, or their derivatives, with the joint before's part of them."""
        if not any(self.share):
            return np.asarray(angles)
        before = np.zeros_like(angles)
        before[:, 1:] = angles[:, :-1]
        return np.asarray(angles + np.array(self.share) * before)

    def rates(self, values: Float[Array, "T n"], sliding: Array) -> Float[Array, "T n"]:
        """The URDF's rates of the log's: as `angles`, without the zeros [rad/s or m/s]."""
        nowhere = np.empty((0, values.shape[1]))
        _, rates = states_as([self], (nowhere, values), sliding)
        return rates[0]

    def with_entry(self, name: str, joint: int, value: Any) -> Hypothesis:
        """A copy with the joint's entry of one of its tuples replaced.

        Args:
            name: Name of the field.
            joint: Index of the joint.
            value: The new entry.
        """
        values = list(getattr(self, name))
        values[joint] = value
        changes: dict[str, Any] = {name: tuple(values)}
        return replace(self, **changes)


def _of_joints(name: str, changed: Sequence[object]) -> list[str]:
    """A change's name with each joint at which it is made."""
    return [f"{name} {joint}" for joint, is_changed in enumerate(changed) if is_changed]


def states_as(
    readings: Sequence[Hypothesis], states: Sequence[Float[Array, "T n"]], sliding: Array
) -> list[Float[Array, "k T n"]]:
    """A log's positions and their derivatives as each of k readings has the URDF's joints.

    Args:
        readings: How the log is read.
        states: Positions of the log, then as many of their derivatives as are wanted.
        sliding: Which joints slide: these have no unit and no turns.
    """
    orders = np.array([reading.order for reading in readings])
    units = np.array([_factors_of_units(reading) for reading in readings])
    direction = np.array([reading.direction for reading in readings])
    gear = np.array([reading.gear for reading in readings])
    quarters = np.array([reading.quarters for reading in readings])
    shares = np.array([reading.share for reading in readings])
    turning_units = np.where(sliding, 1.0, units)
    factor = (turning_units * direction * gear)[:, None]
    zero = np.where(sliding, 0.0, np.array(ZEROS)[quarters])[:, None]
    joints: list[Float[Array, "k T n"]] = []
    for values in states:
        read = factor * values[:, orders].swapaxes(0, 1)
        if not joints:
            read = read + zero
        if shares.any():
            before = read[..., :-1].copy()
            read[..., 1:] += shares[:, None, 1:] * before
        joints.append(read)
    return joints


def _factors_of_units(reading: Hypothesis) -> list[float]:
    """What each joint's position is to be multiplied with for its unit."""
    return [UNITS.get(unit, 1.0) for unit in reading.unit]
