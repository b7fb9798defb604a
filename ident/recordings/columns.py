"""Named columns -> a recording: which columns are used, what they are called, and what torque they
hold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.recordings.recording import CHANNELS, Recording, TelemetryIssue
from ident.recordings.session_toml import SessionFile
from ident.safe_read import FileState, toml_key

TIME = "time"
# What plotting tools call the time of a row.
TIME_ALIASES = ("__time",)
# Names that say time, but are read as time only where [columns] says so.
UNMAPPED_CLOCKS = ("timestamp", "t", "time_s")
ANGLES = ("position", "velocity", "acceleration", "position_command", "velocity_command")
TORQUES = ("effort", "effort_command", "current")


# Columns under their native names, all of the same length, and what was found when reading them.
Table = tuple[Mapping[str, Float[Array, " T"]], tuple[TelemetryIssue, ...]]


@dataclass(frozen=True, eq=False)
class NamedColumns:
    """A run as its file has it, of whatever format: what every reader makes of a file."""

    names: tuple[str, ...]  # the file's own column names; "1", "2", … where it has none
    # Reads some columns: index -> native name. Raises RecordingError for one that holds no numbers.
    read: Callable[[Mapping[int, str]], Table]
    # All columns of numbers by their own names, whatever they hold.
    numbers: Callable[[], Mapping[str, Float[Array, " T"]]]

    @property
    def has_names(self) -> bool:
        """Whether the file names its columns, rather than they being numbered from 1 for want of
        names.
        """
        return self.names != tuple(str(i + 1) for i in range(len(self.names)))


def is_native(name: str) -> bool:
    """Whether a column name is one of the native table's."""
    joint, _, channel = name.rpartition("/")
    return name == TIME or (bool(joint) and channel in CHANNELS)


def joint_of(column: str) -> str:
    """The joint of a native column: `joint_1/position` -> `joint_1`; "" for `time`."""
    return column.rpartition("/")[0]


def native_names(
    names: Sequence[str], session_file: SessionFile, where: str | Path
) -> dict[int, str]:
    """Which columns of a table are used: index -> native name.

    `[columns]` comes first, by name or 1-based number. A joint whose position column is renamed
    keeps its other native columns: `"fer_joint1/position" = "panda_joint1/position"` renames the
    joint.

    Raises:
        RecordingError: A column is there twice, or a column that `[columns]` names is missing.
    """
    chosen: dict[int, str] = {}
    renamed: dict[str, str] = {}
    for foreign, native in session_file.columns.items():
        if not is_native(native):
            what = f"[columns] {foreign} = {native!r} is no native column"
            remedy = f'use "time" or "<joint>/<channel>" with a channel of: {", ".join(CHANNELS)}'
            raise RecordingError(session_file.where, what, remedy)
        chosen[_find(foreign, names, session_file, where)] = native
        if foreign.endswith("/position") and native.endswith("/position"):
            renamed[joint_of(foreign)] = joint_of(native)
    for index, name in enumerate(names):
        if index in chosen or not is_native(name):
            continue
        joint, _, channel = name.rpartition("/")
        native = f"{renamed[joint]}/{channel}" if joint in renamed else name
        # A mapping that takes the native name for itself overrides the table's own column of that
        # name.
        if native not in session_file.columns.values():
            chosen[index] = native
    if TIME not in chosen.values() and session_file.sample_rate_hz is None:
        chosen.update({index: TIME for index, name in enumerate(names) if name in TIME_ALIASES})
    seen: dict[str, int] = {}
    for index, native in chosen.items():
        if (first := seen.setdefault(native, index)) != index:
            what = (
                f"columns {first + 1} ({names[first]}) and {index + 1} ({names[index]}) are both "
                f"{native!r}"
            )
            raise RecordingError(where, what, "keep one of them")
    return dict(sorted(chosen.items()))


def _find(foreign: str, names: Sequence[str], session_file: SessionFile, where: str | Path) -> int:
    """Index of a foreign column by its name, else by its number."""
    matches = [index for index, name in enumerate(names) if name == foreign]
    if len(matches) > 1:
        raise RecordingError(
            where, f"column {foreign!r} is there {len(matches)} times", "keep one of them"
        )
    if matches:
        return matches[0]
    if foreign.isdecimal() and 1 <= int(foreign) <= len(names):
        return int(foreign) - 1
    what = f"no column {foreign!r}, which [columns] of {session_file.where} names"
    raise RecordingError(where, what, f"its columns are: {listed(names)}")


def listed(names: Sequence[str]) -> str:
    """Names for a message: at most twelve and how many there are, or the first and the last of
    numbers in a row.
    """
    if len(names) > 2 and _in_a_row(names):
        return f"{names[0]} to {names[-1]}"
    shown = ", ".join(names[:12])
    return shown if len(names) <= 12 else f"{shown}, … ({len(names)} in all)"


