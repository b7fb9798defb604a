"""Shapley shares of the gap for several effects, independent of the order of acceptance.

Effects overlap: what the second one closes depends on whether the first was there. Shapley's value is the mean over all
orders of acceptance,

    share_i = Σ_{S without i} |S|! (k − |S| − 1)! / k! · (closed(S + i) − closed(S)),

so that shares add up to what all effects close together, and equal effects have equal shares. Of more than four effects
some orders are drawn, each with its reverse; shares still add up.

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

# Largest number of effects for which all orders are taken, and number of orders drawn for more (chosen: work).
ALL_ORDERS, DRAWN_ORDERS = 4, 24


def shapley_shares(
    held_out: HeldOut, groups: Sequence[Group], floors: Float[np.ndarray, " n"], seed: int
) -> Float[np.ndarray, " k"]:
    """Share of the reducible held-out mean square that each effect closes, averaged over orders.

    Args:
        held_out: Held-out scores of models.
        groups: The accepted effects, k of them.
        floors, seed: Floor of each joint's error [N m], and seed of the drawn orders.
    """
    left: dict[frozenset[int], Float[np.ndarray, " n"]] = {}
    shares = np.zeros(len(groups))
    rng, count = np.random.default_rng(seed), len(groups)
    if count <= ALL_ORDERS:
        orders = list(permutations(range(count)))
    else:
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
