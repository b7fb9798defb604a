"""Which samples a fit leaves out in turn, and over which of them its doubt is counted.

Whole runs are left out where there are three or more: stretches of a run whose other stretches were seen are foretold
too well, as they share its speeds and its friction. Of fewer runs, stretches of a few seconds are left out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Int

# Parts that are held back in turn, and the length of the stretches that make them where runs are few [samples].
FOLDS, STRETCH = 4, 200
# Fewer runs than this are not left out whole: half of all data would be missing.
FEWEST_RUNS = 3


def make_folds(
    lengths: Sequence[int], every: int, rng: np.random.Generator
) -> tuple[Int[Array, " T"], Int[Array, " T"]]:
    """Parts to be left out, and groups to be counted as one witness each; a number a sample.

    Args:
        lengths: Samples of each run, after thinning.
        every: One of how many samples was kept.
        rng: Spreads the groups over the parts.
    """
    runs = np.repeat(np.arange(len(lengths)), lengths)
    groups = runs if len(lengths) >= 2 * FOLDS else _stretches(lengths, every)
    return _share_out(runs if len(lengths) >= FEWEST_RUNS else groups, rng), groups


def _stretches(lengths: Sequence[int], every: int) -> Int[Array, " T"]:
    """Stretches of runs; none goes on into the next run."""
    size = min(max(1, STRETCH // every), max(1, sum(lengths) // (2 * FOLDS)))
    numbers, first = [], 0
    for length in lengths:
        count = max(1, round(length / size))
        numbers.append(first + np.arange(length) * count // max(length, 1))
        first += count
    return np.concatenate(numbers)


def _share_out(groups: Int[Array, " T"], rng: np.random.Generator) -> Int[Array, " T"]:
    """Parts of about the same size."""
    sizes = np.bincount(groups)
    order = rng.permutation(len(sizes))
    order = order[np.argsort(-sizes[order], kind="stable")]
    filled, part = np.zeros(FOLDS), np.zeros(len(sizes), dtype=int)
    for group in order:
        part[group] = int(np.argmin(filled))
        filled[part[group]] += sizes[group]
    return part[groups]
