"""What is told of runs that have a convention otherwise than the rest.

And the session without them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ident.checks.between_runs import find_difference
from ident.checks.conventions.reread import read_conventions
from ident.checks.parting import ComparedRuns, RunDifference
from ident.checks.report import issue_of
from ident.checks.run_changes import OTHER_ARM
from ident.checks.zero_steps import find_zero_step
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel

# What is otherwise, in words, by the kind of change.
WORDS = {
    "effort_sign": "the torque of {joints} has the other sign",
    "axis": "{joints} turns the other way",
    "columns": "the columns of {joints} stand in each other's place",
    "effort_columns": "the efforts of {joints} stand in each other's place",
    "effort_scale": "the torque of {joints} is {size:.3g} times as large",
    "zero": "the zero of {joints} is moved by {size:.2f} rad",
    "clock": "the clock goes at {size:.3g} times its speed",
    OTHER_ARM: (
        "the torque is not the other runs': another arm, another load, or columns of other joints"
    ),
}


def check_odd_runs(session: Session, arm: ArmModel) -> tuple[Session, list[TelemetryIssue]]:
    """Finds runs that have one convention otherwise than the rest.

    Of the runs that are left others may differ otherwise: they are looked at again.

    Returns:
        The session without them, for later checks, and an issue for each difference; as it was, and
        none, where all runs are alike.
    """
    issues: list[TelemetryIssue] = []
    while (difference := find_odd(session, arm)) is not None:
        issues.append(tell(difference, session))
        rest = [run for run in session.runs if run.name not in difference.odd]
        session = session.replace(runs=rest)
    return session, issues


def find_odd(session: Session, arm: ArmModel) -> RunDifference | None:
    """What runs of a session have otherwise than the rest; None where they are alike."""
    compared = ComparedRuns(session, arm)
    difference = find_difference(compared)
    if difference is None:
        difference = find_zero_step(compared)
        if difference is not None and not is_step_as_mounted(session, arm):
            return None
    return difference


def is_step_as_mounted(session: Session, arm: ArmModel) -> bool:
    """Whether a zero moves between runs also where gravity pulls as the log itself has it.

    What a zero does to torque follows from the URDF's gravity; under a wrong one, motions that
    differ look like zeros that do.
    """
    reading = read_conventions(session, arm)
    if not any(issue.issue == "mounting" for issue in reading.issues):
        return True
    return find_zero_step(ComparedRuns(reading.session, reading.arm)) is not None


def tell(difference: RunDifference, session: Session) -> TelemetryIssue:
    """The issue of a difference: runs and joints concerned, and errors before and after it is
    undone.
    """
    change = difference.change
    joints = [session.joints[joint] for joint in change.joints]
    what = WORDS[change.kind].format(joints=" and ".join(joints), size=change.size)
    worst = int(np.nanargmax(difference.before / difference.after))
    seen: dict[str, Any] = {
        "runs": ", ".join(difference.odd),
        "what": what,
        "before": float(difference.before[worst]),
        "after": float(difference.after[worst]),
        "usual": float(difference.usual[worst]),
        "at": session.joints[worst],
    }
    key = f"run_{change.kind}"
    return issue_of(key, session, joints, **seen)
