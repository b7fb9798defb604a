"""A small net for each joint, as plain arrays, SiLU inside.

The box of inputs that a joint's net was fitted in; beyond it the net says what it says at the edge.

A net knows nothing of where it never was: on a simulated arm whose runs left out went faster than the others, what it
made up there was four times the error that it was to take away.

A joint's net of one hidden layer whose units are drawn and whose outputs are solved for, not trained in steps.

    τ(x) = Σ a_h silu(w_h · x + b_h) + Σ c_i x_i + d

The w and b are drawn once; a, c and d are the ridge solution, so that folds that leave whole runs out cost only small
solves of sums by fold. What training would find, the shape of the units, is found by those folds: a scale of each
input (how fast the torque may change with it) and the ridge. That takes a fortieth of the time of gradient steps, and
torque on runs left out got no worse by it (four recordings, real and simulated: -8 to 0 %).

Source: Rahimi and Recht 2008 (random features); Huang, Zhu and Siew 2006 (drawn hidden units); Allen 1974 (PRESS).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ident.arrays import Array, Bool, Float, Int, freeze

# Rows that are reckoned at once: hidden units of more would not stay in the cache.
ROWS = 2048
# Speeds at which the direction features bend [rad/s]: the transition at a reversal, and the Stribeck zone.
DIRECTION_SCALES = (0.02, 0.15)
# Rounds the corner of |τ| so that gradients exist at zero [N m].
LOAD_ROUNDING = 0.5


def joint_features(dq: Float[Array, "*T"], ddq: Float[Array, "*T"], rigid: Float[Array, "*T"]) -> Float[Array, "*T 6"]:
    """Inputs of a joint's net: dq, ddq, tanh(dq / v₁), tanh(dq / v₂), its rigid torque τ, √(τ² + ε²) tanh(dq / v₁)."""
    near, far = (np.tanh(dq / scale) for scale in DIRECTION_SCALES)
    return np.stack([dq, ddq, near, far, rigid, np.hypot(rigid, LOAD_ROUNDING) * near], axis=-1)


@dataclass(frozen=True, eq=False)
class JointNets:
    """Perceptrons of one hidden layer, one for each joint.

    A joint sees its own features only. On real arms that carries over to new motions, while one net over the whole
    state learns the training paths by heart.
    """

    # One array a layer, shape (joints, in, out), and the biases, (joints, 1, out).
    weights: tuple[Float[Array, "n f w"], Float[Array, "n w 1"]] = field(repr=False)
    biases: tuple[Float[Array, "n 1 w"], Float[Array, "n 1 1"]] = field(repr=False)

    def __post_init__(self) -> None:
        for name in ("weights", "biases"):
            single = tuple(np.array(one, dtype=np.float32) for one in getattr(self, name))
            for one in single:
                one.setflags(write=False)
            object.__setattr__(self, name, single)

    @classmethod
    def from_arrays(cls, arrays: dict[str, Array], joints: int, inputs: int) -> JointNets:
        """Nets from named arrays, as `arrays` gives them.

        Raises:
            ValueError: One is missing, too many, or of another shape.
        """
        width = width_of(inputs)
        shapes = {"weights.0": (joints, inputs, width), "weights.1": (joints, width, 1)}
        shapes |= {"biases.0": (joints, 1, width), "biases.1": (joints, 1, 1)}
        if (found := {name: values.shape for name, values in arrays.items()}) != shapes:
            raise ValueError(f"its weights are {found}, not {shapes}")
        return cls((arrays["weights.0"], arrays["weights.1"]), (arrays["biases.0"], arrays["biases.1"]))

    def arrays(self) -> dict[str, Array]:
        """All weights by name."""
        named = {"weights": self.weights, "biases": self.biases}
        return {f"{kind}.{i}": values for kind, layers in named.items() for i, values in enumerate(layers)}

    @property
    def size(self) -> int:
        """Number of weights."""
        return sum(part.size for part in (*self.weights, *self.biases))

    def __call__(self, x: Float[Array, "T n f"]) -> Float[Array, "T n"]:
        """Outputs in single precision."""
        out = np.empty(x.shape[:2], dtype=np.float32)
        for start in range(0, len(x), ROWS):
            part = np.ascontiguousarray(x[start : start + ROWS].transpose(1, 0, 2), dtype=np.float32)
            hidden = silu(part @ self.weights[0] + self.biases[0])
            out[start : start + ROWS] = (hidden @ self.weights[1] + self.biases[1])[..., 0].T
        return out

    def scaled(self, shares: Sequence[float]) -> JointNets:
        """The same, of each joint's output a share."""
        factor = np.asarray(shares, dtype=np.float32)[:, None, None]
        (first, last), (bias, offset) = self.weights, self.biases
        return JointNets((first, factor * last), (bias, factor * offset))


