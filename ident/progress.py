"""How far long work has come: stage, share of all, seconds left; for whoever listens, and for nobody else.

with listening(print):
    diagnose("my_session", "my_arm.urdf")
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[str, float, float | None], None]
"""Gets the stage in words, the share of all work that is done, and the seconds left (None where they are not known)."""

# Of a smaller share no time can be foretold.
LEAST_SHARE = 0.05


class _Work:
    """One job as it goes on."""

    def __init__(self, listener: Listener, clock: Callable[[], float]) -> None:
        self.listener, self.clock = listener, clock
        self.words, self.low, self.high, self.share = "", 0.0, 0.0, 0.0
        self.began = clock()

    def begin(self, words: str, low: float, high: float) -> None:
        if low < self.share:  # another job
            self.began = self.clock()
        self.words, self.low, self.high, self.share = words, low, high, low
        self.tell(known=True)

    def go_on(self, done: float) -> None:
        # Steps that are gone through again, as on finer grids, take nothing back; how often they are nobody knows.
        reached, before = self.low + (self.high - self.low) * done, self.share
        self.share = max(before, reached)
        self.tell(known=reached > before)

    def tell(self, known: bool) -> None:
        spent = self.clock() - self.began
        left = spent * (1.0 - self.share) / self.share if known and self.share >= LEAST_SHARE else None
        self.listener(self.words, self.share, left)


_WORK: ContextVar[_Work | None] = ContextVar("work", default=None)


@contextmanager
def listening(listener: Listener, clock: Callable[[], float] = time.monotonic) -> Iterator[None]:
    """Within it, long work in this thread reports how far it has come.

    Args:
        listener: Called as work goes on with stage, share (0 to 1) and seconds left, or None [s].
        clock: The time [s].
    """
    token = _WORK.set(_Work(listener, clock))
    try:
        yield
    finally:
        _WORK.reset(token)


def stage(words: str, low: float = 0.0, high: float = 1.0) -> None:
    """A stage begins.

    Args:
        words: What is done in it.
        low, high: Share of all work that is done before it, and after it: typical ones.
    """
    if (work := _WORK.get()) is not None:
        work.begin(words, low, high)


def step(done: int, total: int, error: float | None = None) -> None:
    """So many of a stage's equal steps are done; the error that a search or a training has come to is not shown."""
    if (work := _WORK.get()) is not None:
        work.go_on(done / max(total, 1))
