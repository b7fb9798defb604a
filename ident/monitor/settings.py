"""Numbers that decide, each with its unit, its meaning and where it comes from: when a
change from day to day is an alarm.

The chance of any false alarm in an arm's life is the user's: `ident.command_options.WatchOptions`.
"""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class AlarmSettings(Numbers):
    """Alarms over an arm's life."""

    least_before: int = number(
        3,
        "sessions",
        "sessions before the first change that is looked for",
        "law: three give a mean and a spread",
    )
    change_size: float = number(
        2.0,
        "1",
        "prior spread of a change, in day-to-day spreads",
        "chosen: changes that matter are one to five of them",
    )
    half_weight: float = number(
        30.0,
        "sessions",
        "half of all weight lies on changes within so many sessions after the first ones",
        "chosen: half a year of weekly sessions",
    )
    most_growth: float = number(
        20.0,
        "1",
        "most that one session may multiply the evidence with",
        "calibrated: in drawn arm-years of 34 parameters, level 5 %, an alarm of none of 100 with "
        "normal days, none of 100 with Student's t of three degrees of freedom, 10 of 160 with "
        "lognormal days; without it one parameter in twelve of such t-distributed days reaches an "
        "arm's alarm",
    )
    rounding: float = number(
        1e-12,
        "1",
        "differences below this share of the values are rounding",
        "law: some last digits",
    )
    outlier_level: float = number(
        0.05,
        "1",
        "chance of a false hint of an outlier in one look at an arm",
        "chosen: usual",
    )
    least_others: int = number(
        4,
        "sessions",
        "other sessions by which the usual is known",
        "chosen: a spread of three degrees of freedom",
    )
    hint: float = number(
        10.0,
        "1",
        "evidence of one parameter alone from which on it is a hint, no alarm yet",
        "calibrated: of arms in which nothing changes one look in twenty has one (32 parameters, "
        "normal days, 1 to 40 sessions)",
    )
    worst_error: float = number(
        2.0,
        "1",
        "times the usual error from which on a session says nothing of day-to-day spread and is "
        "passed over; it follows from its motions alone",
        "chosen: twice",
    )
    agree: float = number(
        0.01,
        "1",
        "chance below which changes of a joint's parameters do not agree on one factor",
        "chosen: one in a hundred",
    )
    changed: float = number(
        3.0,
        "1",
        "standard errors beyond which a parameter has changed",
        "chosen: one in four hundred",
    )
    least_changed: int = number(
        2,
        "parameters",
        "of a joint that must have changed for a common factor",
        "law: one agrees with itself",
    )


ALARMS = AlarmSettings()
