"""Guesses a session.toml and writes it out, every line with its evidence, to be corrected."""

from __future__ import annotations

import hashlib
import json
import math
import os
from dataclasses import dataclass, replace
from functools import cached_property, partial
from html import escape
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment

from ident.checks.angles import ANGULAR
from ident.checks.report import TelemetryReport
from ident.checks.wraps import unwrap
from ident.errors import InputError, RecordingError
from ident.files import atomic_write
from ident.infer.by_data import guess_by_data
from ident.infer.by_name import MEASURED, guess_by_name
from ident.infer.gains import GAINS, torque_settings
from ident.infer.group import likeliest_group
from ident.infer.guess import ForeignTable, Reason, Signals, read_foreign
from ident.infer.units import (
    angle_unit,
    check_velocity,
    sample_rate,
    search_columns,
    slide_scales,
    time_unit,
    zero_count,
)
from ident.outputs import ELSEWHERE, require_plain
from ident.recordings.columns import ANGLES, TIME, listed
from ident.recordings.load import METADATA, SUFFIXES, is_dataset, is_run
from ident.recordings.session_toml import GUESSED, NAME
from ident.recordings.topics import at_rows, rows_of_rarest
from ident.results import Result
from ident.robot.arm import ArmModel
from ident.robot.names import split_tip
from ident.safe_read import LARGEST_TOML, read_bytes, toml_key

SCHEMA = "ident.new/1"
HEAD = (
    "# Guessed by armgap (`ident new`), each line with its evidence: correct what is wrong, then "
    "`ident inspect`."
)
SEAL = "# as written: sha256 "


@dataclass(frozen=True, eq=False)
class NewSession(Result):
    """A session.toml that was guessed."""

    file: Path  # where it stands or is to stand
    columns: dict[str, str]  # foreign name -> native name
    settings: dict[str, Any]  # keys of session.toml beside `[columns]`
    reasons: tuple[Reason, ...]  # why, in the order in which they are reported
    left_out: tuple[str, ...]  # what is not used, in words
    # The telemetry check of the session under these settings; None where no robot was given.
    report: TelemetryReport | None = None

    @property
    def has_effort(self) -> bool:
        """Whether there is a torque or current: more than goal and position."""
        return any(name.rpartition("/")[2] in MEASURED for name in self.columns.values())

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "schema": SCHEMA,
            "file": str(self.file),
            "robot": self.provenance.settings.get("robot") or self.settings.get("robot"),
            "joints": sorted(
                {name.rpartition("/")[0] for name in self.columns.values() if "/" in name}
            ),
            "columns": self.columns,
            "settings": self.settings,
            "reasons": [reason.to_dict() for reason in self.reasons],
            "left_out": list(self.left_out),
            "telemetry": []
            if self.report is None
            else [issue.to_dict() for issue in self.report.issues],
            "provenance": self.provenance.to_dict(),
        }

    @cached_property
    def text(self) -> str:
        """The text of session.toml: keys, then tables, the evidence as comments."""
        pages = Environment(trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
        template = pages.from_string(
            Path(__file__).with_name("session.toml.j2").read_text(encoding="utf-8")
        )
        quoted = partial(json.dumps, ensure_ascii=False)
        # A comment stays within its line whatever names stand in it.
        words = {
            "comment": lambda text: quoted(text)[1:-1].replace("\x7f", "?"),
            "json": quoted,
            "key": toml_key,
        }
        channels = groupby(self.columns.items(), key=lambda column: column[1].rpartition("/")[2])
        body = template.render(guess=self, channels=channels, gains=GAINS, marked=GUESSED, **words)
        return f"{HEAD}\n{SEAL}{_digest(body)}\n{body}"

    def summary(self) -> str:
        """The guesses in plain lines."""
        lines = [f"{reason.what}: {reason.guess} ({reason.evidence})" for reason in self.reasons]
        return "\n".join([*lines, *self.left_out])

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.summary())}</pre>"

    def write(self) -> None:
        """Writes the file, whole or not at all.

        Only an uncorrected guess of armgap's own is ever replaced.
        """
        require_own_guess(self.file)
        with atomic_write(self.file) as temporary:
            temporary.write_text(self.text, encoding="utf-8")


def place_of(path: Path) -> Path:
    """The session.toml of a folder, or `<stem>.toml` beside a single file."""
    return path / NAME if path.is_dir() else path.with_suffix(".toml")


