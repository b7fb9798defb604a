"""The store of a watch: Parquet files that others read too, one of each kind a session.

    figures/ARM/SESSION.parquet   arm, session, date, joint, figure, unit, value, low, high, std
    effects/ARM/SESSION.parquet   arm, session, date, effect, joints, probability, shrink, action
    sessions/ARM/SESSION.parquet  arm, session, date, status, verdict, reason, samples, duration_s, stamp, path, robot

The file below sessions/ is written last: where it is, the session is done. DuckDB: `from 'STORE/figures/*/*.parquet'`.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pyarrow as pa
import pyarrow.parquet as pq

from ident.errors import InputError
from ident.files import atomic_write
from ident.safe_read import require_regular, require_unpacked

TEXT, NUMBER = pa.string(), pa.float64()
SCHEMAS: dict[str, dict[str, pa.DataType]] = {
    "figures": {
        **dict.fromkeys(("arm", "session", "date", "joint", "figure", "unit"), TEXT),
        **dict.fromkeys(("value", "low", "high", "std"), NUMBER),
    },
    "effects": {
        **dict.fromkeys(("arm", "session", "date", "effect", "joints"), TEXT),
        **dict.fromkeys(("probability", "shrink"), NUMBER),
        "action": TEXT,
    },
    "sessions": {
        **dict.fromkeys(("arm", "session", "date", "status", "verdict", "reason"), TEXT),
        "samples": pa.int64(),
        "duration_s": NUMBER,
        **dict.fromkeys(("stamp", "path", "robot"), TEXT),
    },
    "alarms": {
        **dict.fromkeys(("arm", "joint", "figure", "session", "since"), TEXT),
        **dict.fromkeys(("evidence", "probability", "before", "after", "low", "high", "spread"), NUMBER),
        **dict.fromkeys(("scale", "scale_low", "scale_high"), NUMBER),
    },
}
DONE = "sessions"
# Names of files have 255 bytes at the most; an ending and a temporary name's beginning need some.
LONGEST_NAME = 180
# Whatever else is missing in a row, without these it says nothing; a fit session's estimates have all their numbers.
NEEDED = ("arm", "session", "date", "joint", "figure", "status", "effect", "value", "low", "high", "std")


@dataclass(frozen=True)
class Store:
    """A folder of results.

    Attributes:
        folder: Where it is.
    """

    folder: Path

    def place(self, kind: str, arm: str, session: str, suffix: str = ".parquet") -> Path:
        """The file of a session; names that no file can have are quoted."""
        return self.folder / kind / _file_name(arm) / f"{_file_name(session)}{suffix}"

    def page(self, arm: str) -> Path:
        """The page of an arm."""
        return self.folder / f"arm-{_file_name(arm)}.html"

    def write(self, kind: str, arm: str, session: str, rows: Iterable[Mapping[str, Any]]) -> None:
        """Writes the rows of a session, whole or not at all."""
        write_rows(self.place(kind, arm, session), kind, rows)

    def read(self, kind: str) -> list[dict[str, Any]]:
        """All rows of a kind, in the order of their files' names; a file that is none of ours counts as not there.

        So does a table of other columns, and one that unpacks to more than any of ours.
        """
        found: list[dict[str, Any]] = []
        for path in sorted((self.folder / kind).glob("*/*.parquet")):
            try:
                size, file = require_regular(path, "a watch writes it again"), pq.ParquetFile(path)
                require_unpacked(size, 64 * file.metadata.num_rows * len(SCHEMAS[kind]))
                rows = file.read().to_pylist() if file.schema_arrow.equals(pa.schema(SCHEMAS[kind])) else []
            except (pa.ArrowException, OSError, ValueError, InputError):
                continue
            for row in rows:
                needed = [row[name] for name in NEEDED if name in row]
                if all(math.isfinite(one) if isinstance(one, float) else one is not None for one in needed):
                    found.append(row)
        return found

    def stamps(self) -> dict[str, str]:
        """Stamp of each session that is done, by `arm/session`."""
        return {f"{row['arm']}/{row['session']}": row["stamp"] for row in self.read(DONE)}


def write_rows(path: Path, kind: str, rows: Iterable[Mapping[str, Any]]) -> None:
    """Writes a table of a kind, whole or not at all."""
    columns = SCHEMAS[kind]
    table = pa.Table.from_pylist([{name: row.get(name) for name in columns} for row in rows], schema=pa.schema(columns))
    with atomic_write(path) as part:
        pq.write_table(table, part, compression="zstd")


def _file_name(name: str) -> str:
    """A name that every file system takes; a long one keeps its beginning and a digest of all of it."""
    quoted = quote(name, safe=" +=@,()") or "_"
    if len(quoted) <= LONGEST_NAME:
        return quoted
    return f"{quoted[: LONGEST_NAME - 17]}-{hashlib.sha256(name.encode()).hexdigest()[:16]}"
