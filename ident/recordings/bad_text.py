"""Text tables with damaged cells: which lines and cells hold numbers, which text, and which nothing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv

from ident.arrays import Array, Bool, Float
from ident.errors import RecordingError
from ident.recordings.bad_cells import Cells
from ident.recordings.columns import Table
from ident.recordings.text import TextLayout

NUMBER = r"^[\s\"]*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?[\s\"]*$"
MISSING = r"(?i)^[\s\"]*[-+]?(|nan|n/a|na|null|none|inf|infinity|1\.#\w+)[\s\"]*$"


def read_damaged(path: Path, data: bytes | pa.Buffer, layout: TextLayout, chosen: Mapping[int, str]) -> Table:
    """Reads a table that the fast path refused, or in which it met NaN (see `Cells.screen`).

    Blank lines are skipped. A carriage return within a line would part it once more: it is made a letter, which spoils
    its cell alone.

    Args:
        path: The file, for messages.
        data: Its bytes.
        layout: How it is written.
        chosen: Index of the column -> native name.

    Raises:
        RecordingError: No row, or hardly any, can be read.
    """
    lines = bytes(data).split(b"\n")
    separator, expected = layout.separator.encode(), len(layout.names) - 1
    numbers = np.array([number for number in range(layout.first_line, len(lines)) if lines[number].strip()], dtype=int)
    counts = np.array([lines[number].count(separator) for number in numbers], dtype=int)
    good, misshapen = numbers[counts == expected], numbers[counts != expected] + 1
    truncated = int(numbers[-1]) + 1 if len(numbers) and counts[-1] < expected else None
    misshapen = misshapen[misshapen != truncated] if truncated else misshapen
    if len(misshapen) > len(good):
        what = f"most rows have another number of cells than the {len(layout.names)} of the first line"
        raise RecordingError(f"{path}, line {misshapen[0]}", what, "correct the header or the separator")
    if len(good) == 0:
        raise RecordingError(path, "has no whole row", "give a table with samples")
    text = b"\n".join([lines[number].rstrip(b"\r").replace(b"\r", b"?") for number in good])
    try:
        raw = _parse(text, layout, chosen)
    except pa.ArrowException as error:
        reason = str(error).partition(":")[0]
        raise RecordingError(path, f"its rows can't be parted ({reason})", "write the table again") from None
    values, masks = zip(*(_to_numbers(column, layout.decimal) for column in raw), strict=True)
    bad = [
        mask[-1] or not (np.isfinite(column[-1]) or native.endswith("/temperature"))
        for native, column, mask in zip(chosen.values(), values, masks, strict=True)
    ]
    if int(good[-1]) == len(lines) - 1 and any(bad):  # its line lacks an end
        truncated = int(good[-1]) + 1
    labels = [(layout.names[index], native) for index, native in chosen.items()]
    return Cells(
        path,
        dict(zip(chosen.values(), values, strict=True)),
        "line",
        [own if own == native else f"{own} ({native})" for own, native in labels],
        good + 1,
        np.column_stack(masks),
        [int(number) for number in misshapen],
        truncated,
        lambda row, column: raw[column][row].as_py().decode(errors="replace").strip(),
    ).screen()


def _parse(text: bytes, layout: TextLayout, chosen: Mapping[int, str]) -> list[pa.Array]:
    """The chosen columns of lines that have the right number of cells, as they stand."""
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
    return [table.column(name).combine_chunks() for name in wanted]


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
