"""Figures of an arm over its sessions: alarms of what changed, and the ranges that they leave for a simulation."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.monitor.alarms import LIMIT, Alarm, EProcess, Point, find_changes, find_outliers, gain_change, prior_weight
from ident.monitor.estimates import Estimates, ParameterEstimate, estimate_session
from ident.monitor.ranges import HABIT, find_ranges, pool_days
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.made_up import made_motions
from tests.schemas import check_record

KEYS = [(f"joint_{j}", figure) for j in (1, 2) for figure in ("viscous", "coulomb", "gap")]
NAMES = [f"s{i:03}" for i in range(60)]


def history(
    rng: np.random.Generator, changes: dict[tuple[tuple[str, str], int], float], count: int = 60
) -> dict[tuple[str, str], list[Point]]:
    """Figures of mean 10 and spread 1, with steps from some session on."""
    found = {}
    for key in KEYS:
        values = 10.0 + rng.standard_normal(count)
        for (changed, start), size in changes.items():
            if changed == key:
                values[start:] += size
        found[key] = [
            Point(float(v), v - 0.2, v + 0.2, 0.1, NAMES[i], f"2026-01-{i % 28 + 1:02}") for i, v in enumerate(values)
        ]
    return found


def alarms_of(changes: dict[tuple[tuple[str, str], int], float], seed: int) -> tuple[Alarm, ...]:
    return find_changes("arm", history(np.random.default_rng(seed), changes), NAMES)[0]


def test_a_change_is_named_dated_and_sized() -> None:
    """Joint 2's dry friction rises by four spreads at session 25."""
    (alarm,) = alarms_of({(("joint_2", "coulomb"), 25): 4.0}, 1)
    assert (alarm.joint, alarm.figure) == ("joint_2", "coulomb")
    assert abs(NAMES.index(alarm.since) - 25) <= 1
    assert alarm.low < 4.0 < alarm.high
    assert 25 < NAMES.index(alarm.session) < 40
    assert 0.95 < alarm.probability < 1.0
    assert 0.6 < alarm.spread < 1.5
    assert [alarms_of({}, seed) for seed in range(10)].count(()) >= 9  # an arm that does not change is left alone


def test_a_session_that_tells_a_figure_badly_is_passed_over() -> None:
    """Fifteen short sessions, ten times as uncertain and far off, are no change."""
    points = history(np.random.default_rng(6), {})
    key = KEYS[0]
    points[key][30:45] = [Point(20.0, 10.0, 30.0, 5.0, p.session, p.date) for p in points[key][30:45]]
    assert find_changes("arm", points, NAMES)[0] == ()


def test_what_is_told_does_not_depend_on_what_comes_later() -> None:
    """Looking after every session gives the alarms of one look at the end."""
    points = history(np.random.default_rng(7), {(KEYS[1], 20): 5.0})
    whole = find_changes("arm", points, NAMES)[0]
    for end in (25, 30, 45):
        cut = {key: own[:end] for key, own in points.items()}
        assert find_changes("arm", cut, NAMES[:end])[0] == tuple(a for a in whole if NAMES.index(a.session) < end)
    late = {**points, ("joint_2", "gain"): points[KEYS[0]][50:]}
    assert find_changes("arm", late, NAMES)[0] == whole


def test_one_odd_session_stands_out_and_is_no_alarm() -> None:
    """A tool left on for a day: named by its session and its oddest figure; a lasting change is not."""
    points = history(np.random.default_rng(8), {(("joint_2", "viscous"), 30): 5.0})
    key, place = ("joint_1", "coulomb"), 20
    odd = points[key][place]
    points[key][place] = Point(25.0, 24.8, 25.2, 0.1, odd.session, odd.date)
    alarms = find_changes("arm", points, NAMES)[0]
    (found,) = find_outliers("arm", points, alarms)
    assert (found.joint, found.figure, found.session) == (*key, NAMES[place])
    assert 9.0 < found.usual < 11.0
    assert {(alarm.joint, alarm.figure) for alarm in alarms} == {("joint_2", "viscous")}


