"""Alarms of an arm: which parameter changed, since when, by how much.

Null hypothesis: the values x₁, x₂, … of a parameter are independent draws of one normal
distribution, whose mean and spread (that of one day from the next, errors of measurement included)
nobody knows. Alternative: from session k + 1 on the mean is shifted by δ times the spread, δ ~ N(0,
c²). With the right Haar prior on mean and spread, under both, the Bayes factor of the first m
values depends on their maximal invariant alone, whose law is the same for every mean and spread:

    B_k(m) = (1 + c² d'd)^(-1/2) · [ S / (S - c² (d'x)² / (1 + c² d'd)) ]^((m - 1)/2),

d the step at k less its mean, S the sum of squares about the mean. So under the null hypothesis B_k
is a martingale that starts at 1, whatever the spread. Its growth from one session to the next is
cut at `most_growth`, which makes it a supermartingale: one odd session, in days that are not
normally distributed, can't raise an alarm alone. Over all k the evidence is a sum with weights w_k
that add up to one, the weight of changes that are still to come counting as it is. Then by Ville's
inequality

    P( the evidence ever reaches 1/α ) ≤ α,

however often one looks and whenever one stops. Values that drift slowly are caught too, as a change
that goes on.

Not covered: days that depend on each other (a season, one week of heat). Those look like a change,
and are one.

Source: Ville 1939; Robbins 1970 (mixtures); Lai 1976 and Wang and Ramdas 2024 (unknown variance,
anytime-valid t-test); Pérez-Ortiz et al. 2024 (e-statistics by group invariance); Shin, Ramdas and
Rinaldo 2023 (sums over change points).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from scipy.special import chdtrc, ndtri, stdtr, stdtrit

from ident.arrays import Array, Float, Int
from ident.command_options import WatchOptions
from ident.monitor.estimates import ParameterEstimate
from ident.monitor.parameters import SCALED, UNITS
from ident.monitor.settings import ALARMS as LIMIT
from ident.records import Record


def prior_weight(before: Float[Array, " k"] | Array) -> Float[Array, " k"]:
    """Weight of a change after so many values: 1 over the square for late ones, adds up to one over
    all.
    """
    place = before - LIMIT.least_before
    return LIMIT.half_weight / ((place + LIMIT.half_weight) * (place + LIMIT.half_weight + 1.0))


class EProcess:
    """The evidence of a change in one parameter, value by value."""

    def __init__(self) -> None:
        self._values: list[float] = []
        # Logarithms of the bets on each change, as cut and as they are, by the number of values
        # before the change.
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
        if m <= LIMIT.least_before:
            return self.evidence
        before = np.arange(LIMIT.least_before, m)
        now = self._log_bayes_factors(before)
        last = np.append(self._last, 0.0)
        grown = np.append(self._grown, 0.0)
        self._grown = grown + np.minimum(now - last, np.log(LIMIT.most_growth))
        self._last = now
        weight = prior_weight(before)
        share = weight * np.exp(np.minimum(self._grown, 700.0))
        self.evidence = float(share.sum() + 1.0 - weight.sum())
        self.before = int(before[np.argmax(share)])
        return self.evidence

    def _log_bayes_factors(self, before: Int[Array, " k"]) -> Float[Array, " k"]:
        """log B_k of the values so far, for changes after `before` of them."""
        x = np.array(self._values) - self._values[0]
        m = len(x)
        sums = np.cumsum(x)
        squares = float(x @ x)
        spread = max(squares - sums[-1] ** 2 / m, LIMIT.rounding * squares, 1e-300)
        after = m - before
        length = before * after / m
        along = sums[-1] - sums[before - 1] - after * sums[-1] / m
        variance = LIMIT.change_size**2
        explained = variance * along**2 / (1.0 + variance * length)
        left = np.maximum(spread - explained, LIMIT.rounding * spread)
        ratio = np.log(spread / left)
        price = np.log1p(LIMIT.change_size**2 * length)
        return 0.5 * (m - 1) * ratio - 0.5 * price


# Outliers: sessions in which one parameter is far from all its other days, as when a tool was left
# on. No alarm, a hint. Each estimate is held against the mean and spread of the parameter's other
# sessions since its last change (deleted residual, Student's t); the level is shared between all
# estimates of the arm (Bonferroni). So a look at normal days has a false hint with that chance;
# unlike an alarm's, it is one look's, not that of all looks together.


@dataclass(frozen=True)
class Outlier(Record):
    """An estimate that one session alone has."""

    arm: str  # what
    joint: str
    figure: str
    session: str
    value: float  # the estimate there
    usual: float  # mean and standard deviation of the other sessions
    spread: float
    p_value: float  # of a value so far off, before it is shared


def find_outliers(
    arm: str, history: Mapping[tuple[str, str], Sequence[Point]], alarms: Sequence[Alarm]
) -> tuple[Outlier, ...]:
    """The most extreme estimate of each session that stands out.

    Days before and after a change, which the alarms tell, are not compared.
    """
    tests = sum(len(points) for points in history.values())
    outliers: dict[str, Outlier] = {}
    for (joint, figure), points in history.items():
        starts = {alarm.since for alarm in alarms if (alarm.joint, alarm.figure) == (joint, figure)}
        stretch = list(accumulate(point.session in starts for point in points))
        for i, point in enumerate(points):
            others = np.array(
                [
                    other.value
                    for k, other in enumerate(points)
                    if stretch[k] == stretch[i] and k != i
                ]
            )
            if len(others) < LIMIT.least_others:
                continue
            usual = float(others.mean())
            spread = float(others.std(ddof=1))
            # An estimate that is itself uncertain may lie as far off as its own error allows.
            of_others = max(spread, 1e-300) * np.sqrt(1.0 + 1.0 / len(others))
            scale = float(np.hypot(of_others, point.std))
            distance = abs(point.value - usual) / scale
            p = 2.0 * float(stdtr(len(others) - 1, -distance))
            known = outliers.get(point.session)
            if p * tests < LIMIT.outlier_level and (known is None or p < known.p_value):
                outliers[point.session] = Outlier(
                    arm, joint, figure, point.session, point.value, usual, spread, p
                )
    return tuple(outliers.values())


# Alarms of an arm: which parameter changed, since when, by how much. The evidence of all parameters
# of an arm is averaged: an average of such evidence is evidence again, whatever the parameters have
# to do with each other. An alarm is raised when it reaches 1 over the level. So over an arm's whole
# life the chance of any alarm without a change is at most the level, however many parameters there
# are. After an alarm the parameters that it names start anew, the others go on with what evidence
# they had taken away, and the same holds for the next alarm. Where all parameters of a joint that
# are in units of torque changed by one factor, it is the torque's scale that has changed: another
# current gain, another firmware, another drive. For each, r = log(mean after / mean before); these
# must agree (their spread about the weighted mean by χ²), several must have changed, and the common
# change must be sure.


@dataclass(frozen=True)
class Point(ParameterEstimate):
    """An estimate by one session alone: the session's name and its date, ISO."""

    session: str
    date: str


