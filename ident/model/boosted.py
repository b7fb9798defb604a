"""Boosted trees of one question a level: what a torque does that no law and no smooth net tells.

Each tree asks the same few questions "is input f above t?" of every sample; the answers are the
number of its leaf. A tree is fitted to what the ones before it leave, and counts by a share of
itself. Outside of what they have seen trees say what they say at the edge, so that they never make
up a torque that was not there. Rows and inputs of every tree are drawn, which makes them fast and
unlike one another.

Source: Friedman 2001 and 2002 (stochastic gradient boosting); Kohavi 1994 (oblivious trees);
Prokhorenkova et al. 2018.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, Int
from ident.compiled import compiled

# Trees of a joint, and questions of each.
TREES = 100
DEPTH = 5
# Share by which a tree counts, and rows that a leaf is shrunk by.
RATE = 0.2
SHRINKAGE = 20.0
# Bins of an input.
BINS = 32
# Shares of rows and of inputs that a tree is drawn.
ROW_SHARE = 0.5
INPUT_SHARE = 0.6
# Share of an input's range below which values differ by rounding alone: half of a number's digits.
ROUNDING = float(np.sqrt(np.finfo(float).eps))


@dataclass(frozen=True, eq=False)
class Trees:
    """Trees of one joint."""

    inputs: Int[Array, "t d"]  # number of the input that each question is about
    thresholds: Float[Array, "t d"]  # what it is to be above
    # Torque of each leaf, in which the answers are the digits of its number [N m].
    leaves: Float[Array, "t l"]

    def __call__(self, x: Float[Array, "T f"]) -> Float[Array, " T"]:
        """Torque [N m]."""
        out = np.zeros(len(x))
        rows = np.ascontiguousarray(x, dtype=float)
        _evaluate(rows, self.inputs, self.thresholds, self.leaves, out)
        return out

    def scaled(self, share: float) -> Trees:
        """The same, of its torque a share."""
        return Trees(self.inputs, self.thresholds, share * self.leaves)

    def padded(self, count: int) -> Trees:
        """The same, with trees that say nothing up to a number of them."""
        further = ((0, count - len(self.inputs)), (0, 0))
        return Trees(
            np.pad(self.inputs, further),
            np.pad(self.thresholds, further),
            np.pad(self.leaves, further),
        )


def join_trees(first: Trees, second: Trees) -> Trees:
    """Trees of both, whose torques add up; their inputs are numbered alike."""
    return Trees(
        np.concatenate([first.inputs, second.inputs]),
        np.concatenate([first.thresholds, second.thresholds]),
        np.concatenate([first.leaves, second.leaves]),
    )


def fit_trees(x: Float[Array, "T f"], y: Float[Array, " T"], seed: int) -> Trees:
    """Trees for a target.

    Args:
        x: Inputs.
        y: Target [N m].
        seed: Of what each tree is drawn.
    """
    edges = np.array([place_edges(column) for column in x.T])
    binned = np.empty(x.shape[::-1], dtype=np.uint8)
    for f in range(x.shape[1]):
        binned[f] = np.searchsorted(edges[f], x[:, f], side="left")
    rng = np.random.default_rng(seed)
    rows = max(1, int(ROW_SHARE * len(y)))
    drawn = max(1, round(INPUT_SHARE * x.shape[1]))
    inputs = np.zeros((TREES, DEPTH), dtype=np.int64)
    thresholds = np.zeros((TREES, DEPTH))
    leaves = np.zeros((TREES, 1 << DEPTH))
    left = np.array(y, dtype=float)
    for tree in range(TREES):
        sample = np.sort(rng.choice(len(y), rows, replace=False))
        among = np.sort(rng.choice(x.shape[1], drawn, replace=False))
        places = _grow(
            binned, left, sample, among, BINS, inputs[tree], leaves[tree], RATE, SHRINKAGE
        )
        thresholds[tree] = edges[inputs[tree], places]
    return Trees(inputs, thresholds, leaves)


def place_edges(values: Float[Array, " T"]) -> Float[Array, " e"]:
    """Thresholds of one input: quantiles, each moved to the middle of the next gap of its values.

    A threshold on a value, such as the end of a stop's range or of a tanh, leaves the answer to the
    last bit, and another runtime's last bit is another one. Values that differ by rounding alone
    have no gap.

    Args:
        values: The input's values.
    """
    ordered = np.sort(values)
    steps = np.diff(ordered)
    above = ordered[1:][steps > ROUNDING * (ordered[-1] - ordered[0])]
    if not len(above):
        return np.full(BINS - 1, ordered[-1])
    below = ordered[np.searchsorted(ordered, above) - 1]
    middles = 0.5 * (below + above)
    quantiles = np.quantile(ordered, np.arange(1, BINS) / BINS)
    gaps = np.searchsorted(above, quantiles, side="right")
    return np.asarray(middles[np.minimum(gaps, len(middles) - 1)])


@compiled(error_model="numpy", nogil=True)
def _evaluate(x: Array, inputs: Array, thresholds: Array, leaves: Array, out: Array) -> None:
    """Adds the torque of all trees."""
    for t in range(x.shape[0]):
        total = 0.0
        for k in range(inputs.shape[0]):
            leaf = 0
            for d in range(inputs.shape[1]):
                leaf = 2 * leaf + (1 if x[t, inputs[k, d]] > thresholds[k, d] else 0)
            total += leaves[k, leaf]
        out[t] += total


@compiled(error_model="numpy", nogil=True)
def _fill(table: Array, row: Array, sample: Array, leaf: Array, target: Array) -> None:
    """Sum and number of a sample's targets by leaf and bin of one input."""
    table[:] = 0.0
    for i in range(len(sample)):
        cell = table[leaf[i], row[sample[i]]]
        cell[0] += target[i]
        cell[1] += 1.0


