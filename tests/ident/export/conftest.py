"""The arm that all tests of patches share, and a short rich session of it."""

import pytest

from ident.effects.base import SessionContext
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.effects.smooth_motion import make_session
from tests.ident.export.learned_arm import fit_learned, learned_runs
from tests.ident.made_up import two_joint_arm


@pytest.fixture(scope="session")
def session(arm: ArmModel) -> SessionContext:
    """Two runs of 8 s."""
    return make_session(arm, seconds=8.0, runs=2)


@pytest.fixture(scope="session")
def learned_runs_and_model() -> tuple[list[Motion], HybridModel]:
    """Runs of an arm with load friction, a bend and a hysteresis, and what is fitted to them."""
    motions = learned_runs(two_joint_arm())
    return motions, fit_learned(motions)
