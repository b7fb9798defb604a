"""What a model leaves of the parts of recordings that it was not fitted to.

    min_x  Σ_j (xᵀ G_j x) / s_j² + prior   over all parts but one
    wᵀ G w,  w = (-x, 1)                   of that one

Source: Stone 1974.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.command_options import Inertia
from ident.fitting.held_out_sums import CONSTANT, FIRST_DIRECTION, ROTOR, VISCOUS, HeldOutSums
from ident.model.bodies import solve_bounded, solve_partly_non_negative
from ident.model.inertia import base_prior
from ident.robot.tolerance import parameter_scale

# A joint's losses among the unknowns; the last of them is dry friction.
LOSSES = 3


@dataclass(frozen=True, eq=False)
class Selection:
    """The columns of each joint's model."""

    width: Int[Array, " n"]  # place in the grid of widths
    offset: Bool[Array, " n"]  # whether the joint has an offset
    laws: tuple[int, ...] = ()  # numbers of laws among the sums'

    def of_joint(self, sums: HeldOutSums, joint: int) -> tuple[Int[Array, " c"], Bool[Array, " c"]]:
        """A joint's own columns (losses, offset, laws); which coefficients can't be negative."""
        rank = sums.base.rank
        turning = FIRST_DIRECTION + int(self.width[joint])
        columns = [rank + ROTOR, rank + VISCOUS, rank + turning]
        signed = [True] * LOSSES
        if self.offset[joint]:
            columns.append(rank + CONSTANT)
            signed.append(False)
        for number in self.laws:
            law = sums.laws[number]
            if law.joint == joint:
                columns += sums.law_columns(number).tolist()
                signed += [k in law.kind.nonnegative for k in range(law.size)]
        return np.array(columns), np.array(signed)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of all joints for a selection; where each joint's columns stand."""

    information: Float[Array, "m m"]
    score: Float[Array, " m"]
    square: float  # of the torque that they are to explain
    places: tuple[Int[Array, " c"], ...]  # of each joint's base and own columns among the unknowns
    columns: tuple[Int[Array, " c"], ...]  # the same among the joint's sums
    signed: Int[Array, " b"]  # unknowns that can't be negative

    def row_weights(
        self, sums: HeldOutSums, unknowns: Float[Array, " m"], joint: int
    ) -> Float[Array, " p"]:
        """What a model leaves of a joint's row is the row's product with these."""
        weights = np.zeros(sums.squares[joint].shape[1])
        weights[self.columns[joint]] = -unknowns[self.places[joint]]
        weights[-1] = 1.0
        return weights


def assemble(
    sums: HeldOutSums,
    selection: Selection,
    parts: Sequence[int] | Int[Array, " f"],
    noise: Float[Array, " n"],
) -> NormalEquations:
    """Normal equations over some parts, each joint's rows in units of its noise.

    Unknowns: base parameters, three losses a joint, offsets, laws in their order.
    """
    rank = sums.base.rank
    own_places, size = _places_of_own_columns(sums, selection)
    parts = np.asarray(parts)
    information = np.zeros((size, size))
    score = np.zeros(size)
    square = 0.0
    places = []
    columns = []
    signed: list[int] = []
    for j, own_place in enumerate(own_places):
        own_columns, bounded = selection.of_joint(sums, j)
        place = np.concatenate([np.arange(rank), own_place])
        column = np.concatenate([np.arange(rank), own_columns])
        gram = sums.squares[j][parts].sum(axis=0) / noise[j] ** 2
        of_joint = gram[column[:, None], column]
        information[place[:, None], place] += of_joint
        score[place] += gram[column, -1]
        square += float(gram[-1, -1])
        places.append(place)
        columns.append(column)
        signed += own_place[bounded].tolist()
    return NormalEquations(
        information, score, square, tuple(places), tuple(columns), np.array(signed, dtype=int)
    )


def _places_of_own_columns(
    sums: HeldOutSums, selection: Selection
) -> tuple[list[Int[Array, " c"]], int]:
    """Where each joint's losses, offset and laws stand among the unknowns; how many there are."""
    rank = sums.base.rank
    n = sums.nominal.n
    first_offset = rank + LOSSES * n
    places = []
    for j in range(n):
        first = rank + LOSSES * j
        places.append((first + np.arange(LOSSES)).tolist())
    for k, j in enumerate(np.flatnonzero(selection.offset).tolist()):
        places[j].append(first_offset + k)
    size = first_offset + int(selection.offset.sum())
    for number in selection.laws:
        law = sums.laws[number]
        places[law.joint] += range(size, size + law.size)
        size += law.size
    return [np.array(place, dtype=int) for place in places], size


