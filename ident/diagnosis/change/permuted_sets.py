"""Null distribution of a change's gain, by permutation of the recordings' own runs.

No model of a real arm is complete. Its residuals differ with each run's motion, and some law
explains that difference between two sets of few runs. So the runs are permuted into two other sets
that each hold half of either side: any change is then the same in both, and a law's gain is due to
noise and model error alone. With k columns and noise of the modelled size it would be k. A law's
mean gain a column, s², estimates its null variance with f degrees of freedom. With few permutations
that is uncertain, so it is shrunk towards that of all laws at the same joint,

    c = (f₀ s₀² + f s²) / (f₀ + f),

with s₀² and f₀ fitted to them as a scaled inverse χ² distribution. A change's gain is divided by c,
with f₀ + f degrees of freedom. If the model is right c is near one, and no power is lost.

Source: Fisher 1935 (permutation tests); Smyth 2004 (moderated variances, and how their prior is
fitted).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import digamma, polygamma

from ident.arrays import Array, Bool, Float, Int
from ident.diagnosis.change.paired_sums import PairedSums, Sides
from ident.diagnosis.change.settings import PERMUTED
from ident.regression.design import Group, Key
from ident.regression.least_squares import RIDGE, Prior, carried_noise, factorise, ridge_of


@dataclass(frozen=True)
class NullVariance:
    """Mean gain a column of a law without a change, in units of the noise's."""

    ratio: float  # one where the model leaves nothing but noise
    freedom: float  # degrees of freedom of that estimate


@dataclass(frozen=True, eq=False)
class PermutedSets:
    """Sums of parts of the runs, permuted between the two sets."""

    sums: PairedSums  # the sums of both sides
    parts: tuple[Float[Array, "K p p"], ...]  # for each joint, its whitened sums over each part
    whole: Float[Array, "P P"]  # all joints' sums over all parts
    # For each permutation the parts that form the later set.
    permutations: tuple[Int[Array, " h"], ...]
    freedom: int  # number of parts, less the two sides' means

    @classmethod
    def of(cls, sums: PairedSums, sides: Sides, seed: int = 0) -> PermutedSets:
        """Permutes the runs of two sides.

        Args:
            sums, sides: The sums, and the side of each run.
            seed: Seed of the permutations.
        """
        evidence = sums.evidence
        label = parts_of(sides)
        members = [np.flatnonzero(label == part) for part in range(int(label.max()) + 1)]
        later = np.array([sides.later_blocks[blocks[0]] for blocks in members])
        parts = []
        whole = np.zeros((evidence.layout.size + 1,) * 2)
        for j, local in enumerate(evidence.layout.local):
            own = np.stack([evidence.free[j].over(blocks) for blocks in members])
            parts.append(evidence.friction.part(own, j, float(evidence.spread[j]), label)[1])
            whole[np.ix_(local, local)] += parts[j].sum(axis=0)
        return cls(sums, tuple(parts), whole, _draw_permutations(later, seed), len(members) - 2)

    def nulls(
        self, joint: int, prior: Prior, names: Sequence[Group]
    ) -> dict[Key | None, NullVariance]:
        """Null variance of each law of one joint's rows, or of several joints' (-1), by the law's
        key.

        The key None has that of a law whose columns are not visible: the prior fitted to all of
        them.

        Args:
            joint: Index of the joint, or -1.
            prior, names: Prior of the baseline, and all changes between the sides.
        """
        permuted = self._permuted_laws(joint)
        evidence = self.sums.evidence
        layout = self.sums.evidence.layout
        inside = np.concatenate(
            [np.arange(layout.tuned), *(name.columns for name in names)]
        ).astype(int)
        information = self.whole[np.ix_(inside, inside)].copy()
        prior.add_to(information, layout)
        information[np.diag_indices(len(inside))] += ridge_of(self.whole, evidence, inside)
        factor = factorise(information)
        # Another window of a push that is in the model explains what that leaves of the push
        # itself.
        events = {name.key: name.variant.shape for name in names if name.effect.event}
        laws = [
            (key, places)
            for key, shape, places in permuted.laws
            if key not in events
            or shape["end_s"] < events[key]["start_s"]
            or shape["start_s"] > events[key]["end_s"]
        ]
        gains: dict[Key, list[tuple[float, int]]] = {}
        for across, own in permuted.sums:
            slopes = factor.solve(across[inside])
            rest = own - across[inside].T @ slopes
            power = np.diag(own)
            left = np.diag(rest)[:-1]
            noise = carried_noise(evidence, permuted.columns, inside, slopes[:, :-1])
            buried = evidence.settings.least_over_noise * noise
            seen = (left > evidence.settings.least_visible * power[:-1]) & (left > buried)
            for key, places in laws:
                at = places[seen[places]]
                if len(at):
                    matrix = rest[np.ix_(at, at)] + RIDGE * np.diag(power[at])
                    gain = float(rest[at, -1] @ factorise(matrix).solve(rest[at, -1]))
                    gains.setdefault(key, []).append((gain / len(at), len(at)))
        keys = list(gains)
        squares = np.array(
            [max(float(np.mean([gain for gain, _ in gains[key]])), PERMUTED.least) for key in keys]
        )
        many = min(len(self.permutations), self.freedom)
        freedom = many * np.array(
            [float(np.mean([width for _, width in gains[key]])) for key in keys]
        )
        usual = fit_scaled_f(squares, freedom)
        found: dict[Key | None, NullVariance] = {
            None: NullVariance(max(1.0, usual.ratio), usual.freedom)
        }
        for key, square, own in zip(keys, squares, freedom, strict=True):
            total = usual.freedom + float(own)
            ratio = (usual.freedom * usual.ratio + float(own * square)) / total
            found[key] = NullVariance(max(1.0, ratio), total)
        return found

    @cached_property
    def _cache(self) -> dict[int, _PermutedLaws]:
        return {}

    def _permuted_laws(self, joint: int) -> _PermutedLaws:
        """Sums of all laws of a joint's rows alone, or of several joints' rows (-1), in each
        permutation.
        """
        if joint not in self._cache:
            layout = self.sums.evidence.layout
            always = self.sums.always
            laws = [group for group in layout.groups if not group.borrows]
            laws = [law for law in laws if joint_of(law) == joint]
            columns = np.unique(np.concatenate([law.columns for law in laws]))
            found = []
            for permutation in self.permutations:
                across = np.zeros((layout.size + 1, len(columns) + 1))
                own = np.zeros((len(columns) + 1,) * 2)
                for parts, local, places in zip(
                    self.parts, layout.local, layout.places, strict=True
                ):
                    there = np.array(
                        [k for k, column in enumerate(columns) if int(column) in places], dtype=int
                    )
                    if len(there):
                        source = np.array([places[int(always[columns[k]])] for k in there])
                        here = parts[permutation].sum(axis=0)
                        across[np.ix_(local, there)] += here[:, source]
                        own[np.ix_(there, there)] += here[np.ix_(source, source)]
                        own[there, -1] += here[source, -1]
                across[:, -1] = self.whole[:, -1]
                own[-1, -1] = self.whole[-1, -1]
                own[-1, :-1] = own[:-1, -1]
                found.append((across, own))
            at = [
                (law.key, law.variant.shape, np.searchsorted(columns, law.columns)) for law in laws
            ]
            self._cache[joint] = _PermutedLaws(columns, tuple(at), tuple(found))
        return self._cache[joint]


