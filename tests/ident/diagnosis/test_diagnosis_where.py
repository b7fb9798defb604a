"""Where the gap lies, and how far it shrinks: on stretches that no fit saw, effect by effect, in the motion itself."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.gap.gap_map import Place, map_gap, session_axes
from ident.diagnosis.gap.improvement import ONE_RUN, run_energy, shapley_shares, spread_of_runs, spreads
from ident.diagnosis.gap.place_ranking import ExcessError, ReportedCause, measure_excess_errors, rank_places
from ident.diagnosis.gap.replay import integrate, replay
from ident.diagnosis.gap.residuals import RunResidual
from ident.diagnosis.gap.settings import USUAL_MAP, USUAL_REPLAY
from ident.effects.catalogue import find_effect
from ident.regression.cross_validation import HeldOut
from ident.robot.arm import ArmModel
from ident.units import SLIDING, in_linear_units
from tests.ident.diagnosis.planted import (
    analyse,
    load_friction_on_2,
    spring_on_3,
)

JOINTS = ("joint_1", "joint_2", "joint_3")


def with_gap(analysis: Analysis, seed: int, axis: str, size: float = 2.0, ratio: float = 3.0) -> list[Place]:
    """The map of white noise of `size` levels, `ratio` times as strong in the lowest 30 % of an axis of joint 2."""
    rng = np.random.default_rng(seed)
    level = analysis.evidence.whitening.level
    pick = session_axes(analysis.series)[axis]
    low = np.quantile(np.concatenate([pick(item, 1)[item.valid[:, 1]] for item in analysis.series]), 0.3)

    def noisy(item: RunResidual) -> Array:
        left = size * level * rng.standard_normal(item.before.shape)
        left[:, 1] *= np.where(pick(item, 1) <= low, ratio, 1.0)
        return left

    series = [replace(item, before=noisy(item)) for item in analysis.series]
    return map_gap(series, JOINTS, analysis.evidence.whitening, np.random.default_rng(0))["before"]


def sure(places: list[Place]) -> set[tuple[str, str]]:
    """Joint and axis of the significant cells; frequency aside: white noise is not the recordings' noise."""
    return {(p.joint, p.axis) for p in places if p.p_value <= USUAL_MAP.significant and p.axis != "frequency"}


@pytest.mark.parametrize("axis", ["speed", "load", "pose"])
def test_a_gap_is_found_where_it_is(healthy: Analysis, axis: str) -> None:
    """Law: where the residual is thrice as large at an axis's low end, the lowest cell is significant and dense."""
    places = [p for p in with_gap(healthy, 1, axis) if p.axis == axis and p.joint == "joint_2"]
    (best,) = rank_places({"before": places}, {"joint_2": ExcessError(2.0)}, replace(USUAL_MAP, places_told=1))
    assert best == replace(places[0], beyond_noise_Nm=2.0)
    assert best.p_value <= USUAL_MAP.significant
    assert best.share_of_gap > 1.5 * best.share_of_time


def test_a_gap_that_is_everywhere_is_nowhere_dense(healthy: Analysis) -> None:
    """Law: of residuals that depend on nothing, at most one joint in twenty has a significant cell, whatever the axis.

    Of 3 joints × 10 seeds, five false joints have a probability below 2 %.
    """
    false = sum(len({joint for joint, _ in sure(with_gap(healthy, seed, "speed", ratio=1.0))}) for seed in range(10))
    assert false <= 4


def test_a_gap_of_few_samples_has_a_place(healthy: Analysis) -> None:
    """Law: a gap of twelve samples is on the map: else the joint of the largest gap had no place before others."""
    kept = 12 // len(healthy.series)

    def thinned(item: RunResidual) -> RunResidual:
        valid = item.valid & (np.cumsum(item.valid, axis=0) <= kept)
        return replace(item, valid=valid, before=np.full_like(item.before, 5.0 * healthy.evidence.whitening.level))

    series = [thinned(item) for item in healthy.series]
    places = map_gap(series, JOINTS, healthy.evidence.whitening, np.random.default_rng(0))["before"]
    assert {one.joint for one in places} == set(JOINTS)


