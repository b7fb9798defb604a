"""Friction: torques written out here are found again, and what can't show says why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from smooth_motion import COULOMB, VISCOUS, Recover, edit_runs, make_session

from ident.effects.base import RunContext, SessionContext, Variant
from ident.effects.catalogue import find_effect
from ident.robot.arm import ArmModel


def test_stribeck_friction_is_found_with_its_speed(session: SessionContext, recover: Recover) -> None:
    """3 N m that fade over 25 mrad/s come back; fast motion has none of it."""
    effect = find_effect("stribeck_friction")
    torque = [
        3.0 * np.tanh(run.motion.dq[:, 0] / 0.01) * np.exp(-((run.motion.dq[:, 0] / 0.025) ** 2))
        for run in session.runs
    ]
    found = recover(effect, session, 0, torque)
    assert found["amplitude_Nm"].low < 3.0 < found["amplitude_Nm"].high
    assert found["stribeck_velocity_rad_s"].value == 0.025
    assert found["exponent"].value == 2.0
    run = session.runs[0]
    fast = np.abs(run.motion.dq[:, 0]) > 1.0
    for variant in effect.variants(session, 0):
        assert np.all(np.abs(effect.columns(session, 0, variant)[0][fast]) < 2e-3)


def test_a_speed_between_two_points_of_the_grid_lies_in_the_interval(session: SessionContext, recover: Recover) -> None:
    """The grid owns what it can't resolve."""
    torque = [
        2.0 * np.tanh(run.motion.dq[:, 2] / 0.01) * np.exp(-np.abs(run.motion.dq[:, 2] / 0.04)) for run in session.runs
    ]
    found = recover(find_effect("stribeck_friction"), session, 2, torque)["stribeck_velocity_rad_s"]
    assert found.low < 0.04 < found.high


def test_a_curve_over_speed_is_found_with_its_exponent(session: SessionContext, recover: Recover) -> None:
    """A square-root law and a square law are told from each other."""
    effect = find_effect("nonlinear_viscous_friction")
    for exponent in (0.5, 2.0):
        torque = [
            np.tanh(run.motion.dq[:, 1] / 0.01) * 4.0 * np.abs(run.motion.dq[:, 1]) ** exponent for run in session.runs
        ]
        found = recover(effect, session, 1, torque)
        assert found["coefficient"].low < 4.0 < found["coefficient"].high
        assert found["exponent"].value == exponent


def test_load_friction_is_found_where_driving_and_backdriving_differ(session: SessionContext, recover: Recover) -> None:
    """μ is the mean of the two; both coefficients are positive while the two are within a factor of two."""
    effect = find_effect("load_dependent_friction")
    torque = []
    for run in session.runs:
        load, slip = run.link[:, 1], np.tanh(run.motion.dq[:, 1] / 0.01)
        level = np.where(load * run.motion.dq[:, 1] > 0, 0.08, 0.05)
        torque.append(level * slip * np.abs(load))
    found = recover(effect, session, 1, torque)["mu"]
    np.testing.assert_allclose(found.value, 0.065, rtol=0.03)


def test_a_gain_error_is_no_load_friction(session: SessionContext) -> None:
    """With coefficients that aren't negative, torque that scales with the load leaves most of itself unexplained."""
    from scipy.optimize import nnls

    effect = find_effect("load_dependent_friction")
    columns = np.concatenate(effect.columns(session, 1, effect.variants(session, 1)[0]))
    load = np.concatenate([run.link[:, 1] for run in session.runs])
    _, left = nnls(columns, load)
    assert left > 0.9 * np.linalg.norm(load)


def test_the_load_is_the_modelled_one(session: SessionContext) -> None:
    """Measured torque changes nothing: it is what is to be explained."""
    effect = find_effect("load_dependent_friction")

    def louder(run: RunContext) -> RunContext:
        return replace(run, motion=replace(run.motion, tau=run.motion.tau + 100.0))

    variant = effect.variants(session, 1)[1]
    for a, b in zip(
        effect.columns(session, 1, variant), effect.columns(edit_runs(session, louder), 1, variant), strict=True
    ):
        np.testing.assert_array_equal(a, b)


def test_position_dependent_friction_is_found_with_its_phase(session: SessionContext, recover: Recover) -> None:
    """1.5 N m twice a turn, highest at 0.4 rad."""
    torque = [1.5 * run.direction[:, 3] * np.cos(2 * (run.motion.q[:, 3] - 0.4)) for run in session.runs]
    found = recover(find_effect("position_dependent_friction"), session, 3, torque)
    assert found["order"].value == 2.0
    assert found["amplitude_Nm"].low < 1.5 < found["amplitude_Nm"].high
    assert found["phase_rad"].low < 0.8 < found["phase_rad"].high


