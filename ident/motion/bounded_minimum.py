"""The least value of a function of one number between two bounds: golden sections, sped up by parabolas.

The same steps as `scipy.optimize.minimize_scalar(method="bounded")`, whose import takes half a second.

Source: Brent, Algorithms for Minimization without Derivatives, 1973, chapter 5.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

GOLDEN = 0.5 * (3.0 - sqrt(5.0))
ROOT_EPSILON = sqrt(2.2e-16)
MOST_STEPS = 500


def find_minimum(function: Callable[[float], float], low: float, high: float, within: float) -> float:
    """Where a function that falls and then rises is least.

    Args:
        function: The function.
        low, high: Bounds.
        within: How near to the place is near enough.
    """
    best = second = third = low + GOLDEN * (high - low)
    at_best = at_second = at_third = function(best)
    step = before = 0.0
    for _ in range(MOST_STEPS):
        middle = 0.5 * (low + high)
        least = ROOT_EPSILON * abs(best) + within / 3.0
        if abs(best - middle) <= 2.0 * least - 0.5 * (high - low):
            break
        golden = True
        if abs(before) > least:
            # The lowest point of the parabola through the three best places.
            r = (best - second) * (at_best - at_third)
            q = (best - third) * (at_best - at_second)
            p = (best - third) * q - (best - second) * r
            q = 2.0 * (q - r)
            p, q = (-p, q) if q > 0.0 else (p, -q)
            last, before = before, step
            if abs(p) < abs(0.5 * q * last) and q * (low - best) < p < q * (high - best):
                step, golden = p / q, False
                if min(best + step - low, high - best - step) < 2.0 * least:
                    step = least if middle >= best else -least
        if golden:
            before = low - best if best >= middle else high - best
            step = GOLDEN * before
        place = best + (max(abs(step), least) if step >= 0.0 else -max(abs(step), least))
        value = function(place)
        if value <= at_best:
            low, high = (best, high) if place >= best else (low, best)
            third, at_third, second, at_second, best, at_best = second, at_second, best, at_best, place, value
        else:
            low, high = (place, high) if place < best else (low, place)
            if value <= at_second or second == best:
                third, at_third, second, at_second = second, at_second, place, value
            elif value <= at_third or third in (best, second):
                third, at_third = place, value
    return best
