"""One healthy session, analysed once, for all laws of the diagnosis."""

import pytest

from ident.diagnosis.diagnose import Analysis
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import analyse, load_arm, nothing


@pytest.fixture(scope="session")
def short_arm() -> ArmModel:
    return load_arm()


@pytest.fixture(scope="session")
def healthy(short_arm: ArmModel) -> Analysis:
    """What the diagnosis makes of an arm that the baseline describes exactly."""
    return analyse(short_arm, nothing)
