"""How a text table is written: separator, header, decimal point, found from its first lines."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

from ident.errors import RecordingError

SNIFF_BYTES = 1 << 16
COMMENTS = ("#", "%")


@dataclass(frozen=True)
class TextLayout:
    """How a text table is written.

    Attributes:
        names: Column names; "1", "2", … where there is no header.
        separator: One character; a blank stands for any run of blanks and tabs.
        first_line: 0-based number of the first line of data.
        decimal: Decimal point or comma.
    """

    names: tuple[str, ...]
    separator: str
    first_line: int
    decimal: str = "."

    def split(self, line: str) -> list[str]:
        """The cells of a line."""
        return split_cells(line, self.separator)


def split_cells(line: str, separator: str) -> list[str]:
    """Cells of a line, quotes taken off; within quotes a separator is text, and two quotes are one."""
    if '"' not in line or separator == " " or len(line) > csv.field_size_limit():
        cells = line.split() if separator == " " else line.split(separator)
        return [cell.strip().strip('"') for cell in cells]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]


def text_lines(data: bytes) -> list[str]:
    """The lines of a table as its readers count them: other control characters, and bytes, stay in their line."""
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
    with path.open("rb") as stream:
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
    names = split_cells(comments[-1].lstrip().lstrip("".join(COMMENTS)), separator) if comments else []
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
    return "," if cells and sum(bool(comma.fullmatch(cell)) for cell in cells) > len(cells) / 2 else "."


def ends_within_cell(path: Path, layout: TextLayout) -> bool:
    """Whether the file's last cell is surely cut short although it is still a number.

    Told by a missing line end and fewer decimals than all rows before: only tables of fixed decimals can tell.
    """
    with path.open("rb") as stream:
        stream.seek(0, 2)
        stream.seek(max(0, stream.tell() - SNIFF_BYTES))
        tail = stream.read()
    if tail.endswith((b"\n", b"\r")):
        return False
    *before, last = [layout.split(line)[-1:] for line in tail.decode(errors="replace").splitlines()[-20:]] or [[]]
    decimals = {len(cell[0].partition(layout.decimal)[2]) for cell in before[1:] if cell}
    cut = len(last[0].partition(layout.decimal)[2]) if last else 0
    return len(before) > 5 and len(decimals) == 1 and cut < decimals.pop()