def _in_a_row(names: Sequence[str]) -> bool:
    """Whether names are numbers that follow one another."""
    if not names[0].isdecimal():
        return False
    first = int(names[0])
    return list(names) == [str(first + k) for k in range(len(names))]


def unequal(lengths: Mapping[str, int]) -> tuple[str, str]:
    """Words for columns of different lengths.

    Args:
        lengths: Samples of each column; two of them differ.

    Returns:
        What is wrong, and the remedy.
    """
    first, *rest = lengths
    other = next(name for name in rest if lengths[name] != lengths[first])
    return (
        f"{first} has {lengths[first]} samples and {other} {lengths[other]}",
        "make them equally long",
    )


def take_run(
    name: str, columns: NamedColumns, session_file: SessionFile, source: Path
) -> Recording:
    """Makes a recording of a file's columns: time, joints in the order of their position columns,
    torque.

    The torque is `sign * effort`, or `sign * gain * current` where a joint has no effort column.

    Raises:
        RecordingError: No joint at all, a missing column, or settings of a joint that is not there.

    Args:
        name: Name of the run.
        columns: The file's columns.
        session_file: Which columns are used, and what makes native units of them.
        source: The file, for messages.
    """
    cells, seen = columns.read(native_names(columns.names, session_file, source))
    sound = _in_si(_without_gaps_in_temperature(cells), session_file)
    joints = tuple(joint_of(column) for column in sound if column.endswith("/position"))
    if not joints:
        names = listed(columns.names or [*sound]) or "none"
        way = "use `ident new`, or --session-file with the session.toml of a session alike"
        remedy = f"{way}; it has: {names}"
        raise RecordingError(source, "no column <joint>/position", remedy)
    for column in sound:
        if column != TIME and (joint := joint_of(column)) not in joints:
            raise RecordingError(
                source, f"missing column {joint}/position", f"add it, or drop the column {column}"
            )
    sound = _in_stated_order(sound, joints, session_file)
    named = {
        "drive_gain_Nm_per_A": session_file.drive_gain,
        "effort_sign": session_file.effort_sign,
    }
    named |= {"slide_scale": session_file.slides, "direction": session_file.direction}
    named |= {"zero_rad": session_file.zeros, "unit": session_file.units}
    for key, given in named.items():
        unknown = next((joint for joint in given if joint not in joints), None)
        if unknown is not None:
            what = f"[{key}] names the joint {unknown!r}, which the recording lacks"
            raise RecordingError(session_file.where, what, f"its joints are: {', '.join(joints)}")
    channels, issues = _channels(sound, joints, source)
    turns = np.array([joint not in session_file.slides for joint in joints])
    direction = np.array([session_file.direction.get(joint, 1.0) for joint in joints])
    zeros = np.array([session_file.zeros.get(joint, 0.0) for joint in joints])
    usual = session_file.angle_factor or 1.0
    factors = np.array(
        [session_file.slides.get(joint, session_file.units.get(joint, usual)) for joint in joints]
    )
    for channel in ANGLES:
        is_place = channel in ("position", "position_command")
        if channel in channels and np.any((direction * factors != 1.0) | (zeros != 0.0)):
            middle = session_file.angle_zero * turns if is_place else 0.0
            channels[channel] = direction * factors * (channels[channel] - middle) + (
                zeros if is_place else 0.0
            )
    if session_file.with_effort:
        channels["effort"] = stack(
            [_effort(sound, joint, session_file, source) for joint in joints]
        )
    else:
        channels["effort"] = np.zeros_like(channels["position"])
    for channel in TORQUES:
        if channel in channels and np.any(direction != 1.0):
            channels[channel] = direction * channels[channel]
    if TIME in sound:
        time = (
            sound[TIME]
            if session_file.time_factor == 1.0
            else session_file.time_factor * sound[TIME]
        )
    elif session_file.sample_rate_hz is not None:
        time = np.arange(len(channels["effort"])) / session_file.sample_rate_hz
        issues = [*issues, *_unread_clocks(columns.names, session_file, name)]
    else:
        remedy = "add it, or sample_rate_hz = … (a constant rate) to session.toml"
        raise RecordingError(source, "missing column time", remedy)
    return Recording(
        name=name,
        joints=joints,
        time=time,
        source=source,
        state=FileState.of(source),
        stated_rate_hz=session_file.sample_rate_hz if TIME in sound else None,
        issues=(*seen, *issues),
        **channels,
    )


def _in_si(
    columns: Mapping[str, Float[Array, " T"]], session_file: SessionFile
) -> Mapping[str, Float[Array, " T"]]:
    """Columns whose currents are amperes, and whose efforts are N m."""
    factors = {
        "current": session_file.current_factor,
        "effort": session_file.effort_factor,
        "effort_command": session_file.effort_factor,
    }
    scaled = dict(columns)
    for name, values in columns.items():
        factor = factors.get(name.rpartition("/")[2], 1.0)
        if factor != 1.0:
            scaled[name] = factor * values
    return scaled


