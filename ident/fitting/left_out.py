"""What a model leaves of the parts of recordings that it was not fitted to.

    min_x  Σ_j (xᵀ G_j x) / s_j² + prior   over all parts but one;   wᵀ G w, w = (-x, 1), of that one

Beside it what the parts say of a change: whether it helps, and whether it makes the work worse.

Source: Stone 1974; Student 1908 (the test over parts).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from ident.arrays import Array, Bool, Float, Int
from ident.command_options import Inertia
from ident.fitting.held_out_sums import (
    CONSTANT,
    FIRST_DIRECTION,
    ROTOR,
    VISCOUS,
    HeldOutSums,
)
from ident.model.inertia import (
    base_prior,
    parameter_scale,
    solve_bounded,
    solve_partly_non_negative,
)

# How sure it must be over the parts that a law helps, by Student's test.
SURE = 0.975
LOSSES = 3


@dataclass(frozen=True, eq=False)
class Selection:
    """The columns of each joint's model."""

    width: Int[Array, " n"]  # place in the grid of widths
    offset: Bool[Array, " n"]  # whether the joint has an offset
    laws: tuple[int, ...] = ()  # numbers of laws among the sums'

    def of_joint(self, sums: HeldOutSums, joint: int) -> tuple[Int[Array, " c"], Bool[Array, " c"]]:
        """A joint's own columns (losses, offset, laws) and which of their coefficients can't be negative."""
        rank = sums.base.rank
        own = [rank + ROTOR, rank + VISCOUS, rank + FIRST_DIRECTION + int(self.width[joint])]
        signed = [True] * LOSSES
        if self.offset[joint]:
            own.append(rank + CONSTANT)
            signed.append(False)
        for number in self.laws:
            law = sums.laws[number]
            if law.joint == joint:
                own += sums.law_columns(number).tolist()
                signed += [k in law.kind.nonnegative for k in range(law.size)]
        return np.array(own), np.array(signed)


@dataclass(frozen=True, eq=False)
class Problem:
    """Normal equations of all joints for a selection, and where each joint's columns stand in them."""

    information: Float[Array, "m m"]
    score: Float[Array, " m"]
    places: tuple[Int[Array, " c"], ...]  # of each joint's base and own columns among the unknowns
    columns: tuple[Int[Array, " c"], ...]  # the same among the joint's sums
    signed: Int[Array, " b"]  # unknowns that can't be negative


def assemble(
    sums: HeldOutSums, selection: Selection, kept: Sequence[int] | Int[Array, " f"], noise: Float[Array, " n"]
) -> Problem:
    """Normal equations over some parts, each joint's rows in units of its noise.

    Unknowns: base parameters, three losses a joint, offsets, laws in their order.
    """
    rank, n = sums.base.rank, sums.nominal.n
    offsets = np.cumsum(selection.offset) - 1
    first_law = rank + LOSSES * n + int(selection.offset.sum())
    law_place, start = {}, first_law
    for number in selection.laws:
        law_place[number] = start + np.arange(sums.laws[number].size)
        start += sums.laws[number].size
    information, score = np.zeros((start, start)), np.zeros(start)
    places, columns, signed = [], [], []
    for j in range(n):
        own, bounded = selection.of_joint(sums, j)
        at = [*(rank + LOSSES * j + np.arange(LOSSES))]
        if selection.offset[j]:
            at.append(rank + LOSSES * n + offsets[j])
        for number in selection.laws:
            if sums.laws[number].joint == j:
                at += law_place[number].tolist()
        place = np.concatenate([np.arange(rank), np.array(at, dtype=int)])
        column = np.concatenate([np.arange(rank), own])
        gram = sums.squares[j][list(kept)].sum(axis=0) / noise[j] ** 2
        information[np.ix_(place, place)] += gram[np.ix_(column, column)]
        score[place] += gram[column, -1]
        places.append(place)
        columns.append(column)
        signed += place[rank:][bounded].tolist()
    return Problem(information, score, tuple(places), tuple(columns), np.array(signed, dtype=int))


def solve(sums: HeldOutSums, problem: Problem, kind: Inertia, share: float, signed: bool = True) -> Float[Array, " m"]:
    """The unknowns for one kind of inertias.

    Args:
        sums: Where the problem is from.
        problem: The normal equations.
        kind: How the links' inertias may change.
        share: How far the URDF's may be off, as a share of each link's scale.
        signed: Whether losses can't be negative.
    """
    rank, nominal = sums.base.rank, sums.nominal
    bounded = problem.signed if signed else np.zeros(0, dtype=int)
    if kind == "nominal":
        found = np.zeros(len(problem.score))
        own = np.arange(rank, len(problem.score))
        found[rank:] = _least_squares(problem.information[np.ix_(own, own)], problem.score[own], bounded - rank)
        return found
    scale = share * parameter_scale(nominal)
    if kind == "base":
        information = problem.information.copy()
        information[:rank, :rank] += base_prior(sums.base, scale)
        return _least_squares(information, problem.score, bounded)
    numbers, size = len(scale), len(problem.score)
    lift = np.zeros((size, numbers + size - rank))
    lift[:rank, :numbers] = sums.base.mapping * scale
    lift[rank:, numbers:] = np.eye(size - rank)
    information = lift.T @ problem.information @ lift
    information[:numbers, :numbers] += np.eye(numbers)
    links = nominal.inertial_parameters
    return lift @ solve_bounded(information, lift.T @ problem.score, bounded - rank + numbers, links, scale)


