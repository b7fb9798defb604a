"""Models of some parts of both sets, and what they leave of others.

Of a joint's rows over a part a model leaves rᵀV⁻¹r, V of their noise, of what the model's
coefficients are unsure of, and of friction as it varies from run to run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.diagnosis.change.paired_design import PairedDesign
from ident.diagnosis.change.permuted_sets import parts_of
from ident.diagnosis.change.settings import CHANGE
from ident.regression.design import Group
from ident.regression.factors import factorise, positive
from ident.regression.least_squares import ridge_of


class SolvedModel(NamedTuple):
    """The baseline solved on some parts."""

    # −coefficients of the scaled columns and 1: their product with a row is what is left.
    weights: Float[Array, " z"]
    covariance: Float[Array, "k k"]  # of the coefficients


@dataclass(frozen=True, eq=False)
class PartSums:
    """The baseline's sums over the parts of both sets, friction the same in all runs."""

    design: PairedDesign
    changes: tuple[Group, ...] = ()  # what differs between the sets, beside the baseline

    @cached_property
    def label(self) -> Int[Array, " B"]:
        """Part of each block."""
        return parts_of(self.design.sides)

    @cached_property
    def members(self) -> list[Int[Array, " b"]]:
        """Blocks of each part."""
        parts = range(int(self.label.max()) + 1)
        return [np.flatnonzero(self.label == number) for number in parts]

    @cached_property
    def later(self) -> Bool[Array, " K"]:
        """Set of each part."""
        first_blocks = np.array([blocks[0] for blocks in self.members])
        return self.design.sides.later_blocks[first_blocks]

    @cached_property
    def columns(self) -> Int[Array, " z"]:
        """Columns of the baseline and of the changes and, last, the torque."""
        layout = self.design.sums.evidence.layout
        changed = [column for group in self.changes for column in group.columns]
        changes = np.unique(changed).astype(int)
        return np.concatenate([np.arange(layout.tuned), changes, [layout.size]])

    @cached_property
    def places(self) -> list[tuple[Int[Array, " k"], Int[Array, " k"]]]:
        """Of each joint's rows the places of these columns, and which of them they are."""
        layout = self.design.sums.evidence.layout
        places = []
        for local in layout.local:
            in_rows = np.flatnonzero(np.isin(local, self.columns))
            in_columns = np.searchsorted(self.columns, local[in_rows])
            places.append((in_rows, in_columns))
        return places

    @cached_property
    def rows(self) -> Float[Array, "K n"]:
        """Whitened rows of each part and joint."""
        rows = self.design.sums.evidence.rows
        return np.stack([rows[blocks].sum(axis=0) for blocks in self.members])

    @cached_property
    def seen(self) -> Int[Array, " s"]:
        """Joints that have rows in every part."""
        return np.flatnonzero((self.rows >= CHANGE.fewest_rows).all(axis=0))

    @cached_property
    def alike(self) -> list[Float[Array, "K k k"]]:
        """Each joint's whitened sums over each part."""
        evidence = self.design.sums.evidence
        by_joint = []
        for sums, (in_rows, _) in zip(evidence.free, self.places, strict=True):
            square = np.ix_(in_rows, in_rows)
            by_part = [sums.over(blocks)[square] for blocks in self.members]
            by_joint.append(np.stack(by_part))
        return by_joint