def silu(z: Array) -> Array:
    """z / (1 + exp(-z)), without overflow."""
    return np.asarray(z / (1.0 + np.exp(-np.clip(z, -80.0, 80.0))))


# Share of the samples at either end that bound nothing: a smoother's overshoot is no place where the arm was.
TAILS = 0.001


@dataclass(frozen=True, eq=False)
class NetBounds:
    """Least and largest speed, acceleration and rigid torque of each joint that its net is given."""

    # Shape (3, n): dq [rad/s], ddq [rad/s²], rigid torque [N m].
    low: Float[Array, "3 n"]
    high: Float[Array, "3 n"]

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        if self.low.shape != self.high.shape or self.low.ndim != 2 or len(self.low) != 3:
            raise ValueError("the net's bounds are not three pairs a joint")
        if not np.all(self.low <= self.high):
            raise ValueError("a bound of the net is missing, or the lower one is above the upper")

    @classmethod
    def of(cls, inputs: Float[Array, "3 T n"], counts: Bool[Array, "T n"]) -> NetBounds:
        """Bounds of the samples that count; of a joint without any, of all."""
        low, high = np.empty((2, 3, inputs.shape[2]))
        for j in range(inputs.shape[2]):
            rows = counts[:, j] if counts[:, j].any() else slice(None)
            low[:, j], high[:, j] = np.quantile(inputs[:, rows, j], [TAILS, 1.0 - TAILS], axis=1)
        return cls(low, high)

    def clip(
        self, dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"]
    ) -> tuple[Float[Array, "T n"], Float[Array, "T n"], Float[Array, "T n"]]:
        """Speed, acceleration and rigid torque, moved to the nearest edge where they lie outside."""
        low, high = self.low, self.high
        return np.clip(dq, low[0], high[0]), np.clip(ddq, low[1], high[1]), np.clip(rigid, low[2], high[2])

    def of_joints(self, joints: slice) -> NetBounds:
        """The bounds of some joints."""
        return NetBounds(self.low[:, joints], self.high[:, joints])

    def to_dict(self) -> dict[str, Any]:
        """For the net's record."""
        return {"low": self.low.tolist(), "high": self.high.tolist()}

    @classmethod
    def from_dict(cls, record: dict[str, Any], n: int) -> NetBounds:
        """What `to_dict` wrote.

        Raises:
            KeyError, TypeError, ValueError: It is damaged, or not of n joints.
        """
        low, high = (np.array(record[name], dtype=float) for name in ("low", "high"))
        if low.shape != (3, n) or not (np.isfinite(low).all() and np.isfinite(high).all()):
            raise ValueError(f"the net's bounds are not three finite pairs for {n} joints")
        return cls(low, high)


# Units that are drawn for the net, and as many of the first of them as scales are searched with.
DRAWN, SEARCHED = 256, 64
# How far from the middle of the inputs units bend at most, in standard deviations of what they see at scales of one.
BIAS = 3.0
# Scale of each input before the search: friction is bent in direction and acceleration more than in speed and load.
FIRST_SCALES = (0.4, 2.0, 4.0, 4.0, 0.4, 0.8)
# What a scale is tried to be multiplied by, again while that helps, and by which share the error left out must fall.
TRIALS, LEAST_GAIN = (0.3, 2.0), 0.002
MOST_STEPS = 3
# The straight part is punished this much less than the units.
STRAIGHT = 30.0
# Ridges tried, as shares of the mean square of a column, and those tried for all units about the searched one's best.
RIDGES = np.geomspace(1e-6, 10.0, 8)
NEAR = np.geomspace(0.1, 100.0, 4)
# Fewer rows than this tell nothing of a joint.
FEWEST_ROWS = 8


def width_of(inputs: int) -> int:
    """Hidden units of a solved net: the drawn ones, and a pair for each input that passes it straight on."""
    return DRAWN + 2 * inputs


