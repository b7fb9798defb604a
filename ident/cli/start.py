"""The entry of both commands: light, as Ctrl-C is not caught before what catches it is loaded."""

from __future__ import annotations

import os
import signal

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import NoReturn


def main(name: str = "ident") -> NoReturn:
    """Runs the command of a package; see `run_command` for its statuses.

    While its modules are still being loaded, Ctrl-C ends the process with one line.
    """

    def leave(number: int, frame: object) -> None:
        try:
            os.write(2, f"{name}: stopped\n".encode())
        finally:
            os._exit(128 + number)

    # nohup and its like stay as they are
    if signal.getsignal(signal.SIGINT) == signal.default_int_handler:
        signal.signal(signal.SIGINT, leave)
    from ident.process import run_command

    run_command(name, f"{name}.cli.app")
