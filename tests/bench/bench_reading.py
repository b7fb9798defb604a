"""How fast CSV is read, against numpy.loadtxt and a csv-module loop on a slice. Run: pytest tests/bench -s."""

from __future__ import annotations

import csv
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pytest

from ident.recordings.load import load_recording

MEGABYTES = 400
SLICE_LINES = 20_000
JOINTS = 7


def write_table(path: Path, megabytes: int) -> None:
    """A native table of a seven-joint arm, in blocks of 100,000 rows."""
    rng = np.random.default_rng(0)
    names = [f"joint_{j}/{c}" for j in range(1, JOINTS + 1) for c in ("position", "velocity", "effort")]
    rows, start = 100_000, 0.0
    with path.open("wb") as stream:
        while stream.tell() < megabytes * 1e6:
            values = rng.normal(size=(rows, len(names))).round(6)
            columns = {"time": (start + 1e-3 * np.arange(rows)).round(3), **dict(zip(names, values.T, strict=True))}
            pacsv.write_csv(pa.table(columns), stream, pacsv.WriteOptions(include_header=start == 0.0))
            start += 1e-3 * rows


def seconds(action: Callable[[], object]) -> float:
    begin = time.perf_counter()
    action()
    return time.perf_counter() - begin


def read_with_csv_module(path: Path) -> np.ndarray:
    with path.open(newline="") as stream:
        reader = csv.reader(stream)
        next(reader)
        return np.array([[float(cell) for cell in row] for row in reader])


def test_csv_reads_in_seconds(tmp_path: Path) -> None:
    path, piece = tmp_path / "big.csv", tmp_path / "piece.csv"
    write_table(path, MEGABYTES)
    with path.open() as stream:
        piece.write_text("".join(line for _, line in zip(range(SLICE_LINES + 1), stream, strict=False)))
    size, small = path.stat().st_size / 1e9, piece.stat().st_size / 1e9
    ours = size / min(seconds(lambda: load_recording(path)) for _ in range(2))
    numpy = small / seconds(lambda: np.loadtxt(piece, delimiter=",", skiprows=1))
    module = small / seconds(lambda: read_with_csv_module(piece))
    print(f"\n{size:.2f} GB of CSV: {ours:.3f} GB/s, 1 GB in {1 / ours:.1f} s")
    print(f"numpy.loadtxt {numpy:.3f} GB/s, csv module {module:.3f} GB/s")
    print(f"that is {ours / numpy:.1f} and {ours / module:.1f} times as fast")
    damaged = tmp_path / "damaged.csv"
    lines = path.read_text().splitlines(keepends=True)[: 10 * SLICE_LINES]
    damaged.write_text("".join([*lines[:1000], "[WARN] lost\n", *lines[1000:]]))
    rate = damaged.stat().st_size / 1e9 / seconds(lambda: load_recording(damaged))
    print(f"with a garbage row: {rate:.3f} GB/s")
    assert load_recording(damaged).issues[0].issue == "garbage_cells"
    assert ours > 2.0 * module


if __name__ == "__main__":
    pytest.main([__file__, "-s", "--override-ini", "addopts=-q"])
