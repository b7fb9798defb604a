"""Foreign tables of any kind that recordings can be in, as named columns of numbers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.recordings.bag_topics import join_topics, load_topics
from ident.recordings.columns import TIME
from ident.recordings.dialect import SNIFF_BYTES, is_number, sniff, text_lines
from ident.recordings.lerobot import INFO, REMEDY, is_dataset, load_columns, load_features
from ident.recordings.load import BAGS, METADATA, TEXTS, require_readable_size
from ident.recordings.matlab import load_mat
from ident.recordings.parquet import column_numbers, load_npz, spread_joints
from ident.recordings.session_toml import SessionFile
from ident.recordings.text import read_text_table
from ident.safe_read import read_json

# Columns that hold text in most of so many first rows are left out.
LOOKED_AT = 50
# A topic is of the joints if it speaks at least this share as often as the most talkative one.
LEAST_TALK = 0.05


@dataclass(frozen=True, eq=False)
class ForeignTable:
    """Columns of one run under their own names.

    Attributes:
        source: The file.
        columns: Name -> numbers, all of one length, in the file's order; a column without a name by its number.
        has_names: Whether the file names its columns.
        rate_hz: Rate that the file states [Hz], or None.
    """

    source: Path
    columns: dict[str, Float[Array, " T"]]
    has_names: bool = True
    rate_hz: float | None = None


def read_foreign(path: Path) -> ForeignTable:
    """Reads all columns of numbers of a table, a bag or a data set.

    Raises:
        RecordingError: It can't be read, or holds no numbers.
    """
    if is_dataset(path):
        return _read_dataset(path)
    if not path.is_dir():
        require_readable_size(path)
    suffix = path.suffix.lower()
    if suffix in BAGS or (path / METADATA).is_file():
        return ForeignTable(path, _bag_columns(path))
    if suffix in TEXTS:
        return _read_text(path)
    if suffix == ".parquet":
        table = load_columns(path, {})
        return ForeignTable(path, _finite({name: column_numbers(values, name, path) for name, values in table.items()}))
    if suffix in (".npz", ".mat"):
        arrays = load_npz(path) if suffix == ".npz" else load_mat(path)
        found = spread_joints(arrays, path, always=True)
        numeric = {name: values.astype(float) for name, values in found.items() if values.dtype.kind in "fiu"}
        return ForeignTable(path, _finite({name: values for name, values in numeric.items() if values.ndim == 1}))
    raise RecordingError(path, f"unknown kind of file {suffix!r}", "give a table, a bag or a data set")


def _finite(columns: dict[str, Float[Array, " T"]]) -> dict[str, Float[Array, " T"]]:
    """Columns of the usual length that hold some numbers."""
    lengths = [len(values) for values in columns.values()]
    usual = max(set(lengths), key=lengths.count, default=0)
    return {name: one for name, one in columns.items() if len(one) == usual and np.isfinite(one).any()}


def _read_dataset(path: Path) -> ForeignTable:
    features = load_features(path)
    info = read_json(path / INFO, REMEDY, RecordingError)
    files = sorted((path / "data").rglob("*.parquet"))
    if not files:
        raise RecordingError(path, "has no Parquet file below data/", REMEDY)
    table: dict[str, pa.ChunkedArray | pa.Array] = load_columns(files[0], features)
    columns = {name: column_numbers(values, name, files[0]) for name, values in table.items()}
    episode = columns.pop("episode_index", None)
    if episode is not None and len(episode):
        longest = max(set(episode), key=lambda one: int((episode == one).sum()))
        columns = {name: values[episode == longest] for name, values in columns.items()}
    rate = info.get("fps")
    usable = isinstance(rate, int | float) and not isinstance(rate, bool) and rate > 0
    return ForeignTable(path, _finite(columns), rate_hz=float(rate) if usable else None)  # type: ignore[arg-type]


def _read_text(path: Path) -> ForeignTable:
    layout = sniff(path)
    with path.open("rb") as stream:
        head = text_lines(stream.read(SNIFF_BYTES))[layout.first_line :][:LOOKED_AT]
    rows = [cells for line in head if len(cells := layout.split(line)) == len(layout.names)]
    filled = [sum(is_number(row[i]) for row in rows) > len(rows) / 2 for i in range(len(layout.names))]
    numbered = {str(i + 1): f"column_{i}/position" for i, one in enumerate(filled) if one}
    if not numbered:
        raise RecordingError(path, "has no column of numbers", "give a table of samples")
    plain = layout.names == tuple(str(i + 1) for i in range(len(layout.names)))
    table, _ = read_text_table(path, SessionFile(columns=_by_place(layout.names, numbered)))
    names = [layout.names[i] for i, one in enumerate(filled) if one]
    found: dict[str, Float[Array, " T"]] = {}
    for number, name in zip(numbered, names, strict=True):
        # A name that stands twice is no name: its column goes by its number.
        found[number if layout.names.count(name) > 1 else name] = table.columns[numbered[number]]
    return ForeignTable(path, _finite(found), has_names=not plain)


def _by_place(names: tuple[str, ...], numbered: dict[str, str]) -> dict[str, str]:
    """The mapping by numbers, where no column's own name is such a number."""
    own = {name: str(i + 1) for i, name in enumerate(names)}
    if any(number in own and own[number] != number for number in numbered):
        return {names[int(number) - 1]: native for number, native in numbered.items()}
    return numbered


def _bag_columns(path: Path) -> dict[str, Float[Array, " T"]]:
    topics = load_topics(path)
    if not topics:
        raise RecordingError(path, "no message in it can be read", "record it with a ROS that writes definitions")
    most = max(len(topic.rows) for topic in topics.values())
    kept = {name: topic for name, topic in topics.items() if len(topic.rows) > max(1, LEAST_TALK * most)}
    columns = join_topics(kept, set(kept))
    clock = columns.pop(TIME)
    return _finite({TIME: clock, **columns})
