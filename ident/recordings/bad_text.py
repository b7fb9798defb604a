"""Text tables with damaged cells: drops what is surely no sample, keeps and names the rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv

from ident.arrays import Array, Bool, Float, Int
from ident.errors import RecordingError
from ident.recordings.bad_cells import MOST_CELLS, Damage, describe_damage, without_infinity
from ident.recordings.columns import Table
from ident.recordings.text import TextLayout

NUMBER = r"^[\s\"]*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?[\s\"]*$"
MISSING = r"(?i)^[\s\"]*[-+]?(|nan|n/a|na|null|none|inf|infinity|1\.#\w+)[\s\"]*$"


@dataclass(frozen=True)
class Lines:
    """The lines of data that have the right number of cells, and the numbers of those that have not.

    Attributes:
        text: Right lines, joined.
        numbers: Their 1-based line numbers.
        misshapen: Line numbers of the others.
        truncated: Number of the last line if it ends too early, else None.
        ends_open: Whether the last right line is the file's last and lacks its line end.
    """

    text: bytes
    numbers: Int[Array, " R"]
    misshapen: Int[Array, " M"]
    truncated: int | None
    ends_open: bool


def read_damaged(path: Path, data: bytes | pa.Buffer, layout: TextLayout, chosen: Mapping[int, str]) -> Table:
    """Reads a table that the fast path refused, or in which it met NaN.

    A row is dropped if it is surely no sample: a wrong number of cells, most cells unreadable (a line of a log, a
    repeated header), or the file's last row cut short. Single unreadable cells in an otherwise good row become NaN
    with a fatal issue, as nobody knows what else is wrong in that row.

    Args:
        path: The file, for messages.
        data: Its bytes.
        layout: How it is written.
        chosen: Index of the column -> native name.

    Raises:
        RecordingError: No row, or hardly any, can be read.
    """
    lines = _sort_lines(bytes(data), layout)
    if len(lines.misshapen) > len(lines.numbers):
        what = f"most rows have another number of cells than the {len(layout.names)} of the first line"
        raise RecordingError(f"{path}, line {lines.misshapen[0]}", what, "correct the header or the separator")
    if len(lines.numbers) == 0:
        raise RecordingError(path, "has no whole row", "give a table with samples")
    try:
        parsed = _parse(lines.text, layout, chosen)
    except pa.ArrowException as error:
        reason = str(error).partition(":")[0]
        raise RecordingError(path, f"its rows can't be parted ({reason})", "write the table again") from None
    bad = parsed.text | parsed.missing
    lost, has_text = bad.mean(axis=1) >= MOST_CELLS, parsed.text.any(axis=1)
    truncated = lines.truncated
    if lines.ends_open and bad[-1].any():
        lost[-1], truncated = True, int(lines.numbers[-1])
    in_good_rows = np.argwhere(parsed.text & ~lost[:, None])
    unreadable = np.sort(np.append(lines.misshapen, lines.numbers[lost & has_text]))
    labels = [(layout.names[index], native) for index, native in chosen.items()]
    damage = Damage(
        source=path,
        place="line",
        names=tuple(own if own == native else f"{own} ({native})" for own, native in labels),
        natives=tuple(chosen.values()),
        rows=len(lines.numbers) + len(lines.misshapen),
        garbage_rows=unreadable[unreadable != truncated],
        empty_rows=lines.numbers[lost & ~has_text & (lines.numbers != truncated)],
        truncated_row=truncated,
        text_cells=_cells(parsed.text & ~lost[:, None], lines.numbers),
        missing_cells=_cells(parsed.missing & ~lost[:, None], lines.numbers),
        sample=parsed.sample(*in_good_rows[0]) if len(in_good_rows) else "",
    )
    if lost.all():
        raise RecordingError(path, "no row can be read", "give a table with numbers")
    kept = {native: without_infinity(values[~lost]) for native, values in parsed.columns.items()}
    return Table(kept, describe_damage(damage))


def _cells(mask: Bool[Array, "R k"], numbers: Int[Array, " R"]) -> Int[Array, "c 2"]:
    """(line number, index of the column) of marked cells."""
    row, column = np.nonzero(mask)
    return np.column_stack([numbers[row], column])


def _sort_lines(data: bytes, layout: TextLayout) -> Lines:
    """Parts the lines by their number of cells; blank lines are skipped.

    A carriage return within a line would part it once more: it is made a letter, which spoils its cell alone.
    """
    lines = data.split(b"\n")
    separator, expected = layout.separator.encode(), len(layout.names) - 1
    numbers = np.array([number for number in range(layout.first_line, len(lines)) if lines[number].strip()], dtype=int)
    right = np.array([lines[number].count(separator) == expected for number in numbers], dtype=bool)
    truncated = None
    if len(numbers) and not right[-1] and lines[numbers[-1]].count(separator) < expected:
        truncated = int(numbers[-1]) + 1
    good = numbers[right]
    misshapen = numbers[~right] + 1
    return Lines(
        text=b"\n".join([lines[number].rstrip(b"\r").replace(b"\r", b"?") for number in good]),
        numbers=good + 1,
        misshapen=misshapen[misshapen != truncated] if truncated else misshapen,
        truncated=truncated,
        ends_open=bool(len(good)) and int(good[-1]) == len(lines) - 1,
    )


@dataclass(frozen=True)
class Parsed:
    """The chosen columns of the right lines.

    Attributes:
        columns: Native name -> numbers, NaN where there is none.
        text: Mask of cells that hold text.
        missing: Mask of cells that are empty, NaN, infinite or beyond a float's range.
        cells: The raw cells, a column each.
    """

    columns: dict[str, Float[Array, " R"]]
    text: Bool[Array, "R k"]
    missing: Bool[Array, "R k"]
    cells: list[pa.Array]

    def sample(self, row: int, column: int) -> str:
        """A cell as it stands in the file."""
        return self.cells[column][row].as_py().decode(errors="replace").strip()


def _parse(text: bytes, layout: TextLayout, chosen: Mapping[int, str]) -> Parsed:
    positions = [f"f{index}" for index in range(len(layout.names))]
    wanted = [positions[index] for index in chosen]
    table = pacsv.read_csv(
        pa.BufferReader(text),
        read_options=pacsv.ReadOptions(column_names=positions, block_size=1 << 24),
        parse_options=pacsv.ParseOptions(delimiter=layout.separator, quote_char=False),
        convert_options=pacsv.ConvertOptions(
            column_types=dict.fromkeys(wanted, pa.binary()), include_columns=wanted, strings_can_be_null=False
        ),
    )
    cells = [table.column(name).combine_chunks() for name in wanted]
    numbers, masks = zip(*(_to_numbers(column, layout.decimal) for column in cells), strict=True)
    text_cells = np.column_stack(masks)
    # Temperature is often logged more slowly than the rest: its empty cells are filled later, not refused.
    sparse = np.array([native.endswith("/temperature") for native in chosen.values()])
    missing = ~text_cells & ~np.isfinite(np.column_stack(numbers)) & ~sparse
    return Parsed(dict(zip(chosen.values(), numbers, strict=True)), text_cells, missing, cells)


def _to_numbers(cells: pa.Array, decimal: str) -> tuple[Float[Array, " R"], Bool[Array, " R"]]:
    """Numbers of a column, NaN where there is none, and the mask of cells that hold text."""
    if decimal == ",":
        cells = pc.replace_substring(cells, ",", ".")
    number = pc.match_substring_regex(cells, NUMBER)
    absent = pc.match_substring_regex(cells, MISSING)
    readable = pc.if_else(number, cells, pa.scalar(None, pa.binary())).cast(pa.string())
    values = pc.replace_substring_regex(readable, r'[\s"+]+', "").cast(pa.float64())
    text = ~(number.to_numpy(zero_copy_only=False) | absent.to_numpy(zero_copy_only=False))
    return values.to_numpy(zero_copy_only=False), text
