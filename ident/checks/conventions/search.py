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
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from ident.arrays import Array, Float
from ident.checks.conventions.description import (
    BODY_PARAMETERS,
    DESCRIPTION,
    KIND,
    MASSES,
    column_length,
    gravity_length,
    price,
    sign_lengths,
    sizes_told_apart,
)
from ident.checks.conventions.hypothesis import COMPENSATED, GEARS, UNITS, Hypothesis
from ident.checks.conventions.masses import Variant, guessed_masses, variants
from ident.checks.conventions.readings import (
    AXES,
    Log,
    Model,
    Sums,
    common_size,
    evidence_of_columns,
    likeliest_gravity,
    moving,
    read,
    telling,
    unexplained,
)
from ident.records import read_group
from ident.robot.arm import ArmModel

LIMIT = read_group(__file__, "search")

GRAVITY = 9.81
# Readings of the torque that are kept of each motion.
READINGS_OF_MOTION = 2
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


class Pick(NamedTuple):
    """One reading of the torque under a reading of the motion."""

    cost: float  # of all joints, with what it is unlikely
    factor: int  # 0 for the URDF's masses, 1 for all of them by one factor
    gravity: int  # place among those that are tried; 0 as stated
    columns: Array  # of effort, by joint
    signs: Array  # 1 where a joint's torque has the other sign


