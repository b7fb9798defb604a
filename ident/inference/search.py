"""Sets of effects by log evidence: add, swap and drop until nothing gains.

After the baseline, all candidates and the torque are one small matrix R of sums. A set of effects M
with prior deviations s has the log evidence of `evidence.log_evidence` on R_MM, plus the log odds
of its names; what a candidate adds beside a set is the same on what the set leaves of R.
Coefficients that can't be negative are solved with that bound; their prior is half a normal, which
is worth log 2 each. Where an effect knows more of its size than a normal, the ratio of both
densities at the estimate is added (Tierney and Kadane 1986).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from ident.arrays import Array, Float, Int
from ident.effects import optional
from ident.inference.evidence import factorise
from ident.inference.names import Names
from ident.regression.design import Group, Key
from ident.regression.least_squares import Prior, solve_signed

# Rounds over all members of a set in which each may be swapped, after each addition; mostly one is
# enough.
SWAP_ROUNDS = 3
# Candidates of greatest evidence whose coefficients are checked against the point of their grid.
MOST_CHECKED = 30
# Names a joint has at most: a limit on work, never reached by arms with one URDF.
MOST_NAMES = 4
LOG_TWO = float(np.log(2.0))


class Searchable(Protocol):
    """What a search needs of a model."""

    @property
    def sums(self) -> Any:
        """The session's sums; its `evidence` has the layout of all columns."""

    @property
    def names(self) -> Names:
        """The candidates with their priors."""

    @property
    def gram(self) -> Float[Array, "P P"]:
        """Products of all columns, summed over samples and joints; the torque comes last."""

    @property
    def last(self) -> int:
        """Index of the torque's column in `gram`."""

    def prior(self) -> Prior:
        """Prior of the baseline's parameters."""

    def information(
        self, chosen: Sequence[Group], prior: Prior
    ) -> tuple[Int[Array, " z"], Float[Array, "z z"]]:
        """Indices of the columns of the baseline and some effects, and their precision, prior
        included.

        Args:
            chosen: The effects.
            prior: Of the baseline's parameters.
        """


@dataclass(frozen=True, eq=False)
class Batch:
    """Candidates of equally many columns."""

    slots: list[int]  # their numbers among all candidates
    columns: Int[Array, "m w"]  # their columns in R
    deviation: Float[Array, "m w"]  # of each scaled coefficient beforehand


