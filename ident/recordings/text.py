"""CSV and other text tables: how one is written, its cells at once by Arrow, damaged ones one by
one.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv

from ident.arrays import Array, Bool, Float
from ident.errors import RecordingError
from ident.recordings.bad_cells import MISSING, NUMBER, Cells, cut_short, drop_empty
from ident.recordings.columns import TIME, NamedColumns, Table
from ident.recordings.parquet import column_numbers
from ident.recordings.recording import TelemetryIssue
from ident.safe_read import open_regular

SNIFF_BYTES = 1 << 16
COMMENTS = ("#", "%")
# Columns that hold text in most of so many first rows are no columns of numbers.
LOOKED_AT = 50
# What the cells of a time are: numbers, or ISO 8601 without and with a zone.
ISO = re.compile(r"\"?\d{4}-\d\d-\d\d[T ]\d\d:")
CLOCKS = (pa.float64(), pa.timestamp("ns"), pa.timestamp("ns", "UTC"))
# a thread works on a block; Arrow's default of 1 MB costs more overhead than it balances
BLOCK_BYTES = 1 << 24


def read_damaged(
    path: Path, data: bytes | pa.Buffer, layout: TextLayout, chosen: Mapping[int, str]
) -> Table:
    """Reads a table that the fast path refused, or in which it met NaN (see `Cells.screen`).

    Blank lines are skipped. A carriage return within a line would part it once more: it is made a
    letter, which spoils its cell alone.

    Raises:
        RecordingError: No row, or hardly any, can be read.

    Args:
        path: The file, for messages.
        data: Its content.
        layout: How it is written.
        chosen: Index of each column that is read, and its native name.
    """
    lines = bytes(data).split(b"\n")
    separator = layout.separator.encode()
    expected = len(layout.names) - 1
    numbers = np.array(
        [number for number in range(layout.first_line, len(lines)) if lines[number].strip()],
        dtype=int,
    )
    counts = np.array([lines[number].count(separator) for number in numbers], dtype=int)
    good = numbers[counts == expected]
    misshapen = numbers[counts != expected] + 1
    truncated = int(numbers[-1]) + 1 if len(numbers) and counts[-1] < expected else None
    misshapen = misshapen[misshapen != truncated] if truncated else misshapen
    if len(misshapen) > len(good):
        what = (
            f"most rows have another number of cells than the {len(layout.names)} of the first line"
        )
        raise RecordingError(
            f"{path}, line {misshapen[0]}", what, "correct the header or the separator"
        )
    if len(good) == 0:
        raise RecordingError(path, "has no whole row", "give a table with samples")
    text = b"\n".join([lines[number].rstrip(b"\r").replace(b"\r", b"?") for number in good])
    try:
        cells = _parse(
            text, layout, chosen, dict.fromkeys(chosen.values(), pa.binary()), quoted=False
        )
    except pa.ArrowException as error:
        reason = str(error).partition(":")[0]
        raise RecordingError(
            path, f"its rows can't be parted ({reason})", "write the table again"
        ) from None
    raw = [column.combine_chunks() for column in cells]
    values, masks = zip(*(_to_numbers(column, layout.decimal) for column in raw), strict=True)
    bad = []
    for native, column, mask in zip(chosen.values(), values, masks, strict=True):
        may_be_missing = native.endswith("/temperature")
        bad.append(mask[-1] or not (np.isfinite(column[-1]) or may_be_missing))
    if int(good[-1]) == len(lines) - 1 and any(bad):  # its line lacks an end
        truncated = int(good[-1]) + 1
    labels = [(layout.names[index], native) for index, native in chosen.items()]
    return Cells(
        path,
        dict(zip(chosen.values(), values, strict=True)),
        "line",
        [name if name == native else f"{name} ({native})" for name, native in labels],
        good + 1,
        np.column_stack(masks),
        misshapen.tolist(),
        truncated,
        lambda row, column: raw[column][row].as_py().decode(errors="replace").strip(),
    ).screen()


def _parse(
    data: bytes | pa.Buffer,
    layout: TextLayout,
    chosen: Mapping[int, str],
    kinds: Mapping[str, pa.DataType],
    skipped: int = 0,
    quoted: str | bool = '"',
) -> list[pa.ChunkedArray]:
    """The chosen columns by Arrow's reader; raises `ArrowInvalid` at the first cell or row that is
    none of its kind.
    """
    positions = [f"f{index}" for index in range(len(layout.names))]
    types = {positions[index]: kinds.get(native, pa.float64()) for index, native in chosen.items()}
    table = pacsv.read_csv(
        pa.BufferReader(data),
        read_options=pacsv.ReadOptions(
            column_names=positions, skip_rows=skipped, block_size=BLOCK_BYTES
        ),
        parse_options=pacsv.ParseOptions(delimiter=layout.separator, quote_char=quoted),
        convert_options=pacsv.ConvertOptions(
            column_types=types, include_columns=list(types), decimal_point=layout.decimal
        ),
    )
    return [table.column(name) for name in types]


def _to_numbers(cells: pa.Array, decimal: str) -> tuple[Float[Array, " R"], Bool[Array, " R"]]:
    """Numbers of a column, NaN where there is none, and the mask of cells that hold text."""
    import pyarrow.compute as pc  # loaded for damaged tables alone

    if decimal == ",":
        cells = pc.replace_substring(cells, ",", ".")
    number = pc.match_substring_regex(cells, NUMBER)
    absent = pc.match_substring_regex(cells, MISSING)
    readable = pc.if_else(number, cells, pa.scalar(None, pa.binary())).cast(pa.string())
    values = pc.replace_substring_regex(readable, r'[\s"+]+', "").cast(pa.float64())
    text = ~(number.to_numpy(zero_copy_only=False) | absent.to_numpy(zero_copy_only=False))
    return values.to_numpy(zero_copy_only=False), text


@dataclass(frozen=True)
class TextLayout:
    """How a text table is written."""

    names: tuple[str, ...]  # column names; "1", "2", … where there is no header
    separator: str  # one character; a blank stands for any run of blanks and tabs
    first_line: int  # 0-based number of the first line of data
    decimal: str = "."  # decimal point or comma


def split_cells(line: str, separator: str) -> list[str]:
    """Cells of a line, quotes taken off; within quotes a separator is text, and two quotes
    are one.
    """
    if '"' not in line or separator == " " or len(line) > csv.field_size_limit():
        cells = line.split() if separator == " " else line.split(separator)
        return [cell.strip().strip('"') for cell in cells]
    return [
        cell.strip()
        for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    ]


def text_lines(data: bytes) -> list[str]:
    """The lines of a table as its readers count them.

    Control characters other than line ends stay in their line; bytes that are no UTF-8 are escaped.
    """
    return re.split("\r\n|\n|\r", data.decode("utf-8-sig", errors="backslashreplace"))


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, NaN included, with a decimal point or comma."""
    try:
        float(cell.strip().strip('"').replace(",", "."))
    except ValueError:
        return False
    return True


