"""One look at a watched folder: new sessions are examined once, then alarms and pages follow from
the whole store.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path

from ident.checks.gains import Gains
from ident.command_options import WatchOptions
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError, plural
from ident.files import write_record
from ident.model.hybrid import HybridModel
from ident.monitor.alarms import Alarm, Outlier, Point, find_changes, find_outliers
from ident.monitor.estimates import estimate_session
from ident.monitor.parameters import UNITS, unit_of
from ident.monitor.store import (
    DONE,
    STORE_KIND,
    FoundSession,
    Store,
    as_text,
    date_of,
    find_sessions,
    write_rows,
)
from ident.motion.motion import prepare
from ident.outputs import begin_folder, real_path
from ident.recordings.recording import Session
from ident.recordings.session_toml import load_session_file
from ident.records import JsonRecord
from ident.results import Result
from ident.sessions import Given, inspect_sources
from ident.workers import run_tasks

Rows = Iterable[JsonRecord]


def examine_session(task: tuple[FoundSession, Path, WatchOptions, Session | None]) -> str:
    """Looks at one session and writes what is found; a session that is unfit is noted as such.

    Args:
        task: The session, the store's folder, the options, and the session whose guesses of gains
            it is read with.

    Returns:
        Its name, `arm/session`.
    """
    session, folder, options, first = task
    store = Store(folder)
    row: JsonRecord = {
        "arm": session.arm,
        "session": session.name,
        "stamp": session.stamp,
        "path": as_text(session.path),
    }
    tables: dict[str, list[JsonRecord]] = {}
    end: JsonRecord = {"status": "done"}
    try:
        tables = _examine(session, options, row, store, Gains(first))
    except InputError as error:
        end = {"status": "refused", "reason": as_text(str(error))}
    except Exception as error:  # one session that we fail at must not end the watch over all others
        end = {"status": "failed", "reason": as_text(f"{type(error).__name__}: {error}")}
    if "date" not in row:
        try:
            row["date"] = date_of(session, None)
        except InputError:
            row["date"] = ""
    whole = {}
    for kind in ("figures", "effects"):
        whole[kind] = [{**row, **entry} for entry in tables.get(kind, ())]
    for kind, rows in {**whole, DONE: [{**row, **end}]}.items():
        write_rows(store.place(kind, session.arm, session.name), kind, rows)
    return session.key


def _examine(
    folder: FoundSession, options: WatchOptions, row: JsonRecord, store: Store, gains: Gains
) -> dict[str, list[JsonRecord]]:
    """The rows of a session's estimates and effects; fills in its own row, and writes its diagnosis
    beside them.
    """
    read = [
        gains.in_first_unit(recording)
        for recording in Given([folder.path], session_file=folder.settings).parts()
    ]
    arm, (report,) = inspect_sources(Given(read, options.robot), options.accept).whole
    report = replace(report, issues=(*report.issues, *gains.issues()))
    session = report.session
    row["robot"] = arm.name
    first = session.runs[0].time[:1].tolist() if session.runs else []
    row["date"] = date_of(folder, first[0] if first else None)
    report.require_fit()
    model = None if options.model is None else HybridModel.load(Path(options.model))
    if model is not None:
        model.require_robot(arm, "--model")
    reference = (arm if model is None else model.arm).keeping(session.joints)
    estimates = estimate_session(prepare(session), reference)
    rows = [
        {"joint": joint, "figure": name, **vars(estimate), "unit": UNITS[name]}
        for (joint, name), estimate in estimates.items()
    ]
    effects: list[JsonRecord] = []
    if options.diagnosed:
        diagnosis, _, _ = diagnose_reports([report], arm, CATALOGUE, model=model)
        record = diagnosis.to_dict()
        row["verdict"] = diagnosis.verdict
        write_record(store.place("diagnoses", folder.arm, folder.name, ".json"), record)
        for finding in record["findings"]:
            summary_row = {
                "joints": ", ".join(finding["joints"]),
                "shrink": finding["heldout"]["shrink"],
                "action": finding.get("action"),
            }
            effects.append(
                {"effect": finding["effect"], "probability": finding["probability"], **summary_row}
            )
    row |= {"samples": session.samples, "duration_s": session.duration}
    return {"figures": rows, "effects": effects}


def first_of_guesses(sessions: Iterable[FoundSession]) -> Session | None:
    """The first session whose drive gains nobody measured, without its runs: the others are read
    with its guesses.

    Returns:
        None where all are measured.
    """
    for session in sessions:
        with suppress(InputError):  # which its own turn reports
            settings = None if session.settings is None else load_session_file(session.settings)
            if settings is not None and settings.guessed:
                return Session(session.name, (), guessed_gains=dict(settings.drive_gain))
    return None


@dataclass(frozen=True, eq=False)
class ArmHistory:
    """All that is known of an arm."""

    arm: str  # its name
    sessions: tuple[JsonRecord, ...]  # rows of its sessions, in order of time
    # (joint, parameter) -> its points, in order of time
    figures: dict[tuple[str, str], list[Point]]
    effects: tuple[JsonRecord, ...] = ()  # rows of the effects that diagnoses named
    alarms: tuple[Alarm, ...] = ()  # what has changed
    odd: tuple[Outlier, ...] = ()  # sessions that stand out
    hint: Alarm | None = None  # what may be changing, without evidence enough for an alarm

    def record(self) -> JsonRecord:
        """The arm's record in that of a watch; alarms and outliers stand beside the arms.

        Returns:
            "arm", "robot" (None where no session tells it), "joints", "sessions" and "effects"
            (rows of the store), "figures" by "JOINT/FIGURE", and "hint" (None without one).
        """
        figures = {}
        for (joint, name), points in self.figures.items():
            figures[f"{joint}/{name}"] = [vars(point) for point in points]
        return {
            "arm": self.arm,
            "robot": next(
                (row["robot"] for row in reversed(self.sessions) if row.get("robot")), None
            ),
            "joints": list(dict.fromkeys(joint for joint, _ in self.figures)),
            "sessions": [dict(row) for row in self.sessions],
            "figures": figures,
            "effects": [dict(row) for row in self.effects],
            "hint": None if self.hint is None else self.hint.to_dict(),
        }

    @property
    def done(self) -> list[JsonRecord]:
        """Rows of the sessions that were fit."""
        return [row for row in self.sessions if row["status"] == "done"]

    @property
    def last_effects(self) -> list[JsonRecord]:
        """Rows of the effects that the last fit session shows; empty if there is none."""
        last = self.done[-1:]
        return [row for row in self.effects if last and row["session"] == last[0]["session"]]


@dataclass(frozen=True, eq=False)
class Watch(Result):
    """What a look at a folder gave."""

    arms: tuple[ArmHistory, ...]  # every arm in the store
    fresh: tuple[str, ...] = ()  # sessions that were examined this time
    waiting: tuple[str, ...] = ()  # sessions that are still being written
    level: float = WatchOptions.level  # chance of any false alarm in an arm's life

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """All alarms, arm by arm."""
        return tuple(alarm for arm in self.arms for alarm in arm.alarms)

    def to_dict(self) -> JsonRecord:
        """The record of `ident.watch/1`.

        Returns:
            "schema", "level", "fresh", "waiting" (names of sessions), "arms" (see
            `ArmHistory.record`), and more.
        """
        return {
            "schema": "ident.watch/1",
            "level": self.level,
            "fresh": list(self.fresh),
            "waiting": list(self.waiting),
            "arms": [arm.record() for arm in self.arms],
            "alarms": [alarm.to_dict() for alarm in self.alarms],
            "odd": [outlier.to_dict() for arm in self.arms for outlier in arm.odd],
            "provenance": self.provenance.to_dict(),
        }

    def summary(self) -> str:
        """What is new, and what has changed."""
        count = sum(len(arm.sessions) for arm in self.arms)
        arms = plural(len(self.arms), "arm")
        sessions = plural(count, "session")
        lines = [f"{arms}, {sessions}, {len(self.fresh)} of them new"]
        unfit = [row for arm in self.arms for row in arm.sessions if row["status"] != "done"]
        lines += [
            f"{row['arm']}/{row['session']}: {row['status']}: {row['reason']}" for row in unfit
        ]
        lines += [
            f"{name}: waits: it was written to a moment ago (--settle says how long)"
            for name in self.waiting
        ]
        lines += [outlier_line(outlier) for arm in self.arms for outlier in arm.odd]
        lines += [alarm_line(alarm) for alarm in self.alarms]
        lines += [] if self.alarms else ["no alarm"]
        lines += [
            f"no alarm yet, but perhaps: {alarm_line(arm.hint)}"
            for arm in self.arms
            if arm.hint is not None
        ]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.summary())}</pre>"


def alarm_line(alarm: Alarm) -> str:
    """An alarm in one line."""
    if alarm.scale is not None and alarm.scale_low is not None and alarm.scale_high is not None:
        low = 100.0 * (alarm.scale_low - 1.0)
        high = 100.0 * (alarm.scale_high - 1.0)
        size = f"{100.0 * (alarm.scale - 1.0):+.3g} % [{low:.3g}, {high:.3g}]"
        return (
            f"{alarm.arm}: the torque of {alarm.joint} changed its scale by {size} since "
            f"{alarm.since}"
        )
    change = (
        f"{alarm.after - alarm.before:+.3g}{unit_of(alarm.figure)} [{alarm.low:.3g}, "
        f"{alarm.high:.3g}]"
    )
    past = (
        f"from {alarm.before:.3g} since {alarm.since}; day to day it varies by {alarm.spread:.2g}"
    )
    return f"{alarm.arm}: {alarm.joint} {alarm.figure} changed by {change} {past}"


def outlier_line(outlier: Outlier) -> str:
    """A session that stands out, in one line."""
    value = f"{outlier.value:.3g}{unit_of(outlier.figure)}"
    return (
        f"{outlier.arm}: {outlier.session} stands out: {outlier.joint} {outlier.figure} is "
        f"{value}, otherwise {outlier.usual:.3g} ± {outlier.spread:.2g}"
    )


def look(
    folder: Path,
    store: Path,
    options: WatchOptions,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Watch:
    """Examines what is new in a folder and reads the whole store.

    Raises:
        InputError: The folder holds no session, the store's folder is not ours, the scheduler can't
            be reached.
    """
    sessions = find_sessions(real_path(folder))
    store = real_path(store)
    begin_folder(store, STORE_KIND)
    files = Store(store)
    done = {f"{row['arm']}/{row['session']}": row["stamp"] for row in files.read(DONE)}
    new = [session for session in sessions if done.get(session.key) != session.stamp]
    # To a session that has settled nothing was written for some time: nobody is recording there any
    # more.
    ready = [session for session in new if time.time() - session.newest >= options.settle]
    firsts = {}
    for arm in {session.arm for session in ready}:
        of_arm = [session for session in sessions if session.arm == arm]
        firsts[arm] = first_of_guesses(of_arm)
    tasks = [(session, store, options, firsts[session.arm]) for session in ready]
    finished: list[str] = []

    def count(name: str) -> None:
        finished.append(name)
        progress(len(finished), len(tasks))

    if options.workers == 1 and options.scheduler is None:
        for task in tasks:
            count(examine_session(task))
    else:
        run_tasks(examine_session, tasks, options.workers, options.scheduler, count)
    arms = read_histories(files, options.level)
    write_rows(
        store / "alarms.parquet",
        "alarms",
        [alarm.to_dict() for arm in arms for alarm in arm.alarms],
    )
    waiting = tuple(session.key for session in new if session not in ready)
    return Watch(arms, tuple(sorted(finished)), waiting, options.level)


def read_histories(store: Store, level: float = WatchOptions.level) -> tuple[ArmHistory, ...]:
    """Every arm's history and alarms, from the store alone."""
    tables: list[dict[str, list[JsonRecord]]] = []
    for kind in ("sessions", "figures", "effects"):
        tables.append(defaultdict(list))
        for row in store.read(kind):
            tables[-1][row["arm"]].append(row)
    sessions, figures, effects = tables
    return tuple(
        make_history(arm, sessions[arm], figures[arm], effects[arm], level)
        for arm in sorted(sessions)
    )


