"""Compiled loops: numba's, kept beside their source or in a cache that is the user's alone."""

from __future__ import annotations

import hashlib
import os
import shutil
import time
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import event
from numba.core.dispatcher import Dispatcher

from ident.progress import aside
from ident.user_cache import user_cache

NUMBAS: Any = numba.config  # which no type checker knows
# What numba calls the work of making one loop machine code, code that was kept not counted.
COMPILING = "numba:compile"
# What whoever waits for it is told.
WORDS = "compiling loops, once on this computer"
# What each file's loops are made of, as its first loop was defined.
_DIGESTS: dict[Path, str] = {}


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


def compiled(
    *, inner: bool = False, **options: Any
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Makes a function machine code, which is kept for processes to come.

    Where the source's folder can't be written it is kept in the user's cache. Where others may
    write there, or there is none, every process compiles it: kept code is run as it lies there.

    Args:
        inner: Whether compiled loops alone call it: nothing is made then for Python to call it by,
            which is a tenth of what compiling takes; called from there all the same, the process
            ends.
        options: Those of `numba.njit`.
    """
    options["no_cpython_wrapper"] = inner
    options["no_cfunc_wrapper"] = True  # nor for C

    def kept(function: Callable[..., Any]) -> Callable[..., Any]:
        given = NUMBAS.CACHE_DIR
        source = Path(function.__code__.co_filename)
        beside = os.access(source.parent, os.W_OK)
        home = source.parent / "__pycache__" if beside else user_cache()
        folder = Path(given) if given else home
        kind = f"{function.__module__}-"
        name = kind + _digest(source, function.__globals__)
        if folder is not None and folder == home and beside:
            _drop_older(folder, kind, name)
        NUMBAS.CACHE_DIR = "" if folder is None else str(folder / name)
        try:
            _clock()
            return numba.njit(cache=folder is not None, **options)(function)
        finally:
            NUMBAS.CACHE_DIR = given

    return kept


def _digest(source: Path, names: Mapping[str, object]) -> str:
    """What a file's loops are made of: its text, the numbers that it imports, and the files whose
    loops it calls.

    Machine code holds all of these, and numba asks for a change of the first alone: of an installed
    version whose file is older than what it calls it would go on with the code of before.

    Args:
        source: The file.
        names: What its module knows when a loop is defined; imports come first.
    """
    if source in _DIGESTS:
        return _DIGESTS[source]
    digest = hashlib.sha256(source.read_bytes() if source.is_file() else b"")
    for name, value in sorted(names.items()):
        if name.startswith("__"):
            continue
        if isinstance(value, (bool, int, float, str, tuple)):
            digest.update(f"{name}={value!r}".encode())
        elif isinstance(value, np.ndarray):
            digest.update(name.encode() + value.tobytes())
        elif isinstance(value, Dispatcher):
            called = Path(value.py_func.__code__.co_filename)
            if called != source:
                below = _digest(called, value.py_func.__globals__)
                digest.update(f"{name}={below}".encode())
    _DIGESTS[source] = digest.hexdigest()[:16]
    return _DIGESTS[source]


def _drop_older(folder: Path, kind: str, name: str) -> None:
    """Removes the code of a module's earlier versions from beside its source."""
    for older in folder.glob(f"{kind}*"):
        if older.name != name and not older.is_symlink():
            shutil.rmtree(older, ignore_errors=True)