def sniff(path: Path) -> TextLayout:
    """Finds the separator, the header and the first line of data from the file's beginning.

    Raises:
        RecordingError: The file is empty or holds nothing but blank lines.
    """
    with open_regular(path, "give a table", RecordingError) as stream:
        head = stream.read(SNIFF_BYTES)
    lines = text_lines(head)
    if len(head) == SNIFF_BYTES and len(lines) > 1:
        lines.pop()  # cut short by the limit
    numbered = [(number, line) for number, line in enumerate(lines) if line.strip()]
    comments = [line for _, line in numbered if line.lstrip().startswith(COMMENTS)]
    rows = [(number, line) for number, line in numbered if not line.lstrip().startswith(COMMENTS)]
    if not rows:
        raise RecordingError(path, "is empty", "give a table with a header and samples")
    separator = _separator([line for _, line in rows[:50]])
    first = split_cells(rows[0][1], separator)
    if sum(map(is_number, first)) <= len(first) / 2:
        # Most cells of the first line are no numbers: it is a header.
        begin = rows[1][0] if len(rows) > 1 else rows[0][0] + 1
        return TextLayout(tuple(first), separator, begin, _decimal(rows[1:], separator))
    names = (
        split_cells(comments[-1].lstrip().lstrip("".join(COMMENTS)), separator) if comments else []
    )
    if len(names) != len(first):
        names = [str(number + 1) for number in range(len(first))]
    return TextLayout(tuple(names), separator, rows[0][0], _decimal(rows, separator))


def _separator(lines: list[str]) -> str:
    """The separator that most lines hold equally often; blanks where none does."""

    def votes(separator: str) -> tuple[int, int]:
        counts = [line.count(separator) for line in lines]
        common = max(set(counts) - {0}, key=counts.count, default=0)
        return (counts.count(common) if common else 0, common)

    # A comma may be a decimal comma, so another separator that fits as many lines goes first.
    order = (";", "\t", "|", ",")
    best = max(order, key=lambda separator: votes(separator)[0])
    return best if votes(best)[0] >= len(lines) / 2 else " "


def _decimal(rows: list[tuple[int, str]], separator: str) -> str:
    if separator == ",":
        return "."
    comma = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")
    cells = [cell for _, line in rows[:20] for cell in split_cells(line, separator)]
    return (
        ","
        if cells and sum(bool(comma.fullmatch(cell)) for cell in cells) > len(cells) / 2
        else "."
    )


