"""How many numbers a Parquet file holds, from its footer.

Arrow's own accessor of a column's facts ends the process where a footer is damaged; this one raises ValueError.

Source: Apache Parquet, parquet.thrift (numbers of the fields); Apache Thrift, compact protocol.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

# Fields that lead to the number of values: of the file its row groups, of these the columns, of these their facts.
ROW_GROUPS, COLUMNS, FACTS, VALUES = 4, 1, 3, 5
TRUE, FALSE, BYTE, DOUBLE, BINARY, LIST, SET, STRUCT = 1, 2, 3, 7, 8, 9, 10, 12
# A footer nests five levels deep.
DEEPEST = 16


def count_values(path: Path) -> int:
    """Numbers of all columns, those in lists each by itself.

    Raises:
        ValueError: The footer is damaged.
        OSError: The file can't be read.
    """
    with path.open("rb") as stream:
        stream.seek(-8, 2)
        length = int.from_bytes(stream.read(4), "little")
        stream.seek(-8 - length, 2)
        footer = _Footer(stream.read(length))
    try:
        groups = footer.struct(0)[ROW_GROUPS]
        return sum(column[FACTS][VALUES] for group in groups for column in group[COLUMNS])
    except (IndexError, KeyError, TypeError) as error:
        raise ValueError(f"its footer is damaged ({type(error).__name__})") from None


class _Footer:
    """Reads values one after the other; each takes a byte at least, so that no length can make it go on for ever."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def struct(self, depth: int) -> dict[int, Any]:
        """The fields of a structure by their numbers."""
        if depth > DEEPEST:
            raise ValueError(f"its footer nests more than {DEEPEST} levels deep")
        found: dict[int, Any] = {}
        number = 0
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._integer()
            found[number] = self._value(head & 15, depth)
        return found

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
        count, kind = head >> 4, head & 15
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
