"""A timeline read back from its file."""

from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader

from ident.arrays import Array


class Saved:
    """A saved timeline: static components and columns over time, entity by entity."""

    def __init__(self, path: Path) -> None:
        self.static: dict[str, dict[str, list[Any]]] = {}
        self.columns: dict[str, dict[str, list[Any]]] = {}
        for chunk in RrdReader(path).stream().to_chunks():
            into = self.static if chunk.is_static else self.columns
            table = into.setdefault(chunk.entity_path, {})
            for name, values in chunk.to_record_batch().to_pydict().items():
                table.setdefault(name, []).extend(values)

    def curve(self, path: str) -> tuple[Array, Array]:
        """Times [s] and values, breaks between the runs left out."""
        table = self.columns[path]
        time = np.array([t.total_seconds() for t in table["time"]])
        values = np.array([cell[0] for cell in table["Scalars:scalars"]])
        order = np.argsort(time, kind="stable")
        there = np.isfinite(values[order])
        return time[order][there], values[order][there]
