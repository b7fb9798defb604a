"""Which samples a fit leaves out in turn, and over which of them its doubt is counted.

Whole runs are left out where there are two or more: stretches of a run whose other stretches were
seen are foretold too well, as they share its speeds and its friction. Of a single run, stretches of
a few seconds are left out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Int

# Parts that are held back in turn.
FOLDS = 4
# Length of the stretches that make the parts where runs are few [samples].
STRETCH = 200
# Fewer runs than this can't be left out whole. Of two, half of all data is missing, and yet:
# stretches of one motion foretell one another whatever a net made up, and on a dual arm with two
# such runs a net doubled the error on a third.
FEWEST_RUNS = 2


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
    groups = runs
    if len(lengths) < 2 * FOLDS:
        size = min(max(1, STRETCH // every), max(1, sum(lengths) // (2 * FOLDS)))
        groups = _stretches(lengths, size)
    shared = runs if len(lengths) >= FEWEST_RUNS else groups
    sizes = np.bincount(shared)
    order = rng.permutation(len(sizes))
    filled = np.zeros(FOLDS)
    fold = np.zeros(len(sizes), dtype=int)
    # The largest first: parts of about the same size.
    for group in order[np.argsort(-sizes[order], kind="stable")]:
        fold[group] = int(np.argmin(filled))
        filled[fold[group]] += sizes[group]
    return fold[shared], groups


def _stretches(lengths: Sequence[int], size: int) -> Int[Array, " T"]:
    """Number of the stretch of every sample, about so many samples each; none spans two runs."""
    stretches = []
    first = 0
    for length in lengths:
        count = max(1, round(length / size))
        stretches.append(first + np.arange(length) * count // max(length, 1))
        first += count
    return np.concatenate(stretches)
