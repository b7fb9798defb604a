"""How far the gap shrinks: on stretches that no fit saw, effect by effect, and in the motion itself."""

from __future__ import annotations

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.gap.improvement import ONE_RUN, spread_of_runs, spreads
from ident.diagnosis.gap.replay import integrate, replay
from ident.diagnosis.gap.settings import USUAL_REPLAY
from ident.diagnosis.gap.shapley import shapley_shares
from ident.diagnosis.heldout_gain import OF_A_SLIDE, of_a_slide
from ident.diagnosis.regression.cross_validation import HeldOut
from ident.effects.catalogue import find_effect
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import (
    analyse,
    load_friction_on_2,
    named_groups,
    search_of,
    spring_on_3,
)

FEW = tuple(find_effect(name) for name in ("spring_torque", "load_dependent_friction"))


def both(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """Two effects, at joints 2 and 3."""
    return spring_on_3(arm, q, dq, ddq) + load_friction_on_2(arm, q, dq, ddq)


@pytest.fixture(scope="module")
def pair(short_arm: ArmModel) -> Analysis:
    return analyse(short_arm, both, FEW)


@pytest.fixture(scope="module")
def held_out(pair: Analysis) -> HeldOut:
    return search_of(pair).held_out


def test_unseen_residuals_have_the_held_out_rms(pair: Analysis, held_out: HeldOut) -> None:
    """Law: the series of held-out residuals and the sums of the held-out score are the same numbers."""
    for name, groups in (("unseen_before", []), ("unseen_after", named_groups(pair))):
        left = [np.where(item.counts, getattr(item, name), 0.0) for item in pair.series]
        count = np.sum([item.counts.sum(axis=0) for item in pair.series], axis=0)
        rms = np.sqrt(np.sum([np.sum(part**2, axis=0) for part in left], axis=0) / count)
        np.testing.assert_allclose(rms, held_out.score(groups).rms, rtol=1e-9)


def test_shares_add_up_to_what_all_close(pair: Analysis, held_out: HeldOut) -> None:
    """Law (Shapley): shares sum to the joint share whatever the order of the names, and each keeps its own."""
    groups = named_groups(pair)
    assert len(groups) == 2
    floors = 0.5 * held_out.score(groups).rms
    start, end = held_out.score().rms ** 2, held_out.score(groups).rms ** 2
    shares = shapley_shares(held_out, groups, floors, 0)
    assert shares.sum() == pytest.approx(np.sum(start - end) / np.sum(start - floors**2), rel=1e-9)
    np.testing.assert_allclose(shapley_shares(held_out, groups[::-1], floors, 0)[::-1], shares, rtol=1e-9)


def test_shares_of_many_add_up_whatever_orders_are_drawn(pair: Analysis, held_out: HeldOut) -> None:
    """Law: of more effects than all orders are taken of, shares still sum to what all close, from any seed."""
    groups = 3 * named_groups(pair)
    start, end = held_out.score().rms ** 2, held_out.score(groups).rms ** 2
    for seed in (0, 1):
        shares = shapley_shares(held_out, groups, np.zeros(3), seed)
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
        assert record["heldout"]["rms_after_Nm"][joint] <= record["heldout"]["without_names_rms_Nm"][joint]
        assert record["heldout"]["without_names_rms_Nm"][joint] < record["heldout"]["rms_before_Nm"][joint]


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


@pytest.mark.parametrize(("turning", "sliding"), list(OF_A_SLIDE.items()))
def test_every_unit_of_a_turning_joint_has_one_of_a_sliding_joint(turning: str, sliding: str) -> None:
    assert of_a_slide(f"it takes 3 {turning} (1 to 5 {turning})") == f"it takes 3 {sliding} (1 to 5 {sliding})"


def test_a_curved_law_of_a_slide_is_a_force_over_a_speed_in_metres() -> None:
    told = of_a_slide("at 0.5 rad/s 2.1 N m [1, 3] more than on the straight line from rest to 1 rad/s")
    assert told == "at 0.5 m/s 2.1 N [1, 3] more than on the straight line from rest to 1 m/s"