def require_own_guess(path: Path) -> None:
    """Passes if nothing stands at a place, or a guess that nobody has corrected.

    Raises:
        InputError: A file of the user's, or a guess that was corrected.
    """
    require_plain(path)
    if not path.exists():
        return
    text = read_bytes(path, ELSEWHERE, largest=LARGEST_TOML).decode("utf-8", "replace")
    head, seal, rest = text.partition(SEAL)
    digest, _, body = rest.partition("\n")
    if not head.startswith(HEAD):
        raise InputError(path, "is a file that armgap did not write", ELSEWHERE)
    if not seal or digest.strip() != _digest(body):
        raise InputError(
            path,
            "was corrected since armgap guessed it",
            "remove it first if it is to be guessed again",
        )


def guess_session(
    path: Path, arm: ArmModel | None, robot: str | None, rate: float | None = None
) -> NewSession:
    """Guesses the settings of a session from its largest run.

    Args:
        path: Folder of tables, or one.
        arm: The robot, if it is known.
        robot: Its path or name, as it is to stand in the file.
        rate: Samples a second of tables without time, if the user knows it [Hz].

    Raises:
        RecordingError: No table there, or none that can be made out from its names or numbers.
    """
    if not path.exists():
        raise RecordingError(path, "no such file or folder", "give a folder of runs or a table")
    runs = [path]
    if path.is_dir() and not (is_dataset(path) or (path / METADATA).is_file()):
        runs = [run for run in path.iterdir() if is_run(run)]
    if not runs:
        raise RecordingError(path, "holds no runs", f"put recordings there: {', '.join(SUFFIXES)}")
    largest = max(runs, key=lambda run: (run.stat().st_size, run.name))
    table = read_foreign(largest)
    if rate is not None:
        table = replace(table, rate_hz=rate)
    signals = guess_by_name(table, arm) if table.has_names else None
    if signals is None:
        if arm is None:
            what = "its columns' names don't say which is position"
            raise RecordingError(table.source, what, "give --robot: its motion tells the columns")
        signals = guess_by_data(table, arm)
    session = _complete(place_of(path), table, signals, arm)
    if robot is not None:
        session.settings["robot"] = _from_folder(robot, session.file.parent)
    return session


def _from_folder(robot: str, folder: Path) -> str:
    """A robot as a file of a folder names it: a path from there on, its arm's last joint behind it;
    another name as it is.
    """
    path, tip = split_tip(robot)
    if not Path(path).is_file():
        return robot
    relative = os.path.relpath(path, folder)
    return f"{relative}:{tip}" if tip else relative


def _complete(
    place: Path, table: ForeignTable, signals: Signals, arm: ArmModel | None
) -> NewSession:
    """Units, signs and order of the signals, as columns and settings."""
    signals = _whole_rows(signals)
    if not len(signals.time):
        what = "no row holds both position and torque"
        remedy = "sort its rows by time, or put both in one row"
        raise RecordingError(table.source, what, remedy)
    time, second, clock = time_unit(signals)
    rate, rate_reason = sample_rate(signals, table.rate_hz)
    if signals.clock is None and rate is None:
        what = "no column is time, and nothing tells the rate"
        remedy = (
            "say how many samples a second there are: --rate 100, say; or sample_rate_hz in "
            "session.toml"
        )
        raise RecordingError(table.source, what, remedy)
    if rate is not None:
        second = 1.0 / rate
    if arm is not None and any(name in signals.tables for name in MEASURED):
        signals = likeliest_group(signals, arm, lambda group: _in_si(group, arm, second))
    unit = angle_unit(signals, arm)
    angle, _, turn = unit
    slides, sliding = slide_scales(signals, arm)
    as_logged = signals
    signals, velocity, refused = check_velocity(_in_si(signals, arm, second))
    nominal = next((name for name in MEASURED if name in signals.tables), "")
    joints = signals.joints
    torques = signals.joints
    channel = nominal
    settings: dict[str, Any] = {}
    further: list[Reason] = []
    if arm is not None and nominal:
        read = search_columns(signals, arm)
        joints = read.joints
        torques = read.torques
        known = tuple(name for name in arm.joint_names if name in joints)
        channel, of_torque, seen = torque_settings(signals, arm, read.states, known, nominal)
        settings |= read.settings | of_torque
        further = [*read.reasons, *seen]
        moved = angle_unit(replace(as_logged, joints=joints), arm)
        turn = moved[2] if moved[0] == angle else turn
    elif nominal == "current":
        settings[GAINS] = dict.fromkeys(joints, 1.0)
        further = [Reason(GAINS, "1", "without a robot nothing tells it: give the figures")]
    known_reasons = [*signals.reasons, clock, rate_reason, turn, *sliding, velocity]
    # What the search says of the joints replaces what their places say.
    replaced = {"joints"}.intersection(reason.what for reason in further)
    told = [reason for reason in known_reasons if reason and reason.what not in replaced]
    if time != "s":
        settings["time_unit"] = time
    if turn is not None and angle != "rad":
        settings[turn.what] = angle
    is_counted = turn is not None and turn.what == "counts_per_turn"
    if is_counted and not zero_count(as_logged.tables["position"], unit):
        # Counts are read from the middle of a turn; these are from their own zero.
        zeros = settings.get("zero_rad", {})
        turning = [joint for joint in joints if joint not in slides]
        half = {joint: round(math.pi + zeros.get(joint, 0.0), 6) for joint in turning}
        settings["zero_rad"] = zeros | half
        further.append(Reason("zero_rad", "half a turn", "counts run below zero: 0 is their zero"))
    if rate is not None:
        settings["sample_rate_hz"] = rate
    if slides:
        settings["slide_scale"] = slides
    columns = {} if signals.clock is None else {signals.clock: TIME}
    for name, of_channel in signals.columns.items():
        is_torque = name == nominal
        native = channel if is_torque else name
        names = torques if is_torque else joints
        for column, joint in zip(of_channel, names, strict=True):
            columns[column] = f"{joint}/{native}"
    left = []
    if refused is not None:
        left.append(f"velocity {refused}")
    if not nominal:
        left.append("no torque or current: a session for `ident servo` alone")
    unused = [name for name in table.columns if name not in columns]
    if unused:
        left.append(f"not used: {listed(unused)}")
    return NewSession(place, columns, settings, (*told, *further), tuple(left))


