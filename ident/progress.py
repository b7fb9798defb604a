"""How far long work has come: stage, share of all, seconds left; for whoever listens, and for
nobody else.

Seconds are those of the clock on the wall, whatever a budget of the work is counted in. They are
foretold by the slower of two paces, that since the work began and that of the latter half of its
time: work that slows down is not soon done, and of work that stands still no end is foretold.

with listening(print):
    diagnose("my_session", "my_arm.urdf")
"""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from operator import itemgetter

Listener = Callable[[str, float, float | None], None]
"""Gets the stage in words, the share of all work that is done, and the seconds left (None where
they are not known).
"""

# Of a smaller share no time can be foretold.
LEAST_SHARE = 0.05
# Shares that lie nearer are one mark of how the work went on.
MARK_EVERY = 1e-3
_WORK: ContextVar[_Work | None] = ContextVar("work", default=None)


class _Work:
    """One job as it goes on."""

    def __init__(self, listener: Listener, clock: Callable[[], float]) -> None:
        self.listener = listener
        self.clock = clock
        self.words = ""
        self.low = 0.0
        self.high = 0.0
        self.share = 0.0
        self.begin_anew()

    def begin_anew(self) -> None:
        self.began = self.clock()
        self.marks = [(self.began, 0.0)]  # time and share, as far apart as `MARK_EVERY`

    def begin(self, words: str, low: float, high: float) -> None:
        if low < self.share:  # another job
            self.begin_anew()
        self.words = words
        self.low = low
        self.high = high
        self.share = low
        self.tell(known=True)

    def go_on(self, done: float) -> None:
        # Steps that are gone through again, as on finer grids, take nothing back; how often they
        # are nobody knows.
        reached = self.low + (self.high - self.low) * done
        before = self.share
        self.share = max(before, reached)
        self.tell(known=reached > before)

    def tell(self, known: bool) -> None:
        now = self.clock()
        left = self.foretell(now) if known and self.share >= LEAST_SHARE else None
        if self.share >= self.marks[-1][1] + MARK_EVERY:
            self.marks.append((now, self.share))
        self.listener(self.words, self.share, left)

    def foretell(self, now: float) -> float | None:
        """Seconds left by the slower of both paces; None where nothing was done in the latter half
        of the time.
        """
        spent = now - self.began
        middle = self.began + spent / 2.0
        before = self.marks[bisect_right(self.marks, middle, key=itemgetter(0)) - 1][1]
        # In half of the time, so twice.
        progress = min(self.share, 2.0 * (self.share - before))
        return spent * (1.0 - self.share) / progress if progress > 0.0 else None


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


def aside(words: str) -> None:
    """Tells what is done beside the work, which brings it no farther.

    Args:
        words: What that is.
    """
    if (work := _WORK.get()) is not None:
        work.listener(words, work.share, None)


def step(done: int, total: int, error: float | None = None) -> None:
    """So many of a stage's equal steps are done; the error that a search or a training has come to
    is not shown.

    Args:
        done: Steps so far.
        total: Of the stage.
        error: Taken and left aside.
    """
    if (work := _WORK.get()) is not None:
        work.go_on(done / max(total, 1))
