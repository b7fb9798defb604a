"""Blocks for held-out splits: whole runs where there are enough of them, else pieces of runs."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ident.arrays import Array, Int
from ident.recordings.recording import Recording, Session

FEWEST_BLOCKS = 5  # a median over held-out blocks, and a spread, need this many
SHORTEST_BLOCK_S = 1.5  # a shorter block holds less than one swing of an arm and is a copy of its neighbours


def count_blocks(session: Session, shortest: float = SHORTEST_BLOCK_S) -> int:
    """How many blocks of at least this length [s] the runs can be cut into."""
    return sum(max(1, int(run.duration / shortest)) for run in session.runs if run.duration >= shortest)


def blocks(session: Session, count: int = FEWEST_BLOCKS, shortest: float = SHORTEST_BLOCK_S) -> tuple[Recording, ...]:
    """The runs of a session, the longest cut into pieces of equal duration until there are enough.

    Pieces of one run are named `run[0]`, `run[1]`, …

    Args:
        session: Any session.
        count: Number of blocks wanted.
        shortest: Shortest block [s]; fewer blocks are returned where it would be undercut.
    """
    pieces = dict.fromkeys(range(len(session.runs)), 1)
    while sum(pieces.values()) < count:
        lengths = {index: session.runs[index].duration / (number + 1) for index, number in pieces.items()}
        longest = max(lengths, key=lambda index: lengths[index])
        if lengths[longest] < shortest:
            break
        pieces[longest] += 1
    return tuple(block for index, number in pieces.items() for block in cut(session.runs[index], number))


def cut(run: Recording, number: int) -> tuple[Recording, ...]:
    """Cuts a run into pieces of equal duration."""
    if number <= 1:
        return (run,)
    edges = run.time[0] + run.duration * np.arange(1, number) / number
    return cut_before(run, np.searchsorted(run.time, edges))


def cut_before(run: Recording, rows: Int[Array, " k"]) -> tuple[Recording, ...]:
    """Cuts a run before each of some rows, given in order; the pieces are named `run[0]`, `run[1]`, …"""
    edges = [0, *(int(row) for row in rows), len(run)]
    return tuple(run.at(slice(a, b), f"{run.name}[{index}]") for index, (a, b) in enumerate(pairwise(edges)))
