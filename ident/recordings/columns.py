"""Named columns -> a recording: which columns are used, what they are called, and what torque they hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.recordings.recording import CHANNELS, Recording, TelemetryIssue
from ident.recordings.session_toml import SessionFile
from ident.safe_read import toml_key

TIME = "time"
ANGLES = ("position", "velocity", "acceleration", "position_command", "velocity_command")


@dataclass(frozen=True)
class Table:
    """Columns under their native names, all of the same length, and what was found when reading them."""

    columns: Mapping[str, Float[Array, " T"]]
    issues: tuple[TelemetryIssue, ...] = field(default=())


def is_native(name: str) -> bool:
    """Whether a column name is one of the native table's."""
    joint, _, channel = name.rpartition("/")
    return name == TIME or (bool(joint) and channel in CHANNELS)


def joint_of(column: str) -> str:
    """`joint_1/position` -> `joint_1`."""
    return column.rpartition("/")[0]


def native_names(names: Sequence[str], session_file: SessionFile, where: str | Path) -> dict[int, str]:
    """Which columns of a table are used, and under which native names.

    `[columns]` comes first, by name or 1-based number. A joint whose position column is renamed keeps its other
    native columns: `"fer_joint1/position" = "panda_joint1/position"` renames the joint.

    Args:
        names: The table's own column names ("1", "2", … where it has no header).
        session_file: The session's settings.
        where: File, for messages.

    Returns:
        Index of the column -> native name.

    Raises:
        RecordingError: A column is there twice, or a column that `[columns]` names is missing.
    """
    chosen: dict[int, str] = {}
    renamed: dict[str, str] = {}
    for foreign, native in session_file.columns.items():
        if not is_native(native):
            raise RecordingError(
                session_file.where,
                f"[columns] {foreign} = {native!r} is no native column",
                f'use "time" or "<joint>/<channel>" with a channel of: {", ".join(CHANNELS)}',
            )
        chosen[_find(foreign, names, session_file, where)] = native
        if foreign.endswith("/position") and native.endswith("/position"):
            renamed[joint_of(foreign)] = joint_of(native)
    for index, name in enumerate(names):
        if index in chosen or not is_native(name):
            continue
        joint, _, channel = name.rpartition("/")
        native = f"{renamed[joint]}/{channel}" if joint in renamed else name
        # A mapping that takes the native name for itself overrides the table's own column of that name.
        if native not in session_file.columns.values():
            chosen[index] = native
    _refuse_duplicates(chosen, names, where)
    return dict(sorted(chosen.items()))


def _find(foreign: str, names: Sequence[str], session_file: SessionFile, where: str | Path) -> int:
    """Index of a foreign column by its name, else by its number."""
    matches = [index for index, name in enumerate(names) if name == foreign]
    if len(matches) > 1:
        raise RecordingError(where, f"column {foreign!r} is there {len(matches)} times", "keep one of them")
    if matches:
        return matches[0]
    if foreign.isdecimal() and 1 <= int(foreign) <= len(names):
        return int(foreign) - 1
    raise RecordingError(
        where,
        f"no column {foreign!r}, which [columns] of {session_file.where} names",
        f"its columns are: {_listed(names)}",
    )


def _refuse_duplicates(chosen: Mapping[int, str], names: Sequence[str], where: str | Path) -> None:
    seen: dict[str, int] = {}
    for index, native in chosen.items():
        first = seen.get(native)
        if first is not None:
            raise RecordingError(
                where,
                f"columns {first + 1} ({names[first]}) and {index + 1} ({names[index]}) are both {native!r}",
                "keep one of them",
            )
        seen[native] = index


def _listed(names: Sequence[str], limit: int = 12) -> str:
    shown = ", ".join(names[:limit])
    return shown if len(names) <= limit else f"{shown}, … ({len(names)} in all)"


def assemble(name: str, table: Table, session_file: SessionFile, source: Path, found: Sequence[str] = ()) -> Recording:
    """Makes a recording of native columns: time, joints in the order of their position columns, torque.

    The torque is `sign * effort`, or `sign * gain * current` where a joint has no effort column.

    Args:
        name: Name of the run.
        table: Native columns.
        session_file: Drive gains, effort signs, sampling rate.
        source: The file it came from.
        found: The file's own column names, for messages.

    Raises:
        RecordingError: No joint at all, a missing column, or settings of a joint that is not there.
    """
    columns = _fill_temperature(table.columns)
    joints = tuple(joint_of(column) for column in columns if column.endswith("/position"))
    if not joints:
        raise RecordingError(
            source,
            "no column <joint>/position",
            f"name its columns in [columns] of session.toml; it has: {_listed(list(found or columns)) or 'none'}",
        )
    for column in columns:
        if column != TIME and joint_of(column) not in joints:
            raise RecordingError(
                source, f"missing column {joint_of(column)}/position", f"add it, or drop the column {column}"
            )
    _refuse_unknown_joints(joints, session_file)
    channels, issues = _channels(columns, joints, source)
    for channel in ANGLES:
        if channel in channels and session_file.angle_factor != 1.0:
            zero = session_file.angle_zero if channel in ("position", "position_command") else 0.0
            channels[channel] = session_file.angle_factor * (channels[channel] - zero)
    if session_file.with_effort:
        channels["effort"] = _effort(columns, joints, session_file, source)
    else:
        channels["effort"] = np.zeros_like(channels["position"])
    time = _time(columns, len(channels["effort"]), session_file, source)
    return Recording(name=name, joints=joints, time=time, source=source, issues=(*table.issues, *issues), **channels)


