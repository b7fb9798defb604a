"""The search: from the log as it is, change after change, the likeliest readings first.

A reading costs, over the joints, the logarithm of the share of torque that it leaves, and its
changes the length of their description. Signs of torques, the order of their columns, gravity and
efforts in another unit follow from the sums of a reading's motion; order, direction, zero and unit
make another motion, and are tried one by one, from the log as it is and from what all columns may
share: another unit, another usual order. Few states tell which readings are worth more: those are
compared by more states, with masses and bodies, and the next changes are sought from the likeliest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.checks.conventions.description import (
    BODY_PARAMETERS,
    price,
)
from ident.checks.conventions.hypothesis import COMPENSATED, GEARS, UNITS, Hypothesis
from ident.checks.conventions.masses import Variant, guessed_masses, variants
from ident.checks.conventions.readings import (
    AXES,
    Log,
    Model,
    Sums,
    evidence_of_columns,
    likeliest_gravity,
    moving,
    read,
    telling,
)
from ident.checks.conventions.torques import Columns, Gravities, Torque, Torques
from ident.records import read_group
from ident.robot.arm import ArmModel

LIMIT = read_group(__file__, "search")

GRAVITY = 9.81
# Order or entries of a reading's motion that are changed, and at which joints.
Place = tuple[tuple[str, tuple[bool, ...]], ...]
# A reading of the motion, and whether a body is at the arm's end.
Motion = tuple[tuple[object, ...], bool]


@dataclass(frozen=True)
class Scored:
    """A hypothesis, and how well it explains."""

    hypothesis: Hypothesis
    cost: float  # with what its changes are unlikely
    costs: tuple[float, ...]  # of each joint, without that
    sizes: tuple[float, ...]  # of each joint's torque over the model's
    # The same with the joints that move alone; of readings that were looked at closely.
    cost_of_moving: float = np.inf

    @property
    def explains(self) -> float:
        """Share of the torque that is explained, the geometric mean over the joints' shares that
        are left.
        """
        return float(1.0 - np.exp(min(float(np.mean(self.costs)), 0.0)))


class Search:
    """Readings of one log, scored as they are asked for; none twice."""

    def __init__(self, log: Log, model: Model) -> None:
        self.model = model
        self.log = log.thinned(LIMIT.states)
        self.coarse = self.log.thinned(LIMIT.screened)
        self.alive = telling(self.log)
        self.moves = moving(self.log)
        self.columns = Columns(evidence_of_columns(self.log), self.alive)
        self.n = self.log.q.shape[1]
        self.usual_orders = model.usual_orders
        self.after_parallel = model.after_parallel
        self.gravities = self._gravities()
        # By motion, and whether it was screened with a body: its likeliest readings of the torque.
        self._screened: dict[Motion, list[Scored]] = {}
        self._least: dict[Motion, float] = {}  # what the likeliest of them costs
        # What it may cost at most to be looked at closely.
        self._most: dict[Motion, float] = {}
        self._refined: dict[Hypothesis, Scored] = {}
        self._seen: set[Motion] = set()
        self._expanded: set[Motion] = set()

    def _gravities(self) -> Gravities:
        """Gravity as stated, along each axis of the base, and none."""
        names: list[str | tuple[float, float, float]] = ["stated"]
        vectors = [self.model.stated]
        for axis in (*AXES, *-AXES):
            vector = GRAVITY * axis
            if np.linalg.norm(vector - self.model.stated) > 1.0:
                x, y, z = (float(value) for value in vector)
                names.append((x, y, z))
                vectors.append(vector)
        names.append(COMPENSATED)
        vectors.append(np.zeros(3))
        return Gravities(names, np.array(vectors))

    def run(self) -> list[Scored]:
        """The readings that were looked at closely, the likeliest first.

        That the URDF's masses are guesses is asked last: no change of the log is sought from there.
        """
        self._search()
        guess = guessed_masses(self.log, self.model)
        if guess is not None:
            self._take(guess)
        return self.ranked

    def _search(self) -> None:
        """Change after change, until none is left that is worth it."""
        starts = self.starts()
        self.screen(starts, self.model, False)
        self.refine(len(starts))
        while True:
            ranked = self.ranked
            front = self._front(ranked)
            if not front or not self._has_time:
                return
            for scored in front:
                if self._has_time:
                    self._expand(scored)
            self.refine(LIMIT.refined)
            self._settle()

    @property
    def _has_time(self) -> bool:
        """Whether more readings of the motion may be tried."""
        return len(self._seen) < int(LIMIT.most_readings)

    def _expand(self, scored: Scored) -> None:
        """Screens what is one change away from a reading, and its likeliest changes two by two.

        What is changed is seen beside the body, where there is one.
        """
        reading = scored.hypothesis
        has_body = reading.body is not None
        model = self._model_with(reading)
        self._expanded.add((reading.motion, has_body))
        self.screen([reading], model, has_body)
        changed = list(self.neighbours(reading))
        self.screen(changed, model, has_body, reading)
        likeliest = self._likeliest(reading, changed, has_body)
        together = [*_pairs(reading, likeliest), *self._of_joints(reading, likeliest)]
        self.screen(together, model, has_body, reading)

    def _model_with(self, reading: Hypothesis) -> Model:
        """The robot with the body that a reading has at its end."""
        if reading.body is None:
            return self.model
        return Model(with_body(self.model.arm, reading))

    def _settle(self) -> None:
        """Asks for the torques of the likeliest reading anew beside its body, as long as it gains.

        Signs, columns and gravity were sought beside another body than the one they ask for.
        """
        best = self.ranked[0]
        while best.hypothesis.body is not None:
            motion = motion_of(best.hypothesis)
            sums = read(self.coarse, self._model_with(best.hypothesis), [motion])
            for scored in next(self._of_torque(sums, [motion])):
                self._refine(scored.hypothesis)
            before = best
            best = self.ranked[0]
            if best is before:
                return

    @property
    def ranked(self) -> list[Scored]:
        """What was looked at closely, the likeliest first."""
        return sorted(self._refined.values(), key=lambda scored: scored.cost)

    def _front(self, ranked: Sequence[Scored]) -> list[Scored]:
        """The likeliest motions from which no change was sought yet, each of another unit and order
        of all columns.

        Where the best explains well, no other is likelier to lead to a better one, once those were
        tried. A body under a reading that explains little mends what another change would: none is
        sought beside it.
        """
        best = ranked[0]
        fresh: dict[Motion, Scored] = {}
        for scored in ranked:
            has_body = scored.hypothesis.body is not None
            key = (scored.hypothesis.motion, has_body)
            is_sought = scored.explains > LIMIT.well_explained or not has_body
            if is_sought and key not in self._expanded:
                fresh.setdefault(key, scored)
        if self._expanded and best.explains > LIMIT.well_explained:
            return [
                scored
                for scored in fresh.values()
                if scored.hypothesis.motion == best.hypothesis.motion
            ][:1]
        classes: dict[tuple[object, ...], Scored] = {}
        for scored in fresh.values():
            classes.setdefault(self._shared(scored.hypothesis), scored)
        apart = list(classes.values())[: LIMIT.beam]
        if self._expanded:
            # What explains nothing leads nowhere, once another explains something.
            return [scored for scored in apart if scored.explains > 0.0] or apart[:1]
        plain = Hypothesis.as_it_is(self.n)
        apart.append(fresh[plain.motion, False])
        return list(dict.fromkeys(apart))

    def _shared(self, hypothesis: Hypothesis) -> tuple[object, ...]:
        """What all columns of a reading share: a usual order, a unit."""
        order = hypothesis.order if hypothesis.order in self.usual_orders else None
        unit = hypothesis.unit[0] if len(set(hypothesis.unit)) == 1 else ""
        return order, unit

    def _likeliest(
        self, reading: Hypothesis, changed: Sequence[Hypothesis], has_body: bool
    ) -> list[Hypothesis]:
        """The likeliest of a reading's changes, one for each place where it is changed."""
        likeliest: dict[Place, Hypothesis] = {}
        for each in sorted(changed, key=lambda each: self._least[each.motion, has_body]):
            likeliest.setdefault(_place(reading, each), each)
        likeliest.pop((), None)  # the reading itself
        return list(likeliest.values())[: LIMIT.paired]

    def _of_joints(
        self, reading: Hypothesis, likeliest: Sequence[Hypothesis]
    ) -> Iterator[Hypothesis]:
        """All directions, zeros and gears together of the joints that are likeliest changed.

        A zero is another one where the axis turns the other way, or the angle is another one.
        """
        places = [_place(reading, each) for each in likeliest]
        joints = [place[0][1].index(True) for place in places if _is_of_one_joint(place)]
        turning = [j for j in dict.fromkeys(joints) if not self.model.sliding[j]]
        for j in turning[: LIMIT.joints]:
            for direction, quarters, gear in product((1, -1), range(4), (1.0, *GEARS)):
                turned = reading.with_entry("direction", j, direction)
                yield turned.with_entry("quarters", j, quarters).with_entry("gear", j, gear)

    def starts(self) -> list[Hypothesis]:
        """The log as it is, and what all columns may share: another unit, another usual order.

        Where single columns travel further than their joints can, those in degrees.
        """
        plain = Hypothesis.as_it_is(self.n)
        orders = [plain.order, *self.usual_orders]
        units = [("",) * self.n, *((unit,) * self.n for unit in UNITS), self._units_by_travel()]
        columns = range(self.n)
        starts = []
        for order, unit in product(orders, dict.fromkeys(units)):
            of_joints = tuple(unit[order[joint]] for joint in columns)
            starts.append(replace(plain, order=order, unit=of_joints))
        return starts

    def _units_by_travel(self) -> tuple[str, ...]:
        """Degrees for columns that travel further than any of the robot's joints can."""
        limits = self.model.arm.known_limits
        turning = ~self.model.sliding
        widest = float(np.max((limits.upper - limits.lower)[turning], initial=0.0))
        travel = np.ptp(self.log.q, axis=0)
        return tuple("deg" if far else "" for far in turning & (travel > widest))

    def neighbours(self, reading: Hypothesis) -> Iterator[Hypothesis]:
        """Readings of the motion that are one change away."""
        turning = [int(j) for j in np.flatnonzero(~self.model.sliding)]
        for j in range(self.n):
            yield reading.with_entry("direction", j, -reading.direction[j])
        for j in turning:
            for quarters in range(4):
                if quarters != reading.quarters[j]:
                    yield reading.with_entry("quarters", j, quarters)
        for i, j in combinations(range(self.n), 2):
            order = list(reading.order)
            order[i], order[j] = order[j], order[i]
            yield reordered(reading, tuple(order))
        for columns in (tuple(range(self.n)), *self.usual_orders):
            yield reordered(reading, columns)
        for unit in (*UNITS, ""):
            yield replace(reading, unit=(unit,) * self.n)
        for j in turning:
            for unit in ("deg", ""):
                if unit != reading.unit[j]:
                    yield reading.with_entry("unit", j, unit)
            for gear in (1.0, *GEARS):
                if gear != reading.gear[j]:
                    yield reading.with_entry("gear", j, gear)
        for j in self.after_parallel:
            for share in (-1, 0, 1):
                if share != reading.share[j]:
                    yield reading.with_entry("share", j, share)

    def screen(
        self,
        readings: Sequence[Hypothesis],
        model: Model,
        has_body: bool,
        base: Hypothesis | None = None,
    ) -> None:
        """Scores some readings of the motion that were not asked for yet, with the likeliest
        readings of the torque.

        Args:
            readings: Of the motion.
            model: The robot, with the body where there is one.
            has_body: Whether there is one.
            base: What they are changed from: what explains less than half of what its change costs
                is neither likelier nor a rival, and is not looked at closely.
        """
        motions = dict.fromkeys(motion_of(reading) for reading in readings)
        fresh = [reading for reading in motions if (reading.motion, has_body) not in self._seen]
        self._seen.update((reading.motion, has_body) for reading in fresh)
        if not fresh:
            return
        sums = read(self.coarse, model, fresh)
        for reading, scored in zip(fresh, self._of_torque(sums, fresh), strict=True):
            key = reading.motion, has_body
            self._screened[key] = scored
            self._least[key] = min(each.cost for each in scored)
            if base is not None:
                self._most[key] = self._most_after(base, reading, has_body)

    def _most_after(self, base: Hypothesis, changed: Hypothesis, has_body: bool) -> float:
        """The cost at which a change of the motion explains half of what it costs."""
        before = price(motion_of(base), self.usual_orders)
        further = price(changed, self.usual_orders) - before
        return self._least.get((base.motion, has_body), np.inf) + 0.5 * max(further, 0.0)

    def refine(self, count: int) -> None:
        """Looks closely at so many of the likeliest readings: all states, masses and bodies, any
        gravity.
        """
        self._refine(Hypothesis.as_it_is(self.n))
        known = [key for key in self._screened if self._least[key] <= self._most.get(key, np.inf)]
        for key in sorted(known, key=self._least.__getitem__)[:count]:
            readings = self._screened.pop(key)
            for scored in readings:
                self._refine(scored.hypothesis)
            turned = self._turned(min(readings, key=lambda each: each.cost))
            if turned is not None:
                self._refine(turned)

    def _refine(self, hypothesis: Hypothesis) -> None:
        """A reading with what may be said of the masses beside it."""
        if hypothesis in self._refined:
            return
        for variant in variants(hypothesis, self.log, self.model):
            self._take(variant)

    def _take(self, variant: Variant) -> None:
        """What a reading costs whose torque is known."""
        hypothesis = variant.hypothesis
        columns = list(hypothesis.effort_order)
        angles = hypothesis.angles(self.log.q, self.model.sliding)
        limits = LIMIT.limit_cost * float(self.model.beyond_limits(angles[None])[0])
        costs = np.where(self.alive[columns], variant.costs, 0.0)
        told = float(self.columns.weighed(variant.costs, np.array(columns)).sum())
        told_by_moving = float(costs[self.moves[columns]].sum())
        beside = limits + variant.more + price(hypothesis, self.usual_orders)
        self._refined[hypothesis] = Scored(
            hypothesis,
            told + beside,
            tuple(costs.tolist()),
            tuple(variant.sizes.tolist()),
            told_by_moving + beside,
        )

    def _turned(self, scored: Scored) -> Hypothesis | None:
        """The reading with gravity where its torques have it, if that is apart from where it was
        sought.
        """
        hypothesis = scored.hypothesis
        if hypothesis.gravity == COMPENSATED:
            return None
        sums = read(self.coarse, self.model, [motion_of(hypothesis)])
        columns = np.array(hypothesis.effort_order)
        signs = np.array(hypothesis.effort_sign) * np.array(hypothesis.direction)
        left = np.exp(np.array(scored.costs)) * np.maximum(sums.variance[columns], 1e-300)
        left[~self.alive[columns]] = np.inf
        vector = likeliest_gravity(sums, columns, signs, np.array(scored.sizes), left)
        length = float(np.linalg.norm(vector))
        if not length > 0.0 or not self.is_apart(vector):
            return None
        x, y, z = (float(value) for value in GRAVITY / length * vector)
        return replace(hypothesis, gravity=(x, y, z))

    def is_apart(self, vector: Float[Array, " 3"]) -> bool:
        """Whether a direction is none of those that are tried anyway."""
        for other in self.gravities.vectors[:-1]:
            cosine = (
                vector @ other / max(float(np.linalg.norm(vector) * np.linalg.norm(other)), 1e-12)
            )
            if cosine > np.cos(np.radians(LIMIT.snap_deg)):
                return False
        return True

    def _of_torque(self, sums: Sums, readings: Sequence[Hypothesis]) -> Iterator[list[Scored]]:
        """The likeliest readings of the torque under some readings of the motion."""
        torques = Torques(sums, readings, self.gravities, self.columns)
        for k, likeliest in enumerate(torques.likeliest()):
            reading = readings[k]
            base = LIMIT.limit_cost * float(sums.beyond[k]) + price(reading, self.usual_orders)
            yield [self._scored(reading, torque, base) for torque in likeliest]

    def _scored(self, reading: Hypothesis, torque: Torque, base: float) -> Scored:
        """A reading of the motion with one of its torques."""
        hypothesis = replace(
            reading,
            gravity=self.gravities.names[torque.gravity],
            effort_order=tuple(int(column) for column in torque.columns),
            effort_sign=tuple(int(value) for value in np.where(torque.signs == 1, -1, 1)),
        )
        costs = tuple(torque.costs.tolist())
        return Scored(hypothesis, base + torque.cost, costs, tuple(torque.sizes.tolist()))