def test_figures_that_change_alike_are_the_torques_scale() -> None:
    """Eight per cent on all of them is the scale; on one of them, or on none, it is not."""
    rng = np.random.default_rng(9)
    means = {"gain": 1.0, "rotor": 0.8, "viscous": 11.0, "coulomb": 6.0, "offset": 0.3}

    def days(factors: dict[str, float], count: int) -> dict[str, list[float]]:
        return {
            name: list(mean * factors.get(name, 1.0) * (1.0 + 0.01 * rng.standard_normal(count)))
            for name, mean in means.items()
        }

    scale = gain_change(days({}, 8), days(dict.fromkeys(means, 1.08), 6))
    assert scale[1] < 1.08 < scale[2]
    assert scale[2] - scale[1] < 0.03
    assert gain_change(days({}, 8), days({"coulomb": 1.08}, 6)) is None
    assert gain_change(days({}, 8), days({}, 6)) is None


def test_after_a_scale_that_changed_nothing_that_follows_it_is_a_hint() -> None:
    rng, history = np.random.default_rng(4), {}
    for name in ("gain", "rotor", "viscous", "coulomb"):
        values = 1.0 + 0.3 * (np.arange(len(NAMES)) > 7) + 0.01 * rng.standard_normal(len(NAMES))
        days = zip(values, NAMES, strict=True)
        history["joint_2", name] = [Point(one, one - 0.02, one + 0.02, 0.01, day, day) for one, day in days]
    alarms, hint = find_changes("arm", history, NAMES)
    assert {alarm.joint for alarm in alarms if alarm.scale is not None} == {"joint_2"}
    assert hint is None


def evidence(values: np.ndarray) -> np.ndarray:
    bets = EProcess()
    return np.array([bets.add(float(value)) for value in values])


def test_however_often_one_looks_false_alarms_stay_below_the_level() -> None:
    """Ville's inequality at 20 %, after every one of 40 sessions, by 400 histories of normal days."""
    rng = np.random.default_rng()
    level, count = 0.2, 400
    reached = sum(bool((evidence(rng.standard_normal(40)) >= 1.0 / level).any()) for _ in range(count))
    assert reached / count <= level + 3.0 * np.sqrt(level * (1.0 - level) / count)
    # A supermartingale: its mean after 8 sessions is at most one; the weights of all changes add up to one.
    last = np.array([evidence(rng.standard_normal(8))[-1] for _ in range(2000)])
    assert last.mean() <= 1.0 + 4.0 * last.std() / np.sqrt(len(last))
    assert 0.999 < prior_weight(np.arange(LIMIT.least_before, 100_000)).sum() < 1.0


NOISE = 0.2


def day(arm: ArmModel, seed: int, factor: float) -> Sequence[Motion]:
    """Three runs of a day on which friction is so many times what it usually is."""

    def law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        losses = 0.5 * ddq + factor * (4.0 * dq + 6.0 * np.tanh(dq / 1e-3))
        return arm.inverse_dynamics(q, dq, ddq) + losses + 0.3

    return made_motions(arm, law, [10 * seed, 10 * seed + 1, 10 * seed + 2], 10.0, noise=NOISE)


def days_of(arm: ArmModel, spread: float, count: int = 8) -> dict[str, Sequence[Motion]]:
    factors = np.exp(spread * np.random.default_rng(4).standard_normal(count))
    return {f"day_{k}": day(arm, k, float(factor)) for k, factor in enumerate(factors)}


def test_held_out_torque_lies_inside_and_the_ranges_are_narrower_than_the_habit(two_joints: ArmModel) -> None:
    found = find_ranges(days_of(two_joints, 0.04), two_joints)
    assert all(share >= 0.95 for share in found.inside.values())
    assert found.narrower > 2.0
    friction = found.ranges["joint_1", "coulomb"]
    assert friction.source == "days"
    assert friction.low < 6.0 < friction.high
    record = check_record(found.to_dict())
    assert record["ranges"]["joint_1/coulomb"]["unit"] == "N m"
    assert "narrower than ±30 %" in found.summary()


