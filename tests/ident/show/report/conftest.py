"""A two-joint arm with friction, models of it with and without loss parameters, and their evaluations."""

import numpy as np
import pytest

from ident.model.evaluation import evaluate
from ident.model.hybrid import HybridModel
from ident.model.loss import LossFigure, LossParameters
from ident.recordings.recording import Payload, TelemetryIssue
from ident.show.report.evaluation import ReportInput
from tests.ident.made_up import made_motions, two_joint_arm

COULOMB = np.array([6.0, 9.0])


def make_model(share: float, samples: int, session: str = "T") -> HybridModel:
    """A model that knows a share of the friction, as if fitted on run_9 of a session."""
    arm = two_joint_arm()
    zero = np.zeros(2)
    figures = tuple(
        LossFigure(joint, "coulomb", share * f, share * f - 0.5, share * f + 0.5, "N m")
        for joint, f in zip(arm.joint_names, COULOMB, strict=True)
    )
    past = {
        "samples": samples,
        "runs": 1,
        "options": {"links": 6},
        "data": [{"session": session, "file": "run_9.parquet", "sha256": "ab12" * 16}],
        "versions": {"numpy": "2.0"},
    }
    loss = LossParameters(zero, zero, share * COULOMB, zero, np.full(2, 0.01))
    return HybridModel(arm, arm, arm, loss, figures=figures, provenance=past)


@pytest.fixture(scope="session")
def source() -> ReportInput:
    """Two models, the second one the better and of more samples; two sessions free and one with 500 g."""
    arm = two_joint_arm()
    payload = Payload(0.5, (0.0, 0.0, 0.05))

    def law(carried: Payload | None):  # type: ignore[no-untyped-def]
        body = arm.with_payload(carried)
        return lambda q, dq, ddq: body.inverse_dynamics(q, dq, ddq) + COULOMB * np.tanh(dq / 0.01)

    sessions = [
        ("E1", made_motions(arm, law(None), (1, 2), 6.0, noise=0.05)),
        ("E2", made_motions(arm, law(None), (3,), 6.0, noise=0.05)),
        ("heavy", made_motions(arm, law(payload), (4,), 6.0, noise=0.05, payload=payload)),
    ]
    models = (make_model(0.5, 100), make_model(0.98, 200))
    evaluations = tuple(
        evaluate(model, sessions, name) for model, name in zip(models, ("half", "nearly all"), strict=True)
    )
    issues = (
        TelemetryIssue("jitter", (), "note", "run_1: 2 % of <b>jitter</b>", "none needed"),
        TelemetryIssue("clipped_effort", ("joint_1",), "warning", "run_2: 40 samples at 50 N m", "move slower"),
    )
    return ReportInput(models, evaluations, issues)
