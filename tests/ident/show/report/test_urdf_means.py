"""One meaning of "URDF" in every table: as a simulator loads it, with the friction that its <dynamics> state."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ident import FitOptions, diagnose, evaluate, fit
from ident.export.identified import IdentifiedArm
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.robot.arm import ArmModel
from ident.show.report.evaluation import headline, urdf_rung
from tests.ident import wrong_friction as arm


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Fit, evaluation and diagnosis of one arm on one session."""
    folder = tmp_path_factory.mktemp("urdf")
    urdf = folder / "arm.urdf"
    urdf.write_text(arm.state_friction())
    more = [tuple(1.5 * one for one in row) for row in (arm.DAMPING, arm.FRICTION)]
    session: Path = arm.record(arm.load(arm.state_friction(*more)), folder / "session")
    model = fit(session, urdf, options=FitOptions(net="none", inertia="nominal")).model
    found = diagnose(session, urdf)
    score = evaluate(session, model).pooled
    return {"score": score, "diagnosis": found.to_dict()}


def test_evaluation_and_diagnosis_say_the_same_of_the_urdf(results: dict[str, Any]) -> None:
    """Law: within what samples near stops make, of which an evaluation counts more; the rigid body is off threefold."""
    score, gap = results["score"], results["diagnosis"]["gap"]
    evaluated = score.rmse_mean[urdf_rung(score), :-1]
    diagnosed = [gap[joint]["urdf_rms_Nm"] for joint in score.joints]
    assert evaluated == pytest.approx(diagnosed, rel=0.2)


def test_the_rigid_body_is_another_row(results: dict[str, Any]) -> None:
    score, gap = results["score"], results["diagnosis"]["gap"]
    assert score.rungs == ("analytic", "urdf", "loss")
    rigid = score.rmse_mean[0, :-1]
    assert rigid == pytest.approx([gap[joint]["rigid_body_rms_Nm"] for joint in score.joints], rel=0.2)
    assert (score.rmse_mean[1, :-1] < 0.5 * rigid).all()


def test_the_headline_counts_from_the_urdf_as_loaded(results: dict[str, Any]) -> None:
    score = results["score"]
    assert f"the URDF alone {score.rmse_mean[1, -1]:.2f}" in headline(score)


def test_a_patch_measures_the_urdf_with_the_friction_that_it_states() -> None:
    given = IdentifiedArm.as_urdf(ArmModel.from_urdf(arm.state_friction()))
    assert tuple(given.losses.viscous) == arm.DAMPING
    assert tuple(given.losses.coulomb) == arm.FRICTION


def test_a_urdf_without_friction_has_no_row_of_its_own() -> None:
    plain = ArmModel.load("tm5-900")
    none = np.zeros(plain.n)
    model = HybridModel(plain, plain, plain, LossParameters(none, none, none, none, none))
    assert model.rungs == ("analytic", "loss")