def coulomb_of(sums: HeldOutSums, unknowns: Float[Array, " m"]) -> Float[Array, " n"]:
    """Dry friction of each joint among the unknowns [N m]."""
    first = sums.base.rank + LOSSES - 1
    return unknowns[first : first + LOSSES * sums.nominal.n : LOSSES]


def solve(
    sums: HeldOutSums, problem: NormalEquations, kind: Inertia, share: float, signed: bool = True
) -> Float[Array, " m"]:
    """The unknowns for one kind of inertias.

    Args:
        sums: Where the problem is from.
        problem: The normal equations.
        kind: How the links' inertias may change.
        share: How far the URDF's may be off, as a share of each link's scale.
        signed: Whether losses can't be negative.
    """
    bounded = problem.signed if signed else np.zeros(0, dtype=int)
    if kind == "nominal":
        return _solve_losses(problem, sums.base.rank, bounded)
    scale = share * parameter_scale(sums.nominal)
    if kind == "base":
        return _solve_base(sums, problem, bounded, scale)
    return _solve_bodies(sums, problem, bounded, scale)


def _solve_losses(
    problem: NormalEquations, rank: int, bounded: Int[Array, " b"]
) -> Float[Array, " m"]:
    """The unknowns with the URDF's inertias."""
    unknowns = np.zeros(len(problem.score))
    losses = np.arange(rank, len(unknowns))
    information = problem.information[np.ix_(losses, losses)]
    score = problem.score[losses]
    unknowns[rank:] = _least_squares(information, score, problem.square, bounded - rank)
    return unknowns


def _solve_base(
    sums: HeldOutSums,
    problem: NormalEquations,
    bounded: Int[Array, " b"],
    scale: Float[Array, " 10n"],
) -> Float[Array, " m"]:
    """The unknowns with base parameters as they come."""
    rank = sums.base.rank
    information = problem.information.copy()
    information[:rank, :rank] += base_prior(sums.base, scale)
    return _least_squares(information, problem.score, problem.square, bounded)


def _solve_bodies(
    sums: HeldOutSums,
    problem: NormalEquations,
    bounded: Int[Array, " b"],
    scale: Float[Array, " 10n"],
) -> Float[Array, " m"]:
    """The unknowns with links that could exist; their changes are solved for in units of scale."""
    rank = sums.base.rank
    numbers = len(scale)
    losses = len(problem.score) - rank
    lift = np.zeros((rank + losses, numbers + losses))
    lift[:rank, :numbers] = sums.base.mapping * scale
    lift[rank:, numbers:] = np.eye(losses)
    information = lift.T @ problem.information @ lift
    information[:numbers, :numbers] += np.eye(numbers)
    links = sums.nominal.inertial_parameters
    bounded = bounded - rank + numbers
    return lift @ solve_bounded(information, lift.T @ problem.score, bounded, links, scale)


def _least_squares(
    information: Float[Array, "m m"],
    score: Float[Array, " m"],
    square: float,
    bounded: Int[Array, " b"],
) -> Float[Array, " m"]:
    size = len(score)
    sums = np.zeros((size + 1, size + 1))
    sums[:size, :size] = information
    sums[:size, -1] = score
    sums[-1, :size] = score
    sums[-1, -1] = square
    return solve_partly_non_negative(sums, bounded)


@dataclass(frozen=True, eq=False)
class Errors:
    """What a model leaves of each part that it was not fitted to."""

    squares: Float[Array, "f n"]  # sum of squares where each joint moves [N² m²]
    clear: Float[Array, "f n"]  # the share of these in rows clear of starts, stops and reversals
    work: Float[Array, "f n"]  # work that it errs by [J]
    counts: Float[Array, "f n"]

    @property
    def rmse(self) -> Float[Array, " n"]:
        """Torque error of each joint over all parts [N m]."""
        counts = np.maximum(self.counts.sum(axis=0), 1.0)
        return np.sqrt(self.squares.sum(axis=0) / counts)

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
    """What a model of all other parts leaves of each part, and the unknowns of those models.

    Args:
        sums: Sums of every part.
        selection: Which columns the model has.
        noise: Of each joint [N m].
        kind: Of inertias.
        share: How far the URDF's inertias may be off, as a share of each link's scale.
    """
    n = sums.nominal.n
    parts = np.arange(sums.parts)
    squares = np.zeros((sums.parts, n))
    clear = np.zeros((sums.parts, n))
    work = np.zeros((sums.parts, n))
    solutions = []
    for number in parts:
        problem = assemble(sums, selection, parts[parts != number], noise)
        unknowns = solve(sums, problem, kind, share)
        solutions.append(unknowns)
        for j in range(n):
            weights = problem.row_weights(sums, unknowns, j)
            squares[number, j] = weights @ sums.squares[j][number] @ weights
            clear[number, j] = weights @ sums.clear[j][number] @ weights
            work[number, j] = weights @ sums.work[j][number]
    errors = Errors(np.maximum(squares, 0.0), np.maximum(clear, 0.0), work, sums.counts)
    return errors, solutions