def place(joint: str, axis: str, gap: float, time: float, low: float = 0.0, p_value: float = 0.001) -> Place:
    return Place(joint, axis, low, low + 1.0, gap, time, None, p_value)


def test_joints_rank_by_error_beyond_noise_and_none_without_a_gap() -> None:
    """Law: joints rank by their error beyond noise; hidden torque adds as squares do, up to the larger error.

    A torque that is wrong by a factor comes first, for all sizes there are wrong with it.
    """
    errors = {"before": np.array([2.0, 1.05, 5.0]), "fixed": np.array([2.5, 4.0, 9.0])}
    noise, none = np.ones(3), np.zeros(3)

    def rank(*names: ReportedCause, away: Array = none) -> dict[str, ExcessError]:
        return measure_excess_errors(JOINTS, errors, away, noise, names, threshold=1.15)

    assert list(rank()) == ["joint_3", "joint_1"]
    assert rank()["joint_3"].torque == pytest.approx(np.sqrt(24.0))
    own = ReportedCause(("joint_1",), {"joint_1": 0.0})
    assert list(rank(own)) == ["joint_3", "joint_1"]
    hidden = rank(ReportedCause(("joint_2",), {"joint_2": np.inf, "joint_3": 1.0}))
    assert list(hidden) == ["joint_3", "joint_2", "joint_1"]
    assert hidden["joint_2"] == ExcessError(pytest.approx(np.sqrt(15.0)), "fixed")
    assert hidden["joint_3"] == ExcessError(pytest.approx(5.0), "before")
    both = ReportedCause(("joint_1",), {"joint_1": 9.0, "joint_2": 9.0})
    assert list(rank(both)) == ["joint_3", "joint_2", "joint_1"]
    off = ReportedCause(("joint_1", "joint_2"), {"joint_1": np.inf, "joint_2": np.inf}, is_factor=True)
    assert list(rank(off)) == ["joint_2", "joint_1", "joint_3"]
    away = rank(away=np.array([0.0, 2.0, 0.5]))
    assert away["joint_2"] == ExcessError(pytest.approx(np.sqrt(1.05**2 + 3.0)), "fixed")
    assert away["joint_3"] == rank()["joint_3"]
    errors["fixed"][2] = 1.1
    assert list(rank()) == ["joint_1"]
    assert rank(own, ReportedCause(("joint_3",), {"joint_3": 0.0}))["joint_3"].view == "fixed"


def test_a_cell_that_is_no_denser_than_its_time_is_no_place() -> None:
    """Law: cells are denser in gap than in time, the slowest frequencies are none, and each axis has one at most."""
    cells = [
        place("joint_1", "frequency", 0.9, 0.3),
        place("joint_1", "speed", 0.22, 0.2),
        place("joint_1", "load", 0.5, 0.2),
        place("joint_1", "load", 0.3, 0.2, low=1.0),
        place("joint_1", "pose", 0.9, 0.2, p_value=0.4),
        place("joint_2", "speed", 0.4, 0.2),
        place("joint_3", "frequency", 0.9, 0.3),
        place("joint_3", "time", 0.24, 0.2, p_value=0.7),
        place("joint_3", "time", 0.16, 0.2, low=1.0),
    ]
    ranked = rank_places({"before": cells}, {"joint_3": ExcessError(3.0), "joint_1": ExcessError(1.0)})
    assert [(p.joint, p.axis, p.share_of_gap) for p in ranked] == [("joint_3", "time", 0.24), ("joint_1", "load", 0.5)]
    assert [p.beyond_noise_Nm for p in ranked] == [3.0, 1.0]


FEW = tuple(find_effect(name) for name in ("spring_torque", "load_dependent_friction"))


