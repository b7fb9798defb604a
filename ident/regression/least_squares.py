"""Least squares on block sums: what a model explains, and what each candidate would add to it.

By Frisch, Waugh and Lovell, adding columns Φ to a model Z is a regression of the residual on Φ̃ =
(I − P_Z) Φ, and all its sums are a Schur complement of the Gram matrix: one factorisation serves
every candidate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.regression.baseline import Baseline, UrdfError
from ident.regression.design import Group, Layout
from ident.regression.factors import Factor, factorise, factorise_signed, solve_signed
from ident.regression.gram import Evidence
from ident.regression.settings import RegressionSettings

# Ridge of every unknown without a prior, as a share of its column's power: only keeps solves
# well-posed.
RIDGE = 1e-9
# Ridge, in multiples of its encoder noise, of an unknown whose column is nothing else: it stays at
# zero.
FIXED = 1e3
# A URDF as it is mostly believed.
USUAL_URDF = UrdfError()
# Whitened squares of a column below which it is zero but for rounding.
LEAST_POWER = 1e-100


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known beforehand: of the scaled base parameters by the URDF, of further columns by
    their usual size.
    """

    base: Float[Array, "r r"]  # information on the base parameters
    error: UrdfError = USUAL_URDF  # how far off the URDF is believed to be
    # Information on the scaled coefficient of each further column of the baseline; None for none.
    further: Float[Array, " f"] | None = None

    @classmethod
    def of(
        cls, evidence: Evidence, base: Float[Array, "r r"], error: UrdfError = USUAL_URDF
    ) -> Prior:
        """The prior in the evidence's column scale.

        Args:
            evidence: Sums, for scale and layout of the columns.
            base: Information on the change of the base parameters.
            error: How far the URDF was believed to be off for it.
        """
        layout = evidence.layout
        scale = evidence.scale[: layout.rank]
        further = None
        if layout.further_std:
            columns = slice(layout.tuned - layout.further, layout.tuned)
            sizes = evidence.scale[columns] * np.array(layout.further_std)
            further = sizes**-2.0
        return cls(base / np.outer(scale, scale), error, further)

    @classmethod
    def believing(cls, evidence: Evidence, baseline: Baseline, error: UrdfError) -> Prior:
        """The prior of a URDF that is off by so much, in the evidence's column scale.

        Args:
            evidence: Sums, for scale and layout of the columns.
            baseline: The tuned model.
            error: How far the URDF is believed to be off.
        """
        return cls.of(evidence, baseline.prior_of(error), error)

    def tightened(self, factor: float) -> Prior:
        """A copy with the URDF's standard deviations divided by a factor: 100 is as good as the
        URDF fixed.
        """
        return Prior(self.base * factor**2, self.error.divided(factor), self.further)

    def add_to(self, information: Float[Array, "z z"], layout: Layout) -> None:
        """Adds it, in place, to the information on a model whose first columns are those of the
        baseline.
        """
        information[: layout.rank, : layout.rank] += self.base
        if self.further is not None:
            further = np.arange(layout.tuned - layout.further, layout.tuned)
            information[further, further] += self.further


def ridge_of(
    gram: Float[Array, "P P"], evidence: Evidence, columns: Int[Array, " z"]
) -> Float[Array, " z"]:
    """What keeps a solve well-posed: information on the scaled coefficients of some columns that
    they be zero.

    Encoder noise was taken off the sums. A column of which nothing is left was nothing else: its
    coefficient, which may come out as anything, is fixed at zero.

    Args:
        gram: Whitened sums.
        evidence: Where they come from.
        columns: Indices of the columns.
    """
    power = np.diag(gram)[columns]
    noise = evidence.noise_power[columns]
    settings = evidence.settings
    share = np.where(power <= 0.0, FIXED, settings.noise_ridge)
    return np.asarray(RIDGE * np.abs(power) + share * noise + 1e-9)


