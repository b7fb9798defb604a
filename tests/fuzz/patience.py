"""Tells a process that hangs from one that a busy machine leaves waiting for a processor."""

import os
import signal
import time
from pathlib import Path

TICKS_PER_S = os.sysconf("SC_CLK_TCK")
# Letters of /proc/PID/stat: on a processor or waiting for one; waiting for a disk.
BUSY = ("R", "D")
# Where the time on the processor stands in /proc/PID/stat, behind the name (proc(5): utime, stime).
USER_TIME, SYSTEM_TIME = 11, 12


class Patience:
    """How long one child has worked on its input, seen from outside.

    Args:
        child: Its process.
        most_s: Time on the processor after which it hangs, below Python too [s].
        asleep_s: Time on the clock, with no time on the processor in it, after which it hangs [s].
    """

    def __init__(self, child: int, most_s: float, asleep_s: float) -> None:
        self.child, self.most_s, self.asleep_s = child, most_s, asleep_s
        self._input = -1
        self._begun_s = 0.0
        self._spent_s = 0.0
        self._moved = time.monotonic()
        self._woken = False

    def look(self, number: int) -> None:
        """Looks once: wakes a child that sleeps over its input, ends one that goes on for too long.

        Args:
            number: Of the input that the child works on now.
        """
        spent_s, is_busy = read_process(self.child)
        if number != self._input:
            self._input = number
            self._begun_s = spent_s
            self._woken = False
            self._moved = time.monotonic()
        if is_busy or spent_s > self._spent_s:
            self._moved = time.monotonic()
        self._spent_s = spent_s
        if spent_s - self._begun_s > self.most_s:
            os.kill(self.child, signal.SIGKILL)
        elif time.monotonic() - self._moved > self.asleep_s:
            # A handler of Python's own says where it sleeps; below Python there is none.
            os.kill(self.child, signal.SIGKILL if self._woken else signal.SIGALRM)
            self._woken = True
            self._moved = time.monotonic()


def read_process(process: int) -> tuple[float, bool]:
    """Time that a process has had on the processor [s], and whether it works or waits for one."""
    text = Path(f"/proc/{process}/stat").read_text()
    words = text.rpartition(")")[2].split()
    ticks = int(words[USER_TIME]) + int(words[SYSTEM_TIME])
    return ticks / TICKS_PER_S, words[0] in BUSY
