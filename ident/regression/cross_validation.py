"""Held-out scores: the model is solved without a fold and judged on it, from sums alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial

import numpy as np

from ident.arrays import Array, Float, Int
from ident.regression.design import Group
from ident.regression.factors import factorise_signed
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, signs_of

# Models whose sums at a joint are kept.
MODELS_KEPT = 3


@dataclass(frozen=True, eq=False)
class HeldOutScore:
    """What a model leaves of folds that it never saw."""

    # whitened squares by fold and joint, shape (F, n): minus twice the log score
    misfit: Float[Array, "F n"]
    squares: Float[Array, "F n"]  # plain squares by fold and joint, shape (F, n) [N² m²]
    weights: Float[Array, "F n"]  # samples behind `squares`

    @property
    def rms(self) -> Float[Array, " n"]:
        """Root mean square over all folds, joint by joint [N m]."""
        # of a joint of which holds alone count they may be far below one
        samples = self.weights.sum(axis=0)
        samples = np.where(samples > 0.0, samples, 1.0)
        return np.sqrt(self.squares.sum(axis=0) / samples)

    def fall_from(self, other: HeldOutScore) -> Float[Array, " n"]:
        """Share by which each joint's root mean square falls from another model's.

        At most 1, negative where it rises, 0 of a joint without samples.
        """
        old = other.rms
        ratio = self.rms / np.maximum(old, 1e-12)
        return np.where(old > 0.0, 1.0 - ratio, 0.0)

    def gain_over(
        self, other: HeldOutScore, joints: Sequence[int] | None = None
    ) -> tuple[float, float]:
        """Gain of log score over another model, and its standard error over the folds.

        Args:
            other: What the other model leaves.
            joints: Whose rows count; all if None. What is open at other joints says nothing of an
                effect of one's own.

        Returns:
            Both in nats.
        """
        chosen = slice(None) if joints is None else list(joints)
        gains = 0.5 * (other.misfit - self.misfit)
        return _over_folds(gains[:, chosen].sum(axis=1))

    def closed_over(self, other: HeldOutScore, joints: Sequence[int]) -> tuple[float, float]:
        """Fall of the squared torque error from another model's, and its standard error over the
        folds.

        Each joint counts in units of its own error, so that the falls of several add up.

        Args:
            other: What the other model leaves.
            joints: Whose rows count.

        Returns:
            The fall, a number of joints, and its standard error.
        """
        chosen = list(joints)
        unit = np.maximum(other.squares[:, chosen].sum(axis=0), 1e-300)
        falls = (other.squares - self.squares)[:, chosen]
        return _over_folds((falls / unit).sum(axis=1))


def _over_folds(gains: Float[Array, " F"]) -> tuple[float, float]:
    """Sum over the folds and its standard error."""
    deviation = np.std(gains, ddof=1)
    return float(gains.sum()), float(deviation * np.sqrt(len(gains)))


@dataclass(frozen=True, eq=False)
class FoldWeights:
    """A model solved once for each fold, without it."""

    columns: Int[Array, " z"]  # the model's columns and, last, the torque
    # Weights (−coefficients, 1) of the scaled columns: what a model leaves of a row is their
    # product.
    values: Float[Array, "F z"]


@dataclass(frozen=True, eq=False)
class ColumnSums:
    """Sums of some columns of a joint's rows, fold by fold."""

    places: Int[Array, " c"]  # where the columns stand in its rows, ascending
    without: Float[Array, "F c c"]  # whitened, over all folds but each
    of_fold: Float[Array, "F c c"]  # whitened, over each fold
    plain: Float[Array, "F c c"]  # over each fold [N² m²]

    @classmethod
    def of(cls, evidence: Evidence, joint: int, places: Int[Array, " c"]) -> ColumnSums:
        """Sums of some columns of a joint's rows, fold by fold.

        Args:
            evidence: Sums of the session.
            joint: Index of the joint.
            places: Where the columns stand in its rows.
        """
        without, of_fold = evidence.fold_sums(joint, places)
        return cls(
            places=places,
            without=without,
            of_fold=of_fold,
            plain=evidence.plain[joint].part(places),
        )

    def at(self, places: Int[Array, " d"]) -> ColumnSums:
        """The sums of some of these columns.

        Args:
            places: Where they stand in the joint's rows; all are among `self.places`, which rise.
        """
        columns = np.searchsorted(self.places, places)
        rows = columns[:, None]
        return ColumnSums(
            places=places,
            without=self.without[:, rows, columns],
            of_fold=self.of_fold[:, rows, columns],
            plain=self.plain[:, rows, columns],
        )


