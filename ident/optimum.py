"""Small optimisation problems, solved without SciPy's optimiser: that takes longer to load than a fit to solve them.

Source: Lawson and Hanson 1974, chapter 23 (non-negative least squares); Brent 1973, chapter 5 (the
least value in an interval); Kuhn 1955 and Munkres 1957 (assignment), by shortest paths as Jonker
and Volgenant 1987 have it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ident.arrays import Array, Bool, Float, Int

# Times that the set of positive unknowns may change, for each unknown.
MOST_CHANGES = 3
# A gradient below this share of the largest product of columns and target is zero.
ZERO_GRADIENT = 1e-13
# Share of an interval at which its golden section lies.
GOLDEN = 0.5 * (3.0 - np.sqrt(5.0))
# Relative step below which two places can't be told apart.
LEAST_STEP = float(np.sqrt(np.finfo(float).eps))
MOST_EVALUATIONS = 500


def non_negative_least_squares(
    matrix: Float[Array, "m k"], target: Float[Array, " m"]
) -> tuple[Float[Array, " k"], float]:
    """Least squares of unknowns that are not negative, and the norm of what they leave."""
    size = matrix.shape[1]
    solution = np.linalg.lstsq(matrix, target, rcond=None)[0]
    if np.all(solution >= 0.0):  # mostly
        return solution, float(np.linalg.norm(target - matrix @ solution))
    solution = np.zeros(size)
    positive: Bool[Array, " k"] = np.zeros(size, dtype=bool)
    zero = ZERO_GRADIENT * float(np.max(np.abs(matrix).T @ np.abs(target), initial=0.0))
    gradient = matrix.T @ target
    for _ in range(MOST_CHANGES * size):
        waiting = np.flatnonzero(~positive & (gradient > zero))
        if not len(waiting):
            break
        entering = waiting[np.argmax(gradient[waiting])]
        positive[entering] = True
        solution = _within_bounds(matrix, target, solution, positive)
        gradient = matrix.T @ (target - matrix @ solution)
        if not positive[entering]:
            break
    return solution, float(np.linalg.norm(target - matrix @ solution))


def _within_bounds(
    matrix: Float[Array, "m k"],
    target: Float[Array, " m"],
    solution: Float[Array, " k"],
    positive: Bool[Array, " k"],
) -> Float[Array, " k"]:
    """The solution in the positive unknowns; those that reach zero on the way leave their set."""
    while positive.any():
        trial = np.zeros(len(solution))
        trial[positive] = np.linalg.lstsq(matrix[:, positive], target, rcond=None)[0]
        below = positive & (trial <= 0.0)
        if not below.any():
            return trial
        steps = solution[below] / (solution[below] - trial[below])
        share = float(np.min(np.nan_to_num(steps)))
        solution = solution + share * (trial - solution)
        reached = below & (solution <= LEAST_STEP * np.abs(trial))
        if not reached.any():
            reached[np.flatnonzero(below)[np.argmin(steps)]] = True
        positive &= ~reached
        solution = np.where(positive, solution, 0.0)
    return np.zeros(len(solution))


def least_within(function: Callable[[float], float], low: float, high: float, width: float) -> float:
    """Place of a function's least value in an interval, if it has one valley there.

    By golden sections, and by parabolas through the three best places where these converge.

    Args:
        function: The function.
        low, high: Ends of the interval.
        width: How well the place is wanted.
    """
    best = second = third = low + GOLDEN * (high - low)
    value = value_of_second = value_of_third = function(best)
    step = 0.0
    before_last = 0.0
    for _ in range(MOST_EVALUATIONS):
        middle = 0.5 * (low + high)
        least = LEAST_STEP * abs(best) + width / 3.0
        if abs(best - middle) <= 2.0 * least - 0.5 * (high - low):
            break
        last = before_last
        before_last = step
        known = (best, second, third, value, value_of_second, value_of_third)
        move = _parabola(known) if abs(last) > least else None
        inside = move is not None and low < best + move < high and abs(move) < abs(0.5 * last)
        if move is not None and inside:
            step = move
            if min(best + step - low, high - best - step) < 2.0 * least:
                step = np.copysign(least, middle - best)
        else:
            before_last = (low if best >= middle else high) - best
            step = GOLDEN * before_last
        trial = best + np.copysign(max(abs(step), least), step)
        value_of_trial = function(trial)
        if value_of_trial <= value:
            low, high = (best, high) if trial >= best else (low, best)
            third, value_of_third = second, value_of_second
            second, value_of_second = best, value
            best, value = trial, value_of_trial
            continue
        low, high = (trial, high) if trial < best else (low, trial)
        if value_of_trial <= value_of_second or second == best:
            third, value_of_third = second, value_of_second
            second, value_of_second = trial, value_of_trial
        elif value_of_trial <= value_of_third or third in (best, second):
            third, value_of_third = trial, value_of_trial
    return float(best)


def _parabola(known: tuple[float, float, float, float, float, float]) -> float | None:
    """Step from the best of three places to the bottom of the parabola through them."""
    best, second, third, value, value_of_second, value_of_third = known
    r = (best - second) * (value - value_of_third)
    q = (best - third) * (value - value_of_second)
    numerator = (best - third) * q - (best - second) * r
    denominator = 2.0 * (q - r)
    if denominator == 0.0:
        return None
    return -numerator / denominator


def cheapest_assignment(cost: Float[Array, "n n"]) -> Int[Array, " n"]:
    """Column of each row, every column once, whose costs sum to the least.

    Rows are added one by one along the shortest path of reduced costs.
    """
    size = len(cost)
    of_rows = np.zeros(size + 1)
    of_columns = np.zeros(size + 1)
    row_of = np.zeros(size + 1, dtype=int)  # of each column, from one; 0 is nobody's
    for row in range(1, size + 1):
        row_of[0] = row
        column = 0
        shortest = np.full(size + 1, np.inf)
        before = np.zeros(size + 1, dtype=int)
        visited = np.zeros(size + 1, dtype=bool)
        while row_of[column] != 0:
            visited[column] = True
            here = row_of[column]
            reduced = cost[here - 1] - of_rows[here] - of_columns[1:]
            nearer = ~visited[1:] & (reduced < shortest[1:])
            shortest[1:][nearer] = reduced[nearer]
            before[1:][nearer] = column
            open_columns = np.where(visited[1:], np.inf, shortest[1:])
            following = 1 + int(np.argmin(open_columns))
            change = float(open_columns[following - 1])
            of_rows[row_of[visited]] += change
            of_columns[visited] -= change
            shortest[~visited] -= change
            column = following
        while column != 0:
            row_of[column] = row_of[before[column]]
            column = int(before[column])
    columns = np.zeros(size, dtype=int)
    columns[row_of[1:] - 1] = np.arange(size)
    return columns
