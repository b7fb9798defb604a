"""A made-up but faithful session of the TM5-900: exciting motion, rigid body, rotors, friction and noise."""

import numpy as np
import pytest

from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path

RATE_HZ = 125.0
COULOMB = np.array([9.0, 9.0, 6.0, 2.5, 2.0, 1.5])
VISCOUS = np.array([12.0, 12.0, 8.0, 2.0, 1.5, 1.5])
ROTOR = np.array([1.5, 1.5, 0.8, 0.2, 0.2, 0.1])
TORQUE_NOISE = np.array([0.5, 0.5, 0.3, 0.15, 0.12, 0.1])
ENCODER_RAD = 2.0 * np.pi / 2**17


def make_run(
    arm: ArmModel, rng: np.random.Generator, name: str, start: float, seconds: float, speed: float = 1.0
) -> Recording:
    """One run: a Fourier series per joint, quantised encoders, filtered velocity, noisy torque."""
    time = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    harmonics = 2.0 * np.pi * speed * np.array([0.11, 0.17, 0.29, 0.43])
    size = rng.uniform(-0.35, 0.35, (4, arm.n))
    phase = rng.uniform(0.0, 2.0 * np.pi, (4, arm.n))
    angle = harmonics[:, None] * time[:, None, None] + phase.T[None].transpose(0, 2, 1)
    centre = rng.uniform(-0.5, 0.5, arm.n)
    q = centre + (size * np.sin(angle)).sum(axis=1)
    dq = (size * harmonics[:, None] * np.cos(angle)).sum(axis=1)
    ddq = -(size * harmonics[:, None] ** 2 * np.sin(angle)).sum(axis=1)
    tau = arm.inverse_dynamics(q, dq, ddq) + ROTOR * ddq + COULOMB * np.tanh(dq / 0.01) + VISCOUS * dq
    return Recording(
        name,
        arm.joint_names,
        start + time,
        np.round(q / ENCODER_RAD) * ENCODER_RAD,
        tau + TORQUE_NOISE * rng.normal(size=tau.shape),
        velocity=dq + 1e-3 * rng.normal(size=dq.shape),
    )


@pytest.fixture(scope="session")
def clean(arm: ArmModel) -> Session:
    """Five healthy runs of 12 s on one clock."""
    rng = np.random.default_rng(5)
    runs = [make_run(arm, rng, f"run{k}", 30.0 * k, 12.0) for k in range(5)]
    return Session("clean", tuple(runs))


@pytest.fixture(scope="module")
def session() -> Session:
    """A recording of the arm that is shipped."""
    return load_session(data_path("logs/tm5_900/E1"))
