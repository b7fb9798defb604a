"""Readings of the motion: what the search starts from, and what is one change away, or two.

A reading of the motion has its own order, directions, zeros, units, gears and shares, and nothing
else that is not as log and URDF say.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import Any

import numpy as np

from ident.checks.conventions.hypothesis import GEARS, UNITS, Hypothesis
from ident.checks.conventions.model import Model
from ident.checks.conventions.readings import Log, usual_orders
from ident.checks.conventions.settings import SEARCH

ENTRIES = ("direction", "quarters", "unit", "gear", "share")
# A joint's entries as log and URDF say.
UNCHANGED = {"direction": 1, "quarters": 0, "unit": "", "gear": 1.0, "share": 0}
# Order or entries of a reading's motion that are changed, and at which joints.
Place = tuple[tuple[str, tuple[bool, ...]], ...]


class Motions:
    """Readings of one log's motion, by the robot's joints."""

    def __init__(self, log: Log, model: Model) -> None:
        self.n = log.q.shape[1]
        self.plain = Hypothesis.as_it_is(self.n)
        self.usual_orders = usual_orders(log, model)
        self.after_parallel = model.after_parallel
        self.turning = [int(joint) for joint in np.flatnonzero(~model.sliding)]
        self._pairs = list(combinations(range(self.n), 2))
        self._in_degrees = _units_by_travel(log, model)

    def starts(self) -> list[Hypothesis]:
        """The log as it is, and what all columns may share: another unit, another usual order.

        Where single columns travel further than their joints can, those in degrees.
        """
        as_stated = ("",) * self.n
        in_one = [(unit,) * self.n for unit in UNITS]
        units = [as_stated, *in_one, self._in_degrees]
        starts = []
        for order, unit in product((self.plain.order, *self.usual_orders), dict.fromkeys(units)):
            of_joints = tuple(unit[column] for column in order)
            starts.append(replace(self.plain, order=order, effort_order=order, unit=of_joints))
        return starts

    def neighbours(self, reading: Hypothesis) -> Iterator[Hypothesis]:
        """Readings of the motion that are one change away."""
        for joint in range(self.n):
            yield reading.with_entry("direction", joint, -reading.direction[joint])
        yield from _with_others(reading, "quarters", self.turning, range(4))
        yield from self._of_other_orders(reading)
        for unit in (*UNITS, ""):
            yield replace(reading, unit=(unit,) * self.n)
        yield from _with_others(reading, "unit", self.turning, ("deg", ""))
        yield from _with_others(reading, "gear", self.turning, (1.0, *GEARS))
        yield from _with_others(reading, "share", self.after_parallel, (-1, 0, 1))

    def _of_other_orders(self, reading: Hypothesis) -> Iterator[Hypothesis]:
        """Two columns exchanged, or all of them in a usual order."""
        for i, j in self._pairs:
            order = list(reading.order)
            order[i], order[j] = order[j], order[i]
            yield reordered(reading, tuple(order))
        for columns in (self.plain.order, *self.usual_orders):
            yield reordered(reading, columns)

    def pairs(
        self, reading: Hypothesis, places: Sequence[Sequence[Hypothesis]]
    ) -> Iterator[Hypothesis]:
        """The likeliest changes of a reading two by two.

        One change alone may explain nothing as long as another is not made.

        Args:
            reading: What they are changes of.
            places: Its changes by place, the likeliest place and change first.
        """
        for changes, others in combinations(places[: SEARCH.paired], 2):
            yield from _merged(reading, changes[0], others[0])

    def all_pairs(self, reading: Hypothesis) -> Iterator[list[Hypothesis]]:
        """Every two changes of a reading: of each change, it together with those after it."""
        changes = list(dict.fromkeys(self.neighbours(reading)))
        for number, change in enumerate(changes, start=1):
            yield [pair for other in changes[number:] for pair in _merged(reading, change, other)]

    def of_joints(
        self, reading: Hypothesis, places: Sequence[Sequence[Hypothesis]]
    ) -> Iterator[Hypothesis]:
        """All directions, zeros and gears together of the joints that are likeliest changed.

        A zero is another one where the axis turns the other way, or the angle is another one.
        """
        likeliest = [place_of(reading, changes[0]) for changes in places[: SEARCH.paired]]
        joints = [place[0][1].index(True) for place in likeliest if _is_of_one_joint(place)]
        turning = [joint for joint in dict.fromkeys(joints) if joint in self.turning]
        for joint in turning[: SEARCH.joints]:
            for direction, quarters, gear in product((1, -1), range(4), (1.0, *GEARS)):
                turned = reading.with_entry("direction", joint, direction)
                turned = turned.with_entry("quarters", joint, quarters)
                yield turned.with_entry("gear", joint, gear)

    def other_values(
        self, reading: Hypothesis, places: Sequence[Sequence[Hypothesis]]
    ) -> Iterator[Hypothesis]:
        """All values of the likeliest places two by two; and what else a changed joint may have.

        The likeliest value of one place alone need not be its value beside another's; and one
        change of a joint may have been taken for another.
        """
        for changes, others in combinations(places[: SEARCH.valued], 2):
            for first, second in product(changes, others):
                yield from _merged(reading, first, second)
        for joint in range(self.n):
            if any(getattr(reading, name)[joint] != value for name, value in UNCHANGED.items()):
                yield from self._of_joint(reading, joint)

    def _of_joint(self, reading: Hypothesis, joint: int) -> Iterator[Hypothesis]:
        """The reading with other entries of one joint, one of them changed."""
        plain = reading
        for name, value in UNCHANGED.items():
            plain = plain.with_entry(name, joint, value)
        yield plain
        yield plain.with_entry("direction", joint, -1)
        if joint in self.turning:
            yield from _with_others(plain, "quarters", [joint], range(4))
            yield from _with_others(plain, "unit", [joint], ("deg",))
            yield from _with_others(plain, "gear", [joint], GEARS)
        if joint in self.after_parallel:
            yield from _with_others(plain, "share", [joint], (-1, 1))


def _merged(base: Hypothesis, first: Hypothesis, second: Hypothesis) -> Iterator[Hypothesis]:
    """Both changes of a reading, where they are of different entries."""
    merged = both(base, first, second)
    if merged is not None:
        yield merged


def _units_by_travel(log: Log, model: Model) -> tuple[str, ...]:
    """Degrees for columns that travel further than any of the robot's joints can."""
    limits = model.limits
    turning = ~model.sliding
    widest = float(np.max((limits.upper - limits.lower)[turning], initial=0.0))
    too_far = turning & (np.ptp(log.q, axis=0) > widest)
    return tuple("deg" if far else "" for far in too_far)


