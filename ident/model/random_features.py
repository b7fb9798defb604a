"""A net of one hidden layer whose units are drawn and whose outputs are solved for.

    τ(x) = Σ a_h silu(w_h · x + b_h) + Σ c_i x_i + d

The w and b are drawn once; a, c and d are the ridge solution, so that folds that leave whole runs
out cost only small solves of sums by fold. What training would find, the shape of the units, is
found by those folds: a scale of each input (how fast the torque may change with it) and the ridge.
That takes a fortieth of the time of gradient steps, and torque on runs left out got no worse by it
(four recordings, real and simulated: -8 to 0 %).

Source: Rahimi and Recht 2008 (random features); Huang, Zhu and Siew 2006 (drawn hidden units);
Allen 1974 (PRESS).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.model.joint_nets import DRAWN, silu

# Units that scales are searched with: the first of those that are drawn for the net.
SEARCHED = 64
# How far from the middle of the inputs units bend at most, in standard deviations of what they see
# at scales of one.
BIAS = 3.0
# Scale of each input before the search: friction is bent in direction and acceleration more than in
# speed and load.
FIRST_SCALES = (0.4, 2.0, 4.0, 4.0, 0.4, 0.8)
# What a scale is tried to be multiplied by, again while that helps.
TRIALS = (0.3, 2.0)
# By which share the error left out must fall.
LEAST_GAIN = 0.002
MOST_STEPS = 3
# The straight part is punished this much less than the units.
STRAIGHT = 30.0
# Ridges tried, as shares of the mean square of a column.
RIDGES = np.geomspace(1e-6, 10.0, 8)
# Those tried for all units, about the best one of the searched units.
NEAR = np.geomspace(0.1, 100.0, 4)
# Fewer rows than this tell nothing of a joint.
FEWEST_ROWS = 8


@dataclass(frozen=True, eq=False)
class SolvedNet:
    """The net of one joint, and what it says of rows that it was not solved with."""

    weights: tuple[Float[Array, "f w"], Float[Array, "w 1"]]  # of the two layers
    biases: tuple[Float[Array, " w"], Float[Array, " 1"]]
    unseen: Float[Array, " T"]  # of every row, by the net of the folds that it does not lie in
    error: float  # mean square of what is left so, in units of the target's


def solve_net(
    x: Float[Array, "T f"],
    y: Float[Array, " T"],
    counts: Bool[Array, " T"],
    fold: Int[Array, " T"],
    seed: int,
    strange: Float[Array, "T f"] | None = None,
) -> SolvedNet:
    """The net of one joint.

    Args:
        x: Standardised inputs.
        y: Target, of mean square about one.
        counts: Rows that count.
        fold: Which part each row is left out with.
        seed: Of the units.
        strange: The inputs as a net takes them that has not seen their part; the same if None.
    """
    rng = np.random.default_rng(seed)
    inputs = x.shape[1]
    drawn = rng.standard_normal((inputs, DRAWN)) / np.sqrt(inputs)
    bias = rng.uniform(-BIAS, BIAS, DRAWN)
    if counts.sum() < FEWEST_ROWS:
        nothing = np.zeros(DRAWN + inputs + 1)
        weights, biases = _layers(drawn, bias, nothing)
        return SolvedNet(weights, biases, np.zeros(len(x)), 1.0)
    half = np.flatnonzero(counts)[::2]
    scales, ridge = _search(x[half], y[half], fold[half], drawn[:, :SEARCHED], bias[:SEARCHED])
    drawn = drawn * scales[:, None]
    rows = _rows(x, drawn, bias)
    sums = _Sums.of(rows[counts], y[counts], fold[counts])
    errors, solutions = sums.leave_out(ridge * NEAR)
    best = int(np.argmin(errors))
    strange_rows = rows if strange is None else _rows(strange, drawn, bias)
    place_of_fold = np.searchsorted(sums.labels, fold).clip(max=len(sums.labels) - 1)
    unseen = np.einsum("tp,tp->t", strange_rows, solutions[best][place_of_fold])
    weights, biases = _layers(drawn, bias, sums.solve(ridge * NEAR[best]))
    return SolvedNet(weights, biases, unseen, float(errors[best]))


def _search(
    x: Float[Array, "T f"],
    y: Float[Array, " T"],
    fold: Int[Array, " T"],
    drawn: Float[Array, "f h"],
    bias: Float[Array, " h"],
) -> tuple[Float[Array, " f"], float]:
    """Scale of each input and ridge that leave least on rows left out; one pass over the inputs."""
    scales = np.resize(FIRST_SCALES, x.shape[1]).astype(float)

    def leave_out(trial: Array, ridges: Array) -> Float[Array, " l"]:
        rows = _rows(x, drawn * trial[:, None], bias)
        errors, *_ = _Sums.of(rows, y, fold).leave_out(ridges)
        return errors

    errors = leave_out(scales, RIDGES)
    best = int(np.argmin(errors))
    least = errors[best]
    for i in range(len(scales)):
        for factor in TRIALS:
            tried = 0
            while tried < MOST_STEPS:
                trial = scales.copy()
                trial[i] *= factor
                error = leave_out(trial, RIDGES[best : best + 1])[0]
                if error >= (1.0 - LEAST_GAIN) * least:
                    break
                least = error
                scales = trial
                tried += 1
            if tried:
                break
    return scales, float(RIDGES[int(np.argmin(leave_out(scales, RIDGES)))])


def _rows(
    x: Float[Array, "T f"], drawn: Float[Array, "f h"], bias: Float[Array, " h"]
) -> Float[Array, "T p"]:
    """Columns of the linear problem: units, inputs, one; units in single precision, as in a net."""
    single = np.float32
    units = x.astype(single) @ drawn.astype(single) + bias.astype(single)
    constant = np.ones((len(x), 1))
    return np.concatenate([silu(units), STRAIGHT * x, constant], axis=1)


@dataclass(frozen=True, eq=False)
class _Sums:
    """Sums of a linear problem by fold: XᵀX, Xᵀy and yᵀy, and the folds' labels."""

    gram: Float[Array, "k p p"]
    moment: Float[Array, "k p"]
    square: Float[Array, " k"]
    labels: Int[Array, " k"]

    @classmethod
    def of(cls, rows: Float[Array, "T p"], y: Float[Array, " T"], fold: Int[Array, " T"]) -> _Sums:
        labels = np.unique(fold)
        grams = []
        moments = []
        squares = []
        for label in labels:
            inside = fold == label
            x_inside = rows[inside]
            y_inside = y[inside]
            grams.append(x_inside.T @ x_inside)
            moments.append(x_inside.T @ y_inside)
            squares.append(y_inside @ y_inside)
        return cls(np.array(grams), np.array(moments), np.array(squares), labels)

    def leave_out(
        self, ridges: Float[Array, " l"]
    ) -> tuple[Float[Array, " l"], Float[Array, "l k p"]]:
        """Mean square left on each fold by the others' solution, and the solutions.

        The first in units of the target's.
        """
        gram = self.gram.sum(axis=0) - self.gram
        moment = self.moment.sum(axis=0) - self.moment
        ridged = gram + self._ridge(ridges)[:, None]
        solutions = np.linalg.solve(ridged, moment[..., None])[..., 0]
        left = self.square - 2.0 * np.einsum("lkp,kp->lk", solutions, self.moment)
        left = left + np.einsum("lkp,kpq,lkq->lk", solutions, self.gram, solutions, optimize=True)
        return left.sum(axis=1) / max(self.square.sum(), 1e-300), solutions

    def solve(self, ridge: float) -> Float[Array, " p"]:
        """The solution of all folds."""
        gram = self.gram.sum(axis=0) + self._ridge(np.array([ridge]))[0]
        return np.asarray(np.linalg.solve(gram, self.moment.sum(axis=0)))

    def _ridge(self, ridges: Float[Array, " l"]) -> Float[Array, "l p p"]:
        size = self.gram.shape[-1]
        scale = np.trace(self.gram.sum(axis=0)) / size**2
        return ridges[:, None, None] * scale * np.eye(size)


def _layers(
    drawn: Float[Array, "f h"], bias: Float[Array, " h"], solution: Float[Array, " p"]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """The solution as weights and biases of a net's two layers.

    An input is the difference of a unit of it and one of its opposite.
    """
    inputs, units = drawn.shape
    pairs = np.concatenate([np.eye(inputs), -np.eye(inputs)], axis=1)
    straight = STRAIGHT * solution[units : units + inputs]
    out = np.concatenate([solution[:units], straight, -straight])
    first = np.concatenate([drawn, pairs], axis=1)
    first_bias = np.concatenate([bias, np.zeros(2 * inputs)])
    return (first, out[:, None]), (first_bias, solution[-1:])
