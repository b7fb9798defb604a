"""Compiled loops: numba's, kept beside their source or in a cache that is the user's alone."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import event

from ident.progress import aside
from ident.user_cache import user_cache

NUMBAS: Any = numba.config  # which no type checker knows
# What numba calls the work of making one loop machine code, code that was kept not counted.
COMPILING = "numba:compile"
# What whoever waits for it is told.
WORDS = "compiling loops, once on this computer"


class _CompileClock(event.Listener):
    """Adds up the time of compiling; one loop's may hold that of those it calls."""

    def __init__(self) -> None:
        self.spent = 0.0  # processor time [s]
        self.waited = 0.0  # the same on the wall [s]
        self._depth = 0
        self._began = 0.0
        self._began_on_wall = 0.0

    def on_start(self, event: event.Event) -> None:
        """Begins to count where nothing is compiled yet."""
        if self._depth == 0:
            aside(WORDS)
            self._began = time.process_time()
            self._began_on_wall = time.monotonic()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """Counts what the outermost loop took."""
        self._depth -= 1
        if self._depth == 0:
            self.spent += time.process_time() - self._began
            self.waited += time.monotonic() - self._began_on_wall


@cache
def _clock() -> _CompileClock:
    """The process's only one, told of all that is compiled from its first use on."""
    clock = _CompileClock()
    event.register(COMPILING, clock)
    return clock


def compile_seconds() -> float:
    """Processor time that this process has spent on making loops machine code [s].

    Nought where all of them were kept by a process before: so only a first run pays.
    """
    return _clock().spent


def working_clock() -> float:
    """The time on the wall as work goes by: it stands still while loops are compiled [s].

    What is done once on a computer foretells nothing of the work that is left.
    """
    return time.monotonic() - _clock().waited


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Makes a function machine code, which is kept for processes to come.

    Where the source's folder can't be written it is kept in the user's cache. Where others may
    write there, or there is none, every process compiles it: kept code is run as it lies there.

    Args:
        options: Those of `numba.njit`.
    """

    def kept(function: Callable[..., Any]) -> Callable[..., Any]:
        given = NUMBAS.CACHE_DIR
        beside = os.access(Path(function.__code__.co_filename).parent, os.W_OK)
        folder = given or ("" if beside else user_cache())
        NUMBAS.CACHE_DIR = str(folder or "")
        try:
            _clock()
            return numba.njit(cache=folder is not None, **options)(function)
        finally:
            NUMBAS.CACHE_DIR = given

    return kept
