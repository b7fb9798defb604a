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
from ident.regression.factors import factorise
from ident.regression.least_squares import RIDGE, Prior, carried_noise, ridge_of


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
        members = [np.flatnonzero(label == number) for number in range(int(label.max()) + 1)]
        later = np.array([sides.later_blocks[blocks[0]] for blocks in members])
        by_joint = []
        size = evidence.layout.size + 1
        whole = np.zeros((size, size))
        for j, local in enumerate(evidence.layout.local):
            alike = np.stack([evidence.free[j].over(blocks) for blocks in members])
            _, varied = evidence.friction.split_by_fold(alike, j, float(evidence.spread[j]), label)
            by_joint.append(varied)
            whole[np.ix_(local, local)] += varied.sum(axis=0)
        permutations = _draw_permutations(later, seed)
        return cls(sums, tuple(by_joint), whole, permutations, len(members) - 2)

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
        gains = self._gains_without_change(joint, prior, names)
        mean_gains = []
        mean_widths = []
        for of_law in gains.values():
            mean_gains.append(float(np.mean([gain.a_column for gain in of_law])))
            mean_widths.append(float(np.mean([gain.columns for gain in of_law])))
        squares = np.array([max(gain, PERMUTED.least) for gain in mean_gains])
        independent = min(len(self.permutations), self.freedom)
        freedom = independent * np.array(mean_widths)
        usual = fit_scaled_f(squares, freedom)
        nulls: dict[Key | None, NullVariance] = {}
        nulls[None] = NullVariance(max(1.0, usual.ratio), usual.freedom)
        for key, square, degrees in zip(gains, squares, freedom, strict=True):
            total = usual.freedom + float(degrees)
            ratio = (usual.freedom * usual.ratio + float(degrees * square)) / total
            nulls[key] = NullVariance(max(1.0, ratio), total)
        return nulls

    def _gains_without_change(
        self, joint: int, prior: Prior, names: Sequence[Group]
    ) -> dict[Key, list[_Gain]]:
        """Gain of each law in each permutation where it is visible; arguments as in `nulls`."""
        permuted = self._permuted_laws(joint)
        evidence = self.sums.evidence
        layout = evidence.layout
        of_names = [name.columns for name in names]
        inside = np.concatenate([np.arange(layout.tuned), *of_names]).astype(int)
        information = self.whole[np.ix_(inside, inside)].copy()
        prior.add_to(information, layout)
        information[np.diag_indices(len(inside))] += ridge_of(self.whole, evidence, inside)
        factor = factorise(information)
        laws = _apart_from_events(permuted.laws, names)
        gains: dict[Key, list[_Gain]] = {}
        for across, within in permuted.sums:
            slopes = factor.solve(across[inside])
            rest = within - across[inside].T @ slopes
            power = np.diag(within)
            left = np.diag(rest)[:-1]
            noise = carried_noise(evidence, permuted.columns, inside, slopes[:, :-1])
            buried = evidence.settings.least_over_noise * noise
            seen = (left > evidence.settings.least_visible * power[:-1]) & (left > buried)
            for key, places in laws:
                visible = places[seen[places]]
                if len(visible) == 0:
                    continue
                ridge = RIDGE * np.diag(power[visible])
                matrix = rest[np.ix_(visible, visible)] + ridge
                score = rest[visible, -1]
                gain = float(score @ factorise(matrix).solve(score))
                gains.setdefault(key, []).append(_Gain(gain / len(visible), len(visible)))
        return gains

    @cached_property
    def _cache(self) -> dict[int, _PermutedLaws]:
        return {}

    def _permuted_laws(self, joint: int) -> _PermutedLaws:
        """Sums of all laws of a joint's rows alone, or of several joints' rows (-1), in each
        permutation.
        """
        if joint in self._cache:
            return self._cache[joint]
        groups = [group for group in self.sums.evidence.layout.groups if not group.borrows]
        groups = [group for group in groups if joint_of(group) == joint]
        columns = np.unique(np.concatenate([group.columns for group in groups]))
        laws: list[_PlacedLaw] = []
        for group in groups:
            places = np.searchsorted(columns, group.columns)
            laws.append((group.key, group.variant.shape, places))
        sums = [self._sums_of(columns, later) for later in self.permutations]
        self._cache[joint] = _PermutedLaws(columns, tuple(laws), tuple(sums))
        return self._cache[joint]

    def _sums_of(
        self, columns: Int[Array, " c"], later: Int[Array, " h"]
    ) -> tuple[Float[Array, "P c"], Float[Array, "c c"]]:
        """Sums of some columns in the later set of a permutation, the torque last.

        Args:
            columns: The columns.
            later: The parts that form the later set.

        Returns:
            The sums with all columns, and with these.
        """
        layout = self.sums.evidence.layout
        across = np.zeros((layout.size + 1, len(columns) + 1))
        within = np.zeros((len(columns) + 1, len(columns) + 1))
        for parts, local, places in zip(self.parts, layout.local, layout.places, strict=True):
            is_there = [int(column) in places for column in columns]
            there = np.flatnonzero(is_there)
            if len(there) == 0:
                continue
            # The sums of the later set are those of the same law in all runs, of its parts alone.
            in_all_runs = self.sums.always[columns[there]]
            source = np.array([places[int(column)] for column in in_all_runs])
            of_set = parts[later].sum(axis=0)
            across[np.ix_(local, there)] += of_set[:, source]
            within[np.ix_(there, there)] += of_set[np.ix_(source, source)]
            within[there, -1] += of_set[source, -1]
        across[:, -1] = self.whole[:, -1]
        within[-1, -1] = self.whole[-1, -1]
        within[-1, :-1] = within[:-1, -1]
        return across, within


