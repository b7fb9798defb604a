"""How unlikely a reading is before the log is seen: the length of its description.

A change is told by its kind and by which of the alternatives of that kind it is; each costs the
logarithm of its number. What is told by a number costs the logarithm of how many values can be told
apart. Evidence and description are brought together by `observations`: how many independent
observations a joint's torque is worth, halved.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from ident.checks.conventions.hypothesis import (
    AS_STATED,
    COMPENSATED,
    GEARS,
    UNITS,
    ZEROS,
    Hypothesis,
)
from ident.checks.conventions.settings import DESCRIPTION, MASSES, SEARCH
from ident.checks.conventions.settings import READINGS as READING

# The kinds of change: order, effort order, direction, zero, unit, sign, mount, compensation,
# factor, scale, body, all masses, gear, share of the joint before.
KIND = math.log(14.0)
BODY_PARAMETERS = 4
OTHER_ZEROS = len(ZEROS) - 1
AXES = 6
# A vector along an axis of the base has no other component of more than this share of its length.
ALONG_AXIS = 0.999


Orders = Collection[tuple[int, ...]]


class Prices:
    """What readings' changes cost, each counted once.

    Args:
        usual_orders: Orders in which logs have all columns otherwise than the robot has its joints.
    """

    def __init__(self, usual_orders: Orders) -> None:
        self.usual_orders = usual_orders
        self._known: dict[Hypothesis, float] = {}

    def of(self, hypothesis: Hypothesis) -> float:
        """Cost of a reading's changes, as `price` has it; worked out once."""
        known = self._known.get(hypothesis)
        if known is None:
            known = price(hypothesis, self.usual_orders)
            self._known[hypothesis] = known
        return known


def price(hypothesis: Hypothesis, usual_orders: Orders = ()) -> float:
    """Cost of all changes of a reading, in the unit of a joint's cost (logarithm of the share
    left).

    Args:
        hypothesis: The reading.
        usual_orders: Orders in which logs have all columns otherwise than the robot has its joints.
    """
    return description_length(hypothesis, usual_orders) / float(DESCRIPTION.observations)


def description_length(hypothesis: Hypothesis, usual_orders: Orders = ()) -> float:
    """Length of the description of all that a reading changes [nats].

    Args:
        hypothesis: The reading.
        usual_orders: Orders in which logs have all columns otherwise than the robot has its joints.
    """
    count = len(hypothesis.order)
    if hypothesis.order in usual_orders:
        length = KIND + math.log(len(usual_orders))
    else:
        length = _order(hypothesis.order, tuple(range(count)))
    length += _order(hypothesis.effort_order, hypothesis.order)
    turned = sum(sign < 0 for sign in hypothesis.direction)
    length += (KIND + math.log(count)) * turned
    moved = sum(map(bool, hypothesis.quarters))
    length += (KIND + math.log(OTHER_ZEROS * count)) * moved
    geared = sum(factor != 1.0 for factor in hypothesis.gear)
    length += geared * (KIND + math.log(len(GEARS) * count))
    length += sum(map(bool, hypothesis.share)) * (KIND + math.log(2 * count))
    length += _units(hypothesis) + _signs(hypothesis) + gravity_length(hypothesis.gravity)
    if hypothesis.mass_factor != 1.0:
        length += KIND + sizes_told_apart()
    length += len(hypothesis.effort_scale) * scale_length(count)
    if hypothesis.body is not None:
        length += KIND + 0.5 * BODY_PARAMETERS * math.log(MASSES.independent)
    if hypothesis.parameters is not None:  # what the numbers cost, their number tells
        length += KIND
    return length


def sizes_told_apart() -> float:
    """Description length of a torque's size: log of how many sizes are told apart [nats]."""
    return math.log(2.0 * math.log(READING.most_size) / DESCRIPTION.size_spread)


def scale_length(count: int) -> float:
    """Length of the description that one of `count` joints has another unit of effort [nats]."""
    return KIND + math.log(count) + sizes_told_apart()


def gravity_length(gravity: str | tuple[float, float, float]) -> float:
    """Length of the description of where gravity lies [nats].

    Args:
        gravity: `AS_STATED` (0 nats), `COMPENSATED`, or a vector in the base's frame, which costs
            less along an axis.
    """
    if gravity == AS_STATED:
        return 0.0
    if gravity == COMPENSATED:
        return KIND
    vector = np.abs(np.array(gravity, dtype=float))
    if vector.max() > ALONG_AXIS * np.linalg.norm(vector):
        return KIND + math.log(AXES - 1)
    # Share of the sphere around one direction.
    cap = 0.5 * (1.0 - math.cos(math.radians(SEARCH.snap_deg)))
    return KIND + math.log(1.0 / cap)


def sign_lengths(count: int) -> tuple[float, float]:
    """Lengths of two descriptions [nats]: all torques have the other sign; one of them has."""
    return KIND, KIND + math.log(count)


def column_length(count: int) -> float:
    """Length that each column under another name adds, about half that of an exchange of two
    [nats].

    Args:
        count: Number of joints.
    """
    return 0.5 * (KIND + math.log(max(count * (count - 1) / 2, 1.0)))


def size_price(log_size: np.ndarray) -> np.ndarray:
    """Cost of torques of another size, whose logarithms scatter normally.

    Args:
        log_size: Logarithms of the sizes over the model's.
    """
    return np.asarray(0.5 * (log_size / DESCRIPTION.size_spread) ** 2 / DESCRIPTION.observations)


def load_price(share: float) -> float:
    """Cost of a body by its mass, as rated loads scatter.

    Args:
        share: Its mass over that of the moving links.
    """
    return float(
        0.5 * (math.log1p(share) / DESCRIPTION.load_spread) ** 2 / DESCRIPTION.observations
    )


def _order(order: tuple[int, ...], usual: tuple[int, ...]) -> float:
    """Of columns of which some stand in another order than the usual one [nats]."""
    count = len(order)
    moved = sum(column != place for column, place in zip(order, usual, strict=True))
    if not moved:
        return 0.0
    return KIND + math.log(math.comb(count, moved) * _derangements(moved))


def _derangements(count: int) -> int:
    """Orders of so many of which none stands where it did."""
    before = 1
    now = 0
    for k in range(2, count + 1):
        next_one = (k - 1) * (before + now)
        before = now
        now = next_one
    return now if count else before


def _units(hypothesis: Hypothesis) -> float:
    """Of positions' units: all of them one, or single joints' own [nats]."""
    named = [unit for unit in hypothesis.unit if unit]
    count = len(hypothesis.unit)
    if not named:
        return 0.0
    if len(named) == count and len(set(named)) == 1:
        return KIND + math.log(len(UNITS))
    return len(named) * (KIND + math.log(count))


def _signs(hypothesis: Hypothesis) -> float:
    """Of torques of the other sign: all of them, or single joints' [nats]."""
    flipped = sum(sign < 0 for sign in hypothesis.effort_sign)
    every, single = sign_lengths(len(hypothesis.effort_sign))
    return every if flipped == len(hypothesis.effort_sign) else flipped * single