@dataclass(frozen=True, eq=False)
class Projection:
    """A model (the baseline and some groups) solved, and every column, or some, seen after it."""

    inside: Int[Array, " z"]  # the model's columns
    estimate: Float[Array, " z"]  # its scaled coefficients
    factor: Factor  # of its information, prior included
    across: Float[Array, "z P"]  # sums of the model's columns times every column
    total: Float[Array, "P P"]  # the whole Gram matrix, the torque its last row and column
    slopes: Float[Array, "z P"]  # coefficients of every column on the model's
    # encoder noise, taken off, in what the model leaves of every column: its power
    noise: Float[Array, " P"]
    settings: RegressionSettings  # what counts as seen
    columns: Int[Array, " P"] | None = None  # which columns are seen, if not all

    @cached_property
    def spread(self) -> Float[Array, "z z"]:
        """Inverse of its information, the model-based covariance."""
        return self.factor.solve(np.eye(len(self.inside)))

    @property
    def misfit(self) -> float:
        """Penalised sum of whitened squares that the model leaves, prior included."""
        return float(self._target[-1])

    def rest(self, columns: Int[Array, " k"]) -> Float[Array, "k k"]:
        """Sums of some columns, given by index, with the model's projected out, shape (k, k).

        A part of the Schur complement.
        """
        places = self._at(columns)
        total = self.total[places[:, None], places]
        absorbed = self.across[:, places].T @ self.slopes[:, places]
        return np.asarray(total - absorbed)

    def _at(self, columns: Int[Array, " k"]) -> Int[Array, " k"]:
        """Where some columns stand among those that are seen."""
        if self.columns is None:
            return columns
        return np.argmax(self.columns == columns[:, None], axis=1)

    def places(self, columns: Int[Array, " k"]) -> Int[Array, " k"]:
        """Where some of the model's columns stand in it."""
        return np.argmax(self.inside == columns[:, None], axis=1)

    def left_of(self, columns: Int[Array, " k"]) -> Float[Array, "P k"]:
        """Weights that leave of some columns what the model can't absorb: a row's product with
        them.

        Where all columns are seen.

        Args:
            columns: Their indices in the layout.
        """
        weights = np.zeros((len(self.total), len(columns)))
        weights[self.inside] = -self.slopes[:, columns]
        weights[columns, np.arange(len(columns))] += 1.0
        return weights

    @cached_property
    def weights(self) -> Float[Array, " P"]:
        """Weights that leave of the torque what the model can't explain: a row's product with
        them.
        """
        torque = len(self.total) - 1
        return self.left_of(np.array([torque]))[:, 0]

    @cached_property
    def _target(self) -> Float[Array, " P"]:
        """Sums of every column times the torque, after the model."""
        return np.asarray(self.total[:, -1] - self.across.T @ self.estimate)

    @cached_property
    def _power(self) -> Float[Array, " P"]:
        return np.diag(self.total).copy()

    @cached_property
    def _left(self) -> Float[Array, " P"]:
        """Power of every column that the model leaves."""
        absorbed = np.einsum("zp,zp->p", self.across, self.slopes)
        return np.asarray(self._power - absorbed)

    def visibility(self, columns: Int[Array, " k"]) -> Float[Array, " k"]:
        """Share, from 0 to 1, of each column's power that the model can't absorb; 0 without
        power.
        """
        places = self._at(columns)
        left = self._left[places]
        power = self._power[places]
        return np.divide(left, power, out=np.zeros_like(left), where=power > LEAST_POWER)

    def gain(self, group: Group) -> tuple[float, Float[Array, " k"]]:
        """Fall of the misfit by a group, and its scaled coefficients; signs respected."""
        return self._fall(group.columns, group.signed)

    @cached_property
    def _every_seen(self) -> Bool[Array, " P"]:
        """Which of all columns can be seen."""
        has_power = self._power > 0
        is_visible = self._left > self.settings.least_visible * self._power
        return is_visible & has_power & ~self._every_buried

    @cached_property
    def _every_buried(self) -> Bool[Array, " P"]:
        """Which of all columns are lost in noise."""
        least = self.settings.least_over_noise * self.noise
        return np.asarray(self._left <= least)

    def seen(self, columns: Int[Array, " k"]) -> Bool[Array, " k"]:
        """Which columns can be seen: the model and their encoder noise leave anything of them."""
        return self._every_seen[self._at(columns)]

    def buried(self, columns: Int[Array, " k"]) -> Bool[Array, " k"]:
        """Which columns are lost in noise: what the model leaves of them is little beside encoder
        noise.
        """
        return self._every_buried[self._at(columns)]

    def solve(self, columns: Int[Array, " k"], signed: Bool[Array, " k"]) -> Float[Array, " k"]:
        """Scaled coefficients of further columns after the model.

        Args:
            columns: Their indices.
            signed: Which of the coefficients are not negative.

        Returns:
            Those that can't be seen are zero.
        """
        nonnegative = np.flatnonzero(signed).tolist()
        _, coefficients = self._fall(columns, nonnegative)
        return coefficients

    def _fall(
        self, columns: Int[Array, " k"], nonnegative: Sequence[int]
    ) -> tuple[float, Float[Array, " k"]]:
        """Fall of the misfit by further columns, and their coefficients: zero of those that can't
        be seen.
        """
        signed = np.zeros(len(columns), dtype=bool)
        # an effect may have fewer columns here than it can
        signed[[k for k in nonnegative if k < len(columns)]] = True
        places = self._at(columns)
        if len(columns) == 1:  # most candidates: no matrix is needed
            return self._fall_by_one(int(places[0]), bool(signed[0]))
        power = self._power[places]
        target = self._target[places]
        beta = np.zeros(len(columns))
        rest = self.rest(columns)
        visible = np.flatnonzero(self._every_seen[places])
        if len(visible):
            ridge = np.diag(RIDGE * power[visible])
            matrix = rest[visible[:, None], visible] + ridge
            beta[visible] = solve_signed(matrix, target[visible], signed[visible])
        fall = 2.0 * target @ beta - beta @ rest @ beta
        return float(max(fall, 0.0)), beta

    def _fall_by_one(self, place: int, signed: bool) -> tuple[float, Float[Array, " 1"]]:
        """Fall of the misfit by one further column, and its coefficient.

        Args:
            place: Where the column stands among those that are seen.
            signed: Whether its coefficient is not negative.
        """
        left = float(self._left[place])
        target = self._target[place]
        value = 0.0
        if self._every_seen[place]:
            ridge = RIDGE * float(self._power[place])
            value = float(target) / (left + ridge)
            if signed:
                value = max(value, 0.0)
        beta = np.array([value])
        fall = (2.0 * target - beta[0] * left) * beta[0]
        return max(fall, 0.0), beta


