"""Compares two sets of recordings of one arm: what `ident compare` does."""

from __future__ import annotations

from typing import Any

import numpy as np

from ident.checks import inspect_sessions
from ident.checks.report import as_mounted
from ident.command_options import ComparisonOptions
from ident.diagnosis.change.from_reports import compare_reports
from ident.diagnosis.change.result import ArmComparison
from ident.motion.filter import FOR_DIAGNOSIS, Lowpass
from ident.results import Provenance, stamp_sessions
from ident.sessions import Given, Robot, Sources, load_robot


def compare(before: Sources, after: Sources, robot: Robot | None = None, **options: Any) -> ArmComparison:
    """What changed between two sets of recordings of one arm, at which joint, by how much; or why that can't be tested.

    Args:
        before, after: Folders or files of runs, sessions, or tables in memory (the runs of one session).
        robot: URDF path, name or arm; None takes the one named in session.toml. Its numbers may be wrong.
        options: Fields of `ident.command_options.ComparisonOptions`: `cutoff`, `seed`, `topic`, `session_file`.

    Raises:
        InputError: Recordings or robot can't be used.
    """
    chosen = ComparisonOptions.of("compare", options)
    earlier, later = (tuple(Given(side, None, chosen.topic, chosen.session_file).parts()) for side in (before, after))
    arm = load_robot(robot, (*earlier, *later))
    reports = inspect_sessions((*earlier, *later), arm)
    arm = as_mounted(arm, reports[0].session)
    for run in (run for report in reports for run in report.session.runs if len(run) > 1):
        Lowpass.design(1.0 / run.sample_interval, chosen.cutoff, FOR_DIAGNOSIS)  # refuses what the rate does not allow
    found = compare_reports(reports[: len(earlier)], reports[len(earlier) :], arm, chosen.cutoff, chosen.seed)
    used = None if np.isnan(found.cutoff) else found.cutoff
    settings = {"cutoff_hz": used, "seed": chosen.seed, "robot": arm.name, "sessions_before": len(earlier)}
    settings["arm_sha256"] = arm.keeping(found.joints).content
    stamps = stamp_sessions((*earlier, *later))
    return found.with_provenance(Provenance("ident compare", settings=settings, sessions=stamps))