def solve_net(
    x: Float[Array, "T f"],
    y: Float[Array, " T"],
    counts: Bool[Array, " T"],
    fold: Int[Array, " T"],
    seed: int,
    strange: Float[Array, "T f"] | None = None,
) -> tuple[tuple[Array, Array], tuple[Array, Array], Float[Array, " T"], float]:
    """The net of one joint, and what it says of rows that it was not solved with.

    Args:
        x: Standardised inputs.
        y: Target, of mean square about one.
        counts: Rows that count.
        fold: Which part each row is left out with.
        seed: Of the units.
        strange: The inputs as a net takes them that has not seen their part; the same if None.

    Returns:
        Weights (inputs, width) and (width, 1); biases (width,) and (1,); prediction of every row by the net of the
        folds that it does not lie in, (T,); and mean square of what is left so, in units of the target's.
    """
    rng = np.random.default_rng(seed)
    drawn = rng.standard_normal((x.shape[1], DRAWN)) / np.sqrt(x.shape[1])
    bias = rng.uniform(-BIAS, BIAS, DRAWN)
    if counts.sum() < FEWEST_ROWS:
        solution = np.zeros(DRAWN + x.shape[1] + 1)
        return *_layers(drawn, bias, solution), np.zeros(len(x)), 1.0
    scales, ridge = _search(x[counts][::2], y[counts][::2], fold[counts][::2], drawn[:, :SEARCHED], bias[:SEARCHED])
    drawn = drawn * scales[:, None]
    rows = _rows(x, drawn, bias)
    sums = _Sums.of(rows[counts], y[counts], fold[counts])
    errors, parts = sums.leave_out(ridge * NEAR)
    best = int(np.argmin(errors))
    there = rows if strange is None else _rows(strange, drawn, bias)
    unseen = np.einsum(
        "tp,tp->t", there, parts[best][np.searchsorted(sums.labels, fold).clip(max=len(sums.labels) - 1)]
    )
    return *_layers(drawn, bias, sums.solve(ridge * NEAR[best])), unseen, float(errors[best])


def _search(x: Array, y: Array, fold: Array, drawn: Array, bias: Array) -> tuple[Float[Array, " f"], float]:
    """Scale of each input and ridge that leave least on rows left out; one pass over the inputs."""
    scales = np.resize(FIRST_SCALES, x.shape[1]).astype(float)

    def leave_out(trial: Array, ridges: Array) -> Float[Array, " l"]:
        return _Sums.of(_rows(x, drawn * trial[:, None], bias), y, fold).leave_out(ridges)[0]

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
                least, scales, tried = error, trial, tried + 1
            if tried:
                break
    return scales, float(RIDGES[int(np.argmin(leave_out(scales, RIDGES)))])


def _rows(x: Float[Array, "T f"], drawn: Float[Array, "f h"], bias: Float[Array, " h"]) -> Float[Array, "T p"]:
    """Columns of the linear problem: units, inputs, one. Units in single precision, as the net reckons."""
    units = x.astype(np.float32) @ drawn.astype(np.float32) + bias.astype(np.float32)
    return np.concatenate([silu(units), STRAIGHT * x, np.ones((len(x), 1))], axis=1)


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
        parts = [(rows[fold == label], y[fold == label]) for label in labels]
        gram, moment = np.array([a.T @ a for a, _ in parts]), np.array([a.T @ b for a, b in parts])
        return cls(gram, moment, np.array([b @ b for _, b in parts]), labels)

    def leave_out(self, ridges: Float[Array, " l"]) -> tuple[Float[Array, " l"], Float[Array, "l k p"]]:
        """Mean square left on each fold by the others' solution, in units of the target's; and the solutions."""
        gram, moment = self.gram.sum(axis=0) - self.gram, self.moment.sum(axis=0) - self.moment
        found = np.linalg.solve(gram + self._ridge(ridges)[:, None], moment[..., None])[..., 0]
        left = self.square - 2.0 * np.einsum("lkp,kp->lk", found, self.moment)
        left = left + np.einsum("lkp,kpq,lkq->lk", found, self.gram, found, optimize=True)
        return left.sum(axis=1) / max(self.square.sum(), 1e-300), found

    def solve(self, ridge: float) -> Float[Array, " p"]:
        """The solution of all folds."""
        return np.asarray(
            np.linalg.solve(self.gram.sum(axis=0) + self._ridge(np.array([ridge]))[0], self.moment.sum(0))
        )

    def _ridge(self, ridges: Float[Array, " l"]) -> Float[Array, "l p p"]:
        size = self.gram.shape[-1]
        scale = np.trace(self.gram.sum(axis=0)) / size**2
        return ridges[:, None, None] * scale * np.eye(size)


def _layers(drawn: Array, bias: Array, solution: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """The solution as the two layers of a net: an input is the difference of a unit of it and one of its opposite."""
    inputs, units = drawn.shape
    pairs = np.concatenate([np.eye(inputs), -np.eye(inputs)], axis=1)
    straight = STRAIGHT * solution[units : units + inputs]
    out = np.concatenate([solution[:units], straight, -straight])
    first = np.concatenate([drawn, pairs], axis=1)
    return (first, out[:, None]), (np.concatenate([bias, np.zeros(2 * inputs)]), solution[-1:])
