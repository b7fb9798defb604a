"""A session with a spring and one with a Stribeck curve, inferred once for all laws."""

import pytest

from ident.diagnosis.diagnose import Analysis
from tests.ident.diagnosis.planted import analyse, load_arm, spring_on_3, stribeck_on_1


@pytest.fixture(scope="session")
def sprung() -> Analysis:
    """A spring across the third joint."""
    return analyse(load_arm(), spring_on_3)


@pytest.fixture(scope="session")
def slowed() -> Analysis:
    """Friction that falls with speed at the first joint."""
    return analyse(load_arm(), stribeck_on_1)
