"""Whose share of the gap is whose: order-free shares of several named effects.

Effects overlap: what the second one closes depends on whether the first was there. Shapley's value takes the mean over
all orders in which they could have been found,

    share_i = Σ_{S without i} |S|! (k − |S| − 1)! / k! · (closed(S + i) − closed(S)),

so that shares add up to what all close together, and effects that do the same get the same.

Source: Shapley 1953; Lindeman, Merenda and Gold 1980 (shares of explained variance).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import comb

import numpy as np

from ident.arrays import Float
from ident.diagnosis.regression.cross_validation import HeldOut
from ident.diagnosis.regression.design import Group


def shapley_shares(
    held_out: HeldOut, groups: Sequence[Group], floors: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " k"]:
    """Share of the reducible held-out mean square that each effect closes, whatever the order.

    Args:
        held_out: Scores models on folds that they never saw.
        groups: The named effects, k of them: 2^k models are scored.
        floors: Root mean square that nothing can go below, joint by joint [N m].
    """
    members = range(len(groups))
    subsets = [subset for size in range(len(groups) + 1) for subset in combinations(members, size)]
    squares = {subset: held_out.score([groups[i] for i in subset]).rms ** 2 for subset in subsets}
    reducible = float(np.sum(np.maximum(squares[()] - floors**2, 0.0)))
    closed = {subset: float(np.sum(squares[()] - left)) for subset, left in squares.items()}
    shares = np.zeros(len(groups))
    for i in members:
        for subset in subsets:
            if i not in subset:
                orders = len(groups) * comb(len(groups) - 1, len(subset))
                shares[i] += (closed[tuple(sorted((*subset, i)))] - closed[subset]) / orders
    return shares / max(reducible, 1e-12)
