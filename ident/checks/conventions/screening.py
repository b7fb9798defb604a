"""Readings of the motion compared by few states, each with its likeliest readings of the torque.

Signs of torques, the order of their columns, gravity and one factor of all masses follow from the
sums of a reading's motion, so that a reading of the motion is asked once, whatever the torque is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from ident.checks.conventions.description import Prices
from ident.checks.conventions.hypothesis import COMPENSATED, Hypothesis
from ident.checks.conventions.model import Model
from ident.checks.conventions.readings import AXES, GRAVITY, Log, likeliest_gravity, read
from ident.checks.conventions.settings import SEARCH
from ident.checks.conventions.torques import Columns, Gravities, Torque, Torques

# A body at the arm's end: mass [kg] and first moment [kg m]; None for none.
Body = tuple[float, float, float, float] | None
# A reading of the motion, and the body that it is seen beside.
Motion = tuple[tuple[object, ...], Body]


@dataclass(frozen=True, eq=False)
class ScreenedMotion:
    """A reading of the motion with its likeliest readings of the torque, the likeliest first."""

    reading: Hypothesis
    torques: list[Torque]
    beside: float  # what limits and the motion's description cost
    most: float = np.inf  # what it may cost at most to be looked at closely

    @property
    def cost(self) -> float:
        """Cost with the likeliest of its torques."""
        return self.beside + self.torques[0].cost


class Screening:
    """What readings of the motion cost; none is asked twice."""

    def __init__(self, log: Log, model: Model, columns: Columns, prices: Prices) -> None:
        self.log = log
        self.model = model
        self.columns = columns
        self.prices = prices
        self.gravities = _gravities(model)
        self.seen: dict[Motion, float] = {}  # what it costs
        self._waiting: dict[Motion, ScreenedMotion] = {}

    def ask(
        self,
        readings: Sequence[Hypothesis],
        model: Model,
        body: Body,
        base: Hypothesis | None = None,
    ) -> None:
        """Compares readings of the motion that were not asked for yet.

        Args:
            readings: Of the motion alone.
            model: The robot, with the body where there is one.
            body: The body, or None.
            base: What they are changed from: what explains nothing of what its change costs is
                neither likelier nor a rival, and is not looked at closely.
        """
        asked = dict.fromkeys(readings)
        fresh = [reading for reading in asked if (reading.motion, body) not in self.seen]
        if not fresh:
            return
        of_base = np.inf
        price_of_base = 0.0
        if base is not None:
            of_base = self.seen.get((base.motion, body), np.inf)
            price_of_base = self.prices.of(base)
        for screened in self._screened(fresh, model):
            key = (screened.reading.motion, body)
            further = self.prices.of(screened.reading) - price_of_base
            most = np.inf if base is None else of_base + max(further, 0.0)
            self.seen[key] = screened.cost
            self._waiting[key] = replace(screened, most=most)

    def likeliest(self, count: int) -> list[ScreenedMotion]:
        """Up to `count` of the likeliest that were not handed out yet, the likeliest first."""
        known = [key for key, screened in self._waiting.items() if screened.cost <= screened.most]
        known.sort(key=lambda key: self._waiting[key].cost)
        return [self._waiting.pop(key) for key in known[:count]]

    def torques_of(self, motion: Hypothesis, model: Model) -> list[Hypothesis]:
        """The likeliest readings of the torque of one motion for the robot as given.

        Args:
            motion: Reading of the motion.
            model: The robot, with a body where it has one.

        Returns:
            Whole readings, the likeliest first.
        """
        (screened,) = self._screened([motion], model)
        return [self.with_torque(motion, torque) for torque in screened.torques]

    def _screened(self, readings: Sequence[Hypothesis], model: Model) -> Iterator[ScreenedMotion]:
        """Each reading of the motion with its likeliest readings of the torque."""
        sums = read(self.log, model, readings)
        torques = Torques(sums, readings, self.gravities, self.columns).likeliest()
        for reading, beyond, likeliest in zip(readings, sums.beyond, torques, strict=True):
            beside = SEARCH.limit_cost * float(beyond) + self.prices.of(reading)
            yield ScreenedMotion(reading, likeliest, beside)

    def with_torque(self, motion: Hypothesis, torque: Torque) -> Hypothesis:
        """A reading of the motion with one of its torques."""
        return replace(
            motion,
            gravity=self.gravities.names[torque.gravity],
            effort_order=tuple(torque.columns.tolist()),
            effort_sign=tuple((1 - 2 * torque.signs).tolist()),
        )

    def turned(self, motion: Hypothesis, torque: Torque) -> Hypothesis | None:
        """A reading with gravity in the direction that its torques follow best.

        None where gravity is not in the effort, or that direction lies near one that was tried.

        Args:
            motion: Reading of the motion.
            torque: One of its torques.
        """
        hypothesis = self.with_torque(motion, torque)
        if hypothesis.gravity == COMPENSATED:
            return None
        sums = read(self.log, self.model, [motion])
        signs = np.array(hypothesis.effort_sign) * np.array(hypothesis.direction)
        variance = np.maximum(sums.variance[torque.columns], 1e-300)
        left = np.exp(torque.costs) * variance
        left[~self.columns.alive[torque.columns]] = np.inf
        vector = likeliest_gravity(sums, torque.columns, signs, torque.sizes, left)
        length = float(np.linalg.norm(vector))
        if not length > 0.0 or not self._is_apart(vector):
            return None
        x, y, z = (float(value) for value in GRAVITY / length * vector)
        return replace(hypothesis, gravity=(x, y, z))

    def _is_apart(self, vector: Float[Array, " 3"]) -> bool:
        """Whether a direction is none of those that are tried anyway."""
        tried = self.gravities.vectors[:-1]
        lengths = np.linalg.norm(tried, axis=1) * np.linalg.norm(vector)
        cosines = tried @ vector / np.maximum(lengths, 1e-12)
        return bool((cosines <= np.cos(np.radians(SEARCH.snap_deg))).all())


def _gravities(model: Model) -> Gravities:
    """Gravity as stated, along each axis of the base, and none."""
    names: list[str | tuple[float, float, float]] = ["stated"]
    vectors = [model.stated]
    for axis in (*AXES, *-AXES):
        vector = GRAVITY * axis
        if np.linalg.norm(vector - model.stated) > 1.0:
            x, y, z = (float(value) for value in vector)
            names.append((x, y, z))
            vectors.append(vector)
    names.append(COMPENSATED)
    vectors.append(np.zeros(3))
    return Gravities(names, np.array(vectors))
