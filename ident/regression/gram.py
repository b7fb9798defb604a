"""Block sums of a session: Gram matrices of all columns and the torque, joint by joint.

    G_b = Σ_{t in block b} x xᵀ,  x = (columns, torque) of one joint at one instant

One pass over the data fills them (`ident.regression.gather`). Cross-validation, tests, grid search
and nested models are then sums of small matrices and small solves; memory does not grow with the
recording. Two kinds are kept: `white`, where columns and torque went through the same
autoregressive whitening filter and count in units of the noise, for inference; and `plain`, in N m,
for sizes that people ask for.

Columns are made of smoothed positions, and what is left of the encoders' noise in them is in their
sums as well: it makes coefficients too small and other columns of the same noise look useful. A
second draw of that noise goes through the same smoother, columns and filters; the sums of what it
adds are taken off, G_b = Σ x xᵀ − Σ e eᵀ, which leaves unbiased estimates of the sums of noise-free
columns. Where many runs share a block, some of them, chosen at random, tell the noise of all: it is
a small part of a column, and its own sums vary little over so many samples.

Friction differs from run to run, whatever the model. In the whitened sums of a run, its Coulomb and
viscous level are free within a standard deviation of their own, joint by joint: with F the run's
two friction columns and Λ their variance, Xᵀ (I + F Λ Fᵀ)⁻¹ X = XᵀX − XᵀF (Λ⁻¹ + FᵀF)⁻¹ FᵀX.
Without it, friction that seems to depend on place or temperature is found wherever runs cover
different places at different times. Only FᵀX is kept of each run, so that Λ may change afterwards.

Source: Frisch, Waugh and Lovell for the projections that use these sums; Hamilton 1994, section 8.3
(whitening by AR); Fuller 1987, section 3.1 (sums corrected for measurement error); Cook and
Stefanski 1994 (remeasurement); Searle, Casella and McCulloch 1992 (variance components).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float, Int
from ident.model.linearisation import LEAST_MOVING
from ident.regression.block_sums import SymmetricSums
from ident.regression.design import Layout
from ident.regression.dwells import DwellRows
from ident.regression.friction_sums import FrictionSums
from ident.regression.noise import Whitening
from ident.regression.settings import USUAL_REGRESSION, RegressionSettings


@dataclass(frozen=True, eq=False)
class Evidence:
    """Block sums of a session."""

    layout: Layout  # what the columns are
    scale: Float[Array, " P"]  # each column was divided by this, length `layout.size` + 1
    # for each joint, whitened sums of every block, friction the same in all runs
    free: tuple[SymmetricSums, ...]
    plain: tuple[SymmetricSums, ...]  # for each joint, sums of every fold in N² m²
    # fold of each block; folds are whole runs where there are enough
    fold_of_block: Int[Array, " B"]
    rows: Float[Array, "B n"]  # whitened samples of each block and joint, shape (B, n)
    held_rows: Float[Array, "B n"]  # those of them that are holds: none until `with_dwells`
    weights: Float[Array, "F n"]  # plain samples of each fold and joint, shape (F, n)
    whitening: Whitening  # the noise
    # Whitened squares of each column that are encoder noise, taken off already; length as `scale`.
    noise_power: Float[Array, " P"]
    friction: FrictionSums  # what each run's own friction level goes with
    # Relative standard deviation from run to run of each joint's friction, counted in whatever is
    # computed.
    spread: Float[Array, " n"]
    # What each joint's whitened sums were divided by: mean square of what nothing explains there.
    dispersion: Float[Array, " n"]
    settings: RegressionSettings = USUAL_REGRESSION  # what the regression counts with
    # For each joint what its holds say; in none of the sums until `with_dwells` adds them.
    dwells: tuple[DwellRows, ...] = ()
    # For each joint the whitened sums of its discrepancy's columns with all columns of its rows,
    # over all time, friction the same in all runs; they are zero in the sums of blocks and folds.
    flexible: tuple[Float[Array, "m p"], ...] = ()

    def with_dwells(self) -> Evidence:
        """A copy with each joint's holds in the whitened sums, and no longer beside them
        (`dwells`).

        A row counts as one sample. Errors in N m are of motion; of a joint that hardly moves they
        are of its holds, too.
        """
        white = list(self.free)
        plain = list(self.plain)
        held_rows = np.array(self.held_rows)
        weights = np.array(self.weights)
        still = weights.sum(axis=0) < LEAST_MOVING
        flexible = list(self.flexible)
        for j, held in enumerate(self.dwells):
            smooth = self.layout.flexible_places[j]
            weighted = np.asarray(held.weighted, dtype=float)
            if flexible:
                flexible[j] = flexible[j] + weighted[:, smooth].T @ weighted
            weighted[:, smooth] = 0.0
            white[j] = white[j].with_rows(weighted, held.block)
            if still[j]:
                level = float(self.whitening.level[j])
                fold = self.fold_of_block[held.block]
                plain[j] = plain[j].with_rows(level * held.weighted, fold)
                np.add.at(weights[:, j], fold, (level / held.std) ** 2)
            np.add.at(held_rows[:, j], held.block, 1.0)
        return replace(
            self,
            free=tuple(white),
            plain=tuple(plain),
            flexible=tuple(flexible),
            rows=self.rows + (held_rows - self.held_rows),
            weights=weights,
            dwells=(),
            held_rows=held_rows,
        )

    def with_held(self, friction: Sequence[float]) -> Evidence:
        """The sums with other levels of static friction; `with_dwells` comes after it.

        Args:
            friction: Of each joint [N m].
        """
        dwells = []
        for rows, level in zip(self.dwells, friction, strict=True):
            dwells.append(replace(rows, friction=level))
        return replace(self, dwells=tuple(dwells))

    def with_run_spread(self, spread: Float[Array, " n"]) -> Evidence:
        """A copy in which each joint's friction varies from run to run by another share.

        Args:
            spread: Relative standard deviation of each joint's friction level.
        """
        return replace(self, spread=np.array(spread, dtype=float))

    def with_dispersion(self, dispersion: Float[Array, " n"]) -> Evidence:
        """A copy in which each joint's rows have so many times the variance of whitened noise.

        What nobody can explain at a joint is noise to all that is estimated: without it, a joint
        with a gap of many times its noise would decide the inertias that it shares with others, and
        drown what they show.

        Args:
            dispersion: Of each joint, as a whole, whatever it was before.
        """
        if np.array_equal(dispersion, self.dispersion):
            return self
        factor = np.asarray(dispersion / self.dispersion)
        power = np.zeros(len(self.noise_power))
        weighted = np.zeros(len(self.noise_power))
        for j, local in enumerate(self.layout.local):
            power_of_column = np.abs(self.free[j].diagonal())
            power[local] += power_of_column
            weighted[local] += power_of_column / factor[j]
        divisors = factor.tolist()
        sums = tuple(sums.divided(divisors[j]) for j, sums in enumerate(self.free))
        flexible = tuple(sums / factor[j] for j, sums in enumerate(self.flexible))
        tied = tuple(sums / factor[j] for j, sums in enumerate(self.friction.sums))
        return replace(
            self,
            free=sums,
            flexible=flexible,
            friction=replace(self.friction, sums=tied),
            noise_power=self.noise_power * weighted / np.maximum(power, 1e-300),
            dispersion=np.array(dispersion, dtype=float),
        )

    def weighted(self, weights: Float[Array, "B n"]) -> Evidence:
        """A copy in which every block counts by a weight of its own at each joint.

        Args:
            weights: Of each block and joint, shape (B, n).
        """
        free = []
        tied = []
        for j, of_block in enumerate(weights.T):
            free.append(self.free[j].weighted(of_block))
            of_piece = of_block[self.friction.block]
            tied.append(self.friction.sums[j] * of_piece[:, None, None])
        return replace(
            self,
            free=tuple(free),
            friction=replace(self.friction, sums=tuple(tied)),
            rows=self.rows * weights,
        )

    @property
    def samples(self) -> Float[Array, " n"]:
        """Number of whitened samples of each joint over all blocks."""
        return np.asarray(self.rows.sum(axis=0))

    @cached_property
    def total(self) -> tuple[SymmetricSums, ...]:
        """For each joint, its whitened sums over all blocks, as one block."""
        total = []
        for j, sums in enumerate(self.free):
            taken = self.friction.absorbed(j, float(self.spread[j]))
            total.append(SymmetricSums.of((sums.over() - taken)[None]))
        return tuple(total)

    def fold_sums(
        self, joint: int, places: Int[Array, " c"]
    ) -> tuple[Float[Array, "F c c"], Float[Array, "F c c"]]:
        """Whitened sums of some columns of a joint's rows, fold by fold.

        Args:
            joint: The joint.
            places: Where the columns stand in its rows.

        Returns:
            Sums over all folds but each in turn, and over each fold.
        """
        folds = int(self.fold_of_block.max()) + 1
        of_fold = np.zeros((folds, len(places), len(places)))
        np.add.at(of_fold, self.fold_of_block, self.free[joint].part(places))
        spread = float(self.spread[joint])
        return self.friction.split_by_fold(of_fold, joint, spread, self.fold_of_block, places)

    def times(self, joint: int, weights: Float[Array, " p"]) -> Float[Array, "B p"]:
        """Each block's whitened sums times a vector of weights of a joint's columns, torque
        last.
        """
        product = self.free[joint].times(weights)
        spread = float(self.spread[joint])
        taken = self.friction.absorbed_by_block(joint, spread, weights, len(product))
        return np.asarray(product - taken)

    @cached_property
    def friction_noise(self) -> Float[Array, " n"]:
        """What friction that varies from run to run adds to each joint's torque [N m].

        Root mean square.
        """
        deviations = np.zeros(self.layout.n)
        columns = np.arange(self.layout.tuned)[self.friction.columns]
        for j, sums in enumerate(self.plain):
            level = self.friction.level[j]
            squares = level @ sums.part(columns).sum(axis=0) @ level
            power = float(squares / max(float(self.weights[:, j].sum()), 1.0))
            deviations[j] = self.spread[j] * np.sqrt(max(power, 0.0))
        return deviations

    @property
    def floor(self) -> Float[Array, " n"]:
        """What no model of the state can go below [N m].

        The torque's noise, and friction's variation from run to run.
        """
        return np.hypot(self.whitening.level, self.friction_noise)

    def misfit(self, joint: int, weights: Float[Array, " P"]) -> float:
        """Mean square of what a model leaves of a joint's whitened rows, one at the least.

        Whitened noise has a variance of one where the model fits; where more is left, all is less
        certain.

        Args:
            joint: The joint.
            weights: What the model leaves of a row is their product.
        """
        of_joint = weights[self.layout.local[joint]]
        squares = self.total[joint].times(of_joint)[0] @ of_joint
        return max(float(squares / max(float(self.samples[joint]), 1.0)), 1.0)

    def gram(self) -> Float[Array, "P P"]:
        """Whitened sums of all joints over all blocks, in the layout's order; read-only."""
        return self._gram

    @cached_property
    def _gram(self) -> Float[Array, "P P"]:
        total = np.zeros((self.layout.size + 1, self.layout.size + 1))
        for local, sums in zip(self.layout.local, self.total, strict=True):
            total[np.ix_(local, local)] += sums.over()
        total.setflags(write=False)
        return total
