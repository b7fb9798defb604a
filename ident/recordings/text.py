"""CSV and other text tables, by Arrow: all cells at once on all cores, straight to numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.recordings.bad_cells import Damage, describe_damage, drop_empty
from ident.recordings.columns import TIME, NamedColumns, Table
from ident.recordings.dialect import SNIFF_BYTES, TextLayout, ends_within_cell, is_number, sniff, text_lines
from ident.recordings.parquet import column_numbers
from ident.recordings.recording import TelemetryIssue

# Columns that hold text in most of so many first rows are no columns of numbers.
LOOKED_AT = 50
# What the cells of a time are: numbers, or ISO 8601 without and with a zone.
CLOCKS = (pa.float64(), pa.timestamp("ns"), pa.timestamp("ns", "UTC"))
BLOCK_BYTES = 1 << 24  # a thread works on a block; Arrow's default of 1 MB costs more overhead than it balances


def open_text(path: Path) -> NamedColumns:
    """The columns of a text table.

    Raises:
        RecordingError: The file is empty; when columns are read, that it has no rows.
    """
    layout = sniff(path)

    def numbers() -> dict[str, Float[Array, " T"]]:
        with path.open("rb") as stream:
            head = text_lines(stream.read(SNIFF_BYTES))[layout.first_line :][:LOOKED_AT]
        rows = [cells for line in head if len(cells := layout.split(line)) == len(layout.names)]
        filled = [i for i in range(len(layout.names)) if sum(is_number(row[i]) for row in rows) > len(rows) / 2]
        if not filled:
            raise RecordingError(path, "has no column of numbers", "give a table of samples")
        table = _read(path, layout, {i: f"column_{i}/position" for i in filled})
        # A name that stands twice is no name: its column goes by its number.
        own = [str(i + 1) if layout.names.count(layout.names[i]) > 1 else layout.names[i] for i in filled]
        return {name: table.columns[f"column_{i}/position"] for i, name in zip(filled, own, strict=True)}

    return NamedColumns(layout.names, lambda chosen: _read(path, layout, chosen), numbers)


def _read(path: Path, layout: TextLayout, chosen: Mapping[int, str]) -> Table:
    if not chosen:
        return Table({})
    data = _content(path, layout)
    columns = None
    for clock in CLOCKS if TIME in chosen.values() else CLOCKS[:1]:
        try:
            columns = _read_fast(data, layout, chosen, clock)
            break
        except pa.ArrowInvalid:
            continue
    unused: tuple[TelemetryIssue, ...] = ()
    if columns is not None:
        columns, unused = drop_empty(columns, path)
        chosen = {index: native for index, native in chosen.items() if native in columns}
    if columns is None or not all(np.isfinite(values).all() for values in columns.values()):
        from ident.recordings.bad_text import read_damaged  # slow to load, and few tables need it

        damaged = read_damaged(path, data, layout, chosen)
        return Table(damaged.columns, (*unused, *damaged.issues))
    rows = len(next(iter(columns.values())))
    if not rows:
        raise RecordingError(path, "has a header and no rows", "give a table with samples")
    if ends_within_cell(path, layout):
        damage = Damage(path, "row", (), (), rows, truncated_row=rows)
        columns = {name: values[:-1] for name, values in columns.items()}
        unused = (*unused, *describe_damage(damage))
    return Table(columns, unused)


def _content(path: Path, layout: TextLayout) -> bytes | pa.Buffer:
    """The file's bytes: mapped, or with runs of blanks made one (Arrow knows single separators only)."""
    if layout.separator != " ":
        return pa.memory_map(str(path)).read_buffer()
    data = path.read_bytes().replace(b"\t", b" ")
    return re.sub(rb"^ +| +$", b"", re.sub(rb" {2,}", b" ", data), flags=re.MULTILINE)


def _read_fast(
    data: bytes | pa.Buffer, layout: TextLayout, chosen: Mapping[int, str], clock: pa.DataType
) -> dict[str, np.ndarray]:
    """Arrow's own reader, straight to columns of floats; raises `ArrowInvalid` at the first bad cell or row.

    Args:
        data: The file's bytes.
        layout: How it is written.
        chosen: Index of the column -> native name.
        clock: What the cells of the time are, one of `CLOCKS`.
    """
    positions = [f"f{index}" for index in range(len(layout.names))]
    wanted = [positions[index] for index in chosen]
    table = pacsv.read_csv(
        pa.BufferReader(data),
        read_options=pacsv.ReadOptions(column_names=positions, skip_rows=layout.first_line, block_size=BLOCK_BYTES),
        parse_options=pacsv.ParseOptions(delimiter=layout.separator),
        convert_options=pacsv.ConvertOptions(
            column_types={
                position: clock if native == TIME else pa.float64()
                for position, native in zip(wanted, chosen.values(), strict=True)
            },
            include_columns=wanted,
            decimal_point=layout.decimal,
        ),
    )
    return {
        native: column_numbers(table.column(name), native, "time")
        for name, native in zip(wanted, chosen.values(), strict=True)
    }
