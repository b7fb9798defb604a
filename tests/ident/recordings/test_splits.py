"""Blocks for held-out splits: no sample lost, none twice."""

from __future__ import annotations

import numpy as np
import pytest

from ident.recordings.blocks import blocks, count_blocks
from ident.recordings.recording import Recording, Session


def session_of(*durations: float) -> Session:
    runs = []
    for k, duration in enumerate(durations):
        time = np.arange(0.0, duration, 0.01)
        runs.append(Recording(f"r{k}", ("a",), time, time[:, None], time[:, None]))
    return Session("s", tuple(runs))


@pytest.mark.parametrize("durations", [(20.0,), (3.0, 12.0), (5.0, 5.0, 5.0, 5.0, 5.0, 5.0), (9.0, 1.0)])
def test_blocks_are_a_partition(durations: tuple[float, ...]) -> None:
    session = session_of(*durations)
    cut = blocks(session)
    assert len(cut) >= 5
    assert sum(len(block) for block in cut) == session.samples
    joined = np.concatenate([block.position[:, 0] for block in cut])
    np.testing.assert_array_equal(joined, np.concatenate([run.position[:, 0] for run in session.runs]))


def test_enough_runs_are_left_whole() -> None:
    session = session_of(5.0, 5.0, 5.0, 5.0, 5.0)
    assert blocks(session) == session.runs


def test_no_block_is_shorter_than_the_shortest() -> None:
    assert len(blocks(session_of(6.0))) == 3
    assert count_blocks(session_of(7.0)) == 4
    assert count_blocks(session_of(7.6)) == 5
    assert count_blocks(session_of(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)) == 0
