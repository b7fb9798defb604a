"""Friction 1.5 times what a URDF says, on an arm in plain numpy that no other test has: all that a user sees holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ident.robot.names import find_urdf
from tests.bench.bench_wrong_friction import FACTOR, check
from tests.ident.plain_arm import PlainArm, motion_of, state_friction

CLOSE = 0.03


@pytest.fixture(scope="module")
def text() -> str:
    return find_urdf("ur5").read_text()


def test_first_line_table_file_and_replay_hold_within_three_per_cent(text: str, tmp_path: Path) -> None:
    outcome = check(text, 6209, tmp_path / "ur5", unseen_s=8.0)
    assert outcome.said == FACTOR, outcome.headline
    assert outcome.table < CLOSE
    assert outcome.file < CLOSE
    for before, after in (outcome.torque, outcome.angle):
        assert after < CLOSE * before


def test_the_plain_arm_keeps_the_balance_of_energy(text: str) -> None:
    """Law: without friction and rotors, power of the torques is the change of energy: no net work over a period."""
    arm = PlainArm.read(state_friction(text, 0.0))
    time = np.linspace(0.0, 2.0 * np.pi, 2001)
    size = np.linspace(0.2, 0.5, len(arm.joints))
    phase = np.arange(len(arm.joints))
    angle = time[:, None] + phase
    q, dq, ddq = size * np.sin(angle), size * np.cos(angle), -size * np.sin(angle)
    power = np.sum(arm.rigid(q, dq, ddq) * dq, axis=1)
    assert abs(np.trapezoid(power, time)) < 1e-6 * np.trapezoid(np.abs(power), time)


def test_a_replay_of_the_arms_own_torque_is_its_motion(text: str) -> None:
    """Law: forward along what was worked out backward leads where the motion went, as far as the step is small."""
    arm = PlainArm.read(state_friction(text, 1.0))
    _, q, dq, ddq = motion_of(len(arm.joints), 5, 0.2, 2000.0)
    path = arm.replay(q[0], dq[0], arm.torque(q, dq, ddq)[:-1])
    assert np.allclose(path, q[1:], atol=2e-4)
