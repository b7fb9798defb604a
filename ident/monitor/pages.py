"""The pages of a watch: `index.html` for all arms, one page for each arm."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ident.errors import plural
from ident.monitor.alarms import Alarm
from ident.monitor.estimates import UNITS
from ident.monitor.history_strip import draw_strip
from ident.monitor.store import Store
from ident.monitor.watch import ArmHistory, Watch, tell_odd
from ident.show.report.numbers import significant
from ident.show.report.page import Section, write_report
from ident.show.report.provenance import FactsSection
from ident.show.report.words import effect_name

# What a person at the cell does about a figure that has changed.
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


def write_pages(store: Path, found: Watch) -> None:
    """Writes all pages into the store.

    Args:
        store: Its folder.
        found: All that is in it.
    """
    kept = Store(store)
    facts = FactsSection(found.provenance.to_dict())
    for arm in found.arms:
        last = arm.sessions[-1]
        subtitle = f"{plural(len(arm.sessions), 'session')}, {arm.sessions[0]['date'][:10]} to {last['date'][:10]}"
        sections = [ArmVerdict(arm, found.level), ArmFigures(arm), ArmSessions(arm), facts]
        write_report(kept.page(arm.arm), f"Arm {arm.arm}", sections, subtitle)
    count = sum(len(arm.sessions) for arm in found.arms)
    sections = [FleetVerdict(found), FleetTable(found, kept), FleetEffects(found, kept), facts]
    write_report(
        store / "index.html",
        "Arms through time",
        sections,
        f"{plural(len(found.arms), 'arm')}, {plural(count, 'session')}",
    )


def alarm_card(alarm: Alarm) -> dict[str, str]:
    """An alarm as text for a page."""
    unit = "" if UNITS[alarm.figure] == "1" else f" {UNITS[alarm.figure]}"
    change = alarm.after - alarm.before
    scaled = alarm.scale is not None
    share = f" ({change / alarm.before:+.0%})" if alarm.before else ""
    return {
        "arm": alarm.arm,
        "joint": alarm.joint,
        "what": f"torque scale of {alarm.joint}" if scaled else f"{NAMES[alarm.figure]} of {alarm.joint}",
        "change": f"{significant(alarm.before, 3)} → {significant(alarm.after, 3)}{unit}{share}",
        "interval": f"change {significant(alarm.low, 2)} to {significant(alarm.high, 2)}{unit}",
        "spread": f"day to day it varies by {significant(alarm.spread, 2)}{unit}",
        "since": alarm.since,
        "told": alarm.session,
        "action": _scale_action(alarm) if scaled else ACTIONS[alarm.figure],
    }


def _scale_action(alarm: Alarm) -> str:
    """What to do about a torque whose scale has changed."""
    low, high = (100.0 * ((value or 1.0) - 1.0) for value in (alarm.scale_low, alarm.scale_high))
    size = f"{100.0 * ((alarm.scale or 1.0) - 1.0):+.1f} % [{low:.1f}, {high:.1f}]"
    return f"recalibrate the torque or current of {alarm.joint}: all of its figures changed alike, by {size}"


def _hint_words(hint: Alarm, figures: int) -> str:
    """What may be changing, and what to do about it."""
    card = alarm_card(hint)
    return (
        f"{card['what']} may have changed since {card['since']}: {card['change']}. "
        f"That is {hint.evidence:.0f} to 1 for one of {plural(figures, 'figure')} that are watched, too little for an "
        "alarm: record another session or two."
    )


@dataclass(frozen=True, eq=False)
class ArmVerdict(Section):
    """One sentence, and every change with what to do."""

    arm: ArmHistory
    level: float
    anchor: ClassVar[str] = "verdict"
    title: ClassVar[str] = "What has changed"
    template: ClassVar[str] = "watch_verdict.html"

    def context(self) -> dict[str, Any]:
        cards = [alarm_card(alarm) for alarm in reversed(self.arm.alarms)]
        if not cards:
            headline = (
                f"Nothing has changed beyond what days differ by, in {plural(len(self.arm.sessions), 'session')}."
            )
        else:
            first = cards[0]
            headline = f"The {first['what']} has changed since {first['since']}: {first['change']}."
        odd = [tell_odd(one).removeprefix(f"{self.arm.arm}: ") for one in self.arm.odd]
        hint = None if self.arm.hint is None else _hint_words(self.arm.hint, len(self.arm.figures))
        return {"headline": headline, "cards": cards, "odd": odd, "hint": hint, "level": self.level, "fleet": False}


@dataclass(frozen=True, eq=False)
class ArmFigures(Section):
    """Every figure over the dates, with intervals and the changes marked."""

    arm: ArmHistory
    anchor: ClassVar[str] = "figures"
    title: ClassVar[str] = "Figures over time"
    template: ClassVar[str] = "watch_figures.html"

    @property
    def is_present(self) -> bool:
        return bool(self.arm.figures)

    def context(self) -> dict[str, Any]:
        marks: dict[tuple[str, str], list[str]] = defaultdict(list)
        for alarm in self.arm.alarms:
            marks[alarm.joint, alarm.figure].append(alarm.since)
        rows: dict[str, list[dict[str, Any]]] = defaultdict(list)
        for (joint, figure), points in self.arm.figures.items():
            unit = "" if UNITS[figure] == "1" else f" {UNITS[figure]}"
            last = points[-1]
            told = f"{significant(last.value, 3)}{unit} [{significant(last.low, 3)}, {significant(last.high, 3)}]"
            svg = draw_strip(points, marks.get((joint, figure), []), f"{NAMES[figure]} of {joint} over the sessions")
            rows[joint].append({"name": NAMES[figure], "last": told, "svg": svg})
        return {"rows": list(rows.items())}


@dataclass(frozen=True, eq=False)
class ArmSessions(Section):
    """All sessions, the last first."""

    arm: ArmHistory
    anchor: ClassVar[str] = "sessions"
    title: ClassVar[str] = "Sessions"
    template: ClassVar[str] = "watch_sessions.html"

    def context(self) -> dict[str, Any]:
        effects: dict[str, list[str]] = defaultdict(list)
        for row in self.arm.effects:
            effects[row["session"]].append(f"{effect_name(row['effect'])} ({row['joints']})")
        rows = [_session_row(row, effects[row["session"]]) for row in reversed(self.arm.sessions)]
        return {"rows": rows, "said": any(row["said"] for row in rows), "named": bool(self.arm.effects)}


def _session_row(row: dict[str, Any], effects: list[str]) -> dict[str, str]:
    """A session in words: what the diagnosis said, or why there is none."""
    said = row["reason"] if row["status"] != "done" else (row["verdict"] or "").replace("_", " ")
    return {"session": row["session"], "date": row["date"][:16], "said": said or "", "effects": ", ".join(effects)}


@dataclass(frozen=True, eq=False)
class FleetVerdict(Section):
    """One sentence, and the changes of all arms, the last first."""

    found: Watch
    anchor: ClassVar[str] = "verdict"
    title: ClassVar[str] = "What has changed"
    template: ClassVar[str] = "watch_verdict.html"

    def context(self) -> dict[str, Any]:
        dates = {(arm.arm, row["session"]): row["date"] for arm in self.found.arms for row in arm.sessions}
        alarms = sorted(self.found.alarms, key=lambda one: dates[one.arm, one.session], reverse=True)
        changed = {alarm.arm for alarm in alarms}
        if alarms:
            headline = f"{len(changed)} of {len(self.found.arms)} arms have changed; the last: arm {alarms[0].arm}."
        else:
            who = "The arm has not" if len(self.found.arms) == 1 else f"None of {len(self.found.arms)} arms has"
            headline = f"{who} changed beyond what days differ by."
        cards = [alarm_card(alarm) for alarm in alarms]
        odd = [tell_odd(one) for arm in self.found.arms for one in arm.odd]
        return {
            "headline": headline,
            "cards": cards,
            "odd": odd,
            "hint": None,
            "level": self.found.level,
            "fleet": True,
        }


@dataclass(frozen=True, eq=False)
class FleetTable(Section):
    """A line an arm; sorted by a click on a heading, filtered by a word."""

    found: Watch
    store: Store
    anchor: ClassVar[str] = "arms"
    title: ClassVar[str] = "Arms"
    template: ClassVar[str] = "watch_arms.html"

    def context(self) -> dict[str, Any]:
        rows = [self._row(arm) for arm in self.found.arms]
        heads = ["arm", "sessions", "unfit", "last", "changes", "last change"]
        diagnosed = any(row["verdict"] for arm in self.found.arms for row in arm.done)
        return {"rows": rows, "heads": heads + ["effects in the last session"] * diagnosed, "diagnosed": diagnosed}

    def _row(self, arm: ArmHistory) -> dict[str, Any]:
        good = len(arm.done)
        named = {f"{effect_name(row['effect'])} ({row['joints']})" for row in arm.last_effects}
        newest = arm.alarms[-1] if arm.alarms else None
        changed = "none" if newest is None else f"{NAMES[newest.figure]} of {newest.joint} since {newest.since}"
        if arm.hint is not None and newest is None:
            changed = f"perhaps {NAMES[arm.hint.figure]} of {arm.hint.joint} since {arm.hint.since}"
        return {
            "arm": arm.arm,
            "page": self.store.page(arm.arm).name,
            "sessions": good,
            "unfit": len(arm.sessions) - good,
            "last": arm.sessions[-1]["date"][:10],
            "alarms": len(arm.alarms),
            "changed": changed,
            "effects": ", ".join(sorted(named)) or "none",
        }


@dataclass(frozen=True, eq=False)
class FleetEffects(Section):
    """Which arms share which effect, by the last session of each."""

    found: Watch
    store: Store
    anchor: ClassVar[str] = "effects"
    title: ClassVar[str] = "Which arms share which effect"
    template: ClassVar[str] = "watch_effects.html"

    @property
    def is_present(self) -> bool:
        return any(arm.effects for arm in self.found.arms)

    def context(self) -> dict[str, Any]:
        shared: dict[str, dict[str, str]] = defaultdict(dict)
        for arm in self.found.arms:
            for row in arm.last_effects:
                shared[effect_name(row["effect"])][arm.arm] = row["joints"]
        ranked = sorted(shared.items(), key=lambda item: -len(item[1]))
        pages = {arm.arm: self.store.page(arm.arm).name for arm in self.found.arms}
        rows = [
            {"effect": effect, "arms": [{"arm": arm, "joints": own[arm], "page": pages[arm]} for arm in sorted(own)]}
            for effect, own in ranked
        ]
        return {"rows": rows, "count": len(self.found.arms)}
