"""Parameters over a grid of laws: how well each point of a named effect's finer grid explains what the best one does.

A law has parameters in which its torque is not linear: the speed of a Stribeck curve, the order of a wave. Each point
of their grid has coefficients of its own, so an interval that is true of the best point alone is too narrow. With Δ the
fall of the log likelihood from the best point to another, θ the coefficients there and s their deviation, the profile
of a parameter reaches to

    θ ± s √(2 (drop − Δ)),    drop = 1.92 for 95 %,

and its interval holds those of all points with Δ < drop.

No arm obeys a law to the letter. Where its own differs by a share d of the torque, a wrong point may explain as much as
½ d² of the whole gain more than the right one: falls are counted in units in which that counts as the drop itself.

Source: Pawitan 2001 (profile likelihood).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.selection.search import Search
from ident.effects.base import Interval, SessionContext
from ident.regression.design import Group
from ident.regression.least_squares import LEAST_POWER, Projection

TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class Profile:
    """A named effect's grid."""

    group: Group  # the point whose parameters are reported
    mates: tuple[Group, ...]  # all points of the grid, that one among them
    log_likelihood: Float[Array, " m"]  # of each [nats], in units of what the law's own error leaves open
    # Of each, in the columns' own units; the information is that of the model.
    coefficients: tuple[Float[Array, " k"], ...]
    information: tuple[Float[Array, "k k"], ...]
    drop: float  # fall at the ends of a 95 % interval [nats]

    def inner_parameters(self) -> dict[str, Interval]:
        """Intervals of the parameters of the grid itself; parameters that lie on no grid have a point."""
        found = {}
        for name, value in self.group.variant.inner.items():
            values = np.array([mate.variant.inner[name] for mate in self.mates])
            points = np.unique(values)
            if len(points) < 2 or np.any(points <= 0):
                found[name] = Interval(float(value), float(value), float(value))
            # What is one of a few numbers lies at one of them.
            elif name in self.group.effect.doubt.exact:
                likely = values[self.log_likelihood > self.log_likelihood.max() - self.drop]
                found[name] = Interval(float(value), float(min(value, *likely)), float(max(value, *likely)))
            else:
                falls = np.array([self.log_likelihood[values == point].max() for point in points])
                found[name] = _interval(np.log(points), falls, self.drop)
        return found

    def widened(
        self, best: Mapping[str, Interval], session: SessionContext, deviation: Float[Array, " k"]
    ) -> dict[str, Interval]:
        """Parameters with intervals that hold those of all likely points.

        Args:
            best: The parameters of the best point.
            session: The runs that they are taken from.
            deviation: Standard deviations of its coefficients.
        """
        effect, found = self.group.effect, dict(best)
        own = self.mates.index(self.group)
        ratio = deviation / np.sqrt(np.maximum(np.diag(_inverse(self.information[own])), LEAST_POWER))
        falls = np.maximum(self.log_likelihood[own] - self.log_likelihood, 0.0)
        for k in np.flatnonzero((falls < self.drop) & (np.arange(len(falls)) != own)):
            covariance = np.outer(ratio, ratio) * _inverse(self.information[k])
            figures = effect.parameters(
                session, self.group.joint, self.mates[k].variant, self.coefficients[k], covariance
            )
            narrower = float(np.sqrt(1.0 - falls[k] / self.drop))
            found = {name: _both(one, figures[name], narrower, name) for name, one in found.items()}
        return found


def profile(search: Search, projection: Projection, group: Group, inflation: float) -> Profile:
    """The grid of a named effect, seen beside the other names.

    Args:
        search: Of the second pass, whose sums hold the grid.
        projection: The model without the effect.
        group: The effect at the point whose parameters are reported.
        inflation: By how much misfit exceeds noise.
    """
    scale = search.evidence.scale
    # A point with further columns is a law of its own, whose coefficients are not this one's.
    width = len(group.columns)
    mates = tuple(
        other
        for other in search.evidence.layout.groups
        if other.key == group.key
        and len(other.columns) == width
        and other.variant.inner.keys() == group.variant.inner.keys()
    )
    seen = [search.gain_of(projection, mate) for mate in mates]
    gains = np.array([gain for gain, _ in seen]) / inflation
    drop, share = search.settings.interval_fall, group.effect.doubt.share
    open_ended = 0.5 * share**2 * float(gains[mates.index(group)])
    information = tuple(
        projection.rest(mate.columns) * np.outer(scale[mate.columns], scale[mate.columns]) for mate in mates
    )
    coefficients = tuple(beta / scale[mate.columns] for mate, (_, beta) in zip(mates, seen, strict=True))
    return Profile(group, mates, 0.5 * gains * drop / (drop + open_ended), coefficients, information, drop)


def _inverse(information: Float[Array, "k k"]) -> Float[Array, "k k"]:
    """Covariance; of directions of which nothing is known, as wide as numbers allow."""
    scale = np.sqrt(np.maximum(np.diag(information), LEAST_POWER))
    even = information / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
    return np.asarray(np.linalg.inv(even) / np.outer(scale, scale))


def _both(one: Interval, other: Interval, narrower: float, name: str) -> Interval:
    """One's value, and an interval that holds its own and another's after that was narrowed; angles go round."""
    shift = TURN * np.round((one.value - other.value) / TURN) if name == "phase_rad" else 0.0
    middle = other.value + shift
    low = middle - narrower * (other.value - other.low)
    high = middle + narrower * (other.high - other.value)
    return replace(one, low=float(min(one.low, low)), high=float(max(one.high, high)))


def _interval(x: Float[Array, " k"], falls: Float[Array, " k"], drop: float) -> Interval:
    """Maximum and 95 % interval of a profile on a grid of logs: parabola through the top, grid points beyond.

    An end that the profile does not fall from within the grid is open: it stands half a step beyond the grid, and no
    law that was not tried is reported.
    """
    top = int(np.argmax(falls))
    best, peak = x[top], falls[top]
    step = float(np.min(np.diff(x)))
    low, high, margin = best, best, step / 2
    if 0 < top < len(x) - 1:
        a, b, c = np.polyfit(x[top - 1 : top + 2] - x[top], falls[top - 1 : top + 2], 2)
        if a < 0:
            best, peak = x[top] - b / (2 * a), c - b**2 / (4 * a)
            reach = float(np.sqrt(drop / -a))
            low, high, margin = best - reach, best + reach, 0.0
    inside = falls > peak - drop
    low = min(low, x[inside].min(initial=best) - margin)
    high = max(high, x[inside].max(initial=best) + margin)
    low, high = max(low, x[0] - step / 2), min(high, x[-1] + step / 2)
    ends = {(True, False): "low", (False, True): "high", (True, True): "both"}
    open_: Any = ends.get((bool(inside[0]), bool(inside[-1])), "")
    return Interval(float(np.exp(best)), float(np.exp(low)), float(np.exp(high)), open_)
