"""Boosted regression trees for a few thousand samples, compiled.

Each tree is grown leaf by leaf, where the fall of the squared error is greatest, on inputs that were cut into bins;
each takes a share of what the trees before it leave. They are the same, to the last digit, as those of scikit-learn's
`HistGradientBoostingRegressor`, which takes longer to load than these take to grow.

Source: Friedman 2001 (gradient boosting); Ke et al. 2017 (LightGBM: histograms, leaves in the order of their gain);
Chen and Guestrin 2016, equations 5 to 7 (a leaf's answer and a split's gain); scikit-learn's implementation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.compiled import compiled
from ident.diagnosis.gap.settings import TreeSettings

# Bins of each input: equal shares of the samples.
BINS = 255
# Of each node: where its samples begin and end; sum of its gradients; its answer; its best split's gain, input, bin,
# sum of gradients and number of samples to the left; its first child; which of the histograms is its own.
START, STOP, GRADIENT, ANSWER, GAIN, INPUT, BIN, LEFT_GRADIENT, LEFT_COUNT, CHILD, PLACE = range(11)
FIELDS = 11
# What there is room for, sample by sample: gradients, the samples in the order of their leaves, and spare room.
GRADIENTS, ORDER, SPARE = range(3)


@dataclass(frozen=True, eq=False)
class Trees:
    """Trees that were grown.

    Attributes:
        edges: For each input, the upper edges of all its bins but the last.
        mean: Mean of what they learnt, their first answer.
        nodes: Of every tree its nodes, a child with its sibling right after it, shape (trees, nodes, FIELDS).
        rate: Share of each tree's answer that counts.
    """

    edges: tuple[Float[Array, " b"], ...]
    mean: float
    nodes: Float[Array, "k m f"]
    rate: float

    def predict(self, inputs: Float[Array, "T f"]) -> Float[Array, " T"]:
        """What they answer to inputs."""
        answers = np.full(len(inputs), self.mean)
        _ask(_binned(inputs, self.edges), self.nodes, self.rate, answers)
        return answers


def grow_trees(inputs: Float[Array, "T f"], values: Float[Array, " T"], settings: TreeSettings) -> Trees:
    """Grows trees by least squares.

    Args:
        inputs: The inputs of every sample.
        values: What is to be explained.
        settings: How many trees and leaves, their rate, fewest samples and penalty.
    """
    edges = tuple(_edges(column) for column in inputs.T)
    binned = _binned(inputs, edges)
    last = np.array([float(len(each)) for each in edges])
    mean = float(np.mean(values))
    nodes = np.zeros((settings.rounds, 2 * settings.leaves - 1, FIELDS))
    histograms = np.zeros((settings.leaves, len(edges), 2 * BINS))
    room = np.empty((3, len(values)))
    answers = np.full(len(values), mean)
    values = np.ascontiguousarray(values, dtype=float)
    shape = float(settings.leaf_samples), settings.penalty, settings.rate
    _boost(binned, last, values, *shape, answers, room, histograms, nodes)
    return Trees(edges, mean, nodes, settings.rate)


def _edges(values: Float[Array, " T"]) -> Float[Array, " b"]:
    """Upper edges of all bins but the last: between neighbours where values are few, quantiles elsewhere."""
    distinct = np.unique(values)
    if len(distinct) <= BINS:
        return np.asarray(0.5 * (distinct[1:] + distinct[:-1]))
    shares = np.linspace(0, 100, BINS + 1)[1:-1]
    return np.unique(np.percentile(values, shares, method="averaged_inverted_cdf"))


def _binned(inputs: Float[Array, "T f"], edges: tuple[Array, ...]) -> Float[Array, "f T"]:
    """Bin of every input of every sample."""
    return np.stack([np.searchsorted(each, column).astype(float) for each, column in zip(edges, inputs.T, strict=True)])


@compiled("f2 f3 f f1")
def _ask(binned: Array, nodes: Array, rate: float, answers: Array) -> None:
    for k in range(len(nodes)):
        for t in range(len(answers)):
            at = 0
            while nodes[k, at, CHILD] > 0.0:
                right = binned[int(nodes[k, at, INPUT]), t] > nodes[k, at, BIN]
                at = int(nodes[k, at, CHILD]) + (1 if right else 0)
            answers[t] += rate * nodes[k, at, ANSWER]


def _count(binned: Array, room: Array, nodes: Array, k: int, i: int, histograms: Array) -> None:
    """Sum of gradients and number of samples of each bin of each input, of a node's samples."""
    own = int(nodes[k, i, PLACE])
    for f in range(len(binned)):
        for b in range(histograms.shape[2]):
            histograms[own, f, b] = 0.0
        for s in range(int(nodes[k, i, START]), int(nodes[k, i, STOP])):
            t = int(room[ORDER, s])
            b = 2 * int(binned[f, t])
            histograms[own, f, b] += room[GRADIENTS, t]
            histograms[own, f, b + 1] += 1.0


