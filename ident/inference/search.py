"""Sets of effects by log evidence: add, swap and drop until nothing gains.

After the baseline, all candidates and the torque are one small matrix R of sums. A set of effects M
with prior deviations s has the log evidence of `evidence.log_evidence` on R_MM, plus the log odds
of its names; what a candidate adds beside a set is the same on what the set leaves of R.
Coefficients that can't be negative are solved with that bound; their prior is half a normal, which
is worth log 2 each. Where an effect knows more of its size than a normal, the ratio of both
densities at the estimate is added (Tierney and Kadane 1986); of a mass, which has no density at
zero, the mean of that ratio over what recordings leave of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from ident.arrays import Array, Bool, Float, Int
from ident.effects import optional
from ident.inference.bounds import Bounds, SumsAfter
from ident.inference.evidence import LOG_TWO, factorise, free_gains, mass_left, solve_set
from ident.inference.names import LEAST_DEVIATION, Names
from ident.inference.searchable import Searchable
from ident.regression.design import Group, Key

# Rounds over all members of a set in which each may be swapped, after each addition; mostly one is
# enough.
SWAP_ROUNDS = 3
# Candidates of greatest evidence whose coefficients are checked against the point of their grid.
MOST_CHECKED = 30
# Names a joint has at most: a limit on work, never reached by arms with one URDF.
MOST_NAMES = 4


@dataclass(frozen=True, eq=False)
class SetSearch:
    """Sums of all candidates and the torque after the baseline."""

    names: Names
    rest: Float[Array, "c c"]  # R, the torque last
    scale: Float[Array, " c"]  # what each column was divided by

    @classmethod
    def of(cls, model: Searchable) -> SetSearch:
        """Sums of a model's candidates and torque, the baseline's coefficients integrated out."""
        layout = model.sums.evidence.layout
        tuned = layout.tuned
        _, information = model.information((), model.prior())
        factor = factorise(information)
        across = model.gram[:tuned, tuned:]
        half = solve_triangular(factor, across, lower=True, check_finite=False)
        rest = model.gram[tuned:, tuned:] - half.T @ half
        of_candidates = model.sums.evidence.scale[tuned : model.last]
        return cls(model.names, rest, np.append(of_candidates, 1.0))

    def nats(self, chosen: Sequence[Group]) -> float:
        """Log evidence of a set of effects against none, log odds of its names included [nats].

        0 for the empty set.
        """
        if not chosen:
            return 0.0
        nats, _ = self._solve(chosen)
        return nats + sum(self.names.log_odds[group] for group in chosen)

    def _for_size(
        self, group: Group, sums: SumsAfter, scaled: Float[Array, " k"], place: int = 0
    ) -> float:
        """What is to be added where more is known of an effect's size than a deviation [nats].

        A mass that recordings hardly determine may be found at zero, where no body is: over what
        they leave of it is integrated.

        Args:
            group: The effect.
            sums: Of a set that it is in.
            scaled: The set's coefficients, in the scale of its columns.
            place: Where its own begin.
        """
        prior = group.prior
        if prior is None:
            return 0.0
        inside = slice(place, place + len(group.columns))
        unit = self.scale[group.columns - self.names.first]
        size = scaled[inside]
        if not prior.weighs:
            return float(prior.beyond_normal(size / unit))
        left = mass_left(sums.sums, sums.target, sums.deviation, sums.signed, scaled, place)
        step = left.step[inside]

        def log_ratio(above: Float[Array, " s"]) -> Float[np.ndarray, " s"]:
            sizes = size + above[:, None] * step
            return prior.beyond_normal(sizes / unit)

        # Its density is that of a mass above zero, not of half a normal.
        return left.log_mean(log_ratio) - LOG_TWO

    def coefficients(self, chosen: Sequence[Group]) -> dict[Group, Float[Array, " k"]]:
        """Coefficients of a set's effects, in the columns' own units.

        By effect; empty for the empty set.
        """
        if not chosen:
            return {}
        _, scaled = self._solve(chosen)
        coefficients = {}
        for group, of_group in _parts(chosen, scaled):
            scale = self.scale[group.columns - self.names.first]
            coefficients[group] = of_group / scale
        return coefficients

    def covariance(self, chosen: Sequence[Group], group: Group) -> Float[Array, "k k"]:
        """Posterior covariance of one of a set's effects, in the columns' own units.

        Coefficients that their bound keeps at zero are as uncertain as if they were free.
        """
        columns, deviation = self._stacked(chosen)
        inner = deviation[:, None] * self.rest[np.ix_(columns, columns)] * deviation
        inner[np.diag_indices(len(inner))] += 1.0
        of_group = group.columns - self.names.first
        places = np.flatnonzero(np.isin(columns, of_group))
        factor = factorise(inner)
        units = np.eye(len(inner))[:, places]
        solved = cho_solve((factor, True), units, check_finite=False)
        scale = deviation[places] / self.scale[columns[places]]
        return np.asarray(scale[:, None] * solved[places] * scale)

    def _stacked(self, chosen: Sequence[Group]) -> tuple[Int[Array, " k"], Float[Array, " k"]]:
        """Columns in R of a set's effects, one behind the other, and their prior deviations."""
        columns = np.concatenate([group.columns for group in chosen]) - self.names.first
        deviation = np.concatenate([self.names.deviation[group] for group in chosen])
        return columns, deviation

    @cached_property
    def _solved(self) -> dict[tuple[Group, ...], tuple[float, Float[Array, " k"]]]:
        """Sets that were solved so far: most are asked for more than once."""
        return {}

    def _solve(self, chosen: Sequence[Group]) -> tuple[float, Float[Array, " k"]]:
        """Log evidence of a set, without its names' odds, and its scaled coefficients."""
        key = tuple(chosen)
        if key not in self._solved:
            self._solved[key] = self._solve_anew(key)
        return self._solved[key]

    def _solve_anew(self, chosen: Sequence[Group]) -> tuple[float, Float[Array, " k"]]:
        """The same of a set that was not solved before."""
        columns, deviation = self._stacked(chosen)
        sums = SumsAfter(
            sums=self.rest[np.ix_(columns, columns)],
            target=self.rest[columns, -1],
            deviation=deviation,
            signed=self._signed(chosen),
        )
        nats, scaled = solve_set(sums.sums, sums.target, sums.deviation, sums.signed)
        place = 0
        for group in chosen:
            nats += self._for_size(group, sums, scaled, place)
            place += len(group.columns)
        return nats, scaled

    @staticmethod
    def _signed(chosen: Sequence[Group]) -> Bool[Array, " k"]:
        """Which of a set's coefficients can't be negative."""
        of_groups = []
        for group in chosen:
            places = range(len(group.columns))
            of_groups += [place in group.signed for place in places]
        return np.array(of_groups, dtype=bool)

    def beside(self, chosen: Sequence[Group]) -> Float[Array, "c c"]:
        """Sums of all candidates and the torque with the baseline and a set of effects integrated
        out.

        The torque comes last; columns in the scale of `rest`.
        """
        half = self._explained(chosen)
        return self.rest - half.T @ half

    def _explained(self, chosen: Sequence[Group]) -> Float[Array, "k c"]:
        """Root of the sums that a set of effects takes off: HᵀH is what it explains of R."""
        if not chosen:
            return np.zeros((0, len(self.rest)))
        columns, deviation = self._stacked(chosen)
        precision = np.maximum(deviation, LEAST_DEVIATION) ** -2.0
        inner = self.rest[np.ix_(columns, columns)] + np.diag(precision)
        factor = factorise(inner)
        half = solve_triangular(factor, self.rest[columns], lower=True, check_finite=False)
        return np.asarray(half)

    def gains(self, chosen: Sequence[Group], joint: int | None = None) -> Float[Array, " g"]:
        """What each candidate adds to a set's log evidence [nats]; −∞ of what can't be added.

        Args:
            chosen: The set.
            joint: Where candidates have to act; anywhere if None.
        """
        bounds = self._bounds(chosen, joint)
        gains = bounds.most.copy()
        for k in bounds.bent:
            gains[k] = bounds.exactly(k)
        return gains

    def _bounds(self, chosen: Sequence[Group], joint: int | None) -> Bounds:
        """The most that each candidate may add to a set (see `gains`).

        Coefficients that can't be negative are free here, which can only add more.
        """
        half = self._explained(chosen)
        of_torque = half[:, -1]
        target = self.rest[:, -1] - half.T @ of_torque
        most = np.full(len(self.names.groups), -np.inf)
        bent: dict[int, SumsAfter] = {}
        for batch in self.names.batches[joint]:
            columns = batch.columns
            beside = np.ascontiguousarray(half[:, columns].transpose(1, 2, 0))
            taken = beside @ beside.transpose(0, 2, 1)
            square = (columns[:, :, None], columns[:, None, :])
            sums = self.rest[square] - taken
            free = free_gains(sums, target[columns], batch.deviation)
            gains = free.nats + batch.known
            # Beyond its bound a free fit that gains nothing adds nothing at its bound either,
            # unless more is known of its size.
            may_add = np.isfinite(gains) & (batch.sized | (gains > 0.0))
            is_negative = batch.signed & (free.sizes < 0.0)
            below = is_negative.any(axis=1) & may_add
            is_sized = batch.sized & np.isfinite(gains)
            for k in np.flatnonzero(is_sized | below):
                slot = batch.slots[k]
                group = self.names.groups[slot]
                after = SumsAfter(
                    sums=sums[k],
                    target=target[columns[k]],
                    deviation=batch.deviation[k],
                    signed=batch.signed[k],
                )
                if not below[k]:
                    gains[k] += self._for_size(group, after, free.sizes[k])
                elif batch.sized[k]:  # what more is known of the size may add to it
                    gains[k] = self.gain_within(group, after)
                else:
                    bent[slot] = after
            most[batch.slots] = gains
        keys = {group.key for group in chosen}
        for slot, group in enumerate(self.names.groups):
            if group.key in keys:
                most[slot] = -np.inf
                bent.pop(slot, None)

        def exactly(k: int) -> float:
            return self.gain_within(self.names.groups[k], bent[k])

        return Bounds(most, bent.keys(), exactly)

    def gain_within(self, group: Group, after: SumsAfter) -> float:
        """What a candidate adds with its signed coefficients at zero or above [nats].

        Args:
            group: The candidate.
            after: Its sums after a set.
        """
        nats, size = solve_set(after.sums, after.target, after.deviation, after.signed)
        return nats + self.names.log_odds[group] + self._for_size(group, after, size)

    def best(
        self, chosen: Sequence[Group], keys: set[Key] | None = None, joint: int | None = None
    ) -> tuple[float, Group] | None:
        """The candidate that adds most to a set, and what it adds [nats]; None if none adds
        anything.

        Args:
            chosen: The set.
            keys: Names that are candidates; all if None.
            joint: Where candidates have to act; anywhere if None.
        """
        checked = 0
        for k in self._bounds(chosen, joint).from_most():
            if checked == MOST_CHECKED:
                return None
            group = self.names.groups[k]
            if keys is not None and group.key not in keys:
                continue
            checked += 1
            fuller = [*chosen, group]
            if self._stands(fuller, group):
                return self.nats(fuller) - self.nats(chosen), group
        return None

    def _stands(self, chosen: Sequence[Group], group: Group) -> bool:
        """Whether one of a set's effects has coefficients of its own point of the grid there."""
        estimate = self.coefficients(chosen)[group]
        return optional.stands_for(group.effect, group.variant, estimate)

    def run(self, start: Sequence[Group] = ()) -> list[Group]:
        """A set that no addition, swap or removal of one effect improves.

        Args:
            start: The set to begin with; none if empty.

        Returns:
            The set, empty where no effect improves on none. Its size is bounded by the number of
            joints.
        """
        everywhere = set(range(self.names.joints))
        chosen = self.without_idle(list(start))
        chosen = self._swapped(chosen, everywhere)
        while len(chosen) < MOST_NAMES * self.names.joints:
            addition = self.best(chosen)
            if addition is None:
                break
            gain, group = addition
            if gain <= 0.0:
                break
            before = self.nats(chosen)
            near = set(group.acts_on(self.names.joints))
            fuller = self._swapped([*chosen, group], near)
            fuller = self.without_idle(fuller)
            if self.nats(fuller) <= before + 1e-6:
                break
            chosen = fuller
        return self.with_standing(chosen)

    def with_standing(self, chosen: Sequence[Group]) -> list[Group]:
        """A set with what stands in place of each effect (see `standing_for`)."""
        return [group for group in self.standing_for(chosen) if group is not None]

    def standing_for(self, chosen: Sequence[Group]) -> list[Group | None]:
        """What stands in place of each effect that has left its own point of the grid beside the
        others: what is best there.

        Where nothing adds anything there, nothing does if one of the others explains the same
        torque, so that it adds less than half of what it would alone. Else it stays itself.

        Args:
            chosen: The set.

        Returns:
            An effect, or None, for each of the set in its order.
        """
        standing: list[Group | None] = list(chosen)
        for k, group in enumerate(chosen):
            present = [other for other in standing if other is not None]
            if self._stands(present, group):
                continue
            others = rest_of(present, group)
            joint = group.joint if group.effect.rows == "own" else None
            better = self.best(others, joint=joint)
            if better is not None and better[0] > 0.0:
                standing[k] = better[1]
            elif self.nats(present) - self.nats(others) < 0.5 * self.nats([group]):
                standing[k] = None
        return standing

    def settled(self, chosen: Sequence[Group]) -> list[Group]:
        """A set with each effect at its best point beside the others, or what is better in its
        place; none is added, and none leaves that adds anything.
        """
        everywhere = set(range(self.names.joints))
        return self.without_idle(self._swapped(list(chosen), everywhere))

    def without_idle(self, chosen: list[Group]) -> list[Group]:
        """A set without the effects whose removal doesn't lower its log evidence, the weakest going
        first.
        """
        while chosen:
            whole = self.nats(chosen)
            without = [self.nats(rest_of(chosen, group)) for group in chosen]
            weakest = int(np.argmax(without))
            if without[weakest] < whole:
                break
            chosen = rest_of(chosen, chosen[weakest])
        return chosen

    def _swapped(self, chosen: list[Group], near: set[int]) -> list[Group]:
        """A set with each effect at its best point beside the others, or what is better in its
        place.

        Args:
            chosen: The set.
            near: Joints where an effect was added; effects that act elsewhere stay as they are.
        """
        for _ in range(SWAP_ROUNDS):
            moved: set[int] = set()
            for k, group in enumerate(chosen):
                acts = set(group.acts_on(self.names.joints))
                if not acts & (near | moved):
                    continue
                better = self._better(chosen, group)
                if better is not None:
                    others = rest_of(chosen, group)
                    chosen = [*others[:k], better, *others[k:]]
                    moved |= acts | set(better.acts_on(self.names.joints))
            if not moved:
                break
            near = moved
        return chosen

    def _better(self, chosen: list[Group], group: Group) -> Group | None:
        """What is better in the place of one of a set's effects; None where nothing is."""
        others = rest_of(chosen, group)
        joint = group.joint if group.effect.rows == "own" else None
        best = self.best(others, joint=joint)
        if best is None:
            return None
        gain, candidate = best
        # What has left its grid point beside the others is another effect than its name's.
        alone = 0.0
        if self._stands(chosen, group):
            alone = self.nats(chosen) - self.nats(others)
        is_better = candidate is not group and gain > alone + 1e-6
        return candidate if is_better else None


def _parts(
    chosen: Sequence[Group], scaled: Float[Array, " k"]
) -> Iterator[tuple[Group, Float[Array, " w"]]]:
    """A set's effects, each with its own of all their coefficients."""
    ends = np.cumsum([len(group.columns) for group in chosen])[:-1]
    return zip(chosen, np.split(scaled, ends), strict=True)


def rest_of(chosen: Sequence[Group], group: Group) -> list[Group]:
    """A set without one of its effects, which is told by identity; the order stays."""
    return [other for other in chosen if other is not group]