def _with_others(
    reading: Hypothesis, name: str, joints: Sequence[int], values: Sequence[float | str]
) -> Iterator[Hypothesis]:
    """The reading with each other value of one joint's entry."""
    for joint in joints:
        for value in values:
            if value != getattr(reading, name)[joint]:
                yield reading.with_entry(name, joint, value)


def motion_of(hypothesis: Hypothesis) -> Hypothesis:
    """A copy that reads the motion as before and the effort, gravity and masses as they are."""
    plain = Hypothesis.as_it_is(len(hypothesis.order))
    return replace(
        hypothesis,
        effort_order=hypothesis.order,
        effort_sign=plain.effort_sign,
        gravity=plain.gravity,
        mass_factor=1.0,
        effort_scale=(),
        body=None,
        parameters=None,
    )


def reordered(reading: Hypothesis, order: tuple[int, ...]) -> Hypothesis:
    """A reading with columns in another order, each with its own unit and gear.

    Args:
        reading: Of the motion.
        order: For each joint the column that is its.
    """
    joint_of = {column: joint for joint, column in enumerate(reading.order)}
    unit = tuple(reading.unit[joint_of[column]] for column in order)
    gear = tuple(reading.gear[joint_of[column]] for column in order)
    return replace(reading, order=order, effort_order=order, unit=unit, gear=gear)


def place_of(base: Hypothesis, changed: Hypothesis) -> Place:
    """What of a reading's motion is changed, order or entries, and at which joints."""
    place = []
    for name in ("order", *ENTRIES):
        before = getattr(base, name)
        after = getattr(changed, name)
        if before != after:
            differs = tuple(a != b for a, b in zip(before, after, strict=True))
            place.append(("order" if name == "order" else "entry", differs))
    return tuple(place)


def _is_of_one_joint(place: Place) -> bool:
    """Whether one entry of one joint is changed, and no order."""
    return len(place) == 1 and place[0][0] == "entry" and sum(place[0][1]) == 1


def both(base: Hypothesis, first: Hypothesis, second: Hypothesis) -> Hypothesis | None:
    """A reading with two others' changes of it; None where both change the same entry."""
    if base.order not in (first.order, second.order):
        return None
    # A column's unit goes with it to another joint: that is no change of it.
    of_first = first if first.order == base.order else reordered(first, base.order)
    of_second = second if second.order == base.order else reordered(second, base.order)
    fields: dict[str, Any] = {}
    for name in ENTRIES:
        entries = []
        values = zip(*(getattr(each, name) for each in (base, of_first, of_second)), strict=True)
        for before, one_way, other_way in values:
            if before not in (one_way, other_way):
                return None
            entries.append(other_way if one_way == before else one_way)
        fields[name] = tuple(entries)
    order = second.order if first.order == base.order else first.order
    return reordered(replace(base, **fields), order)
