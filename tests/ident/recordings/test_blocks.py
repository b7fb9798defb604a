"""How time is cut into blocks: never shorter than the least length, never more than the most."""

import numpy as np
import pytest

from ident.recordings.blocks import SHORTEST_BLOCK_S, block_length, count_blocks


@pytest.mark.parametrize("total", [0.0, 3.0, 60.0, 1e4])
def test_blocks_are_few_and_long_enough(total: float) -> None:
    length = block_length(total, shortest=0.6, most=128)
    assert length >= 0.6
    assert total / length <= 128 * (1.0 + 1e-12)
    assert isinstance(length, float)


def test_each_set_of_runs_has_a_length_of_its_own() -> None:
    lengths = block_length(np.array([3.0, 640.0]), shortest=0.6, most=64)
    assert lengths == pytest.approx([0.6, 10.0])


def test_a_stretch_holds_whole_blocks_only() -> None:
    assert count_blocks(5.5 * SHORTEST_BLOCK_S) == 5
    assert count_blocks(0.5 * SHORTEST_BLOCK_S) == 0