def ends_within_cell(path: Path, layout: TextLayout) -> bool:
    """Whether the file's last cell is surely cut short although it is still a number.

    Seen by a missing line end and fewer decimals than all rows before: only tables of fixed
    decimals show it.
    """
    with open_regular(path, "give a table", RecordingError) as stream:
        stream.seek(0, 2)
        stream.seek(max(0, stream.tell() - SNIFF_BYTES))
        tail = stream.read()
    if tail.endswith((b"\n", b"\r")):
        return False
    *before, last = [
        split_cells(line, layout.separator)[-1:]
        for line in tail.decode(errors="replace").splitlines()[-20:]
    ] or [[]]
    decimals = set()
    for cell in before[1:]:
        if cell:
            decimals.add(len(cell[0].partition(layout.decimal)[2]))
    cut = len(last[0].partition(layout.decimal)[2]) if last else 0
    return len(before) > 5 and len(decimals) == 1 and cut < decimals.pop()


def open_text(path: Path) -> NamedColumns:
    """The columns of a text table, read when they are asked for.

    Columns without a header are named by their numbers, from 1.

    Raises:
        RecordingError: The file is empty; when columns are read, that it has no rows.
    """
    layout = sniff(path)

    def numbers() -> dict[str, Float[Array, " T"]]:
        with open_regular(path, "give a table", RecordingError) as stream:
            head = text_lines(stream.read(SNIFF_BYTES))[layout.first_line :][:LOOKED_AT]
        rows = [
            cells
            for line in head
            if len(cells := split_cells(line, layout.separator)) == len(layout.names)
        ]
        filled = []
        stamps = []
        for i in range(len(layout.names)):
            cells = [row[i] for row in rows if row[i]]  # another topic's row leaves a cell empty
            if cells and sum(map(is_number, cells)) > len(cells) / 2:
                filled.append(i)
            dates = sum(bool(ISO.match(cell)) for cell in cells)
            if cells and dates > len(cells) / 2:
                stamps.append(i)
        if not filled:
            raise RecordingError(path, "has no column of numbers", "give a table of samples")
        keys = {i: f"column_{i}/position" for i in filled} | dict.fromkeys(stamps[:1], TIME)
        columns, _ = _read(path, layout, keys)
        # A name that stands twice is no name: its column goes by its number.
        numbers_by_key = {
            i: str(i + 1) if layout.names.count(layout.names[i]) > 1 else layout.names[i]
            for i in keys
        }
        return {numbers_by_key[i]: columns[key] for i, key in keys.items()}

    return NamedColumns(layout.names, lambda chosen: _read(path, layout, chosen), numbers)


def constant_texts(path: Path) -> dict[str, str]:
    """The text of each column that holds one and the same in all of the first rows, such as a
    joint's name.

    Returns:
        By the column's name; columns of numbers are left out.

    Raises:
        RecordingError: The file is empty.
    """
    layout = sniff(path)
    with open_regular(path, "give a table", RecordingError) as stream:
        head = text_lines(stream.read(SNIFF_BYTES))[layout.first_line :][:LOOKED_AT]
    rows = [
        cells
        for line in head
        if len(cells := split_cells(line, layout.separator)) == len(layout.names)
    ]
    constants = {}
    for i, name in enumerate(layout.names):
        spoken = {row[i] for row in rows if row[i]}
        if len(spoken) == 1 and not is_number(text := spoken.pop()):
            constants[name] = text
    return constants


def _read(path: Path, layout: TextLayout, chosen: Mapping[int, str]) -> Table:
    if not chosen:
        return {}, ()
    columns = None
    with open_regular(path, "give a table", RecordingError) as stream:
        # Not a map of the file: where somebody cuts it short meanwhile, that ends the process.
        data = stream.read()
    if layout.separator == " ":  # runs of blanks are made one: Arrow knows single separators only
        data = re.sub(rb" {2,}", b" ", data.replace(b"\t", b" "))
        data = re.sub(rb"^ +| +$", b"", data, flags=re.MULTILINE)
    for clock in CLOCKS if TIME in chosen.values() else CLOCKS[:1]:
        try:
            cells = zip(
                chosen.values(),
                _parse(data, layout, chosen, {TIME: clock}, layout.first_line),
                strict=True,
            )
            columns = {native: column_numbers(column, native, "time") for native, column in cells}
            break
        except pa.ArrowInvalid:
            continue
    unused: tuple[TelemetryIssue, ...] = ()
    if columns is not None:
        columns, unused = drop_empty(columns, path)
        chosen = {index: native for index, native in chosen.items() if native in columns}
    if columns is None or not all(np.isfinite(values).all() for values in columns.values()):
        screened, issues = read_damaged(path, data, layout, chosen)
        return screened, (*unused, *issues)
    rows = len(next(iter(columns.values())))
    if not rows:
        raise RecordingError(path, "has a header and no rows", "give a table with samples")
    if ends_within_cell(path, layout):
        columns = {name: values[:-1] for name, values in columns.items()}
        unused = (*unused, cut_short(path, "row", rows))
    return columns, unused
