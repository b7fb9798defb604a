"""Boosted trees of one question a level: what a torque does that no law and no smooth net tells.

Each tree asks the same few questions "is input f above t?" of every sample; the answers are the number of its leaf. A
tree is fitted to what the ones before it leave, and counts by a share of itself. Outside of what they have seen trees
say what they say at the edge, so that they never make up a torque that was not there. Rows and inputs of every tree are
drawn, which makes them fast and unlike one another.

Source: Friedman 2001 and 2002 (stochastic gradient boosting); Kohavi 1994 (oblivious trees); Prokhorenkova et al. 2018.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, Int
from ident.compiled import compiled

# Trees, questions of each, share by which a tree counts, and rows that a leaf is shrunk by.
TREES, DEPTH, RATE, SHRINKAGE = 100, 4, 0.1, 20.0
# Bins of an input, and shares of rows and of inputs that a tree is drawn.
BINS, ROW_SHARE, INPUT_SHARE = 32, 0.5, 0.6


@dataclass(frozen=True, eq=False)
class Trees:
    """Trees of one joint."""

    inputs: Int[Array, "t d"]  # number of the input that each question is about
    thresholds: Float[Array, "t d"]  # what it is to be above
    leaves: Float[Array, "t l"]  # torque of each leaf, in which the answers are the digits of its number [N m]

    def __call__(self, x: Float[Array, "T f"]) -> Float[Array, " T"]:
        """Torque [N m]."""
        out = np.zeros(len(x))
        _evaluate(np.ascontiguousarray(x, dtype=float), self.inputs, self.thresholds, self.leaves, out)
        return out

    def scaled(self, share: float) -> Trees:
        """The same, of its torque a share."""
        return Trees(self.inputs, self.thresholds, share * self.leaves)


def fit_trees(x: Float[Array, "T f"], y: Float[Array, " T"], seed: int) -> Trees:
    """Trees for a target.

    Args:
        x: Inputs.
        y: Target [N m].
        seed: Of what each tree is drawn.
    """
    levels = np.arange(1, BINS) / BINS
    edges = np.ascontiguousarray(np.quantile(x, levels, axis=0).T)
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
        places = _grow(binned, left, sample, among, BINS, inputs[tree], leaves[tree], RATE, SHRINKAGE)
        thresholds[tree] = edges[inputs[tree], places]
    return Trees(inputs, thresholds, leaves)


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
    """Grows one tree on a sample of rows, and takes its torque off all rows; places of its thresholds."""
    depth = inputs.shape[0]
    places = np.zeros(depth, dtype=np.int64)
    leaf = np.zeros(len(sample), dtype=np.int64)
    for d in range(depth):
        count, best = 1 << d, -1.0
        for f in among:
            row = binned[f]
            sums = np.zeros((count, bins))
            rows = np.zeros((count, bins))
            for i in range(len(sample)):
                s = sample[i]
                sums[leaf[i], row[s]] += left[s]
                rows[leaf[i], row[s]] += 1.0
            gain = np.zeros(bins)
            for a in range(count):
                all_sum, all_rows = 0.0, 0.0
                for b in range(bins):
                    all_sum += sums[a, b]
                    all_rows += rows[a, b]
                low_sum, low_rows = 0.0, 0.0
                for b in range(bins - 1):
                    low_sum += sums[a, b]
                    low_rows += rows[a, b]
                    high_sum, high_rows = all_sum - low_sum, all_rows - low_rows
                    gain[b] += low_sum**2 / (low_rows + shrinkage) + high_sum**2 / (high_rows + shrinkage)
            for b in range(bins - 1):
                if gain[b] > best:
                    best = gain[b]
                    inputs[d] = f
                    places[d] = b
        for i in range(len(sample)):
            leaf[i] = 2 * leaf[i] + (1 if binned[inputs[d], sample[i]] > places[d] else 0)
    sums_of = np.zeros(1 << depth)
    rows_of = np.zeros(1 << depth)
    for i in range(len(sample)):
        sums_of[leaf[i]] += left[sample[i]]
        rows_of[leaf[i]] += 1.0
    for a in range(1 << depth):
        leaves[a] = rate * sums_of[a] / (rows_of[a] + shrinkage)
    for t in range(len(left)):
        number = 0
        for d in range(depth):
            number = 2 * number + (1 if binned[inputs[d], t] > places[d] else 0)
        left[t] -= leaves[number]
    return places
