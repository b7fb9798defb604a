"""The first three joints of the TM5-900, what the diagnosis sees of them, and what they may do."""

from __future__ import annotations

import pytest

from ident.robot.arm import ArmModel
from plan.experiment.feasible import Feasibility
from plan.experiment.foresight import Eye


@pytest.fixture(scope="session")
def arm() -> ArmModel:
    return ArmModel.load("tm5-900", joints=["joint_1", "joint_2", "joint_3"])


@pytest.fixture(scope="session")
def eye(arm: ArmModel) -> Eye:
    return Eye.of(arm)


@pytest.fixture(scope="session")
def feasible(arm: ArmModel) -> Feasibility:
    return Feasibility(arm)
