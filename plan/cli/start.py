"""The entry of the `plan` command: light, so that Ctrl-C during the imports is caught too."""

from __future__ import annotations

from ident.stopping import leave_when_stopped

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import NoReturn


def main() -> NoReturn:
    """Runs the command; see `run_command` for its statuses."""
    leave_when_stopped("plan")
    from ident.process import run_command

    run_command("plan", "plan.cli.app")