def test_asymmetry_is_the_difference_of_the_two_directions(session: SessionContext, recover: Recover) -> None:
    """Friction of (9, 7) N m and (11, 9) N m s/rad, less its mean, is told as differences of 2 and 2."""
    torque = []
    for run in session.runs:
        v, slip = run.motion.dq[:, 0], np.tanh(run.motion.dq[:, 0] / 0.01)
        forward = (9.0 * slip + 11.0 * v) * (v > 0) + (7.0 * slip + 9.0 * v) * (v <= 0)
        torque.append(forward - 8.0 * slip - 10.0 * v)
    found = recover(find_effect("asymmetric_friction"), session, 0, torque)
    np.testing.assert_allclose(found["coulomb_difference_Nm"].value, 2.0, rtol=0.02)
    np.testing.assert_allclose(found["viscous_difference_Nms_rad"].value, 2.0, rtol=0.02)


def test_one_direction_shows_no_asymmetry(session: SessionContext) -> None:
    """A joint that only goes forward has nothing to compare with."""

    def forward(run: RunContext) -> RunContext:
        return replace(run, motion=replace(run.motion, dq=np.abs(run.motion.dq)))

    reason = find_effect("asymmetric_friction").untestable(edit_runs(session, forward), 0)
    assert reason == "joint_1 moves in one direction only"


def test_a_narrow_range_shows_no_position_dependence(arm: ArmModel) -> None:
    """Less than half a radian is a line, not a wave."""
    narrow = make_session(arm, seconds=5.0, runs=1, size=0.1)
    assert "covers" in str(find_effect("position_dependent_friction").untestable(narrow, 0))


def test_warmth_is_found_with_its_time_constant(arm: ArmModel, recover: Recover) -> None:
    """Viscous friction that falls by 40 % as heat builds up by θ' = P − θ/30 s, pauses included."""
    session = make_session(arm, seconds=20.0, runs=5, pause=15.0)
    warmth, heat = [], 0.0
    for run in session.runs:
        values = []
        for v in run.motion.dq[:, 1]:
            values.append(heat)
            power = COULOMB[1] * v * np.tanh(v / 0.01) + VISCOUS[1] * v * v
            heat += run.interval * (power - heat / 30.0)
        warmth.append(np.array(values))
        heat *= np.exp(-(15.0 + run.interval) / 30.0)
    top = max(values.max() for values in warmth)
    mean = float(np.mean(np.concatenate(warmth))) / top
    # The baseline knows the friction of the mean warmth; cold friction is what it and the change imply.
    cold = VISCOUS[1] / (1 - 0.4 * mean)
    torque = [
        -0.4 * cold * run.motion.dq[:, 1] * values / top for run, values in zip(session.runs, warmth, strict=True)
    ]
    found = recover(find_effect("thermal_friction"), session, 1, torque)
    assert found["time_constant_s"].value == 30.0
    np.testing.assert_allclose(found["viscous_change"].value, -0.4, atol=0.01)
    np.testing.assert_allclose(found["coulomb_change"].value, 0.0, atol=0.01)


def test_measured_temperature_stands_in_for_the_heat(session: SessionContext, recover: Recover) -> None:
    """With a temperature no clock is needed, and no time constant is told."""

    def warm(run: RunContext) -> RunContext:
        rise = 20.0 + 0.1 * run.motion.time[:, None] + np.zeros((1, run.n))
        return replace(run, temperature=rise)

    warmed = replace(edit_runs(session, warm), common_clock=False)
    torque = [0.8 * run.direction[:, 1] * (run.motion.time / warmed.runs[-1].motion.time[-1]) for run in warmed.runs]
    found = recover(find_effect("thermal_friction"), warmed, 1, torque)
    assert set(found) == {"viscous_change", "coulomb_change"}
    # 0.8 N m on top of a cold level of 8 − 0.8/2.
    np.testing.assert_allclose(found["coulomb_change"].value, 0.8 / 7.6, rtol=0.03)


def test_warmth_needs_a_clock_time_and_change(session: SessionContext, arm: ArmModel) -> None:
    """Without temperature: one clock and a minute; with it: a degree."""
    effect = find_effect("thermal_friction")
    assert "no clock" in str(effect.untestable(replace(session, common_clock=False), 0))
    assert "lasts 12 s only" in str(effect.untestable(make_session(arm, 5.0, 2), 0))

    def mild(run: RunContext) -> RunContext:
        return replace(run, temperature=np.full_like(run.motion.q, 30.0))

    unclocked = replace(edit_runs(session, mild), common_clock=False)
    assert "hardly varies, and the runs share no clock" in str(effect.untestable(unclocked, 0))


