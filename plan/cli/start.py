"""The entry of the `plan` command: light, so that Ctrl-C during the imports is caught too."""

from __future__ import annotations

from typing import NoReturn

from ident.process import run_command


def main() -> NoReturn:
    """Runs the command; see `run_command` for its statuses."""
    run_command("plan", "plan.cli.app")
