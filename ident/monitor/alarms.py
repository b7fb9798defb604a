"""Alarms of an arm: which parameter changed, since when, by how much.

The evidence of all parameters of an arm is averaged: an average of such evidence is evidence again, whatever the
parameters have to do with each other. An alarm is raised when it reaches 1 over the level. So over an arm's whole life
the chance of any alarm without a change is at most the level, however many parameters there are. After an alarm the
parameters that it names start anew, the others go on with what evidence they had taken away, and the same holds for the
next alarm.

Where all parameters of a joint that are in units of torque changed by one factor, it is the torque's scale that has
changed: another current gain, another firmware, another drive. For each, r = log(mean after / mean before); these must
agree (their spread about the weighted mean by χ²), several must have changed, and the common change must be sure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, ndtri, stdtrit

from ident.monitor.e_process import EProcess
from ident.monitor.estimates import UNITS, ParameterEstimate
from ident.records import Record

# Chance of any false alarm in an arm's life.
LEVEL = 0.05
# Evidence of one parameter alone from which on it is a hint, no alarm yet: of arms in which nothing changes, one
# look in twenty has one (32 parameters, normal days, 1 to 40 sessions).
HINT = 10.0
# A session whose estimate is this many times less certain than is usual says nothing about day-to-day spread: it is
# passed over. Whether it is follows from its motions alone, not from what they gave.
WORST_ERROR = 2.0
# Parameters that follow the torque's scale.
SCALED = ("gain", "rotor", "viscous", "coulomb")
# They agree unless so improbable; one has changed beyond so many standard errors; so many of them must have.
AGREE, CHANGED, LEAST_CHANGED = 0.01, 3.0, 2


@dataclass(frozen=True)
class Point(ParameterEstimate):
    """An estimate by one session alone: the session's name and its date, ISO."""

    session: str
    date: str


@dataclass(frozen=True)
class Alarm(Record):
    """A parameter of an arm that has changed.

    Attributes:
        arm, joint, figure: What.
        session: After which session that was found.
        since: The first session after the change, as far as that can be known.
        evidence: Of this parameter: how many times better a change explains its values than none.
        probability: That something of the arm changed, where a change was as likely as none before.
        before, after: Mean of its estimates.
        low, high: 95 % interval of the change.
        spread: Day-to-day standard deviation before the change.
        scale, scale_low, scale_high: Factor by which all parameters of the joint changed alike, if they did.
    """

    arm: str
    joint: str
    figure: str
    session: str
    since: str
    evidence: float
    probability: float
    before: float
    after: float
    low: float
    high: float
    spread: float
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
        usual = np.median([one.std for one in self.points]) if self.points else np.inf
        if point.std <= WORST_ERROR * usual:
            self.points.append(point)
            self.bets.add(point.value)


def find_changes(
    arm: str, history: Mapping[tuple[str, str], Sequence[Point]], order: Sequence[str], level: float = LEVEL
) -> tuple[tuple[Alarm, ...], Alarm | None]:
    """All alarms in an arm's history, as they would have been raised session by session, and what may be the next.

    Args:
        arm: Its name.
        history: (joint, parameter) -> its points.
        order: Names of the sessions in order of time.
        level: Chance of any false alarm in the arm's life.

    Returns:
        The alarms; the parameter that speaks most for a change that is none yet, if one does.
    """
    streams = {key: _Stream() for key in history}
    # All that the joints could have: one that first appears later must not change what was reported before.
    count = max(len(streams), len({joint for joint, _ in history}) * len(UNITS))
    by_session: dict[str, list[tuple[tuple[str, str], Point]]] = {name: [] for name in order}
    for key, points in history.items():
        for point in points:
            by_session[point.session].append((key, point))
    alarms: list[Alarm] = []
    evidence = 1.0
    for session in order:
        for key, point in by_session[session]:
            streams[key].take(point)
        evidence = (sum(stream.evidence for stream in streams.values()) + count - len(streams)) / max(count, 1)
        if evidence < 1.0 / level:
            continue
        # The parameter with most evidence, and every other that would have been enough alone.
        ranked = sorted(streams, key=lambda key: -streams[key].evidence)
        enough = count / level
        named = [key for i, key in enumerate(ranked) if i == 0 or streams[key].evidence >= enough]
        alarms += [_describe(arm, key, streams, session, evidence) for key in named]
        for key, stream in streams.items():
            stream.taken *= max(1.0, stream.evidence)
            if key in named:
                streams[key] = _Stream()
    first = max(streams, key=lambda key: streams[key].evidence, default=None)
    if first is None or streams[first].evidence < HINT:
        return tuple(alarms), None
    return tuple(alarms), _describe(arm, first, streams, order[-1], evidence)


def _describe(
    arm: str, key: tuple[str, str], streams: Mapping[tuple[str, str], _Stream], session: str, evidence: float
) -> Alarm:
    """The alarm of a parameter, by the evidence of all."""
    stream = streams[key]
    values = np.array([point.value for point in stream.points])
    early, late = values[: stream.bets.before], values[stream.bets.before :]
    # 95 % interval of the difference of means, both with the same spread.
    free, change = len(values) - 2, float(late.mean() - early.mean())
    square = ((early - early.mean()) ** 2).sum() + ((late - late.mean()) ** 2).sum()
    half = float(stdtrit(free, 0.975)) * float(np.sqrt(square / free * (1 / len(early) + 1 / len(late))))
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
        **({} if scale is None else dict(zip(("scale", "scale_low", "scale_high"), scale, strict=True))),
    )


def gain_change(
    before: Mapping[str, Sequence[float]], after: Mapping[str, Sequence[float]]
) -> tuple[float, float, float] | None:
    """The factor on a joint's torque with its 95 % interval; None where its parameters did not change alike.

    Args:
        before, after: Parameter -> its estimates in the sessions before and after a change.
    """
    ratios, variances = [], []
    for name in SCALED:
        early, late = (np.array(values.get(name, ())) for values in (before, after))
        if len(early) < 2 or len(late) < 2 or early.mean() <= 0.0 or late.mean() <= 0.0:
            continue
        # Days differ as much after the change as before: both show the spread.
        square = ((early - early.mean()) ** 2).sum() + ((late - late.mean()) ** 2).sum()
        variance = square * (1 / len(early) / early.mean() ** 2 + 1 / len(late) / late.mean() ** 2)
        ratios.append(np.log(late.mean() / early.mean()))
        variances.append(max(variance / (len(early) + len(late) - 2), 1e-12))
    if len(ratios) < LEAST_CHANGED:
        return None
    r, v = np.array(ratios), np.array(variances)
    mean, error = float((r / v).sum() / (1 / v).sum()), float((1 / v).sum() ** -0.5)
    alike = chdtrc(len(r) - 1, float(((r - mean) ** 2 / v).sum())) > AGREE
    several = int((np.sign(mean) * r / np.sqrt(v) > CHANGED).sum()) >= LEAST_CHANGED
    if not (alike and several):
        return None
    reach = float(ndtri(0.975)) * error
    return float(np.exp(mean)), float(np.exp(mean - reach)), float(np.exp(mean + reach))
