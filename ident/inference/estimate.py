"""The chosen effects as a person reads them: parameters with intervals, probability, class,
reasons.

Intervals are of the joint posterior of all effects, losses and inertias, discrepancies integrated
out; nonlinear parameters by profile likelihood over the fine grid. They are given twice: for the
URDF's inertias as they are, which is what the recordings determine, and with the URDF's own error
in them.

The probability is that of the effect's class (`calibration`); within the class each effect has the
share exp(−T d), d its deficit in log evidence and T the fitted temper.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ident.arrays import Float
from ident.effects.base import Interval, SessionContext, impossible
from ident.inference.calibration import NameCalibration, Widths, left_of_kind, sizes_of
from ident.inference.feature_words import FEATURE_WORDS
from ident.inference.features import SHAPE_LEFT, Described
from ident.inference.profile import Profile
from ident.inference.search import SetSearch, rest_of
from ident.inference.solution import Solution
from ident.regression.design import Group

# Odds within which two effects are told as one class (the method's own definition).
CLASS_ODDS = 20.0


@dataclass(frozen=True)
class Reason:
    """What speaks for an effect, or against it.

    Attributes:
        feature: Its name.
        weight: What it adds to the log odds [nats]; above 0 speaks for the effect.
        words: How it is said; empty for the usual words of the feature.
    """

    feature: str  # name of the feature
    weight: float  # what it adds to the log odds [nats]
    words: str = ""  # where the feature's own words are too general

    @property
    def what(self) -> str:
        """The reason in words: its own or, where it has none, those of its feature."""
        if self.words:
            return self.words
        speaks_for, speaks_against = FEATURE_WORDS[self.feature]
        return speaks_for if self.weight > 0.0 else speaks_against

    def to_dict(self) -> dict[str, Any]:
        """Its entry in a record.

        Returns:
            `for` (whether it speaks for the effect), `what` (the words) and `weight` (its absolute
            weight in the log odds [nats]).
        """
        return {"for": self.weight > 0.0, "what": self.what, "weight": abs(self.weight)}


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters, probability and rivals of one chosen effect."""

    group: Group  # the effect at its best point of the coarse grid
    parameters: dict[str, Interval]  # physical parameters with 95 % intervals
    probability: float  # that this effect is the cause, and none of its rivals
    rivals: tuple[str, ...]  # its class: ids that can't be distinguished from it, itself first
    refined: Group  # the effect at the point of the fine grid to which the parameters belong
    coefficients: Float[np.ndarray, " k"]  # estimates there
    covariance: Float[np.ndarray, "k k"]  # covariance of the coefficients
    odds: Mapping[str, float]  # odds of the effect against each rival, by the rival's id
    places: Mapping[int, float] = field(default_factory=dict)  # the same at other joints, by index
    reasons: tuple[Reason, ...] = ()  # why it has this probability, the largest first

    @property
    def shares(self) -> dict[str, float]:
        """Probability of each effect that explains the same torque, by id, its own first."""
        itself = {self.rivals[0]: self.probability}
        return itself | {
            name: self.probability / self.odds[name]
            for name in self.rivals[1:]
            if name in self.odds
        }

    @property
    def class_probability(self) -> float:
        """Probability, at most 1, that this effect, one of its rivals, or the same effect at
        another joint is the cause.
        """
        elsewhere = (self.probability / odds for odds in self.places.values())
        return min(sum((*self.shares.values(), *elsewhere)), 1.0)


def estimate(
    described: Sequence[Described],
    session: SessionContext,
    calibration: NameCalibration,
) -> list[Estimate]:
    """Estimates of some effects, each in its own set, in their order.

    Args:
        described: The effects with their features, rivals and sums.
        session: The runs.
        calibration: The fitted numbers.
    """
    estimates = []
    for effect in described:
        solution = effect.solution
        given, beta, covariance = _parameters(solution, solution.fixed, effect.group, session)
        free, _, _ = _parameters(solution, solution.search, effect.group, session)
        left = float(left_of_kind(effect.features.get(SHAPE_LEFT, -np.inf)))
        parameters = widened(given, free, calibration.widths, left)
        parts = calibration.names.parts(effect.features)
        ordered = sorted(parts.items(), key=lambda reason: -abs(reason[1]))
        sure = calibration.names.probability(effect.features)
        reasons = [Reason(name, nats) for name, nats in ordered]
        outside = impossible(effect.group.effect, session, effect.group.joint, given)
        if outside is not None:
            sure *= calibration.unlike_any_arm
            nats = float(np.log(calibration.unlike_any_arm))
            reasons.insert(0, Reason("unlike_any_arm", nats, outside))
        shares, odds, places = _shares(effect, calibration.temper_of(effect.features))
        classed = [name for name in sorted(odds, key=odds.__getitem__) if odds[name] <= CLASS_ODDS]
        estimates.append(
            Estimate(
                group=effect.coarse,
                parameters=parameters,
                probability=sure * shares,
                rivals=(effect.group.effect.id, *classed),
                refined=effect.group,
                coefficients=beta,
                covariance=covariance,
                odds=odds,
                places=places,
                reasons=tuple(reasons),
            )
        )
    return estimates


