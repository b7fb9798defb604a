"""The individual arm on which effects are switched on and off."""

import numpy as np
import pytest

from ident.robot.arm import ArmModel
from ident.simulation.hardware import Hardware, draw_hardware


@pytest.fixture(scope="session")
def hardware(arm: ArmModel) -> Hardware:
    """An individual TM5-900 whose friction is the same in every run."""
    return draw_hardware(arm, np.random.default_rng(3)).replace(friction_spread=0.0)