@compiled(error_model="numpy", nogil=True)
def _weigh(table: Array, gain: Array, shrinkage: float) -> None:
    """What each threshold of one input would explain, over all leaves."""
    gain[:] = 0.0
    for a in range(table.shape[0]):
        all_sum = 0.0
        all_rows = 0.0
        for b in range(table.shape[1]):
            all_sum += table[a, b, 0]
            all_rows += table[a, b, 1]
        low_sum = 0.0
        low_rows = 0.0
        for b in range(table.shape[1] - 1):
            low_sum += table[a, b, 0]
            low_rows += table[a, b, 1]
            high_sum = all_sum - low_sum
            high_rows = all_rows - low_rows
            low = low_sum**2 / (low_rows + shrinkage)
            gain[b] += low + high_sum**2 / (high_rows + shrinkage)


@compiled(error_model="numpy", nogil=True)
def _grow(
    binned: Array,
    left: Array,
    sample: Array,
    among: Array,
    bins: int,
    inputs: Array,
    leaves: Array,
    rate: float,
    shrinkage: float,
) -> Array:
    """Grows one tree on a sample of rows, and takes its torque off all rows.

    Returns:
        Places of its thresholds among the edges.
    """
    depth = inputs.shape[0]
    drawn = len(sample)
    places = np.zeros(depth, dtype=np.int64)
    leaf = np.zeros(drawn, dtype=np.int64)
    target = left[sample]
    table = np.zeros((1 << depth, bins, 2))
    gain = np.zeros(bins)
    for d in range(depth):
        best = -1.0
        for f in among:
            _fill(table[: 1 << d], binned[f], sample, leaf, target)
            _weigh(table[: 1 << d], gain, shrinkage)
            for b in range(bins - 1):
                if gain[b] > best:
                    best = gain[b]
                    inputs[d] = f
                    places[d] = b
        answers = binned[inputs[d]]
        for i in range(drawn):
            leaf[i] = 2 * leaf[i] + (1 if answers[sample[i]] > places[d] else 0)
    sums = np.zeros((1 << depth, 2))
    for i in range(drawn):
        sums[leaf[i], 0] += target[i]
        sums[leaf[i], 1] += 1.0
    for a in range(1 << depth):
        leaves[a] = rate * sums[a, 0] / (sums[a, 1] + shrinkage)
    number = np.zeros(len(left), dtype=np.int64)
    for d in range(depth):
        answers = binned[inputs[d]]
        for t in range(len(left)):
            number[t] = 2 * number[t] + (1 if answers[t] > places[d] else 0)
    for t in range(len(left)):
        left[t] -= leaves[number[t]]
    return places