@dataclass(frozen=True, eq=False)
class OwnErrors:
    """What a joint's model leaves of each part."""

    squares: Float[Array, " f"]  # sum of squares where it moves [N² m²]
    work: Float[Array, " f"]  # work that it errs by [J]


@dataclass(frozen=True, eq=False)
class OwnColumns:
    """A joint's own columns beside the base parameters that all other parts gave, part by part."""

    gram: Float[Array, "f q q"]  # of own columns and, last, the torque left; over each part
    rest: Float[Array, "f q q"]  # over all other parts
    # The same two over rows clear of starts, stops and reversals alone.
    clear: Float[Array, "f q q"]
    clear_rest: Float[Array, "f q q"]
    work: Float[Array, "f q"]

    @classmethod
    def of(cls, sums: HeldOutSums, joint: int, changes: Sequence[Float[Array, " r"]]) -> OwnColumns:
        """Takes the base parameters of each part's model off the torque.

        Args:
            sums: The sums.
            joint: The joint.
            changes: Change of the base parameters as all parts but each in turn have it.
        """
        rank = sums.base.rank
        size = sums.squares[joint].shape[1]
        total = sums.squares[joint].sum(axis=0)
        clear_total = sums.clear[joint].sum(axis=0)
        grams = []
        rest = []
        clear = []
        clear_rest = []
        work = []
        for number, change in enumerate(changes):
            lift = np.zeros((size, size - rank))
            lift[rank:] = np.eye(size - rank)
            lift[:rank, -1] = -change
            gram = lift.T @ sums.squares[joint][number] @ lift
            grams.append(gram)
            rest.append(lift.T @ total @ lift - gram)
            clear_gram = lift.T @ sums.clear[joint][number] @ lift
            clear.append(clear_gram)
            clear_rest.append(lift.T @ clear_total @ lift - clear_gram)
            work.append(lift.T @ sums.work[joint][number])
        return cls(
            gram=np.array(grams),
            rest=np.array(rest),
            clear=np.array(clear),
            clear_rest=np.array(clear_rest),
            work=np.array(work),
        )

    def errors(self, columns: Int[Array, " c"], signed: Bool[Array, " c"]) -> OwnErrors:
        """What some of the columns, fitted to the other parts, leave of each part."""
        squares = np.zeros(len(self.gram))
        work = np.zeros(len(self.gram))
        for number, rest in enumerate(self.rest):
            weights = _row_weights(rest, columns, signed)
            squares[number] = weights @ self.gram[number] @ weights
            work[number] = weights @ self.work[number]
        return OwnErrors(squares, work)

    def clear_squares(
        self, columns: Int[Array, " c"], signed: Bool[Array, " c"]
    ) -> Float[Array, " f"]:
        """Squares left of each part's clear rows by some of the columns, fitted to the others'."""
        squares = np.zeros(len(self.clear))
        for number, rest in enumerate(self.clear_rest):
            weights = _row_weights(rest, columns, signed)
            squares[number] = weights @ self.clear[number] @ weights
        return squares


def _row_weights(
    gram: Float[Array, "q q"], columns: Int[Array, " c"], signed: Bool[Array, " c"]
) -> Float[Array, " q"]:
    """What columns fitted to some rows leave of a row is the row's product with these."""
    index = np.append(columns, -1)
    within = gram[index[:, None], index]
    bounded = np.flatnonzero(signed)
    coefficients = solve_partly_non_negative(within, bounded)
    weights = np.zeros(len(gram))
    weights[columns] = -coefficients
    weights[-1] = 1.0
    return weights