class _PermutedLaws(NamedTuple):
    """Sums of some laws in permuted sets."""

    columns: Int[Array, " c"]  # columns of all laws
    # For each law its key, the shape of its variant, and the indices of its columns.
    laws: tuple[tuple[Key, Mapping[str, float], Int[Array, " k"]], ...]
    # By permutation: with all columns, with these.
    sums: tuple[tuple[Float[Array, "P c"], Float[Array, "c c"]], ...]


def joint_of(group: Group) -> int:
    """The joint whose rows alone determine a law; -1 for several joints."""
    return group.joint if group.effect.rows == "own" else -1


def parts_of(sides: Sides) -> Int[Array, " B"]:
    """Part of each block: a run, several runs, or a piece of the only run."""
    found = np.zeros(len(sides.run_of_block), dtype=int)
    first = 0
    for side in (False, True):
        here = np.flatnonzero(sides.later_blocks == side)
        runs = np.unique(sides.run_of_block[here], return_inverse=True)[1]
        count = int(runs.max()) + 1
        few = np.arange(len(here)) * PERMUTED.pieces // len(here)
        found[here] = first + (few if count == 1 else runs % min(count, PERMUTED.most_parts))
        first = int(found[here].max()) + 1
    return found


def _draw_permutations(later: Bool[Array, " K"], seed: int) -> tuple[Int[Array, " h"], ...]:
    """Sets that hold half of the parts of each side.

    No set twice, nor the complement of another.
    """
    sides = [np.flatnonzero(later == side) for side in (False, True)]
    halves = [
        list(itertools.combinations(some.tolist(), (len(some) + up) // 2))
        for up, some in enumerate(sides)
    ]
    rng = np.random.default_rng(seed)
    every = frozenset(range(len(later)))
    found: dict[tuple[int, ...], frozenset[int]] = {}
    for k in rng.permutation(len(halves[0]) * len(halves[1])):
        one = frozenset((*halves[0][k // len(halves[1])], *halves[1][k % len(halves[1])]))
        found.setdefault(min(tuple(sorted(one)), tuple(sorted(every - one))), one)
        if len(found) == PERMUTED.dealings:
            break
    return tuple(np.array(sorted(one)) for one in found.values())


def fit_scaled_f(squares: Float[Array, " k"], freedom: Float[Array, " k"]) -> NullVariance:
    """Scale and degrees of freedom of a scaled inverse χ² prior of variances, by the moments of
    their logarithms.
    """
    if len(squares) < 3:
        return NullVariance(
            max(1.0, float(np.mean(squares)) if len(squares) else 1.0), PERMUTED.prior_freedom
        )
    logs = np.log(squares) - digamma(freedom / 2.0) + np.log(freedom / 2.0)
    mean = float(logs.mean())
    beyond = float(logs.var(ddof=1) - np.mean(polygamma(1, freedom / 2.0)))
    if beyond <= float(polygamma(1, 0.5 * PERMUTED.most_freedom)):
        half = 0.5 * PERMUTED.most_freedom
    else:
        half = float(
            brentq(lambda x: float(polygamma(1, x)) - beyond, 1e-3, 0.5 * PERMUTED.most_freedom)
        )
    return NullVariance(float(np.exp(mean + digamma(half) - np.log(half))), 2.0 * half)
