"""Effects of sensors and of their clock: drift, delays, limits and zeros are found again with their parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from smooth_motion import Recover, edit_runs, make_session

from ident.effects.base import RunContext, SessionContext, Variant
from ident.effects.catalogue import find_effect
from ident.effects.sensing import share_of_steps
from ident.laws.acting import shifted
from ident.robot.arm import ArmModel


def test_without_a_clock_there_is_no_drift(session: SessionContext) -> None:
    """One column, the constant."""
    effect, torn = find_effect("torque_offset"), replace(session, common_clock=False)
    variant = effect.variants(torn, 0)[0]
    np.testing.assert_array_equal(effect.columns(torn, 0, variant)[0], np.ones((len(torn.runs[0].motion.time), 1)))
    assert effect.parameters(torn, 0, variant, np.array([0.2]), np.eye(1))["drift_Nm_s"].value == 0.0


@pytest.mark.parametrize("delay", [0.001, 0.005, 0.013, 0.025])
def test_a_delay_is_found_on_and_off_the_grid(arm: ArmModel, recover: Recover, delay: float) -> None:
    """The torque of the same motion, computed late instead of shifted: the figure is within 3 %."""
    session, late = make_session(arm, 10.0, 2), make_session(arm, 10.0, 2, late=delay)
    torque = [b.total - a.total for a, b in zip(session.runs, late.runs, strict=True)]
    found = recover(find_effect("torque_delay"), session, 0, torque)["delay_s"]
    np.testing.assert_allclose(found.value, delay, rtol=0.03)


def test_a_secant_stands_for_what_is_near_it() -> None:
    """A coefficient of a third of a millisecond is no delay of 20 ms, whatever that point of the grid explains."""
    delay, shift = find_effect("torque_delay"), find_effect("encoder_offset")
    points = {ms: Variant(shape={"delay_s": 1e-3 * ms}) for ms in (2, 8, 20)}
    for true in (3.5e-4, 2e-3, 4.5e-3, 12e-3, 30e-3):
        assert any(delay.stands_for(point, np.array([true])) for point in points.values())
    assert not delay.stands_for(points[20], np.array([3.5e-4]))
    assert not delay.stands_for(points[2], np.array([12e-3]))
    secant = Variant(shape={"about_rad": -0.25})
    assert shift.stands_for(secant, np.array([-0.3]))
    assert not shift.stands_for(secant, np.array([0.3]))


def test_torque_that_steps_leaves_a_delay_open_by_half_an_interval(session: SessionContext) -> None:
    """Smooth torque does not: what it is late by is known below the log's interval."""

    def in_steps(run: RunContext) -> RunContext:
        held = 25 * (np.arange(len(run.rigid)) // 25)
        return replace(slow(run), rigid=run.rigid[held])

    def slow(run: RunContext) -> RunContext:
        still = np.zeros_like(run.rigid)
        return replace(run, friction=still, rotor=still, motion=replace(run.motion, log_interval=0.02))

    effect, point = find_effect("torque_delay"), Variant(shape={"delay_s": 0.008})
    smooth, stepped = edit_runs(session, slow), edit_runs(session, in_steps)
    assert share_of_steps(smooth) < 0.2 < 0.4 < share_of_steps(stepped) <= 1.0
    for one in (smooth, stepped):
        told = effect.parameters(one, 0, point, np.array([0.006]), np.zeros((1, 1)))["delay_s"]
        assert told.high - told.value == pytest.approx(0.01 * share_of_steps(one))


def test_a_shift_by_whole_samples_is_exact_and_by_parts_is_cubic() -> None:
    """Three samples late is the value three samples ago; a cubic is shifted by any part exactly."""
    t = np.arange(40.0)
    values = np.stack([np.sin(t), 1 + t - 0.1 * t**2 + 0.01 * t**3], axis=1)
    np.testing.assert_allclose(shifted(values, 3.0, 1.0)[3:], values[:-3])
    late = t - 2.3
    np.testing.assert_allclose(shifted(values, 2.3, 1.0)[5:, 1], (1 + late - 0.1 * late**2 + 0.01 * late**3)[5:])


def test_flat_tops_are_found_with_their_limit(session: SessionContext, recover: Recover) -> None:
    """Torque clipped at 80 % of its largest is found there; below the limit nothing is said."""
    effect = find_effect("torque_saturation")
    whole = np.concatenate([run.total[:, 1] for run in session.runs])
    limit = 0.8 * np.quantile(np.abs(whole), 0.999)
    torque = [np.clip(run.total[:, 1], -limit, limit) - run.total[:, 1] for run in session.runs]
    found = recover(effect, session, 1, torque)["limit_Nm"]
    np.testing.assert_allclose(found.value, limit, rtol=1e-3)
    assert found.low < limit < found.high
    variant = effect.variants(session, 1)[0]
    run = session.runs[0]
    low = np.abs(run.total[:, 1]) < variant.shape["knee_Nm"]
    assert not effect.columns(session, 1, variant)[0][low].any()
    assert np.all(effect.columns(session, 1, variant)[0][:, 0] * run.total[:, 1] <= 0.0)


@pytest.mark.parametrize("shift", [0.3, -0.45])
def test_a_zero_that_is_far_off_is_found_by_its_secant(session: SessionContext, shift: float) -> None:
    """Law: the columns about an offset, times the offset, are the torque that it makes; the slope leaves 4 % of it

    or more. Both signs and offsets up to half a radian are among the points of the finer grid, within a fifth.
    """
    effect, joint = find_effect("encoder_offset"), 1
    exact = [
        run.arm.inverse_dynamics(run.motion.q + shift * np.eye(6)[joint], run.motion.dq, run.motion.ddq) - run.rigid
        for run in session.runs
    ]
    grid = effect.refined(session, joint, effect.variants(session, joint)[0])
    nearest = min((one.shape["about_rad"] for one in grid), key=lambda about: abs(about - shift))
    assert abs(nearest - shift) < 0.2 * abs(shift)
    secant = effect.columns(session, joint, Variant(shape={"about_rad": shift}))
    slope = effect.columns(session, joint, Variant(shape={"about_rad": 0.0}))
    for column, straight, torque in zip(secant, slope, exact, strict=True):
        np.testing.assert_allclose(shift * column[:, :, 0], torque, atol=1e-9)
        left = torque - shift * straight[:, :, 0]
        assert np.sqrt(np.mean(left**2)) > 0.04 * np.sqrt(np.mean(torque**2))
