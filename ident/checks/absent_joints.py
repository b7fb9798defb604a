"""Joints that are not recorded, and moved all the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import least_squares
from ident.checks.effort import TRANSITION_RAD_S, States
from ident.checks.report import issue_of
from ident.checks.settings import EFFORT_KIND as LIMIT
from ident.recordings.recording import Session, Severity, TelemetryIssue


def check_absent(session: Session, states: States, absent: Sequence[str]) -> list[TelemetryIssue]:
    """Whether joints that are not recorded moved.

    Then a torque doesn't follow from the recorded joints' motion. Each torque is held against the
    model's with those joints still, and what the recorded angles, one by one, and the joint's own
    motion can make of it.

    Args:
        session: The recordings.
        states: Their states.
        absent: Names of the joints that are not recorded.

    Returns:
        One issue, fatal or a warning by how little is explained; empty where nothing moved or it
        can't be told.
    """
    swings = np.hstack([np.sin(states.q), np.cos(states.q), states.ddq])
    explained = {}
    for joint in map(int, np.flatnonzero(states.alive & states.moving)):
        dq = states.dq[:, joint]
        tau = states.tau[:, joint]
        model = [states.gravity[:, joint], states.inertial[:, joint]]
        losses = [dq, np.tanh(dq / TRANSITION_RAD_S), np.ones(len(tau))]
        table = np.column_stack([swings, *model, states.q[:, joint], *losses])
        left = tau - table @ least_squares(table, tau)
        explained[joint] = max(1.0 - float(left.var() / tau.var()), 0.0)
    least, enough = LIMIT.own_motion
    worst = min(explained, key=lambda joint: explained[joint], default=None)
    if worst is None or explained[worst] > enough:
        return []
    severity: Severity = "fatal" if explained[worst] < least else "warning"
    names = ", ".join(absent)
    share = explained[worst]
    return [issue_of("absent", session, [worst], worst, severity, explained=share, absent=names)]
