"""The store of a watch: Parquet files that others read too, one of each kind a session.

    figures/ARM/SESSION.parquet   arm, session, date, joint, figure, unit, value, low, high, std
    effects/ARM/SESSION.parquet   arm, session, date, effect, joints, probability, shrink, action
    sessions/ARM/SESSION.parquet  arm, session, date, status, verdict, reason, samples, duration_s, stamp, path, robot

The file below sessions/ is written last: where it is, the session is done. DuckDB: `from 'STORE/figures/*/*.parquet'`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pyarrow as pa
import pyarrow.parquet as pq

from ident.files import atomic_write

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
        """All rows of a kind, in the order of their files' names; a file that can't be read counts as not there."""
        found: list[dict[str, Any]] = []
        for path in sorted((self.folder / kind).glob("*/*.parquet")):
            try:
                found += pq.ParquetFile(path).read().to_pylist()
            except (pa.ArrowException, OSError):
                continue
        return found

    def stamps(self) -> dict[str, str]:
        """Stamp of each session that is done, by `arm/session`."""
        return {f"{row['arm']}/{row['session']}": row["stamp"] for row in self.read(DONE)}


def write_rows(path: Path, kind: str, rows: Iterable[Mapping[str, Any]]) -> None:
    """Writes a table of a kind, whole or not at all."""
    schema = pa.schema(list(SCHEMAS[kind].items()))
    table = pa.Table.from_pylist([{name: row.get(name) for name in SCHEMAS[kind]} for row in rows], schema=schema)
    with atomic_write(path) as part:
        pq.write_table(table, part, compression="zstd")


def _file_name(name: str) -> str:
    return quote(name, safe=" +=@,()") or "_"
