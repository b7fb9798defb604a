"""What damaged cells mean: which rows are dropped, which cells forbid a fit, and how that is
reported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.errors import RecordingError
from ident.recordings.columns import TIME, NamedColumns, Table, joint_of, unequal
from ident.recordings.recording import Severity, TelemetryIssue
from ident.recordings.topics import MANY_ROWS, at_rows, rows_of_rarest

# Channels without which a row holds no joint's state.
NEEDED = ("position", "effort", "current")
# Channels that a recording may lack.
OPTIONAL = ("velocity", "acceleration", "position_command", "velocity_command", "effort_command")
# Cells of a text that hold a number, and words for a value that is missing.
NUMBER = r"^[\s\"]*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?[\s\"]*$"
MISSING = r"(?i)^[\s\"]*[-+]?(|nan|n/a|na|null|none|inf|infinity|1\.#\w+)[\s\"]*$"
MOST_CELLS = 0.5  # a row with half of its cells unreadable is no sample
# Dropped rows leave gaps. One in a thousand is a logger's hiccup; one in ten, `MANY_ROWS`, leaves
# no continuous motion.
FEW_ROWS = 1e-3
MEND = "`ident inspect SESSION --mend DIR` writes a copy without the damaged rows"


@dataclass(frozen=True, eq=False)
class Cells:
    """The cells of one table, some of which may be damaged."""

    source: Path  # the file
    # native name -> numbers, NaN or infinite where there is none
    columns: Mapping[str, Float[Array, " R"]]
    place: str = "row"  # what its rows are counted in: "line" of a text, "row" of a binary table
    names: Sequence[str] = ()  # names of the columns, for messages
    numbers: Int[Array, " R"] | None = None  # number of each row in the file; 1, 2, … if None
    # mask of cells that hold text; None where there are none
    text: Bool[Array, "R k"] | None = None
    misshapen: Sequence[int] = ()  # numbers of further rows, which have a wrong number of cells
    # number of the file's last row if it is cut short: it is dropped whatever it holds
    truncated: int | None = None
    # A cell as it stands in the file, by its row and column
    raw: Callable[[int, int], str] = lambda row, column: ""

    def screen(self) -> Table:
        """Drops rows that are surely no samples; single bad cells of other rows become NaN, with a
        fatal issue.

        A row is no sample if it has a wrong number of cells, is the last and cut short, or if most
        of its cells are text or empty. Temperature is often logged more slowly than the rest: its
        empty cells count for nothing.

        Raises:
            RecordingError: No row is left.
        """
        for take_rows in (self._without_other_topics, self._at_the_rarest):
            if (alone := take_rows()) is not None:
                states, told = alone[0].screen()
                return states, (alone[1], *told)
        finite = np.column_stack([np.isfinite(values) for values in self.columns.values()])
        numbers = np.arange(1, len(finite) + 1) if self.numbers is None else self.numbers
        watched = np.array([not name.endswith("/temperature") for name in self.columns])
        text = np.zeros(finite.shape, dtype=bool) if self.text is None else self.text
        missing = ~text & ~finite & watched
        bad = text | missing
        cut = numbers == (-1 if self.truncated is None else self.truncated)
        lost = cut | (bad[:, watched].mean(axis=1) >= MOST_CELLS if watched.any() else False)
        if lost.all():
            raise RecordingError(self.source, "no row can be read", "give a table with numbers")
        without_number = numbers[lost & ~cut & text.any(axis=1)]
        unreadable = np.sort([*self.misshapen, *without_number]).astype(int)
        empty = numbers[lost & ~cut & ~text.any(axis=1)]
        no_numbers = np.argwhere(text & ~lost[:, None])
        no_values = np.argwhere(missing & ~lost[:, None])
        rest_is_cut = None
        if self.truncated is not None:
            rest_is_cut = cut_short(self.source, self.place, self.truncated)
        issues = [
            self._dropped("garbage_cells", unreadable, "unreadable", len(finite)),
            self._dropped("nan_cells", empty, "empty or NaN", len(finite)),
            rest_is_cut,
            self._bad("garbage_cells", no_numbers, numbers),
            self._bad("nan_cells", no_values, numbers),
        ]
        # Infinite cells become NaN: one mark for "no number here".
        sound = {
            name: np.where(good, values, np.nan)[~lost]
            for (name, values), good in zip(self.columns.items(), finite.T, strict=True)
        }
        return sound, tuple(issue for issue in issues if issue is not None)

    def _without_other_topics(self) -> tuple[Cells, TelemetryIssue] | None:
        """The rows that hold some joint's state, and a note; None where hardly a row holds none.

        Exports of several topics side by side have a row for each message of any. What comes in
        other rows than the states, such as commands, is interpolated to theirs.
        """
        needed = [
            values for name, values in self.columns.items() if name.rpartition("/")[2] in NEEDED
        ]
        if not needed:
            return None
        has_text = False if self.text is None else self.text.any(axis=1)
        states = np.isfinite(np.column_stack(needed)).any(axis=1) | has_text
        if not states.any() or (~states).mean() <= MANY_ROWS:
            return None
        rows = np.arange(len(states))
        columns = {}
        for name, values in self.columns.items():
            known = np.isfinite(values)
            is_apart = (
                name.rpartition("/")[2] in OPTIONAL and known.any() and not (known & states).any()
            )
            columns[name] = (
                np.interp(rows, rows[known], values[known])[states] if is_apart else values[states]
            )
        numbers = rows + 1 if self.numbers is None else np.asarray(self.numbers)
        with_states = np.flatnonzero(states)
        text = None if self.text is None else self.text[states]
        alone = replace(
            self,
            columns=columns,
            numbers=numbers[states],
            text=text,
            raw=lambda row, column: self.raw(int(with_states[row]), column),
        )
        count = int((~states).sum())
        evidence = (
            f"{self.source.name}: {count} of {len(states)} rows hold no joint's state: another "
            "topic's, skipped"
        )
        return alone, TelemetryIssue("other_topics", (), "note", evidence, "none needed")

    def _at_the_rarest(self) -> tuple[Cells, TelemetryIssue] | None:
        """The rows of the channel of a state that comes most rarely, the others interpolated there.

        None where the rows with a state hold all of it, and where time does not increase: what
        lacks then is damage.
        """
        time = self.columns.get(TIME)
        if time is None or (self.text is not None and self.text.any()):
            return None
        held: dict[str, Bool[Array, " R"]] = {}
        for name, values in self.columns.items():
            channel = name.rpartition("/")[2]
            if channel in NEEDED:
                held[channel] = held.get(channel, False) | np.isfinite(values)
        rarest_rows = rows_of_rarest(time, held)
        if rarest_rows is None:
            return None
        rows = rarest_rows.rows
        columns = {}
        for name, values in self.columns.items():
            is_filled = (
                name.rpartition("/")[2] in (*NEEDED, *OPTIONAL) and np.isfinite(values).any()
            )
            columns[name] = at_rows(time, values, rows) if is_filled else values[rows]
        numbers = np.arange(1, len(rows) + 1) if self.numbers is None else np.asarray(self.numbers)
        alone = replace(self, columns=columns, numbers=numbers[rows], text=None)
        rarest = rarest_rows.rarest
        others = rarest_rows.others
        evidence = (
            f"{self.source.name}: {rarest} comes in {int(held[rarest].sum())} of {len(rows)} rows, "
            f"{others} in others, too: two topics; {others} is interpolated to its stamps, "
            f"{int(rows.sum())} rows are used"
        )
        remedy = (
            "see that both topics have the stamps of one clock: what is late there is a delay here"
        )
        return alone, TelemetryIssue("other_topics", (), "note", evidence, remedy)

    def _dropped(
        self, issue: str, rows: Int[Array, " g"], kind: str, read: int
    ) -> TelemetryIssue | None:
        if len(rows) == 0:
            return None
        share = len(rows) / (read + len(self.misshapen))
        few = share <= FEW_ROWS or len(rows) <= 3
        severity: Severity = "fatal" if share > MANY_ROWS else "note" if few else "warning"
        count = f"{len(rows)} rows" if len(rows) > 1 else "1 row"
        shown = ", ".join(map(str, rows[:5])) + (", …" if len(rows) > 5 else "")
        amount = f"{count} {kind} ({100.0 * share:.2f} %)"
        evidence = f"{self.source.name}, {self.place} {shown}: {amount}, dropped"
        remedy = "none needed; look at what writes into the log"
        if severity == "fatal":
            remedy = "record again, or take these rows out: too many for one continuous motion"
        return TelemetryIssue(issue, (), severity, evidence, remedy)

    def _bad(
        self, issue: str, cells: Int[Array, "c 2"], numbers: Int[Array, " R"]
    ) -> TelemetryIssue | None:
        if len(cells) == 0:
            return None
        (row, column) = cells[0]
        natives = list(self.columns)
        columns = sorted(set(cells[:, 1]))
        joints = dict.fromkeys(joint_of(natives[index]) for index in columns)
        seen = "NaN or no number" if issue == "nan_cells" else repr(self.raw(row, column))
        count = "" if len(cells) == 1 else f", and {len(cells) - 1} more such cells"
        name = (self.names or natives)[column]
        row_in_file = numbers[row]
        where = f"{self.source.name}, {self.place} {row_in_file}"
        evidence = f"{where}, column {name}: {seen}{count}"
        return TelemetryIssue(
            issue, tuple(joint for joint in joints if joint), "fatal", evidence, MEND
        )


def cut_short(source: Path, place: str, row: int) -> TelemetryIssue:
    """That the last row of a table was dropped, for it is no whole one.

    Args:
        source: The file.
        place: What its rows are called, as "line" or "row".
        row: The row's number by that count.
    """
    evidence = f"{source.name}, {place} {row}: the last row is cut short, dropped"
    return TelemetryIssue(
        "truncated_row", (), "note", evidence, "none needed; let the logger end cleanly"
    )


def named_columns(
    names: Sequence[str],
    load: Callable[[Sequence[int]], Sequence[Float[Array, " T"]]],
    source: Path,
    numbers: Callable[[], Mapping[str, Float[Array, " T"]]] = dict,
    issues: tuple[TelemetryIssue, ...] = (),
) -> NamedColumns:
    """The columns of a table that holds numbers only; rows that are mostly NaN or infinite are
    dropped.
    """

    def read(chosen: Mapping[int, str]) -> Table:
        columns = dict(zip(chosen.values(), load(list(chosen)), strict=True))
        lengths = {native: len(values) for native, values in columns.items()}
        if len(set(lengths.values())) > 1:
            raise RecordingError(source, *unequal(lengths))
        if columns and not any(lengths.values()):
            raise RecordingError(source, "has no samples", "give a table with samples")
        columns, unused = drop_empty(columns, source)
        if all(
            np.isfinite(values).all()
            for name, values in columns.items()
            if not name.endswith("/temperature")
        ):
            return columns, (*issues, *unused)
        screened, issues_of_cells = Cells(source, columns).screen()
        return screened, (*issues, *unused, *issues_of_cells)

    return NamedColumns(tuple(names), read, numbers)


def held_columns(
    columns: Mapping[str, Sequence[object] | Array],
    source: Path,
    issues: tuple[TelemetryIssue, ...] = (),
) -> NamedColumns:
    """Columns that are in memory already: all that a reader of a further format has to make.

    Args:
        columns: By the file's own names, T values each; None is a missing number. Those that hold
            no numbers are passed over, and refused where they are asked for.
        source: The file, for messages.
        issues: What the reader found and mended.
    """
    names = list(columns)

    def load(chosen: Sequence[int]) -> list[Float[Array, " T"]]:
        loaded = []
        for name in (names[index] for index in chosen):
            values = as_numbers(columns[name])
            if values is None:
                remedy = "a native column holds one number a row"
                raise RecordingError(f"{source}, column {name}", "holds no numbers", remedy)
            loaded.append(values)
        return loaded

    def numbers() -> dict[str, Float[Array, " T"]]:
        every = {name: as_numbers(values) for name, values in columns.items()}
        return {name: values for name, values in every.items() if values is not None}

    return named_columns(names, load, source, numbers, issues)


def as_numbers(values: Sequence[object] | Array) -> Float[Array, " T"] | None:
    """A column as numbers, None as NaN; None where it holds anything else, or is no column."""
    try:
        column = np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return None
    return column if column.ndim == 1 else None


def drop_empty(
    columns: Mapping[str, Float[Array, " T"]], source: Path
) -> tuple[dict[str, Float[Array, " T"]], tuple[TelemetryIssue, ...]]:
    """Leaves out columns that nobody needs and that hold no number: drivers log interfaces that the
    arm lacks.
    """
    empty = [
        name
        for name in columns
        if name.rpartition("/")[2] in OPTIONAL and np.isnan(columns[name]).all()
    ]
    if not empty:
        return dict(columns), ()
    joints = tuple(dict.fromkeys(joint_of(name) for name in empty))
    evidence = (
        f"{source.name}: no number in {', '.join(empty[:3])}{', …' if len(empty) > 3 else ''}; "
        "not used"
    )
    note = TelemetryIssue("missing_channel", joints, "note", evidence, "none needed")
    return {name: values for name, values in columns.items() if name not in empty}, (note,)