def _spots(
    local: Int[Array, " p"], used: Int[Array, " z"]
) -> tuple[Int[Array, " k"], Int[Array, " k"]]:
    """Where the used columns stand in a joint's rows, and where those stand among the used."""
    order = np.argsort(local)
    sorted_places = np.searchsorted(local, used, sorter=order)
    near = order[np.minimum(sorted_places, len(local) - 1)]
    there = np.flatnonzero(local[near] == used)
    return near[there], there


@dataclass(frozen=True, eq=False)
class FoldColumns:
    """Sums of the columns that models have, fold by fold; each is summed once.

    Attributes:
        evidence: Sums of the session.
        expected: Columns that models will have; others may come, too.
    """

    evidence: Evidence
    expected: Int[Array, " z"]

    def at(self, joint: int, places: Int[Array, " c"]) -> ColumnSums:
        """Sums of some columns of a joint's rows."""
        return self._readers[joint](places.tobytes())

    @cached_property
    def _known(self) -> dict[int, ColumnSums]:
        """Of each joint the sums of all columns that are expected, or were asked for so far."""
        known = {}
        for joint, local in enumerate(self.evidence.layout.local):
            places, _ = _spots(local, self.expected)
            known[joint] = ColumnSums.of(self.evidence, joint, np.sort(places))
        return known

    @cached_property
    def _readers(self) -> tuple[Callable[[bytes], ColumnSums], ...]:
        """For each joint a function of places in its rows, packed.

        The last few are kept: most models differ at one joint from the one before.
        """
        readers = []
        for joint in range(self.evidence.layout.n):
            read = partial(self._read, joint)
            readers.append(lru_cache(MODELS_KEPT)(read))
        return tuple(readers)

    def _read(self, joint: int, packed: bytes) -> ColumnSums:
        places = np.frombuffer(packed, dtype=int)
        known = self._known[joint]
        if not np.isin(places, known.places).all():
            wanted = np.union1d(known.places, places)
            known = ColumnSums.of(self.evidence, joint, wanted)
            self._known[joint] = known
        return known.at(places)


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Scores models on folds.

    Attributes:
        evidence, prior: Sums of the session, and what is known beforehand of the baseline.
        expected: Groups that models will have; others may come, too.
        shared: Sums that another scorer of the same session has made; none if None.
    """

    evidence: Evidence
    prior: Prior
    expected: tuple[Group, ...] = field(default=(), kw_only=True)
    shared: FoldColumns | None = field(default=None, kw_only=True)

    def believing(self, prior: Prior) -> HeldOut:
        """A scorer of the same session with another prior; both share their sums."""
        return HeldOut(self.evidence, prior, shared=self._columns)

    @cached_property
    def _columns(self) -> FoldColumns:
        if self.shared is not None:
            return self.shared
        return FoldColumns(self.evidence, self._columns_of(self.expected))

    def _columns_of(self, groups: Sequence[Group]) -> Int[Array, " z"]:
        """Columns of the baseline, some groups, and the torque."""
        layout = self.evidence.layout
        tuned = np.arange(layout.tuned)
        of_groups = [group.columns for group in groups]
        torque = np.array([layout.size])
        return np.concatenate([tuned, *of_groups, torque]).astype(int)

    @cached_property
    def _scored(self) -> dict[tuple[Group, ...], tuple[FoldWeights, HeldOutScore]]:
        """Models solved and scored: most are needed again."""
        return {}

    def weights(self, groups: Sequence[Group] = ()) -> FoldWeights:
        """Residual weights of the baseline and some groups, solved without each fold in turn.

        A residual is the product of a row, the torque last, with them.
        """
        weights, _ = self._of(groups)
        return weights

    def score(self, groups: Sequence[Group] = ()) -> HeldOutScore:
        """What the baseline and some groups leave of each fold, solved without it."""
        _, score = self._of(groups)
        return score

    def power(self, columns: Int[Array, " k"]) -> Float[Array, " k"]:
        """Whitened squares of some columns over all folds."""
        return np.maximum(np.diag(self._over_all_folds(columns)), 0.0)

    def _over_all_folds(self, columns: Int[Array, " z"]) -> Float[Array, "z z"]:
        """Whitened sums of some columns of all joints over all folds."""
        whole = np.zeros((len(columns), len(columns)))
        for joint, local in enumerate(self.evidence.layout.local):
            places, into = _spots(local, columns)
            of_fold = self._columns.at(joint, places).of_fold
            whole[np.ix_(into, into)] += of_fold.sum(axis=0)
        return whole

    def _of(self, groups: Sequence[Group]) -> tuple[FoldWeights, HeldOutScore]:
        key = tuple(groups)
        if key not in self._scored:
            weights = self._solved(groups)
            self._scored[key] = weights, self._score_of(weights)
        return self._scored[key]

    def _solved(self, groups: Sequence[Group]) -> FoldWeights:
        """The model of some groups, solved without each fold in turn."""
        layout = self.evidence.layout
        used = self._columns_of(groups)
        folds = len(self.evidence.weights)
        grams = np.zeros((folds, len(used), len(used)))
        for joint, local in enumerate(layout.local):
            places, into = _spots(local, used)
            grams[:, into[:, None], into] += self._columns.at(joint, places).without
        signed = signs_of(layout.tuned, groups)
        values = np.array([self._solve(gram, used, signed) for gram in grams])
        columns_of_events: list[int] = []
        for group in groups:
            if group.effect.event:
                columns_of_events += group.columns.tolist()
        once = np.isin(used, columns_of_events)
        if once.any():  # what happened once can't be learnt from other runs
            of_all = self._solve(self._over_all_folds(used), used, signed)
            values[:, once] = of_all[once]
        return FoldWeights(used, values)

    def _score_of(self, weights: FoldWeights) -> HeldOutScore:
        """What a model leaves of each fold."""
        layout = self.evidence.layout
        folds = len(weights.values)
        misfit = np.zeros((folds, layout.n))
        squares = np.zeros((folds, layout.n))
        for j, local in enumerate(layout.local):
            places, into = _spots(local, weights.columns)
            of_joint = weights.values[:, into]
            known = self._columns.at(j, places)
            with np.errstate(over="ignore"):  # what a fold knows nothing of may run away
                misfit[:, j] = _squares(of_joint, known.of_fold)
                squares[:, j] = _squares(of_joint, known.plain)
        return HeldOutScore(misfit, np.maximum(squares, 0.0), self.evidence.weights)

    def _solve(
        self, gram: Float[Array, "z z"], used: Int[Array, " z"], signed: Int[Array, " s"]
    ) -> Float[Array, " z"]:
        """Residual weights (−coefficients, 1) of a model trained on some sums."""
        information = gram[:-1, :-1].copy()
        target = gram[:-1, -1]
        self.prior.add_to(information, self.evidence.layout)
        power = np.diag(information).copy()
        noise = self.evidence.settings.noise_ridge * self.evidence.noise_power[used[:-1]]
        ridge = 1e-8 * power + noise + 1e-9
        information[np.diag_indices(len(information))] += ridge
        factor = factorise_signed(information, target, signed)
        estimate = factor.solve(target)
        return np.concatenate([-estimate, [1.0]])


def _squares(weights: Float[Array, "F k"], sums: Float[Array, "F k k"]) -> Float[Array, " F"]:
    """wᵀ S w of each fold's weights and sums."""
    products = sums @ weights[:, :, None]
    return np.einsum("fk,fk->f", weights, products[:, :, 0])
