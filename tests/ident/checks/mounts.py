"""How a recording's arm is found mounted."""

import numpy as np

from ident.checks.conventions.reread import read_conventions
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel


def angle_between(one: np.ndarray, other: np.ndarray) -> float:
    """Of two vectors [deg]."""
    return float(np.degrees(np.arccos(one @ other / np.linalg.norm(one) / np.linalg.norm(other))))


def mounted(session: Session, arm: ArmModel) -> tuple[ArmModel, list[TelemetryIssue]]:
    """The arm as the search finds it mounted, and what is told of that."""
    reading = read_conventions(session, arm)
    return reading.arm, [issue for issue in reading.issues if issue.issue == "mounting"]
