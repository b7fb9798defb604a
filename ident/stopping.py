"""Ctrl-C while a command's modules are still being loaded: light itself, as nothing is caught before it is loaded."""

from __future__ import annotations

import os
import signal


def leave_when_stopped(name: str) -> None:
    """From here on Ctrl-C ends the process with one line, until `ident.process.run_command` takes over.

    Args:
        name: The command's name.
    """

    def leave(number: int, frame: object) -> None:
        try:
            os.write(2, f"{name}: stopped\n".encode())
        finally:
            os._exit(128 + number)

    if signal.getsignal(signal.SIGINT) == signal.default_int_handler:  # nohup and its like stay as they are
        signal.signal(signal.SIGINT, leave)
