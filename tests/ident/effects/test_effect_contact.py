"""Pushes from outside: by the Jacobian, in their window, and where to look for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
from smooth_motion import Recover

from ident.arm import ArmModel
from ident.effects.base import SessionContext
from ident.effects.catalogue import find_effect
from ident.effects.contact import MOST_WINDOWS, ExternalContact, force_columns, screen_windows

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
    np.testing.assert_allclose(force_columns(run.arm, run.motion.q[inside]) @ FORCE, torque[inside], atol=1e-9)


def test_a_push_is_found_in_its_window(session: SessionContext, recover: Recover) -> None:
    """Screening what is left finds the window; in it the force comes out, and times within a tenth of a second."""
    start = session.runs[2].motion.time[0] + 8.0
    torque = push(session, 2, start, start + 1.2)
    rng = np.random.default_rng(2)
    left = [
        run.motion.filtered(tau + rng.normal(0, 0.3, tau.shape)) for run, tau in zip(session.runs, torque, strict=True)
    ]
    windows = screen_windows(session, left)
    assert len(windows) == 1
    found = recover(ExternalContact(windows), session, 0, torque)
    assert windows[0][0] == "run_2"
    np.testing.assert_allclose(found["start_s"].value, start, atol=0.1)
    np.testing.assert_allclose(found["end_s"].value, start + 1.2, atol=0.1)
    np.testing.assert_allclose(found["force_N"].value, np.linalg.norm(FORCE), rtol=0.1)
    assert found["link"].value == 6.0


def test_columns_are_zero_outside_the_window(session: SessionContext) -> None:
    """No other run, and no other time, feels the push."""
    contact = ExternalContact((("run_1", 25.0, 26.0),))
    columns = contact.columns(session, 0, contact.variants(session, 0)[0])
    assert not any(columns[k].any() for k in (0, 2, 3))
    time = session.runs[1].motion.time
    assert not columns[1][(time < 25.0) | (time > 26.0)].any()
    assert columns[1][(time > 25.2) & (time < 25.8)].any(axis=(1, 2)).all()


def test_the_plain_grid_is_bounded_and_covers_the_runs(session: SessionContext, arm: ArmModel) -> None:
    """At most sixteen windows; together they leave no second of few runs out."""
    effect = find_effect("external_contact")
    variants = effect.variants(session, 0)
    assert len(variants) <= MOST_WINDOWS
    covered = sum(variant.shape["end_s"] - variant.shape["start_s"] for variant in variants)
    total = sum(run.motion.time[-1] - run.motion.time[0] for run in session.runs)
    np.testing.assert_allclose(covered, total)
    run = session.runs[0]
    many = tuple(replace(run, motion=replace(run.motion, name=f"copy_{k}")) for k in range(40))
    assert len(effect.variants(replace(session, runs=many), 0)) == MOST_WINDOWS


def test_plain_noise_holds_no_window(session: SessionContext) -> None:
    """Where nothing stands out nothing is looked at."""
    rng = np.random.default_rng(3)
    left = [rng.normal(0, 0.3, run.motion.tau_filtered.shape) for run in session.runs]
    assert screen_windows(session, left) == ()
