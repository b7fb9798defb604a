"""How many threads torch may use: one in trainings and searches, whose batches are too small to share."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Sets torch's thread count for a block, and puts it back; without torch, which is slow to load, there is none.

    Whoever uses torch inside the block has loaded it before.
    """
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
