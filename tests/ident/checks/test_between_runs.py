"""A run whose torque has another sign or scale than the others' is told; runs as they are recorded are not."""

from pathlib import Path

import numpy as np
import pytest

from ident.checks.between_runs import check_between_runs
from ident.checks.inspection import inspect_sessions
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path

LOGS = Path(data_path("logs/tm5_900"))


def scaled(session: Session, number: int, joints: list[int], factor: float) -> Session:
    """The session with one run's torque of some joints times a factor."""
    runs = list(session.runs)
    factors = np.ones(len(session.joints))
    factors[joints] = factor
    runs[number] = runs[number].replace(effort=runs[number].effort * factors)
    return session.replace(runs=tuple(runs))


@pytest.mark.parametrize("joints", [[1], [2], [0, 1, 2, 3, 4, 5]])
@pytest.mark.parametrize("number", [0, 3])
def test_a_run_with_another_sign_is_told(number: int, joints: list[int], tm5: ArmModel) -> None:
    """Law: by its name and its joints, and the recording is not fit for use."""
    session = load_session(LOGS / "E1")
    turned = scaled(session, number, joints, -1.0)
    (issue,) = check_between_runs(turned, tm5)
    assert (issue.issue, issue.severity) == ("effort_sign_flipped", "fatal")
    assert session.runs[number].name in issue.evidence
    assert {session.joints[j] for j in joints} >= set(issue.joints)
    assert inspect_sessions([turned], tm5)[0].fatal


@pytest.mark.parametrize("factor", [0.05, 0.1, 10.0, 1000.0])
def test_a_run_at_another_scale_is_told(factor: float, tm5: ArmModel) -> None:
    session = load_session(LOGS / "E1")
    (issue,) = check_between_runs(scaled(session, 2, [1, 2], factor), tm5)
    assert (issue.issue, issue.severity) == ("effort_not_torque", "fatal")
    assert session.runs[2].name in issue.evidence


@pytest.mark.parametrize("name", ["E1", "E2", "T1", "T2", "payload_516g", "payload_1544g"])
def test_runs_as_they_are_differ_in_neither(name: str, tm5: ArmModel) -> None:
    assert check_between_runs(load_session(LOGS / name), tm5) == []


def test_of_two_runs_nobody_knows_the_odd_one(tm5: ArmModel) -> None:
    session = load_session(LOGS / "E1")
    two = session.replace(runs=session.runs[:2])
    assert check_between_runs(scaled(two, 0, [1, 2], -1.0), tm5) == []
