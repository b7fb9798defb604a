"""What damaged cells mean: which rows were dropped, which cells forbid a fit, and how that is told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float, Int
from ident.recordings.columns import NamedColumns, Table, joint_of
from ident.recordings.recording import Severity, TelemetryIssue

# Channels that a recording may lack.
OPTIONAL = ("velocity", "acceleration", "position_command", "velocity_command", "effort_command")
MOST_CELLS = 0.5  # a row with half of its cells unreadable is no sample
# Dropped rows leave gaps. One in a thousand is a logger's hiccup; one in ten leaves no continuous motion.
FEW_ROWS, MANY_ROWS = 1e-3, 0.1
MEND = "`ident inspect SESSION --mend DIR` writes a copy without the damaged rows"


def _none() -> Int[Array, " 0"]:
    return np.empty(0, dtype=int)


@dataclass(frozen=True)
class Damage:
    """Damaged rows and cells of one table.

    Attributes:
        source: The file.
        place: What its rows are counted in: "line" of a text, "row" of a binary table; 1-based.
        names: Names of the columns, for messages.
        natives: Their native names.
        rows: Number of rows read.
        garbage_rows: Dropped: most cells unreadable, or a wrong number of them.
        empty_rows: Dropped: most cells NaN or empty.
        truncated_row: Dropped: the last row, cut short.
        text_cells: (row, index of the column) of text in an otherwise good row; NaN there.
        missing_cells: The same for NaN, infinite or empty cells.
        sample: The first text cell as it stands in the file.
    """

    source: Path
    place: str
    names: tuple[str, ...]
    natives: tuple[str, ...]
    rows: int
    garbage_rows: Int[Array, " g"] = field(default_factory=_none)
    empty_rows: Int[Array, " e"] = field(default_factory=_none)
    truncated_row: int | None = None
    text_cells: Int[Array, "c 2"] | None = None
    missing_cells: Int[Array, "d 2"] | None = None
    sample: str = ""


def describe_damage(damage: Damage) -> tuple[TelemetryIssue, ...]:
    """The issues of a table's damage; empty where there is none."""
    cut = f"{damage.source.name}, {damage.place} {damage.truncated_row}: the last row is cut short, dropped"
    truncated = TelemetryIssue("truncated_row", (), "note", cut, "none needed; let the logger end cleanly")
    issues = [
        _dropped("garbage_cells", damage, damage.garbage_rows, "unreadable"),
        _dropped("nan_cells", damage, damage.empty_rows, "empty or NaN"),
        None if damage.truncated_row is None else truncated,
        _bad_cells("garbage_cells", damage, damage.text_cells),
        _bad_cells("nan_cells", damage, damage.missing_cells),
    ]
    return tuple(issue for issue in issues if issue is not None)


def _dropped(issue: str, damage: Damage, rows: Int[Array, " g"], kind: str) -> TelemetryIssue | None:
    if len(rows) == 0:
        return None
    share = len(rows) / damage.rows
    severity: Severity = "note" if share <= FEW_ROWS or len(rows) <= 3 else "warning"
    if share > MANY_ROWS:
        severity = "fatal"
    count = f"{len(rows)} rows" if len(rows) > 1 else "1 row"
    evidence = f"{damage.source.name}, {damage.place} {listed(rows)}: {count} {kind} ({share:.2%}), dropped"
    return TelemetryIssue(issue, (), severity, evidence, "none needed; look at what writes into the log")


def _bad_cells(issue: str, damage: Damage, cells: Int[Array, "c 2"] | None) -> TelemetryIssue | None:
    if cells is None or len(cells) == 0:
        return None
    row, column = (int(value) for value in cells[0])
    columns = sorted({int(index) for index in cells[:, 1]})
    joints = dict.fromkeys(joint_of(damage.natives[index]) for index in columns)
    seen = "NaN or no number" if issue == "nan_cells" else repr(damage.sample)
    count = "" if len(cells) == 1 else f", and {len(cells) - 1} more such cells"
    evidence = f"{damage.source.name}, {damage.place} {row}, column {damage.names[column]}: {seen}{count}"
    return TelemetryIssue(issue, tuple(joint for joint in joints if joint), "fatal", evidence, MEND)


def listed(numbers: Int[Array, " n"], limit: int = 5) -> str:
    """`3, 4, 9, …` of row numbers."""
    shown = ", ".join(str(int(number)) for number in numbers[:limit])
    return shown + (", …" if len(numbers) > limit else "")


def screen_cells(columns: Mapping[str, Float[Array, " T"]], source: Path) -> Table:
    """Finds NaN and infinite cells of a table that holds numbers only; drops the rows that are mostly such.

    Args:
        columns: Native name -> values.
        source: The file, for messages.
    """
    columns, unused = drop_empty(columns, source)
    # Temperature is often logged more slowly than the rest: its empty cells are filled later, not refused.
    watched = [name for name in columns if not name.endswith("/temperature")]
    if not watched or all(np.isfinite(columns[name]).all() for name in watched):
        return Table(columns, unused)
    missing = np.column_stack([~np.isfinite(columns[name]) for name in watched])
    lost = missing.mean(axis=1) >= MOST_CELLS
    cells = np.argwhere(missing & ~lost[:, None])
    cells[:, 0] += 1
    damage = Damage(
        source=source,
        place="row",
        names=tuple(watched),
        natives=tuple(watched),
        rows=len(missing),
        empty_rows=np.flatnonzero(lost) + 1,
        missing_cells=cells,
    )
    kept = {name: without_infinity(values[~lost]) for name, values in columns.items()}
    return Table(kept, (*unused, *describe_damage(damage)))


def held_columns(
    columns: Mapping[str, Float[Array, " T"]], source: Path, issues: tuple[TelemetryIssue, ...] = ()
) -> NamedColumns:
    """Columns of numbers that are in memory already.

    Args:
        columns: The file's own names -> values.
        source: The file, for messages.
        issues: What was found when they were read.
    """
    names = tuple(columns)

    def read(chosen: Mapping[int, str]) -> Table:
        table = screen_cells({native: columns[names[i]] for i, native in chosen.items()}, source)
        return Table(table.columns, (*issues, *table.issues))

    return NamedColumns(names, read, lambda: columns)


def drop_empty(
    columns: Mapping[str, Float[Array, " T"]], source: Path
) -> tuple[dict[str, Float[Array, " T"]], tuple[TelemetryIssue, ...]]:
    """Leaves out columns that nobody needs and that hold no number: drivers log interfaces that the arm lacks."""
    needless = [name for name in columns if name.rpartition("/")[2] in OPTIONAL and np.isnan(columns[name]).all()]
    if not needless:
        return dict(columns), ()
    joints = tuple(dict.fromkeys(joint_of(name) for name in needless))
    evidence = f"{source.name}: no number in {', '.join(needless[:3])}{', …' if len(needless) > 3 else ''}; not used"
    note = TelemetryIssue("missing_channel", joints, "note", evidence, "none needed")
    return {name: values for name, values in columns.items() if name not in needless}, (note,)


def without_infinity(values: Float[Array, " T"]) -> Float[Array, " T"]:
    """Infinite cells become NaN: one mark for "no number here"."""
    return np.where(np.isfinite(values), values, np.nan)
