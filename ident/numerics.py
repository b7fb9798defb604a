"""Small numerical routines that every command needs, without the second of processor time that scipy takes to load."""

from __future__ import annotations

from collections.abc import Callable
from math import erf, lgamma, pi, sqrt

import numpy as np

from ident.arrays import Array, Float, Int

GOLDEN = 0.5 * (3.0 - sqrt(5.0))
ROOT_EPSILON = sqrt(2.2e-16)
MOST_STEPS = 500
# Points and steps by which Student's distribution is integrated and inverted: to rounding, for two degrees and more.
POINTS, NEWTON_STEPS = 48, 100


def find_minimum(function: Callable[[float], float], low: float, high: float, within: float) -> float:
    """Where a function of one number that falls and then rises is least: golden sections, sped up by parabolas.

    Args:
        function: The function.
        low, high: Bounds.
        within: How near to the place is near enough.

    Source: Brent, Algorithms for Minimization without Derivatives, 1973, chapter 5.
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


def factor_by_pivots(table: Float[Array, "T k"]) -> tuple[Float[Array, "r k"], Int[Array, " k"]]:
    """R and the order of the columns of table[:, order] = Q R, each step taking the column with most left to it.

    Source: Golub and Van Loan, Matrix Computations, algorithm 5.4.1.
    """
    left = np.asarray(np.linalg.qr(table, mode="r")).copy()
    order = np.arange(left.shape[1])
    for k in range(min(left.shape)):
        sizes = np.einsum("ij,ij->j", left[k:, k:], left[k:, k:])
        chosen = k + int(np.argmax(sizes))
        left[:, [k, chosen]] = left[:, [chosen, k]]
        order[[k, chosen]] = order[[chosen, k]]
        mirror = left[k:, k].copy()
        length = float(np.linalg.norm(mirror))
        if length == 0.0:
            break
        mirror[0] += np.copysign(length, mirror[0])
        left[k:, k:] -= np.outer(mirror, (2.0 / (mirror @ mirror)) * (mirror @ left[k:, k:]))
        left[k + 1 :, k] = 0.0
    return left, order


def solve_non_negative(table: Float[Array, "T k"], target: Float[Array, " T"]) -> Float[Array, " k"]:
    """Least squares without negative unknowns.

    Source: Lawson and Hanson, Solving Least Squares Problems, 1974, chapter 23.
    """
    triangle = np.asarray(np.linalg.qr(np.column_stack([table, target]), mode="r"))
    columns, right = triangle[:, :-1], triangle[:, -1]
    count = columns.shape[1]
    rounding = 10.0 * np.finfo(float).eps * count * max(1e-300, float(np.abs(columns).sum(axis=0).max(initial=0.0)))
    enough = rounding * max(1.0, float(np.linalg.norm(right)))
    found, free = np.zeros(count), np.zeros(count, dtype=bool)
    for _ in range(3 * count):
        slope = np.where(free, -np.inf, columns.T @ (right - columns @ found))
        if not count or slope.max() <= enough:
            break
        free[int(np.argmax(slope))] = True
        while free.any():
            trial = np.zeros(count)
            trial[free] = np.linalg.lstsq(columns[:, free], right, rcond=None)[0]
            negative = free & (trial <= 0.0)
            if not negative.any():
                found = trial
                break
            share = float(np.min(found[negative] / (found[negative] - trial[negative] + 1e-300)))
            found = found + share * (trial - found)
            free &= ~(negative & (found <= rounding))
            found = np.where(free, found, 0.0)
    return found


def student_quantile(probability: float, dof: Float[Array, "..."]) -> Float[Array, "..."]:
    """Quantile above the median of Student's distribution.

    With t = √ν tan θ the distribution is ½ + c ∫₀^θ cos^(ν−1) φ dφ: smooth, rising and concave, so that Newton's steps
    from below never overshoot. They begin at the normal distribution's quantile, below which Student's never lies.

    Args:
        probability: From a half to one.
        dof: Degrees of freedom ν, one or more.
    """
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    freedom, place = np.unique(np.asarray(dof, dtype=float), return_inverse=True)
    scale = np.array([np.exp(lgamma(0.5 * (one + 1.0)) - lgamma(0.5 * one)) / sqrt(pi) for one in freedom])
    angle = np.arctan(normal_quantile(probability) / np.sqrt(freedom))
    for _ in range(NEWTON_STEPS):
        inside = 0.5 * angle[..., None] * (nodes + 1.0)
        area = 0.5 * angle * (np.cos(inside) ** (freedom[..., None] - 1.0) @ weights)
        step = ((probability - 0.5) / scale - area) / np.cos(angle) ** (freedom - 1.0)
        angle = angle + step
        if np.all(np.abs(step) <= 1e-14 * angle):
            break
    return np.asarray((np.sqrt(freedom) * np.tan(angle))[place]).reshape(np.shape(dof))


def normal_quantile(probability: float) -> float:
    """Quantile above the median of the normal distribution, by halving where it may lie."""
    low, high = 0.0, 40.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if 0.5 * (1.0 + erf(middle / sqrt(2.0))) >= probability else (middle, high)
    return low
