"""Sets without the effects that foretell nothing.

Log evidence of a Gaussian model is too sure wherever noise is not as it is modelled, so a set that
is likeliest by it holds effects that only follow the noise. What speaks of that is data that a fit
never saw: an effect without which the rest foretells left-out parts of the session as well, or
better, is no part of the simplest set that explains it.
"""

from __future__ import annotations

from collections.abc import Sequence

from ident.inference.search import rest_of
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group


def without_unforetelling(scorer: HeldOut, chosen: Sequence[Group]) -> list[Group]:
    """A set without the effects that gain nothing on parts of the session that the fit never saw.

    One goes at a time, that without which most is gained. What happens once can't be confirmed by
    other parts, so it stays.

    Args:
        scorer: Scores models on left-out parts.
        chosen: The set.
    """
    left = list(chosen)
    while True:
        whole = scorer.score(left).misfit.sum()
        gains = {}
        for group in left:
            if not group.effect.event:
                without = scorer.score(rest_of(left, group)).misfit.sum()
                gains[group] = without - whole
        weakest = min(gains, key=lambda group: gains[group], default=None)
        if weakest is None or gains[weakest] > 0.0:
            return left
        left = rest_of(left, weakest)
