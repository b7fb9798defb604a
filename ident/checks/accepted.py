"""Refusals that the user overrules: told as warnings, and recorded with whatever is made of the recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ident.checks.report import TelemetryReport
from ident.errors import InputError
from ident.recordings.recording import TelemetryIssue

# All that a telemetry check refuses for.
ACCEPTABLE = (
    "clipped_effort",
    "columns_swapped",
    "effort_gravity_compensated",
    "effort_is_model",
    "effort_not_torque",
    "effort_sign_flipped",
    "effort_spike",
    "garbage_cells",
    "insufficient_excitation",
    "joints_locked",
    "nan_cells",
    "repeated_session",
    "time_gap",
    "time_not_increasing",
    "too_few_runs",
    "truncated_row",
    "units_degrees",
    "velocity_inconsistent",
    "wrong_time_base",
)
# A torque that a model made tells nothing of an arm, but its fit is right: benchmarks and examples are made so. It is
# told where something is fitted; a diagnosis still refuses it.
TOLD_BY_A_FIT = ("effort_is_model",)


def check_accepted(accept: Sequence[str]) -> tuple[str, ...]:
    """The names of issues that are to be accepted.

    Raises:
        InputError: A name that no refusal has.
    """
    for name in accept:
        if name not in ACCEPTABLE:
            raise InputError("--accept", f"{name!r} can't be accepted", f"use one of: {', '.join(ACCEPTABLE)}")
    return tuple(dict.fromkeys(accept))


def overrule(report: TelemetryReport, accept: Sequence[str], told: Sequence[str] = ()) -> TelemetryReport:
    """A report whose accepted refusals are warnings.

    Args:
        report: What a check found.
        accept: Names of the issues that the user accepts.
        told: Names of issues that are only told by what comes next.
    """

    def weaken(issue: TelemetryIssue) -> TelemetryIssue:
        if issue.severity != "fatal" or issue.issue not in (*accept, *told):
            return issue
        said = f"accepted by --accept {issue.issue}" if issue.issue in accept else "told, not refused, in a fit"
        return replace(issue, severity="warning", remedy=f"{said}; otherwise {issue.remedy}")

    return replace(report, issues=tuple(weaken(issue) for issue in report.issues))