@dataclass(frozen=True)
class Alarm(Record):
    """A parameter of an arm that has changed."""

    arm: str  # what
    joint: str
    figure: str
    session: str  # after which session that was found
    since: str  # the first session after the change, as far as that can be known
    # of this parameter: how many times better a change explains its values than none
    evidence: float
    # that something of the arm changed, where a change was as likely as none before
    probability: float
    before: float  # mean of its estimates
    after: float
    low: float  # 95 % interval of the change
    high: float
    spread: float  # day-to-day standard deviation before the change
    # factor by which all parameters of the joint changed alike, if they did
    scale: float | None = None
    scale_low: float | None = None
    scale_high: float | None = None


class _Stream:
    """The values of one parameter since it started anew, and what evidence they hold."""

    def __init__(self) -> None:
        self.points: list[Point] = []
        self.bets = EProcess()
        self.taken = 1.0  # what was taken away at alarms of other parameters

    @property
    def evidence(self) -> float:
        """What speaks for a change, less what was taken away."""
        return self.bets.evidence / self.taken

    def take(self, point: Point) -> None:
        """One more session."""
        usual = np.median([point.std for point in self.points]) if self.points else np.inf
        if point.std <= LIMIT.worst_error * usual:
            self.points.append(point)
            self.bets.add(point.value)


