"""Laws of what is sure: readings that foretell the same torque are not told apart, and what is doubtful is a rival."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ident.checks.conventions.closely import Scored
from ident.checks.conventions.find import Conventions, is_alike, is_changed, search_conventions, second_of
from ident.checks.conventions.hypothesis import COMPENSATED, Hypothesis
from ident.checks.conventions.model import Model
from ident.checks.conventions.readings import Log
from ident.checks.conventions.settings import DESCRIPTION, SEARCH
from ident.checks.conventions.told import tell
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from tests.bench.conventions.arms import simulate

PLAIN = Hypothesis.as_it_is(6)
AXIS = PLAIN.with_entry("direction", 1, -1)
ZERO = PLAIN.with_entry("quarters", 2, 1)
# Costs apart at which the odds are just those that are sure.
SURE = math.log(SEARCH.sure_odds) / DESCRIPTION.observations


def scored(reading: Hypothesis, cost: float) -> Scored:
    """A reading that explains nearly all, at a cost."""
    return Scored(reading, cost, (-3.0,) * 6, (1.0,) * 6, cost)


def found_with(apart: float) -> Conventions:
    """Two readings that explain far more than log and URDF as they say, one by so much more than the other."""
    return Conventions(scored(PLAIN, 0.0), scored(AXIS, -20.0), scored(ZERO, -20.0 + apart))


@pytest.mark.parametrize("share", [0.0, 0.9, 1.1])
def test_none_of_two_is_sure_unless_their_odds_are(share: float) -> None:
    found = found_with(share * SURE)
    assert is_changed(found)
    assert found.is_told_apart == (share > 1.0)
    assert (is_changed(found) and found.is_told_apart) == (share > 1.0)


def test_both_of_two_that_are_not_told_apart_are_said(clean: Session, arm: ArmModel) -> None:
    """Law: one warning with both readings and both lines, and none where they are told apart."""
    told, untold = (tell(found_with(apart), clean, arm) for apart in (2.0 * SURE, 0.5 * SURE))
    assert not [issue for issue in told if issue.issue == "conventions_untold"]
    more = replace(found_with(0.5 * SURE), second=scored(AXIS.with_entry("quarters", 2, 1), -20.0))
    assert not [issue for issue in tell(more, clean, arm) if issue.issue == "conventions_untold"]
    (issue,) = [issue for issue in untold if issue.issue == "conventions_untold"]
    for name, line in ((clean.joints[1], "direction = {"), (clean.joints[2], "zero_rad = {")):
        assert name in issue.evidence
        assert line in issue.evidence


def test_a_shoulder_half_a_turn_off_and_all_torques_turned_are_one_for_an_arm_that_creeps() -> None:
    """Law: without friction and inertia both foretell the same torque, and neither is sure."""
    arm = ArmModel.load("ur5")
    rng = np.random.default_rng(5)
    pulse = rng.uniform(0.3, 1.5, arm.n)
    size = rng.uniform(0.6, 3.0, arm.n)
    angle = pulse * np.arange(240)[:, None]
    q = size * np.sin(angle)
    slow = 1e-3 * size * pulse * np.cos(angle)
    torque = -arm.gravity(q) + 0.02 * rng.standard_normal(q.shape)
    found = search_conventions(Log(q, slow, 1e-3 * slow, torque), Model(arm))
    assert found.second is not None
    assert [found.best.hypothesis.changes, found.second.hypothesis.changes] == [("effort_sign",), ("zero 1",)]
    np.testing.assert_allclose(found.best.costs, found.second.costs, atol=1e-3)
    assert found.gain > 0.0
    assert not found.is_told_apart
    assert not (is_changed(found) and found.is_told_apart)


def test_other_values_are_another_reading_and_other_numbers_are_not() -> None:
    assert not is_alike(ZERO, PLAIN.with_entry("quarters", 2, 2))
    body = replace(PLAIN, body=(1.0, 0.0, 0.0, 0.1))
    assert is_alike(body, replace(body, body=(1.1, 0.0, 0.1, 0.0)))
    down, tilted, sideways = (
        replace(PLAIN, gravity=gravity) for gravity in ((0.0, 0.0, 9.81), (0.0, 2.0, 9.6), (0.0, 9.81, 0.0))
    )
    assert is_alike(down, tilted)
    assert not is_alike(down, sideways)
    second = second_of([scored(ZERO, -9.0), scored(PLAIN.with_entry("quarters", 2, 2), -8.0)], ())
    assert second is not None
    assert second.hypothesis.quarters[2] == 2


def test_another_unit_that_explains_some_of_what_it_costs_is_a_rival() -> None:
    """Law: a joint's effort in another unit, of which inertia alone tells, is the first reading or the second."""
    case = simulate("ur5", np.random.default_rng(4))
    torque = case.log.tau - case.sizes * case.arm.gravity(case.log.q)
    torque[:, 5] *= 100.0
    found = search_conventions(replace(case.log, tau=torque), Model(case.arm))
    assert found.second is not None
    changes = [each.hypothesis.changes for each in (found.best, found.second)]
    assert ("gravity", "effort_scale 5") in changes
    assert all(each.hypothesis.gravity == COMPENSATED for each in (found.best, found.second))