def _find_split(last: Array, least: float, penalty: float, nodes: Array, k: int, i: int, histograms: Array) -> None:
    """Writes a node's best split into it; its gain stays zero where there is none."""
    own, count, whole = int(nodes[k, i, PLACE]), nodes[k, i, STOP] - nodes[k, i, START], nodes[k, i, GRADIENT]
    if count < 2.0 * least:
        return
    best, whole_loss = 0.0, whole * nodes[k, i, ANSWER]
    for f in range(len(last)):
        gradient, left = 0.0, 0.0
        for b in range(int(last[f])):
            gradient += histograms[own, f, 2 * b]
            left += histograms[own, f, 2 * b + 1]
            if left < least:
                continue
            if count - left < least:
                break
            rest = whole - gradient
            first, second = -gradient / (left + penalty), -rest / (count - left + penalty)
            gain = whole_loss - gradient * first - rest * second
            if gain > best:
                best = gain
                nodes[k, i, GAIN], nodes[k, i, INPUT], nodes[k, i, BIN] = gain, f, b
                nodes[k, i, LEFT_GRADIENT], nodes[k, i, LEFT_COUNT] = gradient, left


def _split(binned: Array, room: Array, penalty: float, nodes: Array, k: int, i: int, child: int) -> None:
    """Orders a node's samples, those of its left child first, and makes its children."""
    start, stop, f = int(nodes[k, i, START]), int(nodes[k, i, STOP]), int(nodes[k, i, INPUT])
    left, right = start, 0
    for s in range(start, stop):
        if binned[f, int(room[ORDER, s])] <= nodes[k, i, BIN]:
            room[ORDER, left] = room[ORDER, s]
            left += 1
        else:
            room[SPARE, right] = room[ORDER, s]
            right += 1
    for s in range(right):
        room[ORDER, left + s] = room[SPARE, s]
    nodes[k, i, CHILD] = child
    nodes[k, child, START], nodes[k, child, STOP] = start, left
    nodes[k, child + 1, START], nodes[k, child + 1, STOP] = left, stop
    nodes[k, child, GRADIENT] = nodes[k, i, LEFT_GRADIENT]
    nodes[k, child + 1, GRADIENT] = nodes[k, i, GRADIENT] - nodes[k, i, LEFT_GRADIENT]
    nodes[k, child, ANSWER] = -nodes[k, child, GRADIENT] / (left - start + penalty)
    nodes[k, child + 1, ANSWER] = -nodes[k, child + 1, GRADIENT] / (right + penalty)


def _grow(
    binned: Array, last: Array, least: float, penalty: float, room: Array, histograms: Array, nodes: Array, k: int
) -> int:
    """Grows one tree; how many nodes it has."""
    nodes[k, 0, STOP] = binned.shape[1]
    _count(binned, room, nodes, k, 0, histograms)
    for b in range(BINS):
        nodes[k, 0, GRADIENT] += histograms[0, 0, 2 * b]
    _find_split(last, least, penalty, nodes, k, 0, histograms)
    grown = 1
    for leaves in range(1, len(histograms)):
        best = -1
        for i in range(grown):
            gain = nodes[k, i, GAIN] if nodes[k, i, CHILD] == 0.0 else 0.0
            if gain > (nodes[k, best, GAIN] if best >= 0 else 0.0):
                best = i
        if best < 0:
            break
        _split(binned, room, penalty, nodes, k, best, grown)
        # Samples of the smaller child are counted; the larger has the rest of its parent's.
        few, many = grown, grown + 1
        if not nodes[k, best, LEFT_COUNT] < nodes[k, many, STOP] - nodes[k, many, START]:
            few, many = many, few
        nodes[k, few, PLACE], nodes[k, many, PLACE] = leaves, nodes[k, best, PLACE]
        if nodes[k, many, STOP] - nodes[k, many, START] >= 2.0 * least:
            _count(binned, room, nodes, k, few, histograms)
            own = int(nodes[k, many, PLACE])
            for f in range(len(last)):
                for b in range(histograms.shape[2]):
                    histograms[own, f, b] -= histograms[leaves, f, b]
            _find_split(last, least, penalty, nodes, k, many, histograms)
            _find_split(last, least, penalty, nodes, k, few, histograms)
        grown += 2
    return grown


@compiled("f2 f1 f1 f f f f1 f2 f3 f3", _count, _find_split, _split, _grow)
def _boost(
    binned: Array,
    last: Array,
    values: Array,
    least: float,
    penalty: float,
    rate: float,
    answers: Array,
    room: Array,
    histograms: Array,
    nodes: Array,
) -> None:
    """Grows one tree after the other; `answers` are theirs so far, `room` and `histograms` are room to work."""
    for k in range(len(nodes)):
        for t in range(len(values)):
            room[GRADIENTS, t] = np.float32(answers[t] - values[t])  # as there: rounding breaks ties of splits
            room[ORDER, t] = t
        grown = _grow(binned, last, least, penalty, room, histograms, nodes, k)
        for i in range(grown):
            if nodes[k, i, CHILD] == 0.0:
                for s in range(int(nodes[k, i, START]), int(nodes[k, i, STOP])):
                    answers[int(room[ORDER, s])] += rate * nodes[k, i, ANSWER]
