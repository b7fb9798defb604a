"""Laws of the search's steps: what is combined, what it starts from, and how torques are compared."""

from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
import pytest

from ident.checks.conventions.closely import Scored
from ident.checks.conventions.description import price
from ident.checks.conventions.find import search_conventions, second_of
from ident.checks.conventions.hypothesis import COMPENSATED, Hypothesis, states_as
from ident.checks.conventions.masses import gain_of_agreeing
from ident.checks.conventions.model import Model
from ident.checks.conventions.motions import Motions, both, reordered
from ident.checks.conventions.products import products_of, read_as
from ident.checks.conventions.readings import Log, own_columns, read, unexplained
from ident.checks.conventions.search import Search
from ident.checks.conventions.settings import SEARCH
from ident.robot.arm import ArmModel
from tests.bench.conventions.arms import simulate
from tests.bench.conventions.changes import spoil

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


@pytest.mark.parametrize("place", [0, 2, 3, 5])
def test_a_column_that_stands_amid_the_others_is_the_last_joint_s(place: int, log: Log, arm: ArmModel) -> None:
    """Law: where a hand's column stands among the arm's, each joint has its own again; else nothing is changed."""
    q, dq, ddq = log.q.copy(), log.dq.copy(), log.ddq.copy()
    q[:, 5], dq[:, 5], ddq[:, 5] = 0.3, 0.0, 0.0
    tau = arm.inverse_dynamics(q, dq, ddq) + 2.0 * dq
    columns = np.insert(np.arange(5), place, 5)
    written = Log(*(values[:, columns] for values in (q, dq, ddq, tau)))
    found = search_conventions(written, Model(arm)).best.hypothesis
    assert found.order == tuple(np.argsort(columns))
    assert found.changes == (() if place == 5 else ("order",))


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


def test_what_a_joint_has_may_stand_for_another_change_of_it(log: Log, arm: ArmModel) -> None:
    """Law: from a zero that is off the search comes to a share, another unit and the other way of the same joint."""
    model = Model(arm)
    joint = model.after_parallel[0]
    reading = PLAIN.with_entry("quarters", joint, 1).with_entry("direction", 0, -1)
    others = set(Motions(log, model).other_values(reading, []))
    plain = reading.with_entry("quarters", joint, 0)
    for name, value in (("share", -1), ("unit", "deg"), ("direction", -1), ("gear", 2.0), ("quarters", 3)):
        assert plain.with_entry(name, joint, value) in others


def test_each_value_of_a_place_is_tried_with_each_of_another_s(log: Log, arm: ArmModel) -> None:
    zeros = [PLAIN.with_entry("quarters", 2, quarters) for quarters in (1, 2, 3)]
    turned = [PLAIN.with_entry("direction", 3, -1)]
    together = set(Motions(log, Model(arm)).other_values(PLAIN, [zeros, turned]))
    assert together == {zero.with_entry("direction", 3, -1) for zero in zeros}


def test_states_of_many_readings_are_those_of_each(log: Log, arm: ArmModel) -> None:
    """Law: positions have zeros, their derivatives none; both have units, directions, gears and shares."""
    sliding = np.zeros(6, dtype=bool)
    readings = [
        PLAIN,
        PLAIN.with_entry("quarters", 1, 2).with_entry("unit", 1, "deg").with_entry("share", 2, -1),
        reordered(PLAIN, (2, 1, 0, 3, 4, 5)).with_entry("direction", 0, -1).with_entry("gear", 5, 2.0),
    ]
    q, dq = states_as(readings, (log.q, log.dq), sliding)
    for k, reading in enumerate(readings):
        np.testing.assert_array_equal(q[k], reading.angles(log.q, sliding))
        np.testing.assert_array_equal(dq[k], reading.rates(log.dq, sliding))
    angle = np.pi + np.radians(log.q[:, 1])
    np.testing.assert_allclose(q[1][:, 1], angle)
    np.testing.assert_allclose(q[1][:, 2], log.q[:, 2] - angle)
    np.testing.assert_allclose(dq[1][:, 1], np.radians(log.dq[:, 1]))


def test_each_kind_of_limit_counts_once(log: Log, arm: ArmModel) -> None:
    """Law: within all limits nothing, beyond those of position and of speed one each, whatever the joints are."""
    model = Model(arm)
    limits = arm.known_limits
    slow, fast = 0.5 * np.tile(limits.speed, (1, 3, 1)), 4.0 * np.tile(limits.speed, (1, 3, 1))
    near, far = 0.0 * slow, np.tile(limits.upper + 1.0, (1, 3, 1))
    counts = [float(model.beyond_limits(q, dq)[0]) for q in (near, far) for dq in (slow, fast)]
    assert counts == [0.0, 1.0, 1.0, 2.0]
    assert not model.beyond_effort(0.9 * limits.effort).any()
    assert model.beyond_effort(3.0 * limits.effort).all()


def test_a_log_that_is_explained_is_settled_by_few_readings(log: Log, arm: ArmModel) -> None:
    """Law: work is spent where the log's own motion explains little."""
    asked = {}
    for name, position in (("as it is", log.q), ("columns exchanged", log.q[:, [1, 0, 3, 2, 4, 5]])):
        search = Search(replace(log, q=position), Model(arm))
        search.run()
        asked[name] = len(search.screening.seen)
    assert asked["as it is"] < 0.5 * SEARCH.most_readings
    assert asked["columns exchanged"] > 1.5 * asked["as it is"]