def _in_si(signals: Signals, arm: ArmModel | None, second: float) -> Signals:
    """The signals in seconds, radians and metres, turns unwrapped.

    Args:
        signals: In the units of the file.
        arm: The robot, by whose limits units are told.
        second: What makes seconds of the file's time.
    """
    unit = angle_unit(signals, arm)
    _, radian, _ = unit
    slides, _ = slide_scales(signals, arm)
    scale = np.array([slides.get(name, radian) for name in signals.joints])
    middle = zero_count(signals.tables["position"], unit)
    zeros = np.array([0.0 if name in slides else middle for name in signals.joints])
    tables = {}
    for name, values in signals.tables.items():
        is_place = name in ANGULAR
        tables[name] = values
        if name in ANGLES:
            tables[name] = scale * (values - zeros if is_place else values)
    return _without_wraps(replace(signals, time=second * signals.time, tables=tables), arm)


def _whole_rows(signals: Signals) -> Signals:
    """The rows that hold a state and a torque.

    What comes in other rows only, such as commands or another topic's state, is interpolated.
    """
    apart = _rows_of_topics(signals)
    if apart is not None:
        return apart
    needed = [values for name, values in signals.tables.items() if name in ("position", *MEASURED)]
    whole = np.isfinite(np.column_stack([signals.time, *needed])).all(axis=1)
    rows = np.arange(len(whole))
    tables = {}
    for name, values in signals.tables.items():
        filled = np.array(values)
        for column in filled.T:
            known = np.isfinite(column)
            if known.any() and not known[whole].all():
                column[:] = np.interp(rows, rows[known], column[known])
        tables[name] = filled[whole]
    return replace(signals, time=signals.time[whole], tables=tables)


def _rows_of_topics(signals: Signals) -> Signals | None:
    """The rows of the topic that comes most rarely, the others interpolated to its stamps.

    None where state and torque come in the same rows.
    """
    time = signals.time
    if signals.clock is None:
        return None
    held = {}
    for name, values in signals.tables.items():
        if name in ("position", *MEASURED):
            held[name] = np.isfinite(values).any(axis=1)
    rarest_rows = rows_of_rarest(time, held)
    if rarest_rows is None:
        return None
    rows = rarest_rows.rows
    tables = {}
    for name, values in signals.tables.items():
        columns = [
            at_rows(time, column, rows) if np.isfinite(column).any() else column[rows]
            for column in values.T
        ]
        tables[name] = np.column_stack(columns)
    why = f"{rarest_rows.rarest} comes in {int(held[rarest_rows.rarest].sum())} of {len(rows)} rows"
    what = f"{rarest_rows.others} interpolated to the stamps of {rarest_rows.rarest}"
    reason = Reason("topics", what, why)
    return replace(signals, time=time[rows], tables=tables, reasons=(*signals.reasons, reason))


def _without_wraps(signals: Signals, arm: ArmModel | None) -> Signals:
    """Angles without the steps of a turn, across which nothing is a derivative."""
    position = signals.tables["position"]
    turning = np.ones(position.shape[1], dtype=bool)
    if arm is not None:
        turning = ~arm.sliding_joints[[arm.joint_names.index(name) for name in signals.joints]]
    unwrapped, _ = unwrap(position, turning)
    return replace(signals, tables={**signals.tables, "position": unwrapped})


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()
