"""Masses, centres, payload and delay of a session: of motions whose torque is written out here."""

from __future__ import annotations

import numpy as np
import pytest

from ident.monitor.bodies import ARM, FLANGE, estimate_bodies
from ident.monitor.ranges import find_ranges
from ident.motion.motion import Motion
from ident.recordings.recording import Payload
from ident.regression.settings import USUAL_REGRESSION
from ident.robot.arm import ArmModel
from ident.robot.tolerance import parameter_scale
from tests.ident.made_up import made_motions

NOISE = 0.1  # [N m]
VISCOUS, COULOMB = 8.0, 5.0
LOAD = Payload(1.5, (0.0, 0.1, 0.2))
LATE = 0.004  # [s]


def record(arm: ArmModel, seeds: range, true: ArmModel | None = None, late: float = 0.0) -> list[Motion]:
    """Runs of 12 s of an arm with friction; the torque of the true one, so late."""
    plant = arm if true is None else true

    def law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        # To first order in the delay: q̇ and q̈ a moment ago, and so the torque.
        third = np.gradient(ddq, 1.0 / 100.0, axis=0)
        past = plant.inverse_dynamics(q - late * dq, dq - late * ddq, ddq - late * third)
        return past + VISCOUS * dq + COULOMB * np.tanh(dq / 0.002)

    return made_motions(arm, law, seeds, 12.0, 100.0, noise=NOISE)


def test_a_body_at_the_flange_is_found(three_joints: ArmModel) -> None:
    """Law: mass and moments of what the last link carries, and nothing where it carries nothing."""
    loaded = estimate_bodies(record(three_joints, range(4), three_joints.with_payload(LOAD)), three_joints)
    empty = estimate_bodies(record(three_joints, range(4)), three_joints)
    mass = loaded[FLANGE, "payload_kg"]
    assert mass.value == pytest.approx(LOAD.mass_kg, rel=0.01)
    assert abs(empty[FLANGE, "payload_kg"].value) < 0.1


def test_a_late_torque_is_found(three_joints: ArmModel) -> None:
    """Law: a rigid torque that comes 4 ms late is told as such, and one in time as in time."""
    late = estimate_bodies(record(three_joints, range(4), late=LATE), three_joints)[ARM, "delay_s"]
    punctual = estimate_bodies(record(three_joints, range(4)), three_joints)[ARM, "delay_s"]
    assert late.value == pytest.approx(LATE, rel=0.15)
    assert punctual.low < 2e-4
    assert abs(punctual.value) < 5e-4


def test_links_stay_as_wide_as_urdfs_are_wrong_by_where_nothing_tells(
    three_joints: ArmModel,
) -> None:
    """Law: no interval is wider than the prior's, and the first link's mass, which no torque shows, is as wide."""
    found = estimate_bodies(record(three_joints, range(4)), three_joints)
    scale = USUAL_REGRESSION.inertia_share * parameter_scale(three_joints)
    for k, link in enumerate(three_joints.links):
        assert found[link, "mass_kg"].std <= 1.01 * scale[10 * k]
        assert found[link, "mass_kg"].value == pytest.approx(three_joints.inertial_parameters[10 * k], rel=0.1)
    assert found[three_joints.links[0], "mass_kg"].std == pytest.approx(scale[0], rel=0.01)


def test_too_short_a_session_tells_nothing(three_joints: ArmModel) -> None:
    motions = made_motions(three_joints, lambda q, dq, ddq: dq, range(1), 3.0, 100.0)
    assert estimate_bodies(motions, three_joints) == {}


def test_ranges_hold_bodies_and_delay(three_joints: ArmModel) -> None:
    """Three days with loads of 1, 1.5 and 2 kg: the payload's range holds all of them, and the words are plain."""
    days = {}
    for k, mass in enumerate((1.0, 1.5, 2.0)):
        true = three_joints.with_payload(Payload(mass, LOAD.com_m))
        days[f"day_{k}"] = record(three_joints, range(4 * k, 4 * k + 4), true)
    found = find_ranges(days, three_joints, estimate_bodies)
    payload = found.ranges[FLANGE, "payload_kg"]
    assert payload.source == "days"
    assert payload.low < 1.0 < 2.0 < payload.high
    assert found.ranges[ARM, "delay_s"].high < 2e-3
    assert {(link, "mass_kg") for link in three_joints.links} <= set(found.ranges)
    assert "flange payload: 1." in found.summary()
    assert "_kg" not in found.summary()
