"""Pushes from outside: by the Jacobian, in their window, and where to look for them."""

import numpy as np
import pinocchio as pin
import pytest
from smooth_motion import Recover, make_session

from ident.effects.base import SessionContext, Variant
from ident.effects.catalogue import find_effect
from ident.effects.contact import ExternalContact, Push, force_columns, locate, screen_windows
from ident.laws.acting import shifted
from ident.robot.arm import ArmModel

FORCE = np.array([12.0, -5.0, 8.0])


def push(session: SessionContext, run_index: int, start: float, end: float) -> list[np.ndarray]:
    """Torque −Jᵀ f of a force at the last link's centre of mass, by Pinocchio's Jacobian."""
    torque = [np.zeros_like(run.motion.q) for run in session.runs]
    run = session.runs[run_index]
    model, data = run.arm.model, run.arm.model.createData()
    centre = model.inertias[run.n].lever
    for k in np.flatnonzero((run.motion.time > start) & (run.motion.time < end)):
        jacobian = pin.computeJointJacobian(model, data, run.motion.q[k], run.n)
        pin.forwardKinematics(model, data, run.motion.q[k])
        at_centre = data.oMi[run.n].rotation @ (jacobian[:3] - pin.skew(centre) @ jacobian[3:])
        torque[run_index][k] = -at_centre.T @ FORCE
    return torque


def test_a_push_is_found_in_its_window(session: SessionContext, recover: Recover) -> None:
    """Screening what is left finds the window; in it the force comes out, and times within a tenth of a second."""
    start = session.runs[2].motion.time[0] + 8.0
    torque = push(session, 2, start, start + 1.2)
    rng = np.random.default_rng(2)
    left = [
        run.motion.filtered(tau + rng.normal(0, 0.3, tau.shape)) for run, tau in zip(session.runs, torque, strict=True)
    ]
    found_there = ExternalContact().screened(session, left)
    assert len(found_there.pushes) == 1
    assert found_there.pushes[0].run == "run_2"
    assert found_there.screens > 100  # every window and point that was looked at counts
    found = recover(found_there, session, 0, torque)
    np.testing.assert_allclose(found["start_s"].value, start, atol=0.1)
    np.testing.assert_allclose(found["end_s"].value, start + 1.2, atol=0.1)
    np.testing.assert_allclose(found["force_N"].value, np.linalg.norm(FORCE), rtol=0.1)
    assert found["link"].value == 6.0


def test_a_push_stands_out_of_the_friction_of_its_run(session: SessionContext) -> None:
    """Where a run's friction leaves as much before and after as the push itself, the window is still that of the push,
    and a constant force explains what changes in it.
    """
    run = session.runs[1]
    time = run.motion.time[run.motion.coarse]
    left = [np.random.default_rng(5).normal(0, 0.3, item.motion.tau_filtered.shape) for item in session.runs]
    start = float(time[0]) + 5.0
    force = force_columns(run.arm, run.motion.q[run.motion.coarse], 3, 0.0) @ (0.5 * FORCE)
    around, inside = np.abs(time - start - 0.5) < 2.0, (time > start) & (time < start + 1.0)
    left[1] -= np.where(around[:, None], 0.5 * force[inside].mean(axis=0), 0.0)
    left[1] += np.where(inside[:, None], force, 0.0)
    windows = [push for push in screen_windows(session, left) if push.run == "run_1"]
    assert any(abs(push.start - start) < 0.1 and abs(push.end - start - 1.0) < 0.1 for push in windows)
    best, explained = max((locate(session, left, push) for push in windows), key=lambda pair: pair[1])
    assert best.link == 3
    assert explained > 0.8


def test_a_push_that_swells_is_timed_from_its_first_rise_to_its_end(session: SessionContext, recover: Recover) -> None:
    """Law: of a force that swells and fades as a squared sine its height comes out, and when it began and ended."""
    start = session.runs[2].motion.time[0] + 8.0
    torque = push(session, 2, start, start + 1.5)
    time = session.runs[2].motion.time
    torque[2] = torque[2] * (np.sin(np.pi * (time - start) / 1.5) ** 2)[:, None]
    rng = np.random.default_rng(3)
    left = [
        run.motion.filtered(tau + rng.normal(0, 0.3, tau.shape)) for run, tau in zip(session.runs, torque, strict=True)
    ]
    found = recover(ExternalContact().screened(session, left), session, 0, torque)
    np.testing.assert_allclose(found["start_s"].value, start, atol=0.25)
    np.testing.assert_allclose(found["end_s"].value, start + 1.5, atol=0.25)
    np.testing.assert_allclose(found["force_N"].value, np.linalg.norm(FORCE), rtol=0.15)


