"""A torque that never changes is told, in one run and in many."""

from pathlib import Path

import numpy as np
import pytest

from ident.checks.channels import drop_stuck
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.robot.names import data_path

E1 = Path(data_path("logs/tm5_900")) / "E1"


def with_constant(session: Session, joint: int, values: list[float]) -> Session:
    """The session with one joint's torque at one value a run."""
    runs = []
    for run, value in zip(session.runs, values, strict=True):
        effort = np.array(run.effort)
        effort[:, joint] = value
        runs.append(run.replace(effort=effort))
    return session.replace(runs=tuple(runs))


@pytest.mark.parametrize("values", [[3.0] * 5, [0.0] * 5, [1.0, 2.0, 3.0, 4.0, 5.0], [-2.0, 7.5, 0.0, 1.0, 1.0]])
def test_a_torque_that_is_constant_in_every_run_is_dead(values: list[float]) -> None:
    """Law: whether it is the same in all runs or another in each; it is no coarse channel."""
    _, issues = drop_stuck(with_constant(load_session(E1), 2, values))
    (issue,) = issues
    assert (issue.issue, issue.severity) == ("stuck_channel", "fatal")
    assert issue.joints == ("joint_3",)


def test_a_coarse_torque_is_none() -> None:
    """Law: a channel of few levels that changes between them is used."""
    session = load_session(E1)
    runs = []
    for run in session.runs:
        effort = np.array(run.effort)
        step = np.ptp(effort[:, 4]) / 6
        effort[:, 4] = np.round(effort[:, 4] / step) * step
        runs.append(run.replace(effort=effort))
    _, issues = drop_stuck(session.replace(runs=tuple(runs)))
    assert not any(issue.severity == "fatal" for issue in issues)