def test_every_two_changes_are_asked_where_little_is_explained(log: Log, arm: ArmModel) -> None:
    """Law: two changes of which neither alone explains anything are found, whatever the others' rank is."""
    model = Model(arm)
    pairs = set(chain.from_iterable(Motions(log, model).all_pairs(PLAIN)))
    reversed_zero = PLAIN.with_entry("direction", 5, -1).with_entry("quarters", 0, 3)
    exchanged = reordered(PLAIN, (0, 3, 2, 1, 4, 5)).with_entry("direction", 1, -1)
    assert {reversed_zero, exchanged} <= pairs
    assert PLAIN not in pairs


def test_a_search_that_explains_nothing_asks_every_two_changes_and_ends(log: Log, arm: ArmModel) -> None:
    """Law: torques that are no arm's are given up once so many readings in a row gained nothing."""
    short = arm.keeping(arm.joint_names[:3])
    noise = np.random.default_rng(3).standard_normal((len(log.q), 3))
    search = Search(Log(log.q[:, :3], log.dq[:, :3], log.ddq[:, :3], noise), Model(short))
    search.run()
    pairs = {pair.motion for pairs in search.motions.all_pairs(search.motions.plain) for pair in pairs}
    asked = {motion for motion, body in search.screening.seen if body is None}
    assert pairs <= asked
    of_starts = {each.motion for start in search.motions.starts() for each in search.motions.neighbours(start)}
    assert of_starts <= asked
    assert len(search.screening.seen) < len(pairs | of_starts) + 3 * SEARCH.most_readings


@pytest.mark.parametrize("change", ["all torque signs", "no gravity"])
def test_torques_are_asked_beside_a_heavy_body(change: str, log: Log, arm: ArmModel) -> None:
    """Law: what a body as heavy as half the arm hides is asked once it is seen."""
    parameters = np.array(arm.inertial_parameters)
    mass = 0.4 * float(parameters[::10].sum())
    parameters[-10:-6] += mass * np.array([1.0, 0.05, -0.1, 0.15])
    loaded = arm.with_inertial_parameters(parameters)
    torque = loaded.inverse_dynamics(log.q, log.dq, log.ddq) + 2.0 * log.dq
    truth = replace(PLAIN, effort_sign=(-1,) * 6)
    if change == "no gravity":
        torque -= loaded.gravity(log.q)
        truth = replace(PLAIN, gravity=COMPENSATED)
    else:
        torque = -torque
    best = Search(replace(log, tau=torque), Model(arm)).run()[0].hypothesis
    assert best.body is not None
    assert best.body[0] == pytest.approx(mass, rel=0.2)
    assert replace(best, body=None) == truth


def test_sizes_that_agree_speak_for_a_factor_beside_a_body(log: Log, arm: ArmModel) -> None:
    """Law: nothing is said for the same sizes, and something for those that agree better."""
    sizes = np.array([1.0, 1.4, 0.8, 1.5, 0.7, 1.0])
    torque = sizes * arm.inverse_dynamics(log.q, log.dq, log.ddq)
    products = products_of(read_as(replace(log, tau=torque), Model(arm), PLAIN))
    alike = products_of(read_as(replace(log, tau=2.0 * torque / sizes), Model(arm), PLAIN))
    one, two = np.eye(5)[0], 2.0 * np.eye(5)[0]
    assert gain_of_agreeing(products, one, one) == 0.0
    assert gain_of_agreeing(alike, one, two) > 1.0


@pytest.mark.parametrize(
    ("robot", "changes"),
    [
        ("panda", {"unit": ("turns",) * 7, "gear": (1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 1.0)}),
        (
            "kinova",
            {"quarters": (0, 0, 0, 0, 2, 0), "gear": (1.0, 1.0, 0.5, 1.0, 1.0, 1.0), "share": (0, 0, 1, 0, 0, 0)},
        ),
    ],
)
def test_a_body_does_not_hide_the_change_that_is_missing(robot: str, changes: dict[str, Any]) -> None:
    """Law: where masses at the arm's end explain most, changes are sought without them as well."""
    rng = np.random.default_rng(17)
    case = simulate(robot, rng)
    truth = replace(Hypothesis.as_it_is(case.arm.n), **changes)
    spoilt, urdf = spoil(case, truth, rng)
    found = search_conventions(spoilt, Model(urdf))
    assert found.best.hypothesis.changes == truth.changes
    assert found.best.hypothesis.motion == truth.motion


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_what_explains_a_part_of_its_price_may_be_the_second_reading(share: float) -> None:
    """Law: a further change is a rival as soon as it explains anything."""
    best = PLAIN.with_entry("direction", 1, -1)
    more = best.with_entry("quarters", 5, 1)
    other = replace(PLAIN, gravity=COMPENSATED)
    further = price(more) - price(best)
    costs = {best: -9.0, more: -9.0 + share * further, other: -9.0 + 2.0 * further}
    ranked = [Scored(reading, cost, (0.0,) * 6, (1.0,) * 6) for reading, cost in costs.items()]
    second = second_of(ranked, ())
    assert second is not None
    assert second.hypothesis == (more if share < 1.0 else other)