def _unread_clocks(
    names: Sequence[str], session_file: SessionFile, run: str
) -> list[TelemetryIssue]:
    """That a rate stands in the place of a column that looks like time, if there is one."""
    clocks = [name for name in names if name in (*TIME_ALIASES, *UNMAPPED_CLOCKS)]
    if not clocks:
        return []
    rate = f"sample_rate_hz = {session_file.sample_rate_hz:g}"
    evidence = f"{run}: {rate} is used, the column {clocks[0]} is not"
    remedy = f"none needed; to use the column, remove sample_rate_hz or map {clocks[0]} to time"
    return [TelemetryIssue("stated_rate", (), "note", evidence, remedy)]


def _in_stated_order(
    columns: Mapping[str, Float[Array, " T"]], joints: Sequence[str], session_file: SessionFile
) -> dict[str, Float[Array, " T"]]:
    """Columns under the joints that they are of, as `[order]` and `[effort_order]` say.

    Raises:
        RecordingError: They name a joint that is not recorded, or one twice.
    """
    order = session_file.order
    effort_order = {**order, **session_file.effort_order}
    if not effort_order:
        return dict(columns)
    for key, places in (("order", order), ("effort_order", effort_order)):
        if sorted(places) != sorted(places.values()) or not set(places) <= set(joints):
            what = f"[{key}] gives {', '.join(places)} the columns of {', '.join(places.values())}"
            remedy = f"name each of the same joints once on both sides; there are: {listed(joints)}"
            raise RecordingError(session_file.where, what, remedy)
    ordered = {TIME: columns[TIME]} if TIME in columns else {}
    for joint, channel in product(joints, CHANNELS):
        places = effort_order if channel in TORQUES else order
        source = f"{places.get(joint, joint)}/{channel}"
        if source in columns:
            ordered[f"{joint}/{channel}"] = columns[source]
    return ordered


def _channels(
    columns: Mapping[str, Float[Array, " T"]], joints: Sequence[str], source: Path
) -> tuple[dict[str, Float[Array, "T n"]], list[TelemetryIssue]]:
    """All channels but the torque; an optional one that some joints lack is left out, and that is
    reported.
    """
    channels: dict[str, Float[Array, "T n"]] = {}
    issues: list[TelemetryIssue] = []
    for channel in CHANNELS:
        lacking = tuple(joint for joint in joints if f"{joint}/{channel}" not in columns)
        if channel == "effort" or len(lacking) == len(joints):
            continue
        if not lacking:
            channels[channel] = stack([columns[f"{joint}/{channel}"] for joint in joints])
            continue
        evidence = (
            f"{source.name}: no {channel} of {', '.join(lacking)}; the {channel} of the others is "
            "not used"
        )
        remedy = f"record {channel} of every joint, or of none"
        issues.append(TelemetryIssue("missing_channel", lacking, "note", evidence, remedy))
    return channels, issues


def stack(columns: Sequence[Float[Array, " T"]], rows: int = 4096) -> Float[Array, "T n"]:
    """Columns of equal length side by side, shape (T, n); a read-only copy.

    Block by block of `rows` samples, so that each line of the cache is written once.
    """
    table = np.empty((len(columns[0]), len(columns)))
    for start in range(0, len(table), rows):
        for index, column in enumerate(columns):
            table[start : start + rows, index] = column[start : start + rows]
    table.setflags(write=False)
    return table


def _without_gaps_in_temperature(
    columns: Mapping[str, Float[Array, " T"]],
) -> dict[str, Float[Array, " T"]]:
    """Interpolates the empty cells of temperatures, which are often logged more slowly; drops empty
    columns.
    """
    filled = {}
    for name, values in columns.items():
        rows = np.arange(len(values))
        known = (
            np.isfinite(values)
            if name.endswith("/temperature")
            else np.ones(len(values), dtype=bool)
        )
        if known.any() or not len(values):
            filled[name] = values if known.all() else np.interp(rows, rows[known], values[known])
    return filled


def _effort(
    columns: Mapping[str, Float[Array, " T"]], joint: str, session_file: SessionFile, source: Path
) -> Float[Array, " T"]:
    sign = session_file.effort_sign.get(joint, 1.0)
    effort = f"{joint}/effort"
    current = f"{joint}/current"
    if effort in columns:
        return columns[effort] if sign == 1.0 else -columns[effort]
    if current not in columns:
        remedy = (
            f"add it, or drop the joint {joint}; an arm that logs goal and position only is for "
            "`ident servo`"
        )
        raise RecordingError(source, f"missing column {effort}", remedy)
    if joint not in session_file.drive_gain:
        what = f"missing column {effort}, and {current} has no drive gain"
        remedy = f"add the effort, or [drive_gain_Nm_per_A] {toml_key(joint)} = … to session.toml"
        raise RecordingError(source, what, remedy)
    return sign * session_file.drive_gain[joint] * columns[current]