def _least_squares(
    information: Float[Array, "m m"], score: Float[Array, " m"], bounded: Int[Array, " b"]
) -> Float[Array, " m"]:
    size = len(score)
    sums = np.zeros((size + 1, size + 1))
    sums[:size, :size] = information
    sums[:size, -1] = sums[-1, :size] = score
    # The torque's own square: any number that leaves the sums positive.
    root = np.linalg.lstsq(information, score, rcond=None)[0]
    sums[-1, -1] = 1.0 + abs(float(root @ score))
    return solve_partly_non_negative(sums, bounded)


@dataclass(frozen=True, eq=False)
class Errors:
    """What a model leaves of each part that it was not fitted to."""

    squares: Float[Array, "f n"]  # sum of squares where each joint moves [N² m²]
    work: Float[Array, "f n"]  # work that it errs by [J]
    counts: Float[Array, "f n"]

    @property
    def rmse(self) -> Float[Array, " n"]:
        """Torque error of each joint over all parts [N m]."""
        return np.sqrt(self.squares.sum(axis=0) / np.maximum(self.counts.sum(axis=0), 1.0))

    @property
    def total(self) -> float:
        """Torque error over all joints alike [N m]."""
        return float(np.sqrt(np.mean(self.rmse**2)))

    @property
    def energy(self) -> float:
        """Root mean square over the parts of the work of all joints that it errs by [J]."""
        return float(np.sqrt(np.mean(self.work.sum(axis=1) ** 2)))


def left_out(
    sums: HeldOutSums,
    selection: Selection,
    noise: Float[Array, " n"],
    kind: Inertia,
    share: float,
) -> tuple[Errors, list[Float[Array, " m"]]]:
    """What a model of all other parts leaves of each part, and those models."""
    n, parts = sums.nominal.n, np.arange(sums.parts)
    squares, work, found = np.zeros((sums.parts, n)), np.zeros((sums.parts, n)), []
    for part in parts:
        problem = assemble(sums, selection, parts[parts != part], noise)
        unknowns = solve(sums, problem, kind, share)
        found.append(unknowns)
        for j in range(n):
            weights = _row_weights(sums, problem, unknowns, j)
            squares[part, j] = weights @ sums.squares[j][part] @ weights
            work[part, j] = weights @ sums.work[j][part]
    return Errors(np.maximum(squares, 0.0), work, sums.counts), found


def _row_weights(sums: HeldOutSums, problem: Problem, unknowns: Float[Array, " m"], joint: int) -> Float[Array, " p"]:
    """What a model leaves of a joint's row is the row's product with these."""
    weights = np.zeros(sums.squares[joint].shape[1])
    weights[problem.columns[joint]] = -unknowns[problem.places[joint]]
    weights[-1] = 1.0
    return weights


def surely_less(before: Float[Array, " f"], after: Float[Array, " f"]) -> bool:
    """Whether sums over parts fall by more than one standard error of their fall."""
    fall = before - after
    if len(fall) < 2:
        return bool(fall.sum() > 0.0)
    return bool(fall.mean() > fall.std(ddof=1) / np.sqrt(len(fall)))


def helps(before: Float[Array, " f"], after: Float[Array, " f"]) -> bool:
    """Whether sums over parts fall, by Student's test over the parts."""
    fall = before - after
    if len(fall) < 2:
        return False
    needed = float(stdtrit(len(fall) - 1, SURE))
    return bool(fall.mean() > needed * fall.std(ddof=1) / np.sqrt(len(fall)))


def no_worse_work(before: Float[Array, " f"], after: Float[Array, " f"]) -> bool:
    """Whether the squares of work errors grow by no more than one standard error of their growth."""
    growth = after**2 - before**2
    if len(growth) < 2:
        return bool(growth.sum() <= 0.0)
    return bool(growth.mean() <= growth.std(ddof=1) / np.sqrt(len(growth)))


@dataclass(frozen=True, eq=False)
class OwnColumns:
    """A joint's own columns after the base parameters that all other parts found, part by part."""

    gram: Float[Array, "f q q"]  # of own columns and, last, the torque left; over each part
    rest: Float[Array, "f q q"]  # over all other parts
    work: Float[Array, "f q"]

    @classmethod
    def of(cls, sums: HeldOutSums, joint: int, changes: Sequence[Float[Array, " r"]]) -> OwnColumns:
        """Takes the base parameters of each part's model off the torque.

        Args:
            sums: The sums.
            joint: The joint.
            changes: Change of the base parameters as all parts but each in turn have it.
        """
        rank, size = sums.base.rank, sums.squares[joint].shape[1]
        total = sums.squares[joint].sum(axis=0)
        gram, rest, work = [], [], []
        for part, change in enumerate(changes):
            lift = np.zeros((size, size - rank))
            lift[rank:] = np.eye(size - rank)
            lift[:rank, -1] = -change
            own = lift.T @ sums.squares[joint][part] @ lift
            gram.append(own)
            rest.append(lift.T @ total @ lift - own)
            work.append(lift.T @ sums.work[joint][part])
        return cls(np.array(gram), np.array(rest), np.array(work))

    def errors(self, columns: Int[Array, " c"], signed: Bool[Array, " c"]) -> tuple[Array, Array]:
        """Squares and work left of each part by some of the columns, fitted to the others."""
        squares, work = np.zeros(len(self.gram)), np.zeros(len(self.gram))
        bounded = np.flatnonzero(signed)
        for part, rest in enumerate(self.rest):
            index = np.append(columns, -1)
            found = solve_partly_non_negative(rest[np.ix_(index, index)], bounded)
            weights = np.zeros(rest.shape[0])
            weights[columns] = -found
            weights[-1] = 1.0
            squares[part] = weights @ self.gram[part] @ weights
            work[part] = weights @ self.work[part]
        return squares, work
