"""The arm that all tests of patches share, and a short rich session of it."""

import pytest

from ident.effects.base import SessionContext
from ident.robot.arm import ArmModel
from tests.ident.effects.smooth_motion import make_session


@pytest.fixture(scope="session")
def session(arm: ArmModel) -> SessionContext:
    """Two runs of 8 s."""
    return make_session(arm, seconds=8.0, runs=2)
