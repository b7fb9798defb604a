"""Laws outside the catalogue that remember or live in the mesh: each by its signature."""

from __future__ import annotations

import numpy as np
import pytest

from ident.simulation.laws import make_law
from ident.simulation.loop import fresh_state
from ident.simulation.outside import remembered_torque

DT = 1e-3


def follow(angle, transmitted=0.0, **law):  # type: ignore[no-untyped-def]
    """Torque of a law along a path of one joint."""
    joint = make_law("outside", 1, **law)[0]
    state = fresh_state(1)
    state["transmitted"] = transmitted
    speed = np.gradient(angle, DT)
    return np.array([remembered_torque(joint, state[0], q, v, DT) for q, v in zip(angle, speed, strict=True)])


def at_speed(speed, seconds=2.0):  # type: ignore[no-untyped-def]
    return speed * np.arange(round(seconds / DT)) * DT


def test_without_a_law_there_is_no_torque() -> None:
    assert not follow(at_speed(0.5)).any()


def test_a_seal_is_viscous_when_slow_and_a_spring_when_quick() -> None:
    slow = follow(at_speed(0.2), seal=10.0, seal_relaxation=0.1)
    assert slow[-1] == pytest.approx(-10.0 * 0.2 * 0.1, rel=1e-2)
    t = np.arange(2000) * DT
    quick = 0.01 * np.sin(2 * np.pi * 20.0 * t)
    torque = follow(quick, seal=10.0, seal_relaxation=1.0)
    assert np.corrcoef(torque[1000:], quick[1000:])[0, 1] < -0.99


def test_rest_strengthens_a_contact_and_slip_renews_it() -> None:
    moving = at_speed(0.3)
    rested = np.concatenate([np.zeros(3000), moving])
    fresh, aged = follow(moving, ageing=1.0, ageing_slip=0.01), follow(rested, ageing=1.0, ageing_slip=0.01)[3000:]
    assert -aged[:20].mean() > 2.0 * -fresh[:20].mean()
    assert aged[-1] == pytest.approx(fresh[-1], rel=1e-3)
    assert follow(-moving, ageing=1.0)[-1] > 0.0


def test_tooth_friction_turns_round_within_a_tooth_and_needs_load() -> None:
    angle = at_speed(0.5)
    torque = follow(angle, transmitted=40.0, tooth=0.05, tooth_order=20.0)
    assert torque.max() == pytest.approx(2.0, rel=0.02)
    assert torque.min() == pytest.approx(-2.0, rel=0.02)
    assert abs(torque[: round(2 * np.pi / 20 / 0.5 / DT)].mean()) < 0.05
    assert not follow(angle, tooth=0.05).any()


def test_a_kinematic_error_shakes_hardest_at_the_resonance() -> None:
    law = {"wobble": 1e-3, "wobble_order": 100.0, "wobble_inertia": 1.0, "wobble_resonance": 60.0}
    below, at, above = (np.abs(follow(at_speed(v), **law)[200:]).max() for v in (0.2, 0.6, 1.8))
    assert at > 5.0 * below
    assert at > 1.2 * above
