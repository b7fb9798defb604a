"""The search: from the log as it is, change after change, keeping the best few; then what all joints share.

A reading costs, over the joints, the logarithm of the share of torque that it leaves, and of each change what such a
change is unlikely. Signs of torques, the order of their columns and gravity's direction follow from the sums of a
reading's motion; order, direction, zero and unit make another motion, and are tried one by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment

from ident.arrays import Array, Float
from ident.checks.conventions.hypothesis import COMPENSATED, UNITS, Hypothesis
from ident.checks.conventions.readings import (
    AXES,
    Log,
    Model,
    Sums,
    common_size,
    likeliest_gravity,
    read,
    telling,
    unexplained,
)
from ident.records import read_group

LIMIT = read_group(__file__, "search")
MASSES = read_group(__file__, "masses")

GRAVITY = 9.81


@dataclass(frozen=True)
class Scored:
    """A hypothesis, and how well it explains."""

    hypothesis: Hypothesis
    cost: float  # with what its changes are unlikely
    costs: tuple[float, ...]  # of each joint, without that
    sizes: tuple[float, ...]  # of each joint's torque over the model's

    @property
    def explains(self) -> float:
        """Share of the torque that is explained, the geometric mean over the joints' shares that are left."""
        return float(1.0 - np.exp(min(float(np.mean(self.costs)), 0.0)))


