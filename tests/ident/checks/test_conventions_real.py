"""Laws of the search on real arms' logs, with conventions that a careless person brings."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from faults import spoil
from real_arms import load_real

from ident.checks.conventions.find import find_conventions, is_changed
from ident.checks.conventions.reread import reread
from ident.recordings.recording import Recording

Change = Callable[[Recording], Recording]


def with_column(values: np.ndarray, joint: int, change: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Values with one joint's column changed."""
    changed = np.array(values)
    changed[:, joint] = change(changed[:, joint])
    return changed


def swapped_and_turned(run: Recording, joint: int = 1) -> Recording:
    """The columns of joints 2 and 3 exchanged, and the torque of one joint of the other sign."""
    effort = with_column(run.effort, joint, np.negative)
    order = [0, 2, 1, *range(3, len(run.joints))]
    channels = {name: values[:, order] for name, values in run.replace(effort=effort).channels().items()}
    return run.replace(**channels)


def degrees_and_zero(run: Recording) -> Recording:
    """Joint 3 in degrees, from a zero that is 90° off."""
    changed = {"position": with_column(run.position, 2, lambda q: np.degrees(q - 0.5 * np.pi))}
    if run.velocity is not None:
        changed["velocity"] = with_column(run.velocity, 2, np.degrees)
    return run.replace(**changed)


CHANGES: dict[str, Change] = {"swapped and turned": swapped_and_turned, "degrees and zero": degrees_and_zero}


@pytest.mark.real
@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("name", ["airbot", "ur10"])
def test_a_careless_log_is_read_as_it_was(name: str, change: str, real_data: Path) -> None:
    """Law: read by what is found, positions and torques are those before the change."""
    session, arm = load_real(name, real_data)
    session = session.replace(runs=session.runs[:1])
    spoilt = spoil(session, CHANGES[change])
    found = find_conventions(spoilt, arm)
    assert found is not None
    assert is_changed(found)
    for run, original in zip(reread(spoilt, found.best.hypothesis).runs, session.runs, strict=True):
        np.testing.assert_allclose(run.position, original.position, atol=1e-6)
        np.testing.assert_allclose(run.effort, original.effort, atol=1e-6)


@pytest.mark.real
def test_a_sign_that_a_wrong_size_hides_is_in_the_comparison(real_data: Path) -> None:
    """Law: where a joint's torque is in another unit, 11 times the model's, its sign is not sure;
    the reading with both is the second.
    """
    session, arm = load_real("ur10", real_data)
    spoilt = spoil(session, lambda run: swapped_and_turned(run, 3))
    found = find_conventions(spoilt, arm)
    assert found is not None
    assert found.best.hypothesis.changes == ("order",)
    assert found.second is not None
    assert found.second.hypothesis.changes == ("order", "effort_sign 3", "effort_scale 3")
