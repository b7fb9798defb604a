"""The pages of a watch: `index.html` for all arms, one page for each arm.

Estimates over the sessions are small SVGs drawn by hand: a page holds dozens, for which a plotting
library takes minutes.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from ident.errors import plural
from ident.monitor.alarms import Alarm, Point
from ident.monitor.parameters import unit_of
from ident.monitor.store import Store
from ident.monitor.watch import ArmHistory, Watch, outlier_line
from ident.records import JsonRecord
from ident.show.report.page import Section, facts_section, write_report
from ident.show.report.words import effect_name, significant

# What a person at the cell does about a parameter that has changed.
ACTIONS = {
    "gain": "check the drive's current scale and firmware, and what the arm carries",
    "rotor": "check coupling and gear: the motor turns another inertia",
    "viscous": "check lubrication and temperature of the gear; warm up before precise work",
    "coulomb": "look for wear, dirt or a tight seal at the joint",
    "offset": "check brake, cables, mounting, and what the arm carries",
    "gap": "run `ident diagnose` on the session: something that the figures do not name has come",
}
NAMES = {
    "gain": "torque per model torque",
    "rotor": "rotor inertia",
    "viscous": "viscous friction",
    "coulomb": "dry friction",
    "offset": "constant torque",
    "gap": "unexplained torque",
}


# Size of a strip, and its margins [px].
WIDTH = 240
HEIGHT = 84
LEFT = 44
RIGHT = 6
TOP = 6
BOTTOM = 16
# An interval that is this many times the range of the values is cut: it would hide them.
WIDEST = 1.0


def write_pages(store: Path, watch: Watch) -> None:
    """Writes all pages into the store."""
    files = Store(store)
    facts = facts_section(watch.provenance.to_dict())
    for arm in watch.arms:
        last = arm.sessions[-1]
        subtitle = (
            f"{plural(len(arm.sessions), 'session')}, {arm.sessions[0]['date'][:10]} to "
            f"{last['date'][:10]}"
        )
        sections = [arm_verdict(arm, watch.level), arm_estimates(arm), arm_sessions(arm), facts]
        write_report(files.page(arm.arm), f"Arm {arm.arm}", sections, subtitle)
    count = sum(len(arm.sessions) for arm in watch.arms)
    sections = [fleet_verdict(watch), fleet_table(watch, files), fleet_effects(watch, files), facts]
    subtitle = f"{plural(len(watch.arms), 'arm')}, {plural(count, 'session')}"
    write_report(store / "index.html", "Arms through time", sections, subtitle)


def alarm_card(alarm: Alarm) -> dict[str, str]:
    """An alarm as text for a page, and what to do about it.

    Returns:
        The texts "arm", "joint", "what", "change", "interval", "spread", "since", "told" (the
        session that told it) and "action".
    """
    unit = unit_of(alarm.figure)
    what = f"{NAMES[alarm.figure]} of {alarm.joint}"
    action = ACTIONS[alarm.figure]
    if alarm.scale is not None:
        size, low, high = (
            100.0 * ((factor or 1.0) - 1.0)
            for factor in (alarm.scale, alarm.scale_low, alarm.scale_high)
        )
        what = f"torque scale of {alarm.joint}"
        action = f"recalibrate the torque or current of {alarm.joint}"
        action += f": all of its figures changed alike, by {size:+.1f} % [{low:.1f}, {high:.1f}]"
    share = ""
    if alarm.before:
        share = f" ({100.0 * (alarm.after - alarm.before) / alarm.before:+.0f} %)"
    return {
        "arm": alarm.arm,
        "joint": alarm.joint,
        "what": what,
        "change": f"{significant(alarm.before, 3)} → {significant(alarm.after, 3)}{unit}{share}",
        "interval": f"change {significant(alarm.low, 2)} to {significant(alarm.high, 2)}{unit}",
        "spread": f"day to day it varies by {significant(alarm.spread, 2)}{unit}",
        "since": alarm.since,
        "told": alarm.session,
        "action": action,
    }


def verdict_section(
    headline: str, alarms: Iterable[Alarm], odd: list[str], **values: Any
) -> Section:
    """One sentence, and every change with what to do."""
    cards = [alarm_card(alarm) for alarm in alarms]
    values |= {"headline": headline, "cards": cards, "odd": odd}
    return Section("verdict", "What has changed", "watch_verdict.html", {"hint": None, **values})


def arm_verdict(arm: ArmHistory, level: float) -> Section:
    """What has changed in an arm, the last first."""
    headline = (
        "Nothing has changed beyond what days differ by, in "
        f"{plural(len(arm.sessions), 'session')}."
    )
    if arm.alarms:
        last = alarm_card(arm.alarms[-1])
        headline = f"The {last['what']} has changed since {last['since']}: {last['change']}."
    hint = None
    if arm.hint is not None:
        card = alarm_card(arm.hint)
        hint = (
            f"{card['what']} may have changed since {card['since']}: {card['change']}. "
            f"That is {arm.hint.evidence:.0f} to 1 for one of {plural(len(arm.figures), 'figure')} "
            "that are watched, too little for an alarm: record another session or two."
        )
    odd = [outlier_line(outlier).removeprefix(f"{arm.arm}: ") for outlier in arm.odd]
    return verdict_section(headline, reversed(arm.alarms), odd, hint=hint, level=level, fleet=False)


def fleet_verdict(watch: Watch) -> Section:
    """What has changed in all arms, the last first."""
    dates = {}
    for arm in watch.arms:
        for row in arm.sessions:
            dates[arm.arm, row["session"]] = row["date"]
    alarms = sorted(watch.alarms, key=lambda alarm: dates[alarm.arm, alarm.session], reverse=True)
    if alarms:
        changed = {alarm.arm for alarm in alarms}
        headline = (
            f"{len(changed)} of {len(watch.arms)} arms have changed; the last: arm {alarms[0].arm}."
        )
    else:
        who = "The arm has not" if len(watch.arms) == 1 else f"None of {len(watch.arms)} arms has"
        headline = f"{who} changed beyond what days differ by."
    odd = [outlier_line(outlier) for arm in watch.arms for outlier in arm.odd]
    return verdict_section(headline, alarms, odd, level=watch.level, fleet=True)


def arm_estimates(arm: ArmHistory) -> Section | None:
    """Every estimate over the dates, with intervals and the changes marked."""
    rows: dict[str, list[JsonRecord]] = defaultdict(list)
    for (joint, name), points in arm.figures.items():
        since = {
            alarm.since for alarm in arm.alarms if (alarm.joint, alarm.figure) == (joint, name)
        }
        rows[joint].append(
            {"name": NAMES[name], "unit": unit_of(name), "strip": lay_out(points), "since": since}
        )
    size = {
        "WIDTH": WIDTH,
        "HEIGHT": HEIGHT,
        "LEFT": LEFT,
        "RIGHT": RIGHT,
        "TOP": TOP,
        "BOTTOM": BOTTOM,
    }
    return (
        Section("figures", "Estimates over time", "watch_figures.html", {"rows": rows, **size})
        if rows
        else None
    )


def lay_out(points: Sequence[Point]) -> JsonRecord:
    """Where one parameter's estimates lie in their strip, in order of time, and the ends of its
    scale.

    Returns:
        "marks", "low" and "high".
    """
    try:  # dates as days, or places in the row where one is no date
        times = [datetime.fromisoformat(point.date).timestamp() / 86400.0 for point in points]
    except ValueError:
        times = [float(i) for i in range(len(points))]
    values = [point.value for point in points]
    reach = max(max(values) - min(values), 1e-3 * max(map(abs, values)), 1e-12)
    low = max(min(point.low for point in points), min(values) - WIDEST * reach)
    high = min(max(point.high for point in points), max(values) + WIDEST * reach)
    span = max(times[-1] - times[0], 1e-9)

    def y(value: float) -> float:
        inside = min(max(value, low), high)
        share = (inside - low) / max(high - low, 1e-12)
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * share

    marks = []
    for time, point in zip(times, points, strict=True):
        share = (time - times[0]) / span if len(times) > 1 else 0.5
        x = LEFT + (WIDTH - LEFT - RIGHT) * share
        marks.append(
            (
                point,
                f"{x:.1f}",
                *(f"{y(value):.1f}" for value in (point.value, point.low, point.high)),
            )
        )
    return {"marks": marks, "low": low, "high": high}


def arm_sessions(arm: ArmHistory) -> Section:
    """All sessions, the last first: what the diagnosis found, or why there is none."""
    effects: dict[str, list[str]] = defaultdict(list)
    for row in arm.effects:
        effects[row["session"]].append(f"{effect_name(row['effect'])} ({row['joints']})")
    said = {
        row["session"]: (
            row["reason"] if row["status"] != "done" else (row["verdict"] or "").replace("_", " ")
        )
        or ""
        for row in arm.sessions
    }
    return Section(
        "sessions",
        "Sessions",
        "watch_sessions.html",
        {"arm": arm, "said": said, "effects": effects},
    )


def fleet_table(watch: Watch, store: Store) -> Section:
    """A line an arm; sorted by a click on a heading, filtered by a word."""
    heads = ["arm", "sessions", "unfit", "last", "changes", "last change"]
    diagnosed = any(row["verdict"] for arm in watch.arms for row in arm.done)
    heads += ["effects in the last session"] * diagnosed
    values = {
        "arms": watch.arms,
        "store": store,
        "heads": heads,
        "diagnosed": diagnosed,
        "NAMES": NAMES,
    }
    return Section("arms", "Arms", "watch_arms.html", values)


def fleet_effects(watch: Watch, store: Store) -> Section | None:
    """Which arms share which effect, by the last session of each."""
    shared: dict[str, dict[str, str]] = defaultdict(dict)
    for arm in sorted(watch.arms, key=lambda history: history.arm):
        for row in arm.last_effects:
            shared[effect_name(row["effect"])][arm.arm] = row["joints"]
    rows = sorted(shared.items(), key=lambda entry: -len(entry[1]))
    values = {"rows": rows, "count": len(watch.arms), "store": store}
    present = any(arm.effects for arm in watch.arms)
    return (
        Section("effects", "Which arms share which effect", "watch_effects.html", values)
        if present
        else None
    )