def _refuse_unknown_joints(joints: Sequence[str], session_file: SessionFile) -> None:
    for key, table in (
        ("drive_gain_Nm_per_A", session_file.drive_gain),
        ("effort_sign", session_file.effort_sign),
    ):
        for joint in table:
            if joint not in joints:
                raise RecordingError(
                    session_file.where,
                    f"[{key}] names the joint {joint!r}, which the recording lacks",
                    f"its joints are: {', '.join(joints)}",
                )


def _channels(
    columns: Mapping[str, Float[Array, " T"]], joints: Sequence[str], source: Path
) -> tuple[dict[str, Float[Array, "T n"]], list[TelemetryIssue]]:
    """All channels but the torque; an optional one that some joints lack is left out, and that is told."""
    channels: dict[str, Float[Array, "T n"]] = {}
    issues: list[TelemetryIssue] = []
    for channel in CHANNELS:
        have = [joint for joint in joints if f"{joint}/{channel}" in columns]
        if channel == "effort" or not have:
            continue
        lacking = tuple(joint for joint in joints if joint not in have)
        if not lacking:
            channels[channel] = stack([columns[f"{joint}/{channel}"] for joint in joints])
        else:
            issues.append(
                TelemetryIssue(
                    "missing_channel",
                    lacking,
                    "note",
                    f"{source.name}: no {channel} of {', '.join(lacking)}; the {channel} of the others is not used",
                    f"record {channel} of every joint, or of none",
                )
            )
    return channels, issues


def stack(columns: Sequence[Float[Array, " T"]], rows: int = 4096) -> Float[Array, "T n"]:
    """Columns side by side, read-only. Block by block, so that each line of the cache is written once."""
    table = np.empty((len(columns[0]), len(columns)))
    for start in range(0, len(table), rows):
        for index, column in enumerate(columns):
            table[start : start + rows, index] = column[start : start + rows]
    table.setflags(write=False)
    return table


def _fill_temperature(columns: Mapping[str, Float[Array, " T"]]) -> dict[str, Float[Array, " T"]]:
    """Interpolates the empty cells of temperatures, which are often logged more slowly; drops empty columns."""
    filled = {}
    for name, values in columns.items():
        known = np.isfinite(values)
        if not name.endswith("/temperature") or known.all():
            filled[name] = values
        elif known.any():
            rows = np.arange(len(values))
            filled[name] = np.interp(rows, rows[known], values[known])
    return filled


def _effort(
    columns: Mapping[str, Float[Array, " T"]], joints: Sequence[str], session_file: SessionFile, source: Path
) -> Float[Array, "T n"]:
    torque = []
    for joint in joints:
        sign = session_file.effort_sign.get(joint, 1.0)
        if f"{joint}/effort" in columns:
            effort = columns[f"{joint}/effort"]
            torque.append(effort if sign == 1.0 else -effort)
        elif f"{joint}/current" not in columns:
            remedy = f"add it, or drop the joint {joint}; an arm that logs goal and position only is for `ident servo`"
            raise RecordingError(source, f"missing column {joint}/effort", remedy)
        elif joint not in session_file.drive_gain:
            raise RecordingError(
                source,
                f"missing column {joint}/effort, and {joint}/current has no drive gain",
                f"add the effort, or [drive_gain_Nm_per_A] {toml_key(joint)} = … to session.toml",
            )
        else:
            torque.append(sign * session_file.drive_gain[joint] * columns[f"{joint}/current"])
    return stack(torque)


def _time(
    columns: Mapping[str, Float[Array, " T"]], samples: int, session_file: SessionFile, source: Path
) -> Float[Array, " T"]:
    if TIME in columns:
        return columns[TIME] if session_file.time_factor == 1.0 else session_file.time_factor * columns[TIME]
    if session_file.sample_rate_hz is None:
        raise RecordingError(
            source, "missing column time", "add it, or sample_rate_hz = … (a constant rate) to session.toml"
        )
    return np.arange(samples) / session_file.sample_rate_hz