def with_body(arm: ArmModel, hypothesis: Hypothesis) -> ArmModel:
    """The arm with the body that a hypothesis has at its end."""
    parameters = np.array(arm.inertial_parameters)
    parameters[-10 : BODY_PARAMETERS - 10] += np.array(hypothesis.body)
    return arm.with_inertial_parameters(parameters)


def reordered(reading: Hypothesis, order: tuple[int, ...]) -> Hypothesis:
    """The reading with columns in another order, each in the unit that it has."""
    joint_of = {column: joint for joint, column in enumerate(reading.order)}
    unit = tuple(reading.unit[joint_of[column]] for column in order)
    gear = tuple(reading.gear[joint_of[column]] for column in order)
    return replace(reading, order=order, unit=unit, gear=gear)


def _pairs(reading: Hypothesis, likeliest: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The likeliest changes of a reading, two by two.

    One change alone may explain nothing as long as another is not made.
    """
    merged = [both(reading, first, second) for first, second in combinations(likeliest, 2)]
    return [each for each in merged if each is not None]


def _place(base: Hypothesis, changed: Hypothesis) -> Place:
    """What of a reading's motion is changed, order or entries, and at which joints."""
    place = []
    for name in ("order", "direction", "quarters", "unit", "gear", "share"):
        entries = zip(getattr(base, name), getattr(changed, name), strict=True)
        is_changed = tuple(before != after for before, after in entries)
        if any(is_changed):
            place.append(("order" if name == "order" else "entry", is_changed))
    return tuple(place)


def _is_of_one_joint(place: Place) -> bool:
    """Whether one entry of one joint is changed, and no order."""
    return len(place) == 1 and place[0][0] == "entry" and sum(place[0][1]) == 1


def both(base: Hypothesis, first: Hypothesis, second: Hypothesis) -> Hypothesis | None:
    """A reading with two others' changes of it; None where both change the same entry."""
    fields: dict[str, Any] = {}
    for name in ("direction", "quarters", "unit", "gear", "share"):
        of_base = getattr(base, name)
        # A column's unit goes with it to another joint: that is no change of it.
        of_first = getattr(reordered(first, base.order), name)
        of_second = getattr(reordered(second, base.order), name)
        entries = []
        for before, one_way, other_way in zip(of_base, of_first, of_second, strict=True):
            if before not in (one_way, other_way):
                return None
            entries.append(other_way if one_way == before else one_way)
        fields[name] = tuple(entries)
    if base.order not in (first.order, second.order):
        return None
    order = second.order if first.order == base.order else first.order
    return reordered(replace(base, **fields), order)


def motion_of(hypothesis: Hypothesis) -> Hypothesis:
    """The reading of the motion alone."""
    plain = Hypothesis.as_it_is(len(hypothesis.order))
    return replace(
        hypothesis,
        effort_order=hypothesis.order,
        effort_sign=plain.effort_sign,
        gravity=plain.gravity,
        mass_factor=1.0,
        effort_scale=(),
        body=None,
    )
