"""Checks telemetry before anything is fitted: what `ident inspect` does."""

from __future__ import annotations

from pathlib import Path

from ident.checks.report import Inspection
from ident.provenance import Provenance, stamp_sessions
from ident.recordings.load import TOPIC
from ident.sessions import Robot, Sources, inspect_paths


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
    arm, reports = inspect_paths(source, robot, topic, session_file)
    stamps = stamp_sessions(report.session for report in reports)
    return Inspection(reports).with_provenance(
        Provenance("ident inspect", settings={"robot": arm.name}, sessions=stamps)
    )