@dataclass(frozen=True, eq=False)
class PartModels:
    """Models of some parts, solved where each run has a friction level of its own."""

    sums: PartSums
    # Standard deviation of each joint's friction from run to run, as a share.
    spread: Float[Array, " n"]

    @cached_property
    def varied(self) -> list[Float[Array, "K k k"]]:
        """Each joint's whitened sums over each part, friction free in each run within the share."""
        tied = self.sums.design.sums.evidence.friction
        pairs = zip(tied.sums, self.sums.places, strict=True)
        of_columns = tuple(sums[:, :, in_rows] for sums, (in_rows, _) in pairs)
        tied = replace(tied, sums=of_columns)
        shares = self.spread.tolist()
        by_joint = []
        for joint, (alike, share) in enumerate(zip(self.sums.alike, shares, strict=True)):
            _, varied = tied.split_by_fold(alike, joint, share, self.sums.label)
            by_joint.append(varied)
        return by_joint

    @cached_property
    def solved(self) -> Float[Array, "K z z"]:
        """Sums of all joints over each part that models are solved with."""
        size = len(self.sums.columns)
        total = np.zeros((len(self.sums.members), size, size))
        for sums, (_, in_columns) in zip(self.varied, self.sums.places, strict=True):
            total[:, in_columns[:, None], in_columns] += sums
        return total

    def solve(self, parts: Bool[Array, " K"], free: bool = False) -> SolvedModel:
        """The baseline solved on some parts.

        Args:
            parts: The parts.
            free: Whether nothing is believed beforehand, of the URDF or of the laws that both sets
                share.
        """
        design = self.sums.design
        evidence = design.sums.evidence
        sums = self.solved[parts].sum(axis=0)
        information = sums[:-1, :-1].copy()
        if not free:
            design.prior.add_to(information, evidence.layout)
        ridge = ridge_of(evidence.gram(), evidence, self.sums.columns[:-1])
        information[np.diag_indices(len(information))] += ridge
        factor = factorise(information)
        covariance = factor.solve(np.eye(len(information)))
        coefficients = factor.solve(sums[:-1, -1])
        return SolvedModel(np.append(-coefficients, 1.0), covariance)

    def left(
        self, model: SolvedModel, parts: Bool[Array, " K"], daily: Float[Array, " n"] | None
    ) -> Float[Array, "k n"]:
        """What a model leaves of some parts, over what it should leave.

        Args:
            model, parts: The model, and the parts.
            daily: Variance of each joint's friction between these parts and the model's, as a share
                of its square, where friction is the same in all runs; None where it is free within
                the share.

        Returns:
            Logarithms of the mean squares' ratios, by part and joint.
        """
        logs = np.zeros((int(parts.sum()), len(self.sums.places)))
        every = self.varied if daily is None else self.sums.alike
        for joint, (sums, (_, in_columns)) in enumerate(zip(every, self.sums.places, strict=True)):
            coefficients = in_columns[:-1]
            covariance = model.covariance[np.ix_(coefficients, coefficients)]
            root = np.linalg.cholesky(positive(covariance))
            friction = self._friction(joint, len(in_columns))
            combinations = np.stack([model.weights[in_columns], *friction])
            squares = np.array([_unexplained(over, combinations, root) for over in sums[parts]])
            expected = self.sums.rows[parts, joint]
            if daily is not None:
                of_friction = np.maximum(squares[:, 1:], 0.0).sum(axis=1)
                expected = expected + daily[joint] * of_friction
            of_residual = np.maximum(squares[:, 0], 1.0)
            logs[:, joint] = np.log(of_residual / np.maximum(expected, 1.0))
        return logs

    def _friction(self, joint: int, size: int) -> Float[Array, "2 k"]:
        """Weights of a joint's columns that make its viscous and its Coulomb torque."""
        tied = self.sums.design.sums.evidence.friction
        level = tied.level[joint]
        weights = np.zeros((len(level), size))
        weights[np.arange(len(level)), np.arange(size)[tied.columns]] = level
        return weights

    def left_out(
        self, parts: Bool[Array, " K"], daily: Float[Array, " n"] | None, free: bool = False
    ) -> Float[Array, "k n"]:
        """The same of each of some parts by the model of the others of them."""
        logs = []
        for index in np.flatnonzero(parts):
            alone = np.arange(len(parts)) == index
            model_of_others = self.solve(parts & ~alone, free)
            logs.append(self.left(model_of_others, alone, daily)[0])
        return np.array(logs)

    def permuted_rises(self, daily: Float[Array, " n"] | None) -> Float[Array, "h n"]:
        """By how much more a model of half of permuted parts leaves of the others than of its own.

        Args:
            daily: Variance of friction between halves, as in `left`.
        """
        rises = []
        for later in self.sums.design.permuted.permutations:
            half = np.isin(np.arange(len(self.sums.members)), later)
            for solved in (half, ~half):
                across = self.left(self.solve(solved), ~solved, daily)
                home = self.left_out(solved, daily)
                rises.append(across.mean(axis=0) - home.mean(axis=0))
        return np.array(rises)


def _unexplained(
    sums: Float[Array, "k k"], weights: Float[Array, "w k"], root: Float[Array, "q q"]
) -> Float[Array, " w"]:
    """Squares rᵀV⁻¹r of some combinations of a joint's columns.

    V = I + XΣXᵀ holds what coefficients are unsure of too.

    Args:
        sums, weights: Sums of the columns, the torque last, and weights of each combination r.
        root: L with Σ = LLᵀ, the covariance of the coefficients.
    """
    scores = sums @ weights.T
    turned = root.T @ scores[:-1]
    information = sums[:-1, :-1]
    inner = np.eye(len(root)) + root.T @ information @ root
    squares = (weights.T * scores).sum(axis=0)
    explained = (turned * factorise(inner).solve(turned)).sum(axis=0)
    return np.asarray(squares - explained)
