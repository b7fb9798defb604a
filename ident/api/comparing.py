"""Compares two sets of recordings of one arm: what `ident compare` does."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ident.checks import inspect_sessions
from ident.checks.report import as_mounted
from ident.diagnosis.change.from_reports import compare_reports
from ident.diagnosis.change.result import ArmComparison
from ident.provenance import Provenance, stamp_sessions
from ident.recordings.load import TOPIC
from ident.robot.traits import content_of
from ident.sessions import Given, Robot, Sources, load_robot


def compare(
    before: Sources,
    after: Sources,
    robot: Robot | None = None,
    *,
    cutoff: float | None = None,
    seed: int = 0,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
) -> ArmComparison:
    """What changed between two sets of recordings of one arm, at which joint, by how much; or why that can't be told.

    Args:
        before, after: Folders or files of runs, sessions, or tables in memory (the runs of one session).
        robot: URDF path, name or arm; None takes the one named in session.toml. Its numbers may be wrong.
        cutoff: Corner of the filter for torques and columns [Hz].
        seed: Of the sign-flip tests.
        topic: Topic of bags.
        session_file: A session.toml for folders that can't hold one.

    Raises:
        InputError: Recordings or robot can't be used.
    """
    earlier, later = (tuple(Given(side, None, topic, session_file).parts()) for side in (before, after))
    arm = load_robot(robot, (*earlier, *later))
    reports = inspect_sessions((*earlier, *later), arm)
    arm = as_mounted(arm, reports[0].session)
    found = compare_reports(reports[: len(earlier)], reports[len(earlier) :], arm, cutoff, seed)
    used = None if np.isnan(found.cutoff) else found.cutoff
    settings = {"cutoff_hz": used, "seed": seed, "robot": arm.name, "sessions_before": len(earlier)}
    settings["arm_sha256"] = content_of(arm.keeping(found.joints))
    stamps = stamp_sessions((*earlier, *later))
    return found.with_provenance(Provenance("ident compare", settings=settings, sessions=stamps))
