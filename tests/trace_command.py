"""Runs one command and notes which of our files run, and which of them asks which.

    python tests/trace_command.py ROOT OUT ident diagnose logs/tm5_900/sealed_1 --robot tm5-900

An arrow is one file's call into another file, or its first import of it. OUT gets files, arrows
and the command's status, as JSON. The clock of the command's progress stands still: how often that
is told depends on the machine's load.
"""

import json
import sys
import time
from importlib import import_module
from pathlib import Path
from threading import setprofile
from types import CodeType, FrameType

PACKAGES = ("ident", "plan")


class CallTrace:
    """A profiler: files of ours that were entered, and pairs (caller's file, called file)."""

    def __init__(self, root: str) -> None:
        self.folders = tuple(f"{root}/{package}/" for package in PACKAGES)
        self.files: set[str] = set()
        self.arrows: set[tuple[str, str]] = set()
        self.file_of: dict[CodeType, str] = {}

    def our_file(self, code: CodeType) -> str:
        """The file of ours that a function stands in; "" where it is another's."""
        if code not in self.file_of:
            name = code.co_filename
            self.file_of[code] = name if name.startswith(self.folders) else ""
        return self.file_of[code]

    def note(self, frame: FrameType, event: str, argument: object) -> None:
        """Takes down a call; the caller is the nearest function of ours above."""
        if event != "call":
            return
        called = self.our_file(frame.f_code)
        if not called:
            return
        self.files.add(called)
        above = frame.f_back
        while above is not None:
            caller = self.our_file(above.f_code)
            if caller:
                if caller != called:
                    self.arrows.add((caller, called))
                return
            above = above.f_back


def main(root: str, out: str, package: str, *arguments: str) -> None:
    """Runs the command under the profiler, and writes what it noted."""
    sys.path[0] = root
    sys.argv = [package, *arguments]
    time.monotonic = lambda: 0.0
    trace = CallTrace(root)
    setprofile(trace.note)
    sys.setprofile(trace.note)
    command = import_module(f"{package}.cli.app").app
    status = command(standalone_mode=False)
    sys.setprofile(None)
    counts = {"files": len(trace.files), "arrows": len(trace.arrows), "status": status or 0}
    Path(out).write_text(json.dumps(counts), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
