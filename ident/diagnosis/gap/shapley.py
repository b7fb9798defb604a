"""Whose share of the gap is whose: order-free shares of several named effects.

Effects overlap: what the second one closes depends on whether the first was there. Shapley's value takes the mean over
all orders in which they could have been found,

    share_i = Σ_{S without i} |S|! (k − |S| − 1)! / k! · (closed(S + i) − closed(S)),

so that shares add up to what all close together, and effects that do the same get the same. Of more than four effects a
few orders are drawn, each with its reverse: shares still add up.

Source: Shapley 1953; Lindeman, Merenda and Gold 1980 (shares of explained variance); Mitchell and others 2022 (orders
with their reverse).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from ident.arrays import Float
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group

# Effects of which all orders are taken, and orders that are drawn of more (chosen: work).
ALL_ORDERS, DRAWN_ORDERS = 4, 24


def shapley_shares(
    held_out: HeldOut, groups: Sequence[Group], floors: Float[np.ndarray, " n"], seed: int
) -> Float[np.ndarray, " k"]:
    """Share of the reducible held-out mean square that each effect closes, whatever the order.

    Args:
        held_out: Scores models on folds that they never saw.
        groups: The named effects, k of them.
        floors: Root mean square that nothing can go below, joint by joint [N m].
        seed: Of the orders that are drawn.
    """
    left: dict[frozenset[int], Float[np.ndarray, " n"]] = {}
    shares = np.zeros(len(groups))
    rng, count = np.random.default_rng(seed), len(groups)
    if count <= ALL_ORDERS:
        orders = list(permutations(range(count)))
    else:  # of many effects some orders, each with its reverse
        drawn = [tuple(int(i) for i in rng.permutation(count)) for _ in range(DRAWN_ORDERS // 2)]
        orders = [*drawn, *(order[::-1] for order in drawn)]
    for order in orders:
        for k in range(len(order) + 1):
            subset = frozenset(order[:k])
            if subset not in left:
                left[subset] = held_out.score([groups[i] for i in sorted(subset)]).rms ** 2
            if k:
                shares[order[k - 1]] += float(np.sum(left[frozenset(order[: k - 1])] - left[subset])) / len(orders)
    reducible = float(np.sum(np.maximum(left[frozenset()] - floors**2, 0.0)))
    return shares / max(reducible, 1e-12)
