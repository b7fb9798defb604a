"""The arm that all tests of patches share, and a short rich session of it."""

import pytest

from ident.effects.base import SessionContext
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.effects.smooth_motion import make_session
from tests.ident.export.learned_arm import fit_learned, forget, learned_runs
from tests.ident.made_up import two_joint_arm


@pytest.fixture(scope="session")
def session(arm: ArmModel) -> SessionContext:
    """Two runs of 8 s."""
    return make_session(arm, seconds=8.0, runs=2)


@pytest.fixture(scope="session")
def fitted_runs_and_model() -> tuple[list[Motion], HybridModel]:
    """Runs of an arm with load friction, a bend and a hysteresis, and what is fitted to them."""
    motions = learned_runs(two_joint_arm())
    return motions, fit_learned(motions)


@pytest.fixture(scope="session", params=["as fitted", "net at joint 1", "net at joint 2"])
def learned_runs_and_model(
    request: pytest.FixtureRequest, fitted_runs_and_model: tuple[list[Motion], HybridModel]
) -> tuple[list[Motion], HybridModel]:
    """The same with all memories that the fit kept, and with a net in place of one joint's."""
    motions, model = fitted_runs_and_model
    which = str(request.param)
    if which == "as fitted":
        return motions, model
    return motions, forget(model, int(which[-1]) - 1)