@dataclass(frozen=True, eq=False)
class SetSearch:
    """Sums of all candidates and the torque after the baseline."""

    names: Names
    joints: int  # number of joints
    first: int  # number of the first column in R
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
        scale = np.append(model.sums.evidence.scale[tuned : model.last], 1.0)
        return cls(model.names, layout.n, tuned, rest, scale)

    @cached_property
    def _batches(self) -> dict[int | None, list[Batch]]:
        """Candidates by number of columns: for each joint those that act there; for None all."""
        groups = self.names.groups
        batches: dict[int | None, list[Batch]] = {}
        for joint in (None, *range(self.joints)):
            near = [
                k
                for k, group in enumerate(groups)
                if joint is None or group.effect.rows == "all" or group.joint == joint
            ]
            by_width: dict[int, list[int]] = {}
            for k in near:
                by_width.setdefault(len(groups[k].columns), []).append(k)
            batches[joint] = [self._batch(slots) for slots in by_width.values()]
        return batches

    def _batch(self, slots: list[int]) -> Batch:
        groups = [self.names.groups[k] for k in slots]
        columns = np.stack([group.columns - self.first for group in groups])
        deviation = np.stack([self.names.deviation[group] for group in groups])
        return Batch(slots, columns, deviation)

    def nats(self, chosen: Sequence[Group]) -> float:
        """Log evidence of a set of effects against none, log odds of its names included [nats].

        0 for the empty set.
        """
        if not chosen:
            return 0.0
        nats, scaled = self._solve(chosen)
        ends = np.cumsum([len(group.columns) for group in chosen])[:-1]
        for group, part in zip(chosen, np.split(scaled, ends), strict=True):
            nats += self.names.log_odds[group] + self._for_size(group, part)
        return nats

    def _for_size(self, group: Group, scaled: Float[Array, " k"]) -> float:
        """What is to be added where more is known of an effect's size than a deviation [nats].

        Args:
            group: The effect.
            scaled: Its coefficients, in the scale of its columns.
        """
        if group.prior is None:
            return 0.0
        return group.prior.beyond_normal(scaled / self.scale[group.columns - self.first])

    def coefficients(self, chosen: Sequence[Group]) -> dict[Group, Float[Array, " k"]]:
        """Coefficients of a set's effects, in the columns' own units.

        By effect; empty for the empty set.
        """
        if not chosen:
            return {}
        _, scaled = self._solve(chosen)
        ends = np.cumsum([len(group.columns) for group in chosen])[:-1]
        parts = np.split(scaled, ends)
        return {
            group: part / self.scale[group.columns - self.first]
            for group, part in zip(chosen, parts, strict=True)
        }

    def covariance(self, chosen: Sequence[Group], group: Group) -> Float[Array, "k k"]:
        """Posterior covariance of one of a set's effects, in the columns' own units.

        Coefficients that their bound keeps at zero are as uncertain as if they were free.
        """
        columns = np.concatenate([other.columns for other in chosen]) - self.first
        deviation = np.concatenate([self.names.deviation[other] for other in chosen])
        inner = deviation[:, None] * self.rest[np.ix_(columns, columns)] * deviation
        inner[np.diag_indices(len(inner))] += 1.0
        own = np.flatnonzero(np.isin(columns, group.columns - self.first))
        factor = factorise(inner)
        part = cho_solve((factor, True), np.eye(len(inner))[:, own], check_finite=False)[own]
        scale = deviation[own] / self.scale[columns[own]]
        return np.asarray(scale[:, None] * part * scale)

    def _solve(self, chosen: Sequence[Group]) -> tuple[float, Float[Array, " k"]]:
        columns = np.concatenate([group.columns for group in chosen]) - self.first
        deviation = np.concatenate([self.names.deviation[group] for group in chosen])
        starts = np.cumsum([0, *(len(group.columns) for group in chosen)])
        signed = np.zeros(len(columns), dtype=bool)
        for start, group in zip(starts, chosen, strict=False):
            signed[[start + k for k in group.signed if k < len(group.columns)]] = True
        sums = self.rest[np.ix_(columns, columns)]
        return solve_set(sums, self.rest[columns, -1], deviation, signed)

    def beside(self, chosen: Sequence[Group]) -> Float[Array, "c c"]:
        """Sums of all candidates and the torque with the baseline and a set of effects integrated
        out.

        The torque comes last; columns in the scale of `rest`.
        """
        if not chosen:
            return self.rest
        columns = np.concatenate([group.columns for group in chosen]) - self.first
        deviation = np.concatenate([self.names.deviation[group] for group in chosen])
        inner = self.rest[np.ix_(columns, columns)] + np.diag(np.maximum(deviation, 1e-12) ** -2.0)
        factor = factorise(inner)
        half = solve_triangular(factor, self.rest[columns], lower=True, check_finite=False)
        return self.rest - half.T @ half

    def gains(self, chosen: Sequence[Group], joint: int | None = None) -> Float[Array, " g"]:
        """What each candidate adds to a set's log evidence [nats]; −∞ of what can't be added.

        Args:
            chosen: The set.
            joint: Where candidates have to act; anywhere if None.
        """
        half = np.zeros((0, len(self.rest)))
        if chosen:
            columns = np.concatenate([group.columns for group in chosen]) - self.first
            deviation = np.concatenate([self.names.deviation[group] for group in chosen])
            inner = self.rest[np.ix_(columns, columns)] + np.diag(
                np.maximum(deviation, 1e-12) ** -2.0
            )
            factor = factorise(inner)
            half = solve_triangular(factor, self.rest[columns], lower=True, check_finite=False)
        target = self.rest[:, -1] - half.T @ half[:, -1]
        gains = np.full(len(self.names.groups), -np.inf)
        for batch in self._batches[joint]:
            columns = batch.columns
            taken = np.einsum("kmi,kmj->mij", half[:, columns], half[:, columns])
            sums = self.rest[columns[:, :, None], columns[:, None, :]] - taken
            own = self._gains_of(batch.slots, sums, target[columns], batch.deviation)
            gains[batch.slots] = own
        keys = {group.key for group in chosen}
        gains[[k for k, group in enumerate(self.names.groups) if group.key in keys]] = -np.inf
        return gains

    def _gains_of(
        self,
        slots: Sequence[int],
        sums: Float[Array, "m w w"],
        target: Float[Array, "m w"],
        deviation: Float[Array, "m w"],
    ) -> Float[Array, " m"]:
        """Gains of candidates of equally many columns."""
        width = target.shape[1]
        inner = deviation[:, :, None] * sums * deviation[:, None, :]
        inner = 0.5 * (inner + inner.transpose(0, 2, 1)) + np.eye(width)
        scaled = deviation * target
        sign, log_determinant = np.linalg.slogdet(inner)
        sound = (sign > 0) & np.isfinite(log_determinant)
        # With one added to every eigenvalue none is below one, but for rounding.
        sound &= np.linalg.eigvalsh(inner)[:, 0] > 0.5
        inner[~sound] = np.eye(width)
        along = np.linalg.solve(inner, scaled[:, :, None])[:, :, 0]
        gains = 0.5 * (np.sum(scaled * along, axis=1) - log_determinant)
        gains[~sound] = -np.inf
        for k, slot in enumerate(slots):
            group = self.names.groups[slot]
            gains[k] += self.names.log_odds[group]
            signed = [c for c in group.signed if c < width]
            size = deviation[k] * along[k]
            if signed:
                gains[k] += LOG_TWO * len(signed)
                if (along[k, signed] < 0.0).any() and gains[k] > 0.0:
                    bound = np.isin(np.arange(width), signed)
                    nats, size = solve_set(sums[k], target[k], deviation[k], bound)
                    gains[k] = nats + self.names.log_odds[group]
            gains[k] += self._for_size(group, size)
        return gains

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
        gains, checked = self.gains(chosen, joint), 0
        for k in np.argsort(-gains):
            if gains[k] <= 0.0 or checked == MOST_CHECKED:
                return None
            group = self.names.groups[k]
            if keys is not None and group.key not in keys:
                continue
            checked += 1
            if self._stands([*chosen, group], group):
                return self.nats([*chosen, group]) - self.nats(chosen), group
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
        chosen = self._swapped(self.without_idle(list(start)), set(range(self.joints)))
        while len(chosen) < MOST_NAMES * self.joints:
            addition = self.best(chosen)
            if addition is None or addition[0] <= 0.0:
                break
            before = self.nats(chosen)
            near = set(addition[1].acts_on(self.joints))
            fuller = self.without_idle(self._swapped([*chosen, addition[1]], near))
            if self.nats(fuller) <= before + 1e-6:
                break
            chosen = fuller
        return chosen

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
                acts = set(group.acts_on(self.joints))
                if not acts & (near | moved):
                    continue
                others = rest_of(chosen, group)
                joint = group.joint if group.effect.rows == "own" else None
                better = self.best(others, joint=joint)
                # What has left its grid point beside the others is another effect than its name's.
                alone = 0.0
                if self._stands(chosen, group):
                    alone = self.nats(chosen) - self.nats(others)
                if better is not None and better[1] is not group and better[0] > alone + 1e-6:
                    chosen = [*others[:k], better[1], *others[k:]]
                    moved |= acts | set(better[1].acts_on(self.joints))
            if not moved:
                break
            near = moved
        return chosen


def rest_of(chosen: Sequence[Group], group: Group) -> list[Group]:
    """A set without one of its effects, which is told by identity; the order stays."""
    return [other for other in chosen if other is not group]


def solve_set(
    sums: Float[Array, "k k"],
    target: Float[Array, " k"],
    deviation: Float[Array, " k"],
    signed: Float[Array, " k"],
) -> tuple[float, Float[Array, " k"]]:
    """Log evidence of coefficients against none [nats], and their estimates.

    Args:
        sums, target: Sums of the columns, and of these times the torque.
        deviation: Standard deviation of each beforehand.
        signed: Which of them can't be negative.

    Returns:
        Log evidence, and the coefficients in the columns' scale; none of the signed ones is
        negative.
    """
    inner = deviation[:, None] * sums * deviation
    inner[np.diag_indices(len(inner))] += 1.0
    factor = factorise(inner)
    scaled = deviation * target
    free = cho_solve((factor, True), scaled, check_finite=False)
    if (free[signed] < 0.0).any():
        free = solve_signed(inner, scaled, signed)
    gain = float(scaled @ free - 0.5 * free @ inner @ free)
    nats = gain - float(np.log(np.diag(factor)).sum()) + LOG_TWO * int(signed.sum())
    return nats, deviation * free