def test_a_push_on_a_standing_arm_stands_out_of_its_holds(session: SessionContext) -> None:
    """Law: in a run of which nothing goes beyond friction but in a window, what does is a push; its link is found."""
    run = session.runs[1]
    time = run.motion.time[run.motion.coarse]
    left = [np.random.default_rng(6).normal(0, 0.1, item.motion.tau_filtered.shape) for item in session.runs]
    left[1][:] = 0.0
    start = float(time[0]) + 5.0
    inside = (time > start) & (time < start + 1.0)
    left[1][inside] = force_columns(run.arm, run.motion.q[run.motion.coarse][inside], 4, 1.0) @ (4.0 * FORCE)
    windows = screen_windows(session, left)
    assert [one.run for one in windows] == ["run_1"]
    np.testing.assert_allclose([windows[0].start, windows[0].end], [start, start + 1.0], atol=0.1)
    place, explained = locate(session, left, windows[0])
    assert place.link == 4
    assert explained > 0.95


@pytest.mark.parametrize(("shaken", "least", "most"), [(False, 0.75, 1.0), (True, 0.0, 0.6)])
def test_noise_around_a_faint_push_says_nothing_against_it(
    session: SessionContext, shaken: bool, least: float, most: float
) -> None:
    """Law: of three times the noise of the joint that feels it most a constant force explains what is more than noise,
    though noise is most of what is left; of the same force shaken to and fro it doesn't.
    """
    run = session.runs[1]
    time = run.motion.time[run.motion.coarse]
    left = [np.random.default_rng(7).normal(0, 0.3, item.motion.tau_filtered.shape) for item in session.runs]
    start = float(time[0]) + 5.0
    inside = (time > start) & (time < start + 0.7)
    felt = force_columns(run.arm, run.motion.q[run.motion.coarse][inside], 4, 1.0) @ FORCE
    sway = np.random.default_rng(8).choice([-1.0, 1.0], len(felt)) if shaken else np.ones(len(felt))
    left[1][inside] += 0.9 * felt / np.sqrt(np.mean(felt**2, axis=0)).max() * sway[:, None]
    _, explained = locate(session, left, Push("run_1", start, start + 0.7))
    assert least <= explained <= most


@pytest.mark.parametrize("delay", [0.001, 0.005, 0.013, 0.025])
def test_a_delay_is_found_on_and_off_the_grid(arm: ArmModel, recover: Recover, delay: float) -> None:
    """The torque of the same motion, computed late instead of shifted: the figure is within 3 %."""
    session, late = make_session(arm, 10.0, 2), make_session(arm, 10.0, 2, late=delay)
    torque = [b.total - a.total for a, b in zip(session.runs, late.runs, strict=True)]
    found = recover(find_effect("torque_delay"), session, 0, torque)["delay_s"]
    np.testing.assert_allclose(found.value, delay, rtol=0.03)


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


def test_a_force_acts_by_the_jacobian(session: SessionContext) -> None:
    """Unit forces give the columns of −Jᵀ, whatever the links weigh."""
    run = session.runs[0]
    torque = push(session, 0, -1.0, 1.0)[0]
    inside = run.motion.time < 1.0
    np.testing.assert_allclose(force_columns(run.arm, run.motion.q[inside], run.n) @ FORCE, torque[inside], atol=1e-9)


def test_a_shift_by_whole_samples_is_exact_and_by_parts_is_cubic() -> None:
    """Three samples late is the value three samples ago; a cubic is shifted by any part exactly."""
    t = np.arange(40.0)
    values = np.stack([np.sin(t), 1 + t - 0.1 * t**2 + 0.01 * t**3], axis=1)
    np.testing.assert_allclose(shifted(values, 3.0, 1.0)[3:], values[:-3])
    late = t - 2.3
    np.testing.assert_allclose(shifted(values, 2.3, 1.0)[5:, 1], (1 + late - 0.1 * late**2 + 0.01 * late**3)[5:])
