"""Parquet files, and Arrow's columns as numbers.

Arrow's own accessor of a column's facts ends the process where a footer is damaged; this one raises
ValueError.

Source: Apache Parquet, parquet.thrift (numbers of the fields); Apache Thrift, compact protocol.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
import pyarrow as pa

from ident.arrays import Array, Float
from ident.errors import RecordingError, first_line
from ident.recordings.bad_cells import named_columns
from ident.recordings.columns import NamedColumns
from ident.safe_read import open_regular, require_unpacked

if TYPE_CHECKING:
    import pyarrow.parquet as pq


# Fields that lead to the number of values and to the pages: of the file its row groups, of these
# the columns, of these their facts.
ROW_GROUPS = 4
COLUMNS = 1
FACTS = 3
VALUES = 5
PACKED = 7
DATA_PLACE = 9
DICTIONARY_PLACE = 11
# Of a page's header: what it unpacks to, and what it takes in the file.
UNPACKED_PAGE = 2
PACKED_PAGE = 3
# The header of a page is far shorter.
HEADER_BYTES = 1 << 16
TRUE = 1
FALSE = 2
BYTE = 3
DOUBLE = 7
BINARY = 8
LIST = 9
SET = 10
STRUCT = 12
# A footer nests five levels deep.
DEEPEST = 16
# A column of lists is as many columns: `q.0`, `q.1`, …, or `q.<label>` where the file names its
# places. How an ISO 8601 time ends that says its zone.
ZONE = re.compile(r"(Z|[+-]\d\d:?\d\d)$")
# A list longer than this is a picture or a cloud of points, no joints.
MOST_PLACES = 64
# The fields of a structure by their numbers.
Fields = dict[int, Any]
FAILURES = (pa.ArrowException, OSError, ValueError, UnicodeDecodeError)


def require_in_proportion(stream: BinaryIO) -> None:
    """Passes if an open file holds no more than its size lets expect, by its footer and its pages.

    What the footer says of the number of values is not what is unpacked: Arrow unpacks a page
    whole, as large as the page itself says, before it takes a value from it.

    Raises:
        ValueError: It unpacks to more; or the footer or a page's header is damaged.
        OSError: The file can't be read.
    """
    footer = read_footer(stream)
    size = os.fstat(stream.fileno()).st_size
    require_unpacked(size, 8 * count_values(footer))
    require_unpacked(size, _unpacked_pages(stream, footer))


def read_footer(stream: BinaryIO) -> Fields:
    """What stands at the end of an open file, by the numbers of its fields.

    Raises:
        ValueError: It is damaged.
        OSError: The file can't be read.
    """
    stream.seek(-8, 2)
    length = int.from_bytes(stream.read(4), "little")
    stream.seek(-8 - length, 2)
    try:
        return _Footer(stream.read(length)).struct(0)
    except (IndexError, TypeError) as error:
        raise ValueError(f"its footer is damaged ({type(error).__name__})") from None


def count_values(footer: Fields) -> int:
    """Numbers of all columns, those in lists each by itself.

    Raises:
        ValueError: The footer is damaged.
    """
    try:
        return sum(facts[VALUES] for facts in _all_facts(footer))
    except (IndexError, KeyError, TypeError) as error:
        raise ValueError(f"its footer is damaged ({type(error).__name__})") from None


def _all_facts(footer: Fields) -> Iterator[Fields]:
    """The facts of each column of each row group."""
    for group in footer[ROW_GROUPS]:
        for column in group[COLUMNS]:
            yield column[FACTS]


def _unpacked_pages(stream: BinaryIO, footer: Fields) -> int:
    """What all pages say that they unpack to [bytes]."""
    total = 0
    try:
        for facts in _all_facts(footer):
            if not facts[VALUES]:  # Arrow reads none of its pages, and there may be none
                continue
            first = facts[DATA_PLACE]
            dictionary = facts.get(DICTIONARY_PLACE, 0)
            begin = dictionary if 0 < dictionary < first else first
            place = begin
            while place < begin + facts[PACKED]:
                header, length = _page_header(stream, place)
                total += header[UNPACKED_PAGE]
                place += length + max(0, header[PACKED_PAGE])
    except (IndexError, KeyError, TypeError) as error:
        raise ValueError(f"a page of it is damaged ({type(error).__name__})") from None
    return total


def _page_header(stream: BinaryIO, place: int) -> tuple[Fields, int]:
    """The header of a page, and its length [bytes]."""
    stream.seek(place)
    reader = _Footer(stream.read(HEADER_BYTES))
    return reader.struct(0), reader.at


class _Footer:
    """Reads values one after the other; each takes a byte at least, so that no length can make it
    go on for ever.
    """

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def struct(self, depth: int) -> Fields:
        """The fields of a structure by their numbers."""
        if depth > DEEPEST:
            raise ValueError(f"its footer nests more than {DEEPEST} levels deep")
        fields: Fields = {}
        number = 0
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._integer()
            fields[number] = self._value(head & 15, depth)
        return fields

    def _value(self, kind: int, depth: int) -> Any:
        if kind in (TRUE, FALSE):
            return kind == TRUE
        if kind in (LIST, SET):
            return self._list(depth)
        if kind == STRUCT:
            return self.struct(depth + 1)
        if kind == BINARY:
            return self._skip(self._varint())
        if kind in (BYTE, DOUBLE):
            return self._skip(8 if kind == DOUBLE else 1)
        if BYTE < kind < DOUBLE:
            return self._integer()
        raise ValueError(f"its footer holds a value of kind {kind}")

    def _list(self, depth: int) -> list[Any]:
        head = self._byte()
        count = head >> 4
        kind = head & 15
        count = self._varint() if count == 15 else count
        kind = BYTE if kind in (TRUE, FALSE) else kind
        return [self._value(kind, depth + 1) for _ in range(count)]

    def _skip(self, length: int) -> None:
        self.at += length
        if self.at > len(self.data):
            raise IndexError

    def _byte(self) -> int:
        self.at += 1
        return self.data[self.at - 1]

    def _varint(self) -> int:
        value = shift = 0
        while (byte := self._byte()) >= 128:
            value |= (byte & 127) << shift
            shift += 7
        return value | byte << shift

    def _integer(self) -> int:
        value = self._varint()
        return value >> 1 ^ -(value & 1)


Column = Any  # pa.ChunkedArray or pa.Array


def open_table(path: Path) -> NamedColumns:
    """The columns of a Parquet file; read when they are asked for.

    Raises:
        RecordingError: Not a Parquet file; when columns are read: no rows, or a column that holds
            no numbers.
    """
    try:
        with open_parquet(path) as file:
            nested = [
                column.name
                for column in file.schema_arrow
                if pa.types.is_nested(column.type) and may_be_numbers(column.type)
            ]
            first = next(file.iter_batches(batch_size=1, columns=nested), None) if nested else None
            lists = {}
            for name, column in (
                () if first is None else zip(first.schema.names, first.columns, strict=True)
            ):
                lists[name] = list(spread_list(name, pa.chunked_array([column])))
            homes = [
                (name, cell_name)
                for name in file.schema_arrow.names
                for cell_name in lists.get(name, (name,))
            ]
    except FAILURES as error:
        raise RecordingError(path, *_not_whole(error)) from None
    names = tuple(cell_name for _, cell_name in homes)

    def load(chosen: Sequence[int]) -> list[Float[Array, " T"]]:
        cells = _cells(path, {}, list(dict.fromkeys(homes[index][0] for index in chosen)))
        return [column_numbers(cells[names[index]], names[index], path) for index in chosen]

    def numbers() -> dict[str, Float[Array, " T"]]:
        return {
            name: column_numbers(values, name, path) for name, values in load_columns(path).items()
        }

    return named_columns(names, load, path, numbers)


@contextmanager
def open_parquet(path: Path) -> Iterator[pq.ParquetFile]:
    """Opens a Parquet file whose numbers are in proportion to its size: constants pack without end.

    Raises:
        RecordingError: No plain file.
        ValueError: It unpacks to more than any recording; pyarrow raises its own where it is none.
    """
    import pyarrow.parquet as pq  # slow to load, and text tables need none

    with open_regular(path, "give a table", RecordingError) as stream:
        # not read_table: that loads all of pyarrow's data sets, at half a second
        file = pq.ParquetFile(stream)
        require_in_proportion(stream)
        # A text that stands in a million cells stands once in the file, and is to stand once in
        # memory.
        texts = [field.name for field in file.schema_arrow if is_text(field.type)]
        yield pq.ParquetFile(stream, read_dictionary=texts) if texts else file


def read_numbers(file: pq.ParquetFile, names: Sequence[str] | None, where: str | Path) -> pa.Table:
    """Some columns of an open file, or all that may hold numbers; no other column is unpacked.

    Args:
        file: The file.
        names: Names of columns; all if None.
        where: The file, for messages.

    Raises:
        RecordingError: A column that was asked for holds no numbers.
        ValueError: A column stands twice; pyarrow raises its own where the file is damaged.
    """
    usable = []
    for column in file.schema_arrow:
        if names is not None and column.name not in names:
            continue
        if file.schema_arrow.names.count(column.name) > 1:
            raise ValueError(f"the column {column.name!r} stands twice")
        if may_be_numbers(column.type):
            usable.append(column.name)
        elif names is not None:
            what = f"holds no numbers ({column.type})"
            raise RecordingError(f"{where}, column {column.name}", what, "write it as numbers")
    return file.read(columns=usable)


def may_be_numbers(kind: pa.DataType) -> bool:
    """Whether a column may hold numbers or stamps: only then it is unpacked.

    What else is in a file (pictures, structures, bytes) may be gigabytes that stand in it once.
    """
    if pa.types.is_fixed_size_list(kind) or pa.types.is_list(kind) or pa.types.is_large_list(kind):
        kind = kind.value_type
        return pa.types.is_floating(kind) or pa.types.is_integer(kind)
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    is_stamp = pa.types.is_string(kind) or pa.types.is_large_string(kind)
    return is_stamp or pa.types.is_primitive(kind) or pa.types.is_decimal(kind)


def is_text(kind: pa.DataType) -> bool:
    """Whether a column holds texts or bytes."""
    return any(
        test(kind) for test in (pa.types.is_string, pa.types.is_large_string, pa.types.is_binary)
    )


def load_columns(
    path: Path, labels: Mapping[str, Sequence[str]] | None = None
) -> dict[str, Column]:
    """All columns of numbers of a file.

    Args:
        path: The file.
        labels: For columns of lists, the names of a list's places; numbers from 0 where there are
            none or too few.

    Returns:
        By name; the places of a list are `<name>.<label>`.

    Raises:
        RecordingError: Not a Parquet file, or lists of different lengths.
    """
    cells = _cells(path, labels or {})
    return {
        name: cell
        for name, cell in cells.items()
        if pa.types.is_floating(cell.type) or pa.types.is_integer(cell.type)
    }


def _cells(
    path: Path, labels: Mapping[str, Sequence[str]], names: list[str] | None = None
) -> dict[str, Column]:
    """Some columns of a file, or all that may hold numbers; lists spread out."""
    try:
        with open_parquet(path) as file:
            table = read_numbers(file, names, path)
        columns: dict[str, Column] = {}
        for name in table.column_names:
            columns.update(spread_list(name, table.column(name), labels.get(name, ())))
    except FAILURES as error:
        raise RecordingError(path, *_not_whole(error)) from None
    return columns


def _not_whole(error: Exception) -> tuple[str, str]:
    return f"not a whole Parquet file ({first_line(error)})", "write the file again"


def spread_list(
    name: str, column: pa.ChunkedArray, labels: Sequence[str] = ()
) -> dict[str, Column]:
    """A column of lists as columns of numbers `<name>.<label>`; any other column as it is.

    Args:
        name: The column's name.
        column: The column.
        labels: Names of a list's places; numbers from 0 where they are not as many as the places.

    Returns:
        By name. Lists of anything but numbers, or very long ones, stay one column.
    """
    kind = column.type
    length = 0
    if pa.types.is_fixed_size_list(kind):
        length = int(kind.list_size)
    elif pa.types.is_list(kind) or pa.types.is_large_list(kind):
        length = next(
            (len(entry) for chunk in column.chunks for entry in chunk if entry.is_valid), 0
        )
    numeric = length and (
        pa.types.is_floating(kind.value_type) or pa.types.is_integer(kind.value_type)
    )
    if not numeric or length > MOST_PLACES:
        return {name: column}
    import pyarrow.compute as pc  # slow to load, and few tables hold lists

    cell_labels = labels if len(set(labels)) == length else [str(i) for i in range(length)]
    return {f"{name}.{label}": pc.list_element(column, i) for i, label in enumerate(cell_labels)}


def column_numbers(column: Column, name: str, where: str | Path) -> Float[Array, " T"]:
    """A column as float; timestamps and durations become seconds.

    Raises:
        RecordingError: It holds no numbers.
    """
    try:
        if pa.types.is_dictionary(column.type):
            return _dictionary_numbers(column, name, where)
        if pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
            zoned = len(column) and ZONE.search(str(column[0]))
            column = column.cast(pa.timestamp("ns", "UTC" if zoned else None))  # ISO 8601
        if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
            nanoseconds = column.cast(
                pa.timestamp("ns") if pa.types.is_timestamp(column.type) else pa.duration("ns")
            )
            return nanoseconds.cast(pa.int64()).to_numpy() * 1e-9
        # A cast loads all of Arrow's functions, at a tenth of a second. Unsafe, as nanoseconds
        # since 1970 need more than 53 bits: a float rounds them to a quarter of a microsecond.
        column = (
            column if pa.types.is_float64(column.type) else column.cast(pa.float64(), safe=False)
        )
        chunks = (
            chunk
            for chunk in (column.chunks if isinstance(column, pa.ChunkedArray) else [column])
            if len(chunk)
        )
        # Without a gap from the buffer itself: Arrow's own way loads pandas where there is one, at
        # half a second.
        parts = [
            np.asarray(chunk.to_numpy(zero_copy_only=False))
            if chunk.null_count
            else np.frombuffer(chunk.buffers()[1], dtype=float)[
                chunk.offset : chunk.offset + len(chunk)
            ]
            for chunk in chunks
        ]
        return np.concatenate([np.empty(0), *parts]) if len(parts) != 1 else parts[0]
    except (pa.ArrowException, ValueError, TypeError) as error:
        what = f"holds no numbers ({first_line(error)})"
        raise RecordingError(f"{where}, column {name}", what, "write it as numbers") from None


def _dictionary_numbers(column: Column, name: str, where: str | Path) -> Float[Array, " T"]:
    """The same of a column whose chunks hold each value once, and where it stands; each value is
    read once.
    """
    parts = [np.empty(0)]
    for chunk in column.chunks if isinstance(column, pa.ChunkedArray) else [column]:
        if len(chunk):
            values = column_numbers(chunk.dictionary, name, where)
            if chunk.null_count or not len(values):
                raise RecordingError(
                    f"{where}, column {name}", "holds empty cells", "write every cell out"
                )
            parts.append(values[np.asarray(chunk.indices)])
    return np.concatenate(parts)
