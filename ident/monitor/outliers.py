"""Outliers: sessions in which one parameter is far from all its other days, as when a tool was left on.

No alarm, a hint. Each estimate is held against the mean and spread of the parameter's other sessions since its last
change (deleted residual, Student's t); the level is shared between all estimates of the arm (Bonferroni). So a look at
normal days has a false hint with that chance; unlike an alarm's, it is one look's, not that of all looks together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from scipy.special import stdtr

from ident.monitor.alarms import Alarm, Point
from ident.records import Record

# Chance of a false hint in one look at an arm.
LEVEL = 0.05
# Other sessions by which the usual is known.
LEAST_OTHERS = 4


@dataclass(frozen=True)
class Outlier(Record):
    """An estimate that one session alone has.

    Attributes:
        arm, joint, figure, session: What.
        value: The estimate there.
        usual, spread: Mean and standard deviation of the other sessions.
        p_value: Of a value so far off, before it is shared.
    """

    arm: str
    joint: str
    figure: str
    session: str
    value: float
    usual: float
    spread: float
    p_value: float


def find_outliers(
    arm: str, history: Mapping[tuple[str, str], Sequence[Point]], alarms: Sequence[Alarm], level: float = LEVEL
) -> tuple[Outlier, ...]:
    """The most extreme estimate of each session that stands out.

    Args:
        arm: Its name.
        history: (joint, parameter) -> its points, in order of time.
        alarms: What has changed: days before and after are not compared.
        level: Chance of a false hint.
    """
    tests = sum(len(points) for points in history.values())
    found: dict[str, Outlier] = {}
    for (joint, figure), points in history.items():
        starts = {alarm.since for alarm in alarms if (alarm.joint, alarm.figure) == (joint, figure)}
        stretch = list(accumulate(point.session in starts for point in points))
        for i, point in enumerate(points):
            others = np.array([one.value for k, one in enumerate(points) if stretch[k] == stretch[i] and k != i])
            if len(others) < LEAST_OTHERS:
                continue
            usual, spread = float(others.mean()), float(others.std(ddof=1))
            # An estimate that is itself uncertain may lie as far off as its own error allows.
            scale = float(np.hypot(max(spread, 1e-300) * np.sqrt(1.0 + 1.0 / len(others)), point.std))
            p = 2.0 * float(stdtr(len(others) - 1, -abs(point.value - usual) / scale))
            known = found.get(point.session)
            if p * tests < level and (known is None or p < known.p_value):
                found[point.session] = Outlier(arm, joint, figure, point.session, point.value, usual, spread, p)
    return tuple(found.values())