def find_changes(
    arm: str,
    history: Mapping[tuple[str, str], Sequence[Point]],
    order: Sequence[str],
    level: float = WatchOptions.level,
) -> tuple[tuple[Alarm, ...], Alarm | None]:
    """All alarms in an arm's history, as they would have been raised session by session, and what
    may be the next.

    Args:
        arm: Its name.
        history: (joint, parameter) -> its points.
        order: Names of the sessions in order of time.
        level: Chance of any false alarm in the arm's life.

    Returns:
        The alarms; the parameter that speaks most for a change that is none yet, if one does.
    """
    streams = {key: _Stream() for key in history}
    # All that the joints could have: one that first appears later must not change what was reported
    # before.
    joints = {joint for joint, _ in history}
    count = max(len(streams), len(joints) * len(UNITS))
    by_session: dict[str, list[tuple[tuple[str, str], Point]]] = {}
    for name in order:
        by_session[name] = []
    for key, points in history.items():
        for point in points:
            by_session[point.session].append((key, point))
    alarms: list[Alarm] = []
    evidence = 1.0
    for session in order:
        for key, point in by_session[session]:
            streams[key].take(point)
        evidence = (
            sum(stream.evidence for stream in streams.values()) + count - len(streams)
        ) / max(count, 1)
        if evidence < 1.0 / level:
            continue
        # The parameter with most evidence, and every other that would have been enough alone.
        ranked = sorted(streams, key=lambda key: -streams[key].evidence)
        enough = count / level
        named = []
        for i, key in enumerate(ranked):
            if i == 0 or streams[key].evidence >= enough:
                named.append(key)
        raised = [_describe(arm, key, streams, session, evidence) for key in named]
        alarms += raised
        # Where the torque's scale has changed, all parameters that follow it have.
        named += [
            (change.joint, name) for change in raised if change.scale is not None for name in SCALED
        ]
        for key, stream in streams.items():
            stream.taken *= max(1.0, stream.evidence)
            if key in named:
                streams[key] = _Stream()
    first = max(streams, key=lambda key: streams[key].evidence, default=None)
    if first is None or streams[first].evidence < LIMIT.hint:
        return tuple(alarms), None
    return tuple(alarms), _describe(arm, first, streams, order[-1], evidence)


def _describe(
    arm: str,
    key: tuple[str, str],
    streams: Mapping[tuple[str, str], _Stream],
    session: str,
    evidence: float,
) -> Alarm:
    """The alarm of a parameter, by the evidence of all."""
    stream = streams[key]
    values = np.array([point.value for point in stream.points])
    early = values[: stream.bets.before]
    late = values[stream.bets.before :]
    # 95 % interval of the difference of means, both with the same spread.
    free = len(values) - 2
    change = float(late.mean() - early.mean())
    square_early = ((early - early.mean()) ** 2).sum()
    square_late = ((late - late.mean()) ** 2).sum()
    square = square_early + square_late
    variance = square / free * (1 / len(early) + 1 / len(late))
    quantile = float(stdtrit(free, 0.975))
    half = quantile * float(np.sqrt(variance))
    past = {point.session for point in stream.points[: stream.bets.before]}
    before: dict[str, list[float]] = {}
    after: dict[str, list[float]] = {}
    for (joint, name), other in streams.items():
        for point in other.points if joint == key[0] else ():
            (before if point.session in past else after).setdefault(name, []).append(point.value)
    scale = gain_change(before, after)
    return Alarm(
        arm=arm,
        joint=key[0],
        figure=key[1],
        session=session,
        since=stream.points[stream.bets.before].session,
        evidence=float(min(stream.evidence, 1e300)),
        probability=evidence / (1.0 + evidence),
        before=float(early.mean()),
        after=float(late.mean()),
        low=change - half,
        high=change + half,
        spread=float(early.std(ddof=1)),
        **(
            {}
            if scale is None
            else dict(zip(("scale", "scale_low", "scale_high"), scale, strict=True))
        ),
    )


def gain_change(
    before: Mapping[str, Sequence[float]], after: Mapping[str, Sequence[float]]
) -> tuple[float, float, float] | None:
    """The factor on a joint's torque with its 95 % interval; None where its parameters did not
    change alike.

    Args:
        before: Values of each figure before the change, by its name.
        after: Those after it.

    Returns:
        The factor, then the low and the high end.
    """
    ratios = []
    variances = []
    for name in SCALED:
        early, late = (np.array(values.get(name, ())) for values in (before, after))
        if len(early) < 2 or len(late) < 2:
            continue
        if early.mean() <= 0.0 or late.mean() <= 0.0:
            continue
        # Days differ as much after the change as before: both show the spread.
        square_early = ((early - early.mean()) ** 2).sum()
        square_late = ((late - late.mean()) ** 2).sum()
        square = square_early + square_late
        of_early = 1 / len(early) / early.mean() ** 2
        of_late = 1 / len(late) / late.mean() ** 2
        variance = square * (of_early + of_late)
        ratios.append(np.log(late.mean() / early.mean()))
        variances.append(max(variance / (len(early) + len(late) - 2), 1e-12))
    if len(ratios) < LIMIT.least_changed:
        return None
    r = np.array(ratios)
    v = np.array(variances)
    mean = float((r / v).sum() / (1 / v).sum())
    error = float((1 / v).sum() ** -0.5)
    misfit = float(((r - mean) ** 2 / v).sum())
    alike = chdtrc(len(r) - 1, misfit) > LIMIT.agree
    in_errors = np.sign(mean) * r / np.sqrt(v)
    changed = int((in_errors > LIMIT.changed).sum())
    several = changed >= LIMIT.least_changed
    if not (alike and several):
        return None
    reach = float(ndtri(0.975)) * error
    low = float(np.exp(mean - reach))
    high = float(np.exp(mean + reach))
    return float(np.exp(mean)), low, high
