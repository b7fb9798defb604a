"""Pushes from outside: by the Jacobian, in their window, and where to look for them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from smooth_motion import Recover

from ident.effects.base import SessionContext
from ident.effects.contact import ExternalContact, Push, force_columns, locate, screen_windows

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


def test_a_force_acts_by_the_jacobian(session: SessionContext) -> None:
    """Unit forces give the columns of −Jᵀ, whatever the links weigh."""
    run = session.runs[0]
    torque = push(session, 0, -1.0, 1.0)[0]
    inside = run.motion.time < 1.0
    np.testing.assert_allclose(force_columns(run.arm, run.motion.q[inside], run.n) @ FORCE, torque[inside], atol=1e-9)


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


@pytest.mark.parametrize("link", [2, 4])
def test_the_pushed_link_is_told_by_the_joints_that_feel_it(session: SessionContext, link: int) -> None:
    """A force on a link is felt by the joints below it only, each by its lever."""
    run = session.runs[1]
    left = [np.random.default_rng(link).normal(0, 0.1, item.motion.tau_filtered.shape) for item in session.runs]
    time = run.motion.time[run.motion.coarse]
    start = float(time[0]) + 5.0
    inside = (time > start) & (time < start + 1.0)
    left[1][inside] += force_columns(run.arm, run.motion.q[run.motion.coarse][inside], link, 1.0) @ (4.0 * FORCE)
    place, explained = locate(session, left, Push("run_1", start, start + 1.0))
    assert place.link == link
    assert explained > 0.9


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


def test_columns_are_zero_outside_the_window(session: SessionContext) -> None:
    """No other run, and no other time, feels the push."""
    contact = ExternalContact((Push("run_1", 25.0, 26.0),))
    columns = contact.columns(session, 0, contact.variants(session, 0)[0])
    assert not any(columns[k].any() for k in (0, 2, 3))
    time = session.runs[1].motion.time
    assert not columns[1][(time < 25.0) | (time > 26.0)].any()
    assert columns[1][(time > 25.2) & (time < 25.8)].any(axis=(1, 2)).all()


def test_plain_noise_holds_no_window(session: SessionContext) -> None:
    """Where nothing stands out nothing is looked at."""
    rng = np.random.default_rng(3)
    left = [rng.normal(0, 0.3, run.motion.tau_filtered.shape) for run in session.runs]
    assert screen_windows(session, left) == ()
