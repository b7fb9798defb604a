"""Checks telemetry before anything is fitted: what `ident inspect` does."""

from __future__ import annotations

from pathlib import Path

from ident.checks.report import Inspection
from ident.provenance import Provenance
from ident.recordings.load import TOPIC
from ident.sessions import Given, Robot, Sources, inspect_sources


def inspect(
    source: Sources, robot: Robot | None = None, *, topic: str = TOPIC, session_file: str | Path | None = None
) -> Inspection:
    """Checks recordings, and mends what can be mended safely.

    Args:
        source: Folders or files of runs, sessions, or tables in memory (the runs of one session).
        robot: URDF path, name or arm; None takes the one named in session.toml.
        topic: Topic of bags.
        session_file: A session.toml for folders that can't hold one.

    Raises:
        InputError: Recordings or robot can't be read.
    """
    found = inspect_sources(Given(source, robot, topic, session_file))
    origin = Provenance("ident inspect", settings={"robot": found.arm.name}, sessions=found.ledger.stamps)
    return Inspection(tuple(found.reports)).with_provenance(origin)