def test_an_arm_that_changes_more_gets_wider_ranges(two_joints: ArmModel) -> None:
    """And where nothing changes from day to day the parameter's own interval counts; one day has that alone."""
    widths = []
    for spread in (0.0, 0.03, 0.12):
        found = find_ranges(days_of(two_joints, spread, 5), two_joints)
        one = found.ranges["joint_2", "coulomb"]
        widths.append(one.high - one.low)
    assert widths == sorted(widths)
    assert widths[0] < 0.05 * 2 * HABIT * 6.0 * 4
    alone = find_ranges(days_of(two_joints, 0.04, 1), two_joints)
    assert {one.source for one in alone.ranges.values()} == {"interval"}
    assert not alone.inside
    assert alone.to_dict()["heldout"]["narrower_than_habit"] is None
    assert "not checked" in alone.summary()


def test_the_range_is_the_wider_of_interval_and_days() -> None:
    """Two days far apart make it wide by themselves; two days alike leave it to the interval."""

    def day(value: float) -> Estimates:
        return {("joint_1", "viscous"): ParameterEstimate(value, value - 1.0, value + 1.0, 0.5)}

    near, far = (pool_days([day(a), day(b)])["joint_1", "viscous"] for a, b in ((5.0, 5.0), (4.0, 6.0)))
    assert (near.low, near.high, near.source) == (4.0, 6.0, "interval")
    assert far.source == "days"
    assert far.high - far.value == pytest.approx(12.706 * np.sqrt(2.0) * np.sqrt(1.5), rel=1e-3)
    assert far.low == 0.0


def estimates_of(
    arm: ArmModel, gain: float = 1.0, viscous: float = 9.0, coulomb: float = 6.0
) -> dict[tuple[str, str], ParameterEstimate]:
    def law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        return gain * arm.inverse_dynamics(q, dq, ddq) + 0.4 * ddq + viscous * dq + coulomb * np.sign(dq) + 1.5

    return estimate_session(made_motions(arm, law, [1, 2], noise=0.5), arm)


def test_estimates_come_back_within_their_intervals(two_joints: ArmModel) -> None:
    """Joint 2 is moved by gravity: its gain too. Joint 1's axis is upright: there its inertia is the rotor's."""
    found = estimates_of(two_joints, gain=1.08)
    true = {"gain": 1.08, "rotor": 0.4, "viscous": 9.0, "coulomb": 6.0, "offset": 1.5}
    for name, value in true.items():
        one = found["joint_2", name]
        assert abs(one.value - value) < 4.0 * one.std, name
        assert one.low < one.value < one.high
    assert ("joint_1", "gain") not in found
    assert abs(found["joint_1", "viscous"].value - 9.0) < 4.0 * found["joint_1", "viscous"].std


def test_what_no_parameter_explains_is_the_gap(two_joints: ArmModel) -> None:
    """White noise of 0.5 N m, of which the filter lets a part through; friction does not change it."""
    first, second = estimates_of(two_joints)["joint_2", "gap"], estimates_of(two_joints, viscous=14.0)["joint_2", "gap"]
    assert 0.05 < first.value < 0.5
    assert first.value == pytest.approx(second.value, rel=1e-6)


def test_a_change_is_told_and_dated() -> None:
    """Five spreads after 20 sessions: beyond any level in use within ten sessions, dated to the session."""
    rng = np.random.default_rng(2)
    bets = EProcess()
    for value in [*rng.standard_normal(20), *(5.0 + rng.standard_normal(10))]:
        bets.add(float(value))
    assert bets.evidence > 1e4
    assert bets.before == 20


def test_one_odd_session_raises_no_alarm() -> None:
    """However far off, it multiplies the evidence by `LIMIT.most_growth` at most, and the next ones take that back."""
    rng = np.random.default_rng(3)
    values = rng.standard_normal(30)
    values[15] = 1e6
    found = evidence(values)
    assert found[15] <= LIMIT.most_growth * found[14] + 1.0
    assert found[-1] < LIMIT.most_growth
    assert evidence(np.full(10, 3.7)).max() <= 1.0  # no spread at all, as of a counter


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e3))
@settings(max_examples=20, deadline=None)
def test_neither_unit_nor_zero_matter(shift: float, scale: float) -> None:
    """Evidence depends on the maximal invariant alone: that is why no spread needs to be known."""
    values = np.random.default_rng(5).standard_normal(15)
    np.testing.assert_allclose(evidence(shift + scale * values), evidence(values), rtol=1e-4)
