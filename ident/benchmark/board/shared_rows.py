"""Rows that two sessions have in common: who compares their torques reads what came to one of them.

A row is known again by the positions of all joints but one, whichever that is: an effect may shift
the positions of one joint. Rows in which the arm stands still are like many others and don't count.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from ident.arrays import Array, Float
from ident.benchmark.board.case import PLANTED
from ident.benchmark.board.files import Board

Key = tuple[int, bytes]


@dataclass(frozen=True)
class SharedRows:
    """Rows of a session with a planted effect, or with none, that another session holds, too."""

    session: str
    other: str
    rows: int


def find_shared_rows(board: Board) -> list[SharedRows]:
    """Pairs of sessions that share rows to which something may have come, by session.

    Rows of `before` are plain in all sessions that have them: two sessions may share those.
    """
    holders: dict[Key, set[str]] = {}
    for name in board.sessions:
        for path in _tables(board, name):
            for keys in row_keys(path, board.sessions[name]["joints"]):
                for key in keys:
                    holders.setdefault(key, set()).add(name)
    shared: list[SharedRows] = []
    for name, session in board.sessions.items():
        if session["tier"] != PLANTED:
            continue
        counts: Counter[str] = Counter()
        for path in sorted(board.session_folder(name).glob("*.parquet")):
            for keys in row_keys(path, session["joints"]):
                others = set().union(*(holders[key] for key in keys))
                counts.update(others - {name})
        shared += [SharedRows(name, other, count) for other, count in sorted(counts.items())]
    return shared


def _tables(board: Board, name: str) -> Iterator[Path]:
    """All tables of a session."""
    yield from sorted(board.session_folder(name).glob("*.parquet"))
    before = board.before_folder(name)
    if before is not None:
        yield from sorted(before.glob("*.parquet"))
    if board.unseen_file(name).is_file():
        yield board.unseen_file(name)


def row_keys(path: Path, joints: list[str]) -> Iterator[list[Key]]:
    """What each row of a table in which the arm moves, two joints of it at the least, is known by:
    one key for each joint that may have been shifted.
    """
    table = pq.read_table(path)
    columns = [table[f"{joint}/position"].to_numpy() for joint in joints]
    position: Float[Array, "T n"] = np.ascontiguousarray(np.column_stack(columns))
    moving = np.count_nonzero(np.diff(position, axis=0), axis=1)
    for row in position[1:][moving >= min(2, len(joints))]:
        yield [_key_without(row, joint) for joint in range(len(joints))]


def _key_without(row: Float[Array, " n"], joint: int) -> Key:
    """The positions of all joints but one; of an arm with one joint all of them."""
    rest = np.delete(row, joint) if len(row) > 1 else row
    return joint, rest.tobytes()