def project(
    gram: Float[Array, "P P"],
    evidence: Evidence,
    prior: Prior,
    groups: Sequence[Group] = (),
    columns: Int[Array, " c"] | None = None,
    signed: bool = True,
) -> Projection:
    """Solves the baseline and some groups.

    Args:
        gram: Whitened sums, of all blocks or some.
        evidence: Where they come from.
        prior: What the URDF says of the base parameters.
        groups: Candidates that are part of the model.
        columns: Which columns are to be seen after it, the torque last; all if None. A few cost a
            fraction of the work.
        signed: Whether coefficients that can't be negative are zero where they would be.
    """
    inside, factor = _factorise(gram, evidence, prior, groups, signed)
    every = slice(None) if columns is None else columns
    across = gram[inside][:, every]
    total = gram if columns is None else gram[np.ix_(columns, columns)]
    slopes = factor.solve(across)
    return Projection(
        inside=inside,
        estimate=slopes[:, -1],
        factor=factor,
        across=across,
        total=total,
        slopes=slopes,
        noise=carried_noise(evidence, every, inside, slopes),
        settings=evidence.settings,
        columns=columns,
    )


def _factorise(
    gram: Float[Array, "P P"],
    evidence: Evidence,
    prior: Prior,
    groups: Sequence[Group],
    signed: bool,
) -> tuple[Int[Array, " z"], Factor]:
    """A model's columns and the factor of its information."""
    layout = evidence.layout
    tuned = np.arange(layout.tuned)
    of_groups = [group.columns for group in groups]
    inside = np.concatenate([tuned, *of_groups]).astype(int)
    information = gram[np.ix_(inside, inside)].copy()
    prior.add_to(information, layout)
    information[np.diag_indices(len(inside))] += ridge_of(gram, evidence, inside)
    if not signed:
        return inside, factorise(information)
    target = gram[inside, -1]
    nonnegative = signs_of(layout.tuned, groups)
    return inside, factorise_signed(information, target, nonnegative)


def signs_of(tuned: int, groups: Sequence[Group]) -> Int[Array, " s"]:
    """Places, in a model of the baseline and some groups, of coefficients that can't be negative.

    Args:
        tuned: Number of columns of the baseline, which come first.
        groups: The groups, in the model's order.
    """
    places = []
    start = tuned
    for group in groups:
        width = len(group.columns)
        places += [start + k for k in group.signed if k < width]
        start += width
    return np.array(places, dtype=int)


def carried_noise(
    evidence: Evidence,
    columns: Int[Array, " k"] | slice,
    inside: Int[Array, " z"],
    slopes: Float[Array, "z k"],
) -> Array:
    """Power of the encoder noise, taken off, in what a model leaves of some columns: theirs, and
    its own columns'.
    """
    of_columns = evidence.noise_power[columns]
    of_model = evidence.noise_power[inside] @ slopes**2
    return np.asarray(of_columns + of_model)
