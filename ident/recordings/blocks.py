"""How long a block of time is: the one place for every cut of a session into blocks.

A block is the unit of evidence: neighbouring samples say the same thing, blocks are as good as
independent. A session is judged by how many of the shortest blocks it holds; the sums of a
diagnosis and of a comparison, and the map of the gap, cut its time into blocks of their own.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from ident.arrays import Array, Float

# Blocks of held-out splits: a median over them, and a spread, need this many.
FEWEST_BLOCKS = 5
# Shortest block that counts where a session is judged [s]: five of them are a short jog; one of
# much less is a copy of its neighbours.
SHORTEST_BLOCK_S = 0.9
# Shortest block of the sums of a diagnosis or of a comparison [s]: some correlation times of what
# an arm's model leaves.
SHORTEST_SUMMED_S = 0.6
# Shortest block of the map of the gap [s], whose signs are drawn: some correlation times of a
# residual.
SHORTEST_MAPPED_S = 1.5

Durations = TypeVar("Durations", float, Float[Array, " R"])


def count_blocks(seconds: float) -> int:
    """How many of the shortest blocks a stretch holds.

    Args:
        seconds: Its duration [s].
    """
    return int(seconds / SHORTEST_BLOCK_S)


def block_length(total: Durations, shortest: float, most: int) -> Durations:
    """Length of the blocks that so much time is cut into [s]: max(shortest, total / most).

    Args:
        total: Time in all, or that of each run's set [s].
        shortest: Least length of a block [s].
        most: Blocks, at the most.
    """
    length = np.maximum(shortest, total / most)
    return float(length) if isinstance(total, float) else length
