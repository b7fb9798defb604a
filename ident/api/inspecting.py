"""Checks telemetry before anything is fitted: what `ident inspect` does."""

from __future__ import annotations

from typing import Any

from ident.checks.report import Inspection
from ident.command_options import ReadOptions
from ident.results import Provenance
from ident.sessions import Given, Robot, Sources, inspect_sources


def inspect(source: Sources, robot: Robot | None = None, **options: Any) -> Inspection:
    """Checks recordings, and mends what can be mended safely.

    Args:
        source: Folders or files of runs, sessions, or tables in memory (the runs of one session).
        robot: URDF path, name or arm; None takes the one named in session.toml.
        options: Fields of `ident.command_options.ReadOptions`: `topic`, `session_file`, `accept`.

    Raises:
        InputError: Recordings or robot can't be read.
    """
    read = ReadOptions.of("inspect", options)
    inspected = inspect_sources(Given(source, robot, read.topic, read.session_file), read.accept)
    origin = Provenance(
        "ident inspect", settings={"robot": inspected.arm.name}, sessions=inspected.ledger.stamps
    )
    return Inspection(tuple(inspected.reports)).with_provenance(origin)