class _Gain(NamedTuple):
    """What a law explains in a permutation, where nothing changed."""

    a_column: float  # gain over the number of its visible columns [nats]
    columns: int  # number of its visible columns


# A law's key, the shape of its variant, and the places of its columns among those of all laws.
_PlacedLaw = tuple[Key, Mapping[str, float], Int[Array, " k"]]


class _PermutedLaws(NamedTuple):
    """Sums of some laws in permuted sets."""

    columns: Int[Array, " c"]  # columns of all laws
    laws: tuple[_PlacedLaw, ...]
    # By permutation: with all columns, with these.
    sums: tuple[tuple[Float[Array, "P c"], Float[Array, "c c"]], ...]


def _apart_from_events(
    laws: Sequence[_PlacedLaw], names: Sequence[Group]
) -> list[tuple[Key, Int[Array, " k"]]]:
    """The laws and their places, without those that share time with an event that is named.

    Another window of a push that is in the model explains what that leaves of the push itself.
    """
    events = {name.key: name.variant.shape for name in names if name.effect.event}
    apart = []
    for key, shape, places in laws:
        event = events.get(key)
        if event is None or shape["end_s"] < event["start_s"] or shape["start_s"] > event["end_s"]:
            apart.append((key, places))
    return apart


def joint_of(group: Group) -> int:
    """The joint whose rows alone determine a law; -1 for several joints."""
    return group.joint if group.effect.rows == "own" else -1


def parts_of(sides: Sides) -> Int[Array, " B"]:
    """Part of each block: a run, several runs, or a piece of the only run."""
    label = np.zeros(len(sides.run_of_block), dtype=int)
    first = 0
    for side in (False, True):
        blocks = np.flatnonzero(sides.later_blocks == side)
        runs = np.unique(sides.run_of_block[blocks], return_inverse=True)[1]
        count = int(runs.max()) + 1
        if count == 1:
            dealt = np.arange(len(blocks)) * PERMUTED.pieces // len(blocks)
        else:
            dealt = runs % min(count, PERMUTED.most_parts)
        label[blocks] = first + dealt
        first = int(label[blocks].max()) + 1
    return label


def _draw_permutations(later: Bool[Array, " K"], seed: int) -> tuple[Int[Array, " h"], ...]:
    """Sets that hold half of the parts of each side.

    No set twice, nor the complement of another. Of an odd number of parts the earlier side gives
    the smaller half, and the later one the larger.
    """
    earlier_parts = np.flatnonzero(~later).tolist()
    later_parts = np.flatnonzero(later).tolist()
    earlier_halves = list(itertools.combinations(earlier_parts, len(earlier_parts) // 2))
    later_halves = list(itertools.combinations(later_parts, (len(later_parts) + 1) // 2))
    rng = np.random.default_rng(seed)
    every = frozenset(range(len(later)))
    # By the smaller of a set and its complement, in their order.
    drawn: dict[tuple[int, ...], frozenset[int]] = {}
    for k in rng.permutation(len(earlier_halves) * len(later_halves)):
        earlier, late = divmod(int(k), len(later_halves))
        half = frozenset((*earlier_halves[earlier], *later_halves[late]))
        complement = every - half
        key = min(tuple(sorted(half)), tuple(sorted(complement)))
        drawn.setdefault(key, half)
        if len(drawn) == PERMUTED.dealings:
            break
    return tuple(np.array(sorted(half)) for half in drawn.values())


def fit_scaled_f(squares: Float[Array, " k"], freedom: Float[Array, " k"]) -> NullVariance:
    """A scaled inverse χ² prior of variances, by the moments of their logarithms.

    With half of a variance's degrees of freedom d and half of the prior's d₀, a logarithm is spread
    by ψ'(d) + ψ'(d₀), and off by ψ(d) − log d less ψ(d₀) − log d₀.

    Args:
        squares, freedom: Variances, and the degrees of freedom of each.

    Returns:
        The prior's scale and degrees of freedom.
    """
    if len(squares) < 3:
        mean_square = float(np.mean(squares)) if len(squares) else 1.0
        return NullVariance(max(1.0, mean_square), PERMUTED.prior_freedom)
    half_freedom = freedom / 2.0
    logs = np.log(squares) - digamma(half_freedom) + np.log(half_freedom)
    mean = float(logs.mean())
    beyond = float(logs.var(ddof=1) - np.mean(polygamma(1, half_freedom)))
    most = 0.5 * PERMUTED.most_freedom
    if beyond <= float(polygamma(1, most)):
        half = most
    else:
        half = float(brentq(lambda x: float(polygamma(1, x)) - beyond, 1e-3, most))
    scale = float(np.exp(mean + digamma(half) - np.log(half)))
    return NullVariance(scale, 2.0 * half)
