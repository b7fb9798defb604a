"""Gravity-compensated effort is diagnosed like the whole torque."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ident.checks import inspect_sessions
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import find_effect
from ident.recordings.load import load_session
from ident.robot.arm import ArmModel
from tests.ident.checks.faults import spoil

LOGS = Path(__file__).parents[2] / "logs/tm5_900"


def test_the_diagnosis_is_that_of_the_whole_torque() -> None:
    """A spring on one joint is named alike, although the driver's masses are 3 % above the URDF's."""
    arm, shipped = ArmModel.load("tm5-900"), load_session(LOGS / "E1")
    driver = arm.with_inertial_parameters(1.03 * np.array(arm.inertial_parameters))
    pull = 12.0 * (np.arange(arm.n) == 1)
    whole = spoil(shipped, lambda run: run.replace(effort=run.effort + pull * run.position))
    compensated = spoil(whole, lambda run: run.replace(effort=run.effort - driver.gravity(run.position)))
    few = [find_effect(name) for name in ("spring_torque", "load_dependent_friction")]
    named, shrinks = [], []
    for session in (whole, compensated):
        diagnosis, _, _ = diagnose_reports(inspect_sessions([session], arm), arm, few)
        record = diagnosis.to_dict()
        named.append([(one["effect"], one["joints"]) for one in record["findings"]])
        shrinks.append(record["heldout"]["shrink"])
    assert ("spring_torque", ["joint_2"]) in named[0]
    assert named[0] == named[1]
    assert abs(shrinks[0] - shrinks[1]) < 0.1
