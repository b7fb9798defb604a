"""Coupling, ripple and springs: torques written out here are found again, and what can't show says why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from smooth_motion import Recover, edit_runs

from ident.effects.base import RunContext, SessionContext
from ident.effects.catalogue import find_effect
from ident.effects.transmission import BENT
from ident.effects.typical_sizes import joint_range, travel


def test_coupling_is_found_with_the_other_joint(session: SessionContext, recover: Recover) -> None:
    """Friction and inertia of joint 5 that joint 4 feels."""
    torque = [
        0.6 * run.direction[:, 4] + 0.9 * run.motion.dq[:, 4] + 0.05 * run.motion.ddq[:, 4] for run in session.runs
    ]
    found = recover(find_effect("joint_coupling"), session, 3, torque)
    assert found["other_joint"].value == 5.0
    for name, value in {"coulomb_Nm": 0.6, "viscous_Nms_rad": 0.9, "inertia_kgm2": 0.05}.items():
        assert found[name].low < value < found[name].high
        np.testing.assert_allclose(found[name].value, value, rtol=0.02)


def test_friction_of_a_sum_is_told_from_friction_of_one(session: SessionContext, recover: Recover) -> None:
    """A gear that turns with the sum of two neighbours rubs by the sum's direction."""
    torque = [0.8 * np.tanh((run.motion.dq[:, 4] + run.motion.dq[:, 5]) / 0.01) for run in session.runs]
    found = recover(find_effect("joint_coupling"), session, 5, torque)
    assert found["other_joint"].value == 5.0
    np.testing.assert_allclose(found["coulomb_Nm"].value, 0.8, rtol=0.02)


@pytest.mark.parametrize("mix", [1.0, -1.0])
def test_friction_of_a_sum_is_none_where_the_sum_stands_still(session: SessionContext, mix: float) -> None:
    """Law: whatever each of two joints does, what rubs with their sum (difference) feels that alone."""

    def against(run: RunContext) -> RunContext:
        dq = run.motion.dq.copy()
        dq[:, 5] = -mix * dq[:, 4]
        return replace(run, motion=replace(run.motion, dq=dq))

    effect = find_effect("joint_coupling")
    variant = next(one for one in effect.variants(session, 5) if one.other == 4 and one.shape["mix"] == mix)
    for columns in effect.columns(edit_runs(session, against), 5, variant):
        np.testing.assert_allclose(columns, 0.0, atol=1e-12)


def test_a_joint_feels_nothing_of_one_that_stands_or_moves_with_it(session: SessionContext) -> None:
    """Neither is a candidate; with no candidate left the coupling can't be tested."""

    def together(run: RunContext) -> RunContext:
        dq, q = np.zeros_like(run.motion.dq), np.zeros_like(run.motion.q)
        dq[:, :2], q[:, :2] = run.motion.dq[:, :1], run.motion.q[:, :1]
        return replace(run, motion=replace(run.motion, q=q, dq=dq))

    effect, tied = find_effect("joint_coupling"), edit_runs(session, together)
    assert "move only together with joint_1" in str(effect.untestable(tied, 0))
    assert {variant.other for variant in effect.variants(tied, 4)} == {0, 1}


def test_ripple_is_found_with_order_and_phase(session: SessionContext, recover: Recover) -> None:
    """1.2 N m twice a turn of a motor behind a gear of 1:100, highest at a phase of 0.7 rad."""
    torque = [1.2 * np.cos(200 * run.motion.q[:, 2] - 0.7) for run in session.runs]
    found = recover(find_effect("torque_ripple"), session, 2, torque)
    assert found["order"].value == 2.0
    np.testing.assert_allclose(found["amplitude_Nm"].value, 1.2, rtol=0.01)
    np.testing.assert_allclose(found["phase_rad"].value, 0.7, atol=0.01)


def test_ripple_of_the_load_is_told_at_typical_load(session: SessionContext, recover: Recover) -> None:
    """Two per cent of the load, whatever its sign."""
    load = np.concatenate([run.link[:, 1] for run in session.runs])
    torque = [0.02 * run.link[:, 1] * np.sin(100 * run.motion.q[:, 1]) for run in session.runs]
    found = recover(find_effect("torque_ripple"), session, 1, torque)
    np.testing.assert_allclose(found["amplitude_Nm"].value, 0.02 * np.sqrt(np.mean(load**2)), rtol=0.01)
    np.testing.assert_allclose(found["phase_rad"].value, np.pi / 2, atol=0.01)