def test_warmth_follows_the_friction_power_where_the_sensor_stays_cold(session: SessionContext) -> None:
    """A sensor on the housing that never warms says nothing of the gear: its work does."""
    effect = find_effect("thermal_friction")

    def mild(run: RunContext) -> RunContext:
        return replace(run, temperature=np.full_like(run.motion.q, 30.0))

    without = edit_runs(session, lambda run: replace(run, temperature=None))
    cold = edit_runs(session, mild)
    assert effect.untestable(cold, 0) == effect.untestable(without, 0)
    for one, other in zip(effect.variants(cold, 0), effect.variants(without, 0), strict=True):
        np.testing.assert_array_equal(effect.columns(cold, 0, one)[0], effect.columns(without, 0, other)[0])


def test_hysteresis_is_found_with_its_displacement(session: SessionContext, recover: Recover) -> None:
    """2 N m of a spring and slider with 4 mrad of travel, written out step by step."""
    effect = find_effect("presliding_hysteresis")
    torque = []
    for run in session.runs:
        q, state, values = run.motion.q[:, 4], 0.0, []
        for k in range(len(q)):
            state += q[k] - q[k - 1] if k else 0.0
            state = min(max(state, -0.004), 0.004)
            values.append(2.0 * state / 0.004)
        torque.append(np.array(values))
    found = recover(effect, session, 4, torque)
    # Amplitude times displacement is the area that the build-up lacks; a sharp one counts as two thirds as long.
    area = found["amplitude_Nm"].value * found["displacement_rad"].value
    np.testing.assert_allclose(area, 2.0 * 0.004, rtol=0.15)
    assert found["displacement_rad"].low < 0.004 < found["displacement_rad"].high


def test_a_smooth_build_up_is_found_with_its_figures(session: SessionContext, recover: Recover) -> None:
    """2 N m that build up as 1 − 2 exp(−x/d) with d = 8 mrad, by Dahl's equation, step by step."""
    effect = find_effect("presliding_hysteresis")
    torque = []
    for run in session.runs:
        q, state, values = run.motion.q[:, 4], 0.0, []
        for k in range(len(q)):
            step = q[k] - q[k - 1] if k else 0.0
            goal = np.sign(step)
            state = goal + (state - goal) * np.exp(-abs(step) / 0.008)
            values.append(2.0 * state)
        torque.append(np.array(values))
    found = recover(effect, session, 4, torque)
    np.testing.assert_allclose(found["amplitude_Nm"].value, 2.0, rtol=0.25)
    np.testing.assert_allclose(found["displacement_rad"].value, 0.008, rtol=0.25)


def test_hysteresis_is_full_friction_far_from_reversals(session: SessionContext) -> None:
    """Beyond 60 mrad of travel in one direction a stop operator says no more than Coulomb friction."""
    effect = find_effect("presliding_hysteresis")
    q = session.runs[0].motion.q[:, 0]
    stretch = int(np.argmax(np.abs(session.runs[0].motion.dq[:, 0])))
    heading = np.sign(q[stretch] - q[stretch - 1])
    assert abs(q[stretch] - q[stretch - 20]) > 0.06
    for variant in effect.variants(session, 0):
        np.testing.assert_allclose(effect.columns(session, 0, variant)[0][stretch], heading)


def test_hysteresis_needs_reversals_and_fine_positions(session: SessionContext) -> None:
    """A path that goes one way, or an encoder of 20 mrad, shows none."""

    def one_way(run: RunContext) -> RunContext:
        return replace(run, motion=replace(run.motion, q=np.cumsum(np.abs(run.motion.dq), axis=0) * run.interval))

    def coarse(run: RunContext) -> RunContext:
        return replace(run, motion=replace(run.motion, std=np.array([[0.02], [1e-3], [0.1]]) * np.ones((1, run.n))))

    effect = find_effect("presliding_hysteresis")
    assert "reverses" in str(effect.untestable(edit_runs(session, one_way), 0))
    assert "too noisy" in str(effect.untestable(edit_runs(session, coarse), 0))


def test_what_is_dry_friction_as_well_is_the_joints() -> None:
    """Law: nothing is lost; what is left adds up to the amplitude that is reported of all ranges; the longest ranges
    stay as they were; ranges that make a smooth build-up are all kept.
    """
    effect = find_effect("presliding_hysteresis")
    variant = Variant(shape={"range_0_rad": 0.0006, "range_1_rad": 0.002, "range_2_rad": 0.018})
    parts = np.array([3.0, 5.0, 9.0])
    kept, dry = effect.without_dry_friction(parts, variant)
    assert kept.sum() + dry == pytest.approx(17.0)
    sizes = np.array(list(variant.shape.values()))
    assert kept.sum() == pytest.approx((parts @ sizes) ** 2 / (2.0 / 3.0 * (parts @ sizes**2)))
    assert 0.0 < kept[0] < 3.0
    assert list(kept[1:]) == [5.0, 9.0]
    bend = Variant(shape={"range_0_rad": 0.006, "range_1_rad": 0.012, "range_2_rad": 0.018})
    whole, none = effect.without_dry_friction(np.array([1.0, 1.0, 1.0]), bend)
    np.testing.assert_array_equal(whole, 1.0)
    assert none == 0.0