def make_history(
    arm: str, sessions: Rows, figures: Rows, effects: Rows = (), level: float = WatchOptions.level
) -> ArmHistory:
    """An arm's history from the rows of the store.

    Args:
        arm: Its name.
        sessions: Its sessions, with `session`, `date` and `status`; figures and effects of those
            whose status is not `done` are left out.
        figures: Estimates, with `session`, `date`, `joint`, `figure`, `value`, `low`, `high` and
            `std`.
        effects: Effects that were named, with `session`.
        level: Chance, from 0 to 1, of any false alarm in the arm's life.

    Returns:
        Sessions by date, estimates by joint and figure, and alarms, outliers and hints in them.
    """
    ordered = tuple(sorted(sessions, key=lambda row: (row["date"], row["session"])))
    order = [row["session"] for row in ordered if row["status"] == "done"]
    place = {name: i for i, name in enumerate(order)}
    points: dict[tuple[str, str], list[Point]] = defaultdict(list)
    for row in figures:
        if row["session"] in place and row["figure"] in UNITS:
            values = (row[name] for name in ("value", "low", "high", "std", "session", "date"))
            points[row["joint"], row["figure"]].append(Point(*values))
    for of_figure in points.values():
        of_figure.sort(key=lambda point: place[point.session])
    alarms, hint = find_changes(arm, points, order, level)
    odd = find_outliers(arm, points, alarms)
    named = tuple(row for row in effects if row["session"] in place)
    return ArmHistory(arm, ordered, dict(points), named, alarms, odd, hint)
