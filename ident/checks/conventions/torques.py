"""The likeliest readings of the torque under readings of the motion.

Each joint's own column of effort is asked first, of either sign, under each gravity, with the
URDF's masses and with all of them by one factor. Where that is likeliest, and with gravity as
stated, every column is asked as every joint's: whether others' explain more.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from ident.arrays import Array, Float
from ident.checks.conventions.description import (
    KIND,
    column_length,
    gravity_length,
    sign_lengths,
    sizes_told_apart,
)
from ident.checks.conventions.hypothesis import Hypothesis
from ident.checks.conventions.readings import Sums, common_size, own_columns, unexplained
from ident.checks.conventions.settings import DESCRIPTION, MASSES

# Readings of the torque that are kept of each motion.
MOST_TORQUES = 3


class Columns(NamedTuple):
    """What a log's columns of effort are worth, by column."""

    weights: Float[Array, " n"]  # of evidence for a reading
    alive: Array  # whether the column changes at all: then it is evidence against one

    def weighed(self, costs: Array, columns: Array | slice = slice(None)) -> Array:
        """Costs by column (last axis), weighed by what the columns are worth.

        Of a joint that stands, gains count little and losses in full.

        Args:
            costs: Logarithms of the shares that are left.
            columns: Which column each is of; all in order by default.
        """
        gains = self.weights[columns] * costs
        losses = self.alive[columns] * costs
        return np.asarray(np.where(costs < 0.0, gains, losses))


class Gravities(NamedTuple):
    """Directions of gravity that are tried, the stated one first."""

    names: list[str | tuple[float, float, float]]
    vectors: Float[Array, "g 3"]  # zero where gravity is not in the effort [m/s²]


class Torque(NamedTuple):
    """One reading of the torque under a reading of the motion."""

    cost: float  # of all joints, with what it is unlikely
    gravity: int  # place among those that are tried; 0 as stated
    columns: Array  # of effort, by joint
    signs: Array  # 1 where a joint's torque has the other sign
    costs: Array  # of each joint
    sizes: Array  # of each joint's torque over the model's


class Place(NamedTuple):
    """A factor of all masses and a gravity of one reading of the motion."""

    reading: int
    factor: int  # 0 for the URDF's masses, 1 for all of them by one factor
    gravity: int


