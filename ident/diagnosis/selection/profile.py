"""Profile likelihood of an accepted effect over its fine grid, for intervals of its nonlinear parameters.

A law's torque is nonlinear in some parameters: the speed of a Stribeck curve, the order of a wave. Each point of their
grid has linear coefficients of its own, so intervals at the best point alone are too narrow. With Δ the fall of the log
likelihood from the best point to another, θ the parameter there and s its standard deviation, the profile of the
parameter reaches to

    θ ± s √(2 (drop − Δ)),    drop = ½ χ²₁(95 %) = 1.92,

and the interval is the union over all points with Δ < drop.

No arm obeys a law exactly. Where its own differs by a share d of the torque, a wrong point may explain ½ d² of the
whole gain more than the right one: falls are scaled such that this amount counts as the drop.

Source: Pawitan 2001 (profile likelihood).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.selection.candidates import Candidates
from ident.effects.base import Interval, SessionContext
from ident.inference.profile import profile_interval, unite
from ident.regression.design import Group
from ident.regression.least_squares import LEAST_POWER, Projection

TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class Profile:
    """Log likelihood and coefficients of an accepted effect at all points of its fine grid."""

    group: Group  # the point whose parameters are reported
    points: tuple[Group, ...]  # all points of the grid, that one among them
    log_likelihood: Float[Array, " m"]  # of each [nats], in units of what the law's own error leaves open
    # Of each, in the columns' own units; the information is that of the model.
    coefficients: tuple[Float[Array, " k"], ...]
    information: tuple[Float[Array, "k k"], ...]
    drop: float  # fall at the ends of a 95 % interval [nats]

    def inner_parameters(self) -> dict[str, Interval]:
        """Intervals of the grid's own parameters, of zero width for a parameter that has one value on the grid."""
        found = {}
        for name, value in self.group.variant.inner.items():
            values = np.array([mate.variant.inner[name] for mate in self.points])
            values_on_grid = np.unique(values)
            if len(values_on_grid) < 2 or np.any(values_on_grid <= 0):
                found[name] = Interval(float(value), float(value), float(value))
            # What is one of a few numbers lies at one of them.
            elif name in self.group.effect.doubt.exact:
                likely = values[self.log_likelihood > self.log_likelihood.max() - self.drop]
                found[name] = Interval(float(value), float(min(value, *likely)), float(max(value, *likely)))
            else:
                falls = np.array([self.log_likelihood[values == point].max() for point in values_on_grid])
                found[name] = profile_interval(np.log(values_on_grid), falls, self.drop)
        return found

    def widen(
        self, best: Mapping[str, Interval], session: SessionContext, deviation: Float[Array, " k"]
    ) -> dict[str, Interval]:
        """Parameters with intervals that hold those of all points within the drop.

        Args:
            best: Parameters of the best point.
            session: The runs from which parameters are computed.
            deviation: Standard deviations of the best point's coefficients.
        """
        effect, found = self.group.effect, dict(best)
        own = self.points.index(self.group)
        ratio = deviation / np.sqrt(np.maximum(np.diag(_inverse(self.information[own])), LEAST_POWER))
        falls = np.maximum(self.log_likelihood[own] - self.log_likelihood, 0.0)
        for k in np.flatnonzero((falls < self.drop) & (np.arange(len(falls)) != own)):
            covariance = np.outer(ratio, ratio) * _inverse(self.information[k])
            variant = self.points[k].variant
            others = effect.parameters(session, self.group.joint, variant, self.coefficients[k], covariance)
            narrowing = float(np.sqrt(1.0 - falls[k] / self.drop))
            found = {name: unite(one, others[name], narrowing, name) for name, one in found.items()}
        return found


def profile(search: Candidates, projection: Projection, group: Group, inflation: float) -> Profile:
    """The profile of an accepted effect beside the other effects.

    Args:
        search: Search over the sums of the fine grids.
        projection: The model without the effect.
        group: The effect at the point whose parameters are reported.
        inflation: Variance inflation.
    """
    scale = search.evidence.scale
    # A point with more columns is another form of the law, with other coefficients.
    width = len(group.columns)
    points = tuple(
        other
        for other in search.evidence.layout.groups
        if other.key == group.key
        and len(other.columns) == width
        and other.variant.inner.keys() == group.variant.inner.keys()
    )
    solved = [search.gain_of(projection, point) for point in points]
    gains = np.array([gain for gain, _ in solved]) / inflation
    drop, share = search.settings.interval_fall, group.effect.doubt.share
    law_error = 0.5 * share**2 * float(gains[points.index(group)])
    information = tuple(
        projection.rest(mate.columns) * np.outer(scale[mate.columns], scale[mate.columns]) for mate in points
    )
    coefficients = tuple(beta / scale[point.columns] for point, (_, beta) in zip(points, solved, strict=True))
    return Profile(group, points, 0.5 * gains * drop / (drop + law_error), coefficients, information, drop)


def _inverse(information: Float[Array, "k k"]) -> Float[Array, "k k"]:
    """Covariance from information, regularised in directions that have none."""
    scale = np.sqrt(np.maximum(np.diag(information), LEAST_POWER))
    even = information / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
    return np.asarray(np.linalg.inv(even) / np.outer(scale, scale))