def both(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """Two effects, at joints 2 and 3."""
    return spring_on_3(arm, q, dq, ddq) + load_friction_on_2(arm, q, dq, ddq)


@pytest.fixture(scope="module")
def pair(short_arm: ArmModel) -> Analysis:
    return analyse(short_arm, both, FEW)


@pytest.fixture(scope="module")
def held_out(pair: Analysis) -> HeldOut:
    return pair.conclusion.held_out


def test_unseen_residuals_have_the_held_out_rms(pair: Analysis, held_out: HeldOut) -> None:
    """Law: the series of held-out residuals and the sums of the held-out score are the same numbers."""
    for name, groups in (("unseen_before", []), ("unseen_after", pair.conclusion.groups)):
        left = [np.where(item.valid, getattr(item, name), 0.0) for item in pair.series]
        count = np.sum([item.valid.sum(axis=0) for item in pair.series], axis=0)
        rms = np.sqrt(np.sum([np.sum(part**2, axis=0) for part in left], axis=0) / count)
        np.testing.assert_allclose(rms, held_out.score(groups).rms, rtol=1e-9)


def test_shares_add_up_to_what_all_close(pair: Analysis, held_out: HeldOut) -> None:
    """Law (Shapley): shares sum to the joint share whatever the order of the names, and each keeps its own; of more
    effects than all orders are taken of, too, from any seed.
    """
    groups = pair.conclusion.groups
    assert len(groups) == 2
    floors = 0.5 * held_out.score(groups).rms
    start, end = held_out.score().rms ** 2, held_out.score(groups).rms ** 2
    shares = shapley_shares(held_out, groups, floors, 0)
    assert shares.sum() == pytest.approx(np.sum(start - end) / np.sum(start - floors**2), rel=1e-9)
    np.testing.assert_allclose(shapley_shares(held_out, groups[::-1], floors, 0)[::-1], shares, rtol=1e-9)
    end = held_out.score(3 * groups).rms ** 2
    for seed in (0, 1):
        shares = shapley_shares(held_out, 3 * groups, np.zeros(3), seed)
        assert shares.sum() == pytest.approx(np.sum(start - end) / np.sum(start), rel=1e-9)


def test_the_record_tells_shares_and_the_motion(pair: Analysis) -> None:
    """Bound: both effects' shares are told and sum to what they close together; where an effect acts the replayed
    motion comes nearer, and a discrepancy in the names' place does no better than they.
    """
    record = pair.diagnosis.to_dict()
    assert sum(finding["heldout"]["share"] for finding in record["findings"]) == pytest.approx(
        record["heldout"]["shrink"], abs=0.02
    )
    forward = record["heldout"]["forward"]
    before, after = (forward["position_rms_rad"][key] for key in ("before", "after"))
    for joint in ("joint_2", "joint_3"):
        assert after[joint] < 0.6 * before[joint]
        assert record["heldout"]["rms_after_Nm"][joint] < record["heldout"]["rms_before_Nm"][joint]


def test_an_exact_model_departs_by_its_noise_only(healthy: Analysis) -> None:
    """Law: a model without a gap moves as the recording, but for what 0.3 N m of noise moves: half a milliradian or so;
    without names nothing changes.
    """
    found = replay(healthy.series, healthy.baseline)
    assert found.windows.min() >= 10
    assert found.before.max() < 2.5e-3
    np.testing.assert_array_equal(found.before, found.after)
    assert found.to_dict(("a", "b", "c"))["window_s"] == USUAL_REPLAY.window_s


def test_a_constant_force_on_a_mass() -> None:
    """Law: one joint of mass m under force f departs by f t² / 2 m; a joint that is led stays, and so does its pull."""
    shape = (2, 11)
    mass = np.broadcast_to(np.array([[2.0, 0.5], [0.5, 1.0]]), (*shape, 2, 2))
    zero = np.zeros((*shape, 2, 2))
    force = np.ones((*shape, 2, 1))
    free = np.array([[True, False], [True, True]])
    end = integrate(mass, zero, zero, force, free, 0.02)[:, :, 0]
    np.testing.assert_allclose(end[0], [0.2**2 / 2 / 2.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(end[1], np.linalg.solve(mass[0, 0], [1.0, 1.0]) * 0.2**2 / 2, rtol=1e-9)


def test_a_single_run_has_no_spread_and_the_record_says_why() -> None:
    """Zero would read as: all runs err alike."""
    one, several = np.array([[1.0, -2.0]]), np.array([[1.0, -2.0], [3.0, -2.0]])
    assert spread_of_runs(one) is None
    np.testing.assert_allclose(spread_of_runs(several), [1.0, 0.0])
    assert spreads(None, None)["energy_error_std_missing"] == ONE_RUN
    assert spreads(0.0, 1.0) == {"energy_error_before_std_J": 0.0, "energy_error_after_std_J": 1.0}


@pytest.mark.parametrize(("turning", "sliding"), list(SLIDING.items()))
def test_every_unit_of_a_turning_joint_has_one_of_a_sliding_joint(turning: str, sliding: str) -> None:
    assert in_linear_units(f"it takes 3 {turning} (1 to 5 {turning})") == f"it takes 3 {sliding} (1 to 5 {sliding})"


def test_a_curved_law_of_a_slide_is_a_force_over_a_speed_in_metres() -> None:
    told = in_linear_units("at 0.5 rad/s 2.1 N m [1, 3] more than on the straight line from rest to 1 rad/s")
    assert told == "at 0.5 m/s 2.1 N [1, 3] more than on the straight line from rest to 1 m/s"


def test_first_order_replay_is_the_nonlinear_one(short_arm: ArmModel) -> None:
    """Law: for a departure of 30 mrad in a quarter of a second it is that of the nonlinear simulation within 3 %."""
    step, count = 0.002, 126
    state, missing = np.array([0.3, -0.5, 0.9, 0.8, -0.6, 1.1]), np.array([0.3, -0.3, 0.3])

    def accelerate(q: Array, dq: Array, tau: Array) -> Array:
        one = [part[None] for part in (q, dq, np.zeros(3))]
        return np.linalg.solve(short_arm.derivatives(*one)[2][0], tau - short_arm.inverse_dynamics(*one)[0])

    def simulate(extra: Array) -> tuple[Array, Array, Array]:
        """Runge and Kutta's rule under the torque that holds the arm at the start, plus `extra`."""
        start = np.concatenate([state])
        hold = short_arm.gravity(start[None, :3])[0]

        def slope(x: Array) -> Array:
            return np.concatenate([x[3:], accelerate(x[:3], x[3:], hold + extra)])

        path = [start]
        for _ in range(count - 1):
            x = path[-1]
            a = slope(x)
            b = slope(x + step / 2 * a)
            c = slope(x + step / 2 * b)
            path.append(x + step / 6 * (a + 2 * b + 2 * c + slope(x + step * c)))
        whole = np.array(path)
        return whole[:, :3], whole[:, 3:], np.array([slope(x)[3:] for x in path])

    recorded, replayed = simulate(np.zeros(3)), simulate(missing)
    stiffness, damping, mass = (part[None] for part in short_arm.derivatives(*recorded))
    force = np.broadcast_to(missing[:, None], (1, count, 3, 1))
    found = integrate(mass, damping, stiffness, force, np.ones((1, 3), dtype=bool), step)[0, :, 0]
    exact = replayed[0][-1] - recorded[0][-1]
    np.testing.assert_allclose(found, exact, atol=0.03 * np.abs(exact).max())


def _stretches(counts: Array) -> list[Array]:
    pieces = itertools.groupby(np.flatnonzero(counts), key=lambda at: at - int(np.sum(counts[:at])))
    return [np.array(list(group)) for _, group in pieces]


def test_energy_error_is_minus_the_work_of_what_is_left(pair: Analysis) -> None:
    """Law: a residual of 1 N m on a joint that turns by Δq leaves −Δq J, over what counts."""
    item = pair.series[0]
    work = run_energy(item, np.ones_like(item.before))
    moved = [
        sum(float(np.trapezoid(item.speed[part, j], dx=item.step)) for part in _stretches(item.valid[:, j]))
        for j in range(3)
    ]
    np.testing.assert_allclose(work, -np.array(moved), atol=0.15)


def test_a_right_urdf_needs_no_tuning(healthy: Analysis) -> None:
    """Law: where the URDF is the truth, holding it fast leaves what tuning it leaves."""
    for gap in healthy.diagnosis.to_dict()["gap"].values():
        assert gap["fixed_rms_Nm"] == pytest.approx(gap["rms_Nm"], rel=0.03)