class Torques:
    """The likeliest readings of the torque under some readings of the motion."""

    def __init__(
        self,
        sums: Sums,
        readings: Sequence[Hypothesis],
        gravities: Gravities,
        columns: Columns,
    ) -> None:
        self.sums = sums
        self.columns = columns
        self.n = len(readings[0].order)
        self.orders = np.array([reading.order for reading in readings])
        directions = np.array([reading.direction for reading in readings])
        self.backwards = directions < 0
        shape = (len(readings), *gravities.vectors.shape)
        self.vectors = np.broadcast_to(gravities.vectors, shape)
        size = common_size(sums, self.vectors, self.orders)
        is_usual = np.abs(np.log(size)) <= np.log(MASSES.usual_factor)
        usual = np.ones_like(size)
        self.scales = np.stack([usual, np.where(is_usual, 1.0, size)])
        of_gravity = np.array([gravity_length(gravity) for gravity in gravities.names])
        of_factor = (KIND + sizes_told_apart()) * (self.scales != 1.0)
        unlikely = of_gravity + of_factor
        self.unlikely = unlikely / DESCRIPTION.observations  # by factor, reading, gravity
        every, single = sign_lengths(self.n)
        self.price_of_all_signs = np.array([0.0, every / DESCRIPTION.observations])
        self.price_of_sign = np.array([0.0, single / DESCRIPTION.observations])

    def likeliest(self) -> Iterator[list[Torque]]:
        """For each reading of the motion its likeliest torques, the likeliest first.

        One of them at least has gravity as stated.
        """
        costs, sizes = self._of_own_columns()
        signed = np.stack([costs, costs[..., ::-1]]) + self.price_of_sign
        totals = signed.min(axis=-1).sum(axis=-1) + self.unlikely
        totals = totals + self.price_of_all_signs[:, None, None, None]
        turned = totals.argmin(axis=0)
        least = totals.min(axis=0)
        all_turned = np.arange(2)[:, None, None, None, None]
        signs = signed.argmin(axis=-1) ^ all_turned
        joints = np.arange(self.n)
        places: list[Place] = []
        torques: list[list[Torque]] = []
        for k, order in enumerate(self.orders):
            near = self._nearest(least[:, k], k)
            places += near[-2:]
            of_reading = []
            for place in dict.fromkeys(near):
                f = place.factor
                g = place.gravity
                sign = signs[turned[f, k, g], f, k, g]
                chosen = (f, k, g, joints, sign)
                torque = Torque(
                    cost=float(least[f, k, g]),
                    gravity=g,
                    columns=order,
                    signs=sign,
                    costs=costs[chosen],
                    sizes=sizes[chosen],
                )
                of_reading.append(torque)
            torques.append(of_reading)
        for place, exchanged in self._exchanged(list(dict.fromkeys(places)), least):
            torques[place.reading].append(exchanged)
        for some in torques:
            some.sort(key=lambda torque: torque.cost)
            as_stated = [torque for torque in some[MOST_TORQUES:] if torque.gravity == 0]
            yield some[:MOST_TORQUES] + as_stated[:1]

    def _nearest(self, least: Float[Array, "f g"], reading: int) -> list[Place]:
        """The likeliest factors and gravities; last once more the likeliest, and with gravity as
        stated.
        """
        count = least.shape[1]
        cheapest = np.argsort(least, axis=None)[: MOST_TORQUES - 1].tolist()
        stated = count * int(np.argmin(least[:, 0]))
        places = []
        for place in [*cheapest, cheapest[0], stated]:
            factor, gravity = divmod(place, count)
            places.append(Place(reading, factor, gravity))
        return places

    def _of_own_columns(self) -> tuple[Float[Array, "f k g n 2"], Float[Array, "f k g n 2"]]:
        """Cost and size of each joint's own column, by factor, reading, gravity, joint and sign."""
        sums = own_columns(self.sums, self.orders)
        all_costs = []
        all_sizes = []
        for scale in self.scales:
            costs, sizes = unexplained(sums, self.vectors, scale)
            all_costs.append(costs)
            all_sizes.append(sizes)
        flipped = self.backwards[:, :, None, None]
        costs = _as_directed(np.stack(all_costs)[:, :, :, :, 0], flipped)
        sizes = _as_directed(np.stack(all_sizes)[:, :, :, :, 0], flipped)
        columns = self.orders[:, None, None, :]
        weighed = self.columns.weighed(costs.transpose(0, 1, 3, 4, 2), columns)
        return weighed.transpose(0, 1, 2, 4, 3), sizes.transpose(0, 1, 3, 2, 4)

    def _exchanged(
        self, places: Sequence[Place], least: Float[Array, "f k g"]
    ) -> Iterator[tuple[Place, Torque]]:
        """With columns of effort that explain more than each joint's own."""
        k, f, g = np.array(places).T
        sums = self.sums
        some = Sums(
            left=sums.left[k],
            friction=sums.friction[k],
            spread=sums.spread[k],
            variance=sums.variance,
            beyond=sums.beyond[k],
        )
        vectors = self.vectors[k, g][:, None]
        scales = self.scales[f, k, g][:, None]
        costs, sizes = unexplained(some, vectors, scales)
        by_column = costs[:, :, 0].swapaxes(-1, -2)
        weighed = self.columns.weighed(by_column).swapaxes(-1, -2)
        flipped = self.backwards[k][:, :, None, None]
        costs = _as_directed(weighed, flipped)
        sizes = _as_directed(sizes[:, :, 0], flipped)
        joints = np.arange(self.n)
        column = column_length(self.n) / DESCRIPTION.observations
        moved = column * (self.orders[k][:, :, None] != joints)
        known = least[f, k, g]
        for turned in (0, 1):
            in_order = costs[..., ::-1] if turned else costs
            signed = in_order + self.price_of_sign
            best = signed.min(axis=-1) + moved
            more = self.unlikely[f, k, g] + self.price_of_all_signs[turned]
            # No columns explain more than each joint's best one.
            is_open = best.min(axis=-1).sum(axis=-1) + more < known
            for number in np.flatnonzero(is_open).tolist():
                _, columns = linear_sum_assignment(best[number])
                signs = signed[number, joints, columns].argmin(axis=-1) ^ turned
                chosen = (number, joints, columns, signs)
                place = places[number]
                torque = Torque(
                    cost=float(best[number, joints, columns].sum() + more[number]),
                    gravity=place.gravity,
                    columns=columns,
                    signs=signs,
                    costs=costs[chosen],
                    sizes=sizes[chosen],
                )
                yield place, torque


def _as_directed(values: Array, flipped: Array) -> Array:
    """Values by sign (last axis), the signs exchanged where a joint's direction is."""
    return np.where(flipped, values[..., ::-1], values)