class Search:
    """Readings of one log, scored as they are asked for; none twice."""

    def __init__(self, log: Log, model: Model) -> None:
        self.model = model
        self.log = log.thinned(LIMIT.states)
        self.coarse = self.log.thinned(LIMIT.screened)
        self.alive = telling(self.log)
        self.moves = moving(self.log)
        self.weights = evidence_of_columns(self.log)
        self.n = self.log.q.shape[1]
        self.usual_orders = model.usual_orders
        self.after_parallel = model.after_parallel
        self.gravities, self.vectors = self._gravities()
        # By motion, and whether it was screened with a body: its likeliest readings of the torque.
        self._screened: dict[Motion, list[Scored]] = {}
        self._refined: dict[Hypothesis, Scored] = {}
        self._seen: set[Motion] = set()
        self._expanded: set[Motion] = set()

    def _gravities(self) -> tuple[list[str | tuple[float, float, float]], Float[Array, "g 3"]]:
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
        return names, np.array(vectors)

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
            if not front or len(self._seen) >= LIMIT.most_readings:
                return
            for scored in front:
                has_body = scored.hypothesis.body is not None
                self._expanded.add((scored.hypothesis.motion, has_body))
                # What is one change away is seen beside the body, where there is one.
                model = (
                    Model(with_body(self.model.arm, scored.hypothesis)) if has_body else self.model
                )
                self.screen(list(self.neighbours(scored.hypothesis)), model, has_body)
            self.refine(LIMIT.refined)

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
        if not self._expanded:
            plain = Hypothesis.as_it_is(self.n)
            apart.append(fresh[plain.motion, False])
        return list(dict.fromkeys(apart))

    def _shared(self, hypothesis: Hypothesis) -> tuple[object, ...]:
        """What all columns of a reading share: a usual order, a unit."""
        order = hypothesis.order if hypothesis.order in self.usual_orders else None
        unit = hypothesis.unit[0] if len(set(hypothesis.unit)) == 1 else ""
        return order, unit

    def starts(self) -> list[Hypothesis]:
        """The log as it is, and what all columns may share: another unit, another usual order."""
        plain = Hypothesis.as_it_is(self.n)
        orders = [plain.order, *self.usual_orders]
        units = ["", *UNITS]
        return [
            replace(plain, order=order, unit=(unit,) * self.n)
            for order, unit in product(orders, units)
        ]

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

    def screen(self, readings: Sequence[Hypothesis], model: Model, has_body: bool) -> None:
        """Scores some readings of the motion that were not asked for yet, with the likeliest
        readings of the torque.
        """
        motions = dict.fromkeys(motion_of(reading) for reading in readings)
        fresh = [reading for reading in motions if (reading.motion, has_body) not in self._seen]
        self._seen.update((reading.motion, has_body) for reading in fresh)
        if not fresh:
            return
        sums = read(self.coarse, model, fresh)
        for reading, scored in zip(fresh, self._of_torque(sums, fresh), strict=True):
            self._screened[reading.motion, has_body] = scored

    def refine(self, count: int) -> None:
        """Looks closely at so many of the likeliest readings: all states, masses and bodies, any
        gravity.
        """
        waiting = sorted(
            self._screened, key=lambda motion: min(each.cost for each in self._screened[motion])
        )
        self._refine(Hypothesis.as_it_is(self.n))
        for motion in waiting[:count]:
            readings = self._screened.pop(motion)
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
        told = float(self._weighed(variant.costs, columns).sum())
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

    def _weighed(self, costs: Array, columns: Sequence[int] | slice = slice(None)) -> Array:
        """Costs by column of effort, last axis: of a joint that stands little speaks for a reading,
        all against it.
        """
        return np.asarray(
            np.where(costs < 0.0, self.weights[columns] * costs, self.alive[columns] * costs)
        )

    def is_apart(self, vector: Float[Array, " 3"]) -> bool:
        """Whether a direction is none of those that are tried anyway."""
        for other in self.vectors[:-1]:
            cosine = (
                vector @ other / max(float(np.linalg.norm(vector) * np.linalg.norm(other)), 1e-12)
            )
            if cosine > np.cos(np.radians(LIMIT.snap_deg)):
                return False
        return True

    def _of_torque(self, sums: Sums, readings: Sequence[Hypothesis]) -> Iterator[list[Scored]]:
        """The likeliest readings of the torque under some readings of the motion.

        The torque as it stands, all of it of the other sign, and joints of the other sign, under
        each gravity, with the URDF's masses or all of them by one factor; where other columns of
        effort would explain more, those.
        """
        vectors = np.broadcast_to(self.vectors, (len(readings), *self.vectors.shape))
        orders = np.array([reading.order for reading in readings])
        size = common_size(sums, vectors, orders)
        size = np.where(np.abs(np.log(size)) > np.log(MASSES.usual_factor), size, 1.0)
        scales = np.stack([np.ones_like(size), size])
        backwards = np.array([reading.direction for reading in readings]) < 0
        tables = []
        for scale in scales:
            costs, sizes = unexplained(sums, vectors, scale)
            costs = self._weighed(costs.swapaxes(-1, -2)).swapaxes(
                -1, -2
            )  # reading, joint, gravity, column, sign
            turned = backwards[..., None, None, None]
            tables.append(
                [np.where(turned, values[..., ::-1], values) for values in (costs, sizes)]
            )
        costs, sizes = (np.stack(each) for each in zip(*tables, strict=True))
        unlikely = np.array([gravity_length(gravity) for gravity in self.gravities])
        unlikely = unlikely + (KIND + sizes_told_apart()) * (scales != 1.0)
        unlikely = unlikely / DESCRIPTION.observations  # factor, reading, gravity
        for k, reading in enumerate(readings):
            base = LIMIT.limit_cost * float(sums.beyond[k]) + price(reading, self.usual_orders)
            picks = self._picks(costs[:, k].swapaxes(1, 2), unlikely[:, k], orders[k])
            yield [self._scored(reading, pick, base, costs[:, k], sizes[:, k]) for pick in picks]

    def _picks(
        self, table: Float[Array, "f g n n 2"], unlikely: Float[Array, "f g"], order: Array
    ) -> list[Pick]:
        """The likeliest torques of one motion, one of them with gravity as stated.

        Args:
            table: Cost of each joint's torque by factor, gravity, column of effort and sign.
            unlikely: What factor and gravity cost.
            order: Column of each joint's position.
        """
        every, single = (length / DESCRIPTION.observations for length in sign_lengths(self.n))
        column = column_length(self.n) / DESCRIPTION.observations
        joints = np.arange(self.n)
        moved = column * (order[:, None] != joints[None, :])
        picks: list[Pick] = []
        for turned, more in ((False, 0.0), (True, every)):
            signed = table[..., ::-1] if turned else table
            signed = signed + np.array([0.0, single])
            best = signed.min(axis=-1)
            own = best[:, :, joints, order].sum(axis=-1) + unlikely + more
            # No columns explain more than each joint's best one.
            bound = (best + moved).min(axis=-1).sum(axis=-1) + unlikely + more
            places = [int(place) for place in np.argsort(own, axis=None)[:READINGS_OF_MOTION]]
            stated = int(np.argmin(own[:, 0])) * own.shape[1]
            for place in dict.fromkeys([*places, stated]):
                f, g = divmod(place, own.shape[1])
                signs = signed[f, g][joints, order].argmin(axis=-1) ^ turned
                picks.append(Pick(float(own[f, g]), f, g, order, signs))
            f, g = divmod(int(np.argmin(bound)), own.shape[1])
            if bound[f, g] < own.min() - column:
                _, columns = linear_sum_assignment(best[f, g] + moved)
                signs = signed[f, g][joints, columns].argmin(axis=-1) ^ turned
                cost = float((best[f, g] + moved)[joints, columns].sum() + unlikely[f, g]) + more
                picks.append(Pick(cost, f, g, columns, signs))
        picks.sort(key=lambda pick: pick.cost)
        likeliest = picks[: 1 + READINGS_OF_MOTION]
        return likeliest + [pick for pick in picks[len(likeliest) :] if pick.gravity == 0][:1]

    def _scored(
        self, reading: Hypothesis, pick: Pick, base: float, costs: Array, sizes: Array
    ) -> Scored:
        """A reading of the motion with one of its torques."""
        hypothesis = replace(
            reading,
            gravity=self.gravities[pick.gravity],
            effort_order=tuple(int(column) for column in pick.columns),
            effort_sign=tuple(int(value) for value in np.where(pick.signs == 1, -1, 1)),
        )
        place = (pick.factor, np.arange(self.n), pick.gravity, pick.columns, pick.signs)
        return Scored(
            hypothesis, base + pick.cost, tuple(costs[place].tolist()), tuple(sizes[place].tolist())
        )


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