def _parameters(
    solution: Solution, spread: SetSearch, group: Group, session: SessionContext
) -> tuple[dict[str, Interval], Float[np.ndarray, " k"], Float[np.ndarray, "k k"]]:
    """Parameters of an effect at its best point, with its coefficients and their covariance.

    Args:
        solution: Sums that the estimates come from.
        spread: Sums that the covariances come from.
        group, session: One of the effects, and the runs.
    """
    search = solution.search
    others = rest_of(solution.chosen, group)
    width = len(group.columns)
    points = tuple(
        point
        for point in search.names.groups
        if point.key == group.key
        and len(point.columns) == width
        and point.variant.inner.keys() == group.variant.inner.keys()
    )
    nats = []
    coefficients = []
    covariances = []
    for point in points:
        chosen = [*others, point]
        nats.append(search.nats(chosen))
        coefficients.append(search.coefficients(chosen)[point])
        covariances.append(spread.covariance(chosen, point))
    profile = Profile(group, points, np.array(nats), tuple(coefficients), tuple(covariances))
    best = points.index(group)
    return profile.parameters(session), coefficients[best], covariances[best]


def widened(
    given: Mapping[str, Interval],
    free: Mapping[str, Interval],
    widths: Widths | None,
    left: float,
) -> dict[str, Interval]:
    """Parameters with intervals as wide as the corpus asks for.

    Args:
        given, free: An effect's parameters for the URDF as it is, and for one that may be off.
        widths: The fitted numbers; None for intervals as the recordings alone have them.
        left: Torque that a smooth function still finds beside the effect, as a share of its own.

    Returns:
        Intervals by the names of `given`, about its values.
    """
    sizes = sizes_of({name: interval.value for name, interval in given.items()})
    parameters = {}
    for name, interval in given.items():
        fit = Fit(name, sizes[name], left, widths)
        parameters[name] = _both(fit, interval, free[name])
    return parameters


@dataclass(frozen=True)
class Fit:
    """What the width of one parameter's interval is worked out from."""

    parameter: str
    size: float  # what the law's share is of
    left: float  # torque that a smooth function still finds beside the law, as a share of the law's
    widths: Widths | None  # fitted numbers; None for intervals as the recordings alone have them


def _both(fit: Fit, given: Interval, free: Interval) -> Interval:
    """An interval for the URDF as it is, with that of a URDF that may be off beside it."""
    given = _wider(fit, given)
    free = _wider(fit, free)
    low = min(given.low, free.low)
    high = max(given.high, free.high)
    return replace(given, low_with_urdf=low, high_with_urdf=high)


def _wider(fit: Fit, interval: Interval) -> Interval:
    """An interval as wide as the corpus asks for.

    Ends that are open stay, and none crosses zero that did not.
    """
    value = interval.value
    if fit.widths is None or not np.isfinite(value) or interval.low == interval.high:
        return interval
    below = fit.widths.half_width(fit.parameter, value - interval.low, fit.size, fit.left)
    above = fit.widths.half_width(fit.parameter, interval.high - value, fit.size, fit.left)
    low = interval.low if interval.open in ("low", "both") else value - below
    high = interval.high if interval.open in ("high", "both") else value + above
    if interval.low >= 0.0:
        low = max(low, 0.0)
    if interval.high <= 0.0:
        high = min(high, 0.0)
    return replace(interval, low=low, high=high)


def _shares(
    described: Described, temper: float
) -> tuple[float, dict[str, float], dict[int, float]]:
    """An effect's share of its class, its odds against other effects and other joints."""
    odds: dict[str, float] = {}
    places: dict[int, float] = {}
    for (effect, joint, _), deficit in described.rivals.items():
        against = float(np.exp(np.clip(temper * deficit, -50.0, 50.0)))
        if effect != described.group.effect.id:
            odds[effect] = min(odds.get(effect, np.inf), against)
        elif joint != described.group.joint and against <= CLASS_ODDS:
            places[joint] = min(places.get(joint, np.inf), against)
    others = sum(1.0 / value for value in odds.values() if value <= CLASS_ODDS)
    others += sum(1.0 / value for value in places.values())
    return 1.0 / (1.0 + others), odds, places
