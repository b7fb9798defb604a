"""The first three joints of the TM5-900 and all six, what the diagnosis sees of them, and what they may do."""

import pytest

from ident.robot.arm import ArmModel
from plan.experiment.distance import Predictor
from plan.experiment.feasible import Feasibility


@pytest.fixture(scope="session")
def arm() -> ArmModel:
    return ArmModel.load("tm5-900", joints=["joint_1", "joint_2", "joint_3"])


@pytest.fixture(scope="session")
def whole() -> ArmModel:
    return ArmModel.load("tm5-900")


@pytest.fixture(scope="session")
def predictor(arm: ArmModel) -> Predictor:
    return Predictor.of(arm)


@pytest.fixture(scope="session")
def feasible(arm: ArmModel) -> Feasibility:
    return Feasibility(arm)