class Search:
    """Readings of one log, scored as they are asked for; none twice."""

    def __init__(self, log: Log, model: Model) -> None:
        self.model = model
        self.log = log.thinned(LIMIT.states)
        self.alive = telling(self.log)
        self.n = self.log.q.shape[1]
        self._seen: set[tuple[object, ...]] = set()
        self.gravities, self.vectors = self._gravities()

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

    def score(self, readings: Sequence[Hypothesis]) -> list[Scored]:
        """The likeliest readings of the torque under some readings of the motion that were not asked for yet."""
        fresh = [one for one in dict.fromkeys(readings) if one.motion not in self._seen]
        self._seen.update(reading.motion for reading in fresh)
        if not fresh:
            return []
        sums = read(self.log, self.model, fresh)
        return [scored for k, reading in enumerate(fresh) for scored in self._score_torque(_entry(sums, k), reading)]

    def _score_torque(self, sums: Sums, reading: Hypothesis) -> list[Scored]:
        """The likeliest readings of the torque under each gravity, one that fits best among them."""
        scored = self._under(sums, reading, self.gravities, self.vectors)
        plain = [one for one in scored if one.hypothesis.gravity != COMPENSATED]
        best = min(plain, key=lambda one: one.cost)
        found = best.hypothesis
        columns = np.array(found.effort_order)
        signs = np.array(found.effort_sign) * np.array(found.direction)
        left = np.exp(np.array(best.costs)) * np.maximum(sums.variance[columns], 1e-300)
        left[~self.alive[columns]] = np.inf
        vector = likeliest_gravity(sums, columns, signs, np.array(best.sizes), left)
        length = float(np.linalg.norm(vector))
        if not length > 0.0 or not self.is_apart(vector):
            return scored
        x, y, z = (float(value) for value in GRAVITY / length * vector)
        return scored + self._under(sums, reading, [(x, y, z)], np.array([[x, y, z]]))

    def is_apart(self, vector: Float[Array, " 3"]) -> bool:
        """Whether a direction is none of those that are tried anyway."""
        for other in self.vectors[:-1]:
            cosine = vector @ other / max(float(np.linalg.norm(vector) * np.linalg.norm(other)), 1e-12)
            if cosine > np.cos(np.radians(LIMIT.snap_deg)):
                return False
        return True

    def _under(
        self,
        sums: Sums,
        reading: Hypothesis,
        gravities: Sequence[str | tuple[float, float, float]],
        vectors: Float[Array, "g 3"],
    ) -> list[Scored]:
        """The likeliest readings of the torque under some gravities, with the URDF's masses or all by one factor."""
        one = np.ones((1, len(vectors)))
        scored = self._of_size(sums, reading, gravities, vectors, one)
        size = common_size(sums, vectors[None], np.array(reading.order)[None])
        size = np.where(np.abs(np.log(size)) > np.log(MASSES.usual_factor), size, 1.0)
        return scored + (self._of_size(sums, reading, gravities, vectors, size) if np.any(size != 1.0) else [])

    def _of_size(
        self,
        sums: Sums,
        reading: Hypothesis,
        gravities: Sequence[str | tuple[float, float, float]],
        vectors: Float[Array, "g 3"],
        size: Float[Array, "1 g"],
    ) -> list[Scored]:
        """The torque as it stands, all of it of the other sign, and the likeliest signs and columns: by gravity."""
        costs, sizes = (values[0] for values in unexplained(sums, vectors[None], size))
        costs = np.where(self.alive[:, None], costs, 0.0)  # joint, gravity, column of effort, sign
        backwards = np.array(reading.direction) < 0
        costs[backwards], sizes[backwards] = costs[backwards, ..., ::-1], sizes[backwards, ..., ::-1]
        rows, order = np.arange(self.n), np.array(reading.order)
        limits = LIMIT.limit_cost * float(sums.beyond[0])
        moved = LIMIT.order_cost * (order[:, None] != rows[None, :])
        flips = np.array([0.0, LIMIT.sign_cost])
        scored = []
        for g, gravity in enumerate(gravities):
            cost = costs[:, g]
            _, columns = linear_sum_assignment((cost + flips).min(axis=-1) + moved)
            own_signs = (cost + flips)[rows, order].argmin(axis=-1)
            signs = (cost + flips)[rows, columns].argmin(axis=-1)
            for where, sign in ((order, 0 * rows), (order, 0 * rows + 1), (order, own_signs), (columns, signs)):
                found = replace(
                    reading,
                    gravity=gravity,
                    effort_order=tuple(int(column) for column in where),
                    effort_sign=tuple(int(value) for value in np.where(sign == 1, -1, 1)),
                    mass_factor=float(size[0, g]),
                )
                own = cost[rows, where, sign]
                total = float(own.sum()) + limits + self.unlikely(found)
                scored.append(Scored(found, total, tuple(own.tolist()), tuple(sizes[rows, g, where, sign].tolist())))
        return scored

    def unlikely(self, hypothesis: Hypothesis) -> float:
        """What the changes of a hypothesis cost together."""
        names = [name.partition(" ")[0] for name in hypothesis.changes]
        cost = LIMIT.change_cost * sum(name in ("direction", "zero", "gravity") for name in names)
        cost += LIMIT.unit_cost * names.count("unit")
        cost += LIMIT.sign_cost * names.count("effort_sign")
        cost += MASSES.factor_cost * names.count("mass_factor")
        moved = sum(column != j for j, column in enumerate(hypothesis.order))
        moved += sum(a != b for a, b in zip(hypothesis.order, hypothesis.effort_order, strict=True))
        return float(cost + LIMIT.order_cost * moved)

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
            yield replace(reading, order=tuple(order))
        for columns in self._usual_orders():
            yield replace(reading, order=columns)
        for unit in (*UNITS, ""):
            yield replace(reading, unit=(unit,) * self.n)
        for j in turning:
            for unit in ("deg", ""):
                if unit != reading.unit[j]:
                    yield reading.with_entry("unit", j, unit)

    def _usual_orders(self) -> list[tuple[int, ...]]:
        """Orders in which logs have all columns otherwise: alphabetical, and from the tip on."""
        names = self.model.arm.joint_names
        alphabetical = tuple(sorted(names).index(name) for name in names)
        return [alphabetical, tuple(reversed(range(self.n)))]

    def run(self) -> list[Scored]:
        """All readings that were scored, the likeliest first."""
        start = Hypothesis.as_it_is(self.n)
        every = self.score([start])
        kept = every
        for _ in range(LIMIT.most_changes):
            motions: list[Hypothesis] = []
            for scored in kept:
                motions += self.neighbours(_bare(scored.hypothesis, self.n))
            fresh = self.score(motions)
            best = min(every, key=lambda scored: scored.cost)
            every = sorted([*every, *fresh], key=lambda scored: scored.cost)
            # Where much is left, two changes may help only together.
            patience = 0.0 if best.explains > LIMIT.well_explained else LIMIT.patience
            if not fresh or min(one.cost for one in fresh) > best.cost + patience:
                break
            kept = _apart(every)[: LIMIT.beam]
        return every


def _bare(hypothesis: Hypothesis, count: int) -> Hypothesis:
    """The reading of the motion alone."""
    plain = Hypothesis.as_it_is(count)
    return replace(
        hypothesis,
        effort_order=plain.effort_order,
        effort_sign=plain.effort_sign,
        gravity=plain.gravity,
        mass_factor=1.0,
    )


def _apart(every: Sequence[Scored]) -> list[Scored]:
    """The likeliest of each reading of the motion."""
    found: dict[tuple[object, ...], Scored] = {}
    for scored in every:
        found.setdefault(scored.hypothesis.motion, scored)
    return list(found.values())


def _entry(sums: Sums, k: int) -> Sums:
    """The sums of one reading."""
    only = slice(k, k + 1)
    return Sums(sums.left[only], sums.friction[only], sums.spread[only], sums.variance, sums.beyond[only])
