"""Watches what this process does to the machine while files of strangers are read: an audit hook of Python's own.

Reading a file may open files for reading. It may not run programs or text, delete, rename, write or reach the network.
What libraries do in C below Python's own calls is not seen.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ident.robot.meshes import COPY_PREFIX

RUNNING = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.spawn", "os.startfile", "pty.spawn")
NETWORK = ("socket.connect", "socket.bind", "socket.sendto", "urllib.Request")
CHANGING = ("os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.link", "os.symlink", "os.truncate", "os.chmod")
CHANGING += ("os.chown", "os.utime", "shutil.rmtree", "shutil.move", "shutil.copyfile")
# Those whose last argument may be the folder that their path is relative to, as a file descriptor.
BESIDE = ("os.remove", "os.rmdir")
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
# Libraries write their compiled code and Python its own there: nothing of the user's.
CACHES = ("__pycache__",)


class Guard:
    """Notes what happens while it is on.

    Attributes:
        allowed: Folders that may be written to.
        done: What was done that must not be, in words.
        read: Paths that were opened for reading.
        compiled: Texts that became code that can be run; an expression that is only parsed is none.
        swap: A file, and what is done before it is opened for the second time; None for nothing.
    """

    def __init__(self) -> None:
        self.allowed: tuple[Path, ...] = ()
        self.done: list[str] = []
        self.read: list[str] = []
        self.compiled: list[str] = []
        self.swap: tuple[Path, Callable[[], object]] | None = None
        self._opens = 0
        self._on = False
        sys.addaudithook(self._hear)  # for the life of the process: a hook can't be taken away

    @contextmanager
    def watching(self, *allowed: Path) -> Iterator[Guard]:
        """On for a block; what was noted before is forgotten."""
        self.allowed, self.done, self.read = tuple(path.resolve() for path in allowed), [], []
        self.compiled, self._opens, self._on = [], 0, True
        try:
            yield self
        finally:
            self._on = False

    def _hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self._on:
            return
        if event == "open":
            self._opened(*arguments)
            return
        if event == "exec" or (event == "compile" and "<unknown>" not in repr(arguments)):
            self.compiled.append(repr(arguments)[:300])
        paths = [one for one in arguments if isinstance(one, str | bytes | Path)]
        if event == "os.symlink":  # what a link leads to stays as it is
            paths = paths[1:]
        if event in BESIDE and isinstance(arguments[-1], int) and arguments[-1] >= 0:  # seen from an open folder
            paths = [Path(os.readlink(f"/proc/self/fd/{arguments[-1]}"), os.fsdecode(one)) for one in paths]
        if event in (*RUNNING, *NETWORK, "pickle.find_class") or (event in CHANGING and not all(map(self._may, paths))):
            self.done.append(f"{event} {arguments!r}"[:300])

    def _opened(self, path: Any, mode: Any, flags: Any) -> None:
        writes = any(letter in mode for letter in "wax+") if isinstance(mode, str) else bool(int(flags or 0) & WRITES)
        if isinstance(path, int):
            return
        if not writes:
            self.read.append(os.fsdecode(path))
            self._swap(os.fsdecode(path))
        elif not self._may(path):
            self.done.append(f"open for writing: {path!r}"[:300])

    def _swap(self, path: str) -> None:
        """Puts something else in a file's place where it has been looked at already."""
        if self.swap is None or path != str(self.swap[0]):
            return
        self._opens += 1
        if self._opens == 2:
            self._on = False
            self.swap[1]()
            self._on = True

    def _may(self, path: str | bytes | Path) -> bool:
        self._on = False  # to look at a path is not what is watched
        try:
            place = Path(os.path.abspath(os.fsdecode(path)))
        finally:
            self._on = True
        if any(part in CACHES or part.startswith(COPY_PREFIX) for part in place.parts) or place == Path(os.devnull):
            return True
        return any(place.is_relative_to(folder) for folder in self.allowed)