@pytest.mark.parametrize("turns", [37.3, 161.0])
def test_ripple_of_an_unknown_gear_is_found_over_the_angle(
    session: SessionContext, recover: Recover, turns: float
) -> None:
    """Law: 0.6 N m of ripple beside 1 N m of noise stands out at its cycles a turn, once refined to a tenth of what the

    joint's travel tells apart; noise alone shows no line.
    """
    effect, unknown, rng = find_effect("torque_ripple"), replace(session, gear_ratios=None), np.random.default_rng(0)
    assert not effect.variants(unknown, 2)
    noise = [rng.normal(size=(run.motion.filtered_length, 6)) for run in session.runs]
    ripple = [0.6 * np.cos(turns * run.motion.q[:, 2] - 0.7) for run in session.runs]
    left = [one.copy() for one in noise]
    for run, values, torque in zip(session.runs, left, ripple, strict=True):
        values[:, 2] += run.motion.filtered(torque)
    assert not any(effect.screened(unknown, noise).lines)
    lines = [effect.screened(unknown, left).lines[j] for j in range(6)]
    assert [len(one) for one in lines] == [0, 0, 1, 0, 0, 0]
    low = min(run.motion.q[:, 2].min() for run in session.runs)
    high = max(run.motion.q[:, 2].max() for run in session.runs)
    screened = effect.screened(unknown, left)
    finer = screened.refined(unknown, 2, screened.variants(unknown, 2)[0])
    nearest = min(abs(one.inner["order"] - turns) for one in finer)
    assert nearest < 0.1 * 2 * np.pi / (high - low)
    found = recover(screened, unknown, 2, ripple)
    np.testing.assert_allclose(found["amplitude_Nm"].value, 0.6, rtol=0.15)


def test_a_reduction_of_one_is_no_gear(session: SessionContext) -> None:
    """Law: URDFs hold a reduction of one where nobody knew it; a wave a turn of the joint is a law of position."""
    effect = find_effect("torque_ripple")
    assert effect.variants(session, 2)
    assert not effect.variants(replace(session, gear_ratios=np.ones(6)), 2)


def test_ripple_needs_slow_motion(session: SessionContext) -> None:
    """Fast motion lifts the line above the filter's corner."""
    effect = find_effect("torque_ripple")

    def fast(run: RunContext) -> RunContext:
        return replace(run, motion=replace(run.motion, dq=3.0 + np.abs(run.motion.dq)))

    assert "never slow enough" in str(effect.untestable(edit_runs(session, fast), 0))


def test_a_spring_is_found_with_its_rest(session: SessionContext, recover: Recover) -> None:
    """5 N m/rad about 0.3 rad."""
    torque = [5.0 * (run.motion.q[:, 0] - 0.3) for run in session.runs]
    found = recover(find_effect("spring_torque"), session, 0, torque)
    assert found["stiffness_Nm_rad"].low < 5.0 < found["stiffness_Nm_rad"].high
    assert found["rest_rad"].low < 0.3 < found["rest_rad"].high


def test_a_spring_with_two_rests_a_turn_has_the_same_stiffness(session: SessionContext, recover: Recover) -> None:
    """k sin(2 (q − q₀)) / 2 has the slope k at its rest."""
    torque = [2.5 * np.sin(2 * (run.motion.q[:, 0] - 0.3)) for run in session.runs]
    found = recover(find_effect("spring_torque"), session, 0, torque)
    assert found["stiffness_Nm_rad"].low < 5.0 < found["stiffness_Nm_rad"].high
    assert found["rest_rad"].low < 0.3 < found["rest_rad"].high


def test_a_bent_spring_that_rests_out_of_reach_pulls_though_its_stiffness_there_is_unsure(
    session: SessionContext,
) -> None:
    """Law: of a cubic without a zero within a range's width the rest is told up to as far as the joint could be turned,
    the stiffness there not below zero by more than rounding; one that has a zero is told as before.
    """
    effect = find_effect("spring_torque")
    bent = next(one for one in effect.variants(session, 1) if one.shape["law"] == BENT)
    cells = np.diag([0.03, 0.03, 0.07, 0.3]) ** 2
    outside = effect.parameters(session, 1, bent, np.array([1.5, -40.0, 0.0, 0.1]), cells)
    assert outside["stiffness_Nm_rad"].low == 0.0
    low, high = joint_range(session, 1, travel(session, 1))
    assert outside["rest_rad"].high == pytest.approx(high + np.pi)
    assert outside["rest_rad"].low > low - np.pi
    inside = effect.parameters(session, 1, bent, np.array([1.5, -0.3, 0.0, 0.0]), cells)
    assert inside["rest_rad"].high - inside["rest_rad"].low < 0.2
