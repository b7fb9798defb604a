"""Has a parameter changed from some session on? Evidence that may be looked at after every session.

Null hypothesis: the values x₁, x₂, … of a parameter are independent draws of one normal distribution, whose mean and
spread (that of one day from the next, errors of measurement included) nobody knows. Alternative: from session k + 1
on the mean is shifted by δ times the spread, δ ~ N(0, c²). With the right Haar prior on mean and spread, under both,
the Bayes factor of the first m values depends on their maximal invariant alone, whose law is the same for every mean
and spread:

    B_k(m) = (1 + c² d'd)^(-1/2) · [ S / (S - c² (d'x)² / (1 + c² d'd)) ]^((m - 1)/2),

d the step at k less its mean, S the sum of squares about the mean. So under the null hypothesis B_k is a martingale
that starts at 1, whatever the spread. Its growth from one session to the next is cut at `MOST_GROWTH`, which makes it
a supermartingale: one odd session, in days that are not normally distributed, can't raise an alarm alone. Over all k
the evidence is a sum with weights w_k that add up to one, the weight of changes that are still to come counting as it
is. Then by Ville's inequality

    P( the evidence ever reaches 1/α ) ≤ α,

however often one looks and whenever one stops. Values that drift slowly are caught too, as a change that goes on.

Not covered: days that depend on each other (a season, one week of heat). Those look like a change, and are one.

Source: Ville 1939; Robbins 1970 (mixtures); Lai 1976 and Wang and Ramdas 2024 (unknown variance, anytime-valid
t-test); Pérez-Ortiz et al. 2024 (e-statistics by group invariance); Shin, Ramdas and Rinaldo 2023 (sums over change
points).
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float, Int

# Sessions before the first change that is looked for: three give a mean and a spread.
LEAST_BEFORE = 3
# Prior spread of a change, in day-to-day spreads: changes that matter are one to five of them.
CHANGE_SIZE = 2.0
# Half of all weight lies on changes within so many sessions after the first ones: half a year of weekly sessions.
HALF_WEIGHT = 30.0
# Most that one session may multiply the evidence with. In arm-years of 34 parameters, level 5 %, it gave an alarm to
# none of 100 with normal days, none of 100 with Student's t of three degrees of freedom, and 10 of 160 with lognormal
# days (`tests/bench/bench_watch.py`); without a cut one parameter in twelve of such t-distributed days reaches an arm's
# alarm.
MOST_GROWTH = 20.0
# Differences below this share of the values are rounding.
ROUNDING = 1e-12


def prior_weight(before: Float[Array, " k"] | Array) -> Float[Array, " k"]:
    """Weight of a change after so many values: 1 over the square for late ones, adds up to one over all."""
    place = before - LEAST_BEFORE
    return HALF_WEIGHT / ((place + HALF_WEIGHT) * (place + HALF_WEIGHT + 1.0))


class EProcess:
    """The evidence of a change in one parameter, value by value."""

    def __init__(self) -> None:
        self._values: list[float] = []
        # Logarithms of the bets on each change, as cut and as they are, by the number of values before the change.
        self._grown: Float[Array, " k"] = np.zeros(0)
        self._last: Float[Array, " k"] = np.zeros(0)
        self.evidence = 1.0
        self.before = 0

    def add(self, value: float) -> float:
        """Takes one more value; `before` says how many lie before the change that fits best.

        Returns:
            The evidence after it.
        """
        self._values.append(value)
        m = len(self._values)
        if m <= LEAST_BEFORE:
            return self.evidence
        before = np.arange(LEAST_BEFORE, m)
        now = self._log_bayes_factors(before)
        last, grown = np.append(self._last, 0.0), np.append(self._grown, 0.0)
        self._grown, self._last = grown + np.minimum(now - last, np.log(MOST_GROWTH)), now
        weight = prior_weight(before)
        share = weight * np.exp(np.minimum(self._grown, 700.0))
        self.evidence = float(share.sum() + 1.0 - weight.sum())
        self.before = int(before[np.argmax(share)])
        return self.evidence

    def _log_bayes_factors(self, before: Int[Array, " k"]) -> Float[Array, " k"]:
        """log B_k of the values so far, for changes after `before` of them."""
        x = np.array(self._values) - self._values[0]
        m, sums, squares = len(x), np.cumsum(x), float(x @ x)
        spread = max(squares - sums[-1] ** 2 / m, ROUNDING * squares, 1e-300)
        after = m - before
        length = before * after / m
        along = sums[-1] - sums[before - 1] - after * sums[-1] / m
        explained = CHANGE_SIZE**2 * along**2 / (1.0 + CHANGE_SIZE**2 * length)
        left = np.maximum(spread - explained, ROUNDING * spread)
        return 0.5 * (m - 1) * np.log(spread / left) - 0.5 * np.log1p(CHANGE_SIZE**2 * length)
