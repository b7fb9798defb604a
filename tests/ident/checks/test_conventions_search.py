"""Laws of the search's steps: what is combined, what it starts from, and how torques are compared."""

from dataclasses import replace

import numpy as np
import pytest

from ident.checks.conventions.hypothesis import Hypothesis
from ident.checks.conventions.motions import Motions, both, reordered
from ident.checks.conventions.readings import Log, Model, own_columns, read, unexplained
from ident.robot.arm import ArmModel

PLAIN = Hypothesis.as_it_is(6)


@pytest.fixture(scope="module")
def log(arm: ArmModel) -> Log:
    """States of two sinusoids a joint."""
    rng = np.random.default_rng(8)
    t = np.arange(300)[:, None] * 0.05
    pulse, size = rng.uniform(0.3, 1.5, (2, 6)), rng.uniform(0.2, 0.6, (2, 6))
    q = (size[:, None] * np.sin(pulse[:, None] * t)).sum(axis=0)
    dq = (size * pulse)[0] * np.cos(pulse[0] * t) + (size * pulse)[1] * np.cos(pulse[1] * t)
    ddq = np.gradient(dq, 0.05, axis=0)
    return Log(q, dq, ddq, arm.inverse_dynamics(q, dq, ddq) + 2.0 * dq)


def test_changes_of_two_joints_are_combined() -> None:
    first, second = PLAIN.with_entry("direction", 1, -1), PLAIN.with_entry("quarters", 3, 2)
    assert both(PLAIN, first, second) == first.with_entry("quarters", 3, 2)
    assert both(PLAIN, second, first) == both(PLAIN, first, second)


def test_changes_of_one_entry_are_not() -> None:
    assert both(PLAIN, PLAIN.with_entry("quarters", 3, 1), PLAIN.with_entry("quarters", 3, 2)) is None
    orders = [replace(PLAIN, order=order) for order in ((1, 0, 2, 3, 4, 5), (0, 1, 3, 2, 4, 5))]
    assert both(PLAIN, *orders) is None


def test_a_column_keeps_its_unit_under_another_joint() -> None:
    """Law: degrees are of a column, whichever joint it is given to."""
    exchanged = reordered(PLAIN, (2, 1, 0, 3, 4, 5))
    merged = both(PLAIN, PLAIN.with_entry("unit", 0, "deg"), exchanged)
    assert merged is not None
    assert merged.order == exchanged.order
    assert merged.unit == ("", "", "deg", "", "", "")


def test_columns_that_travel_further_than_joints_can_start_in_degrees(log: Log, arm: ArmModel) -> None:
    scale = np.array([1.0, 57.3, 1.0, 1.0, 57.3, 1.0])
    starts = Motions(replace(log, q=scale * log.q), Model(arm)).starts()
    assert PLAIN.with_entry("unit", 1, "deg").with_entry("unit", 4, "deg") in starts
    assert not [start for start in Motions(log, Model(arm)).starts() if len({*start.unit}) > 1]


def test_a_joint_s_own_column_costs_what_it_does_among_all(log: Log, arm: ArmModel) -> None:
    """Law: what is asked of own columns alone is what the whole table has of them."""
    model = Model(arm)
    readings = [PLAIN, reordered(PLAIN, (2, 1, 0, 3, 4, 5)), PLAIN.with_entry("direction", 1, -1)]
    orders = np.array([reading.order for reading in readings])
    sums = read(log, model, readings)
    vectors = np.broadcast_to([model.stated, np.zeros(3)], (3, 2, 3))
    whole = unexplained(sums, vectors, np.ones((3, 2)))
    own = unexplained(own_columns(sums, orders), vectors, np.ones((3, 2)))
    for table, of_own in zip(whole, own, strict=True):
        expected = np.take_along_axis(table, orders[:, :, None, None, None], axis=3)
        np.testing.assert_allclose(of_own, expected, rtol=1e-9, atol=1e-12)
