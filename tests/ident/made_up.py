"""Made-up arms and motions with exactly known states, shared by the tests of the identification's core."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.model.loss import LossParameters
from ident.motion.filter import Lowpass
from ident.motion.motion import Motion
from ident.recordings.recording import Payload, Recording, Session
from ident.robot.arm import ArmModel

Law = Callable[[Array, Array, Array], Array]


def link(name: str, mass: float | str = 2.0, com: str = "0.1 0.02 -0.03", moment: float | str = 0.02) -> str:
    """A link of a URDF with an inertia that is neither diagonal nor about the origin."""
    return (
        f'<link name="{name}"><inertial><origin xyz="{com}" rpy="0.3 -0.2 0.1"/><mass value="{mass}"/>'
        f'<inertia ixx="{moment}" ixy="0.001" ixz="-0.002" iyy="0.03" iyz="0.0015" izz="0.025"/></inertial></link>'
    )


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    axis: str = "0 0 1",
    limit: str | None = None,
    turn: str = "0.4 -0.7 1.1",
) -> str:
    """A joint of a URDF."""
    bounds = '<limit lower="-2" upper="2" effort="50" velocity="3"/>' if limit is None else limit
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 -0.05 0.3" rpy="{turn}"/><axis xyz="{axis}"/>{bounds}</joint>'
    )


def urdf(*parts: str) -> str:
    return '<robot name="made_up">' + "".join(parts) + "</robot>"


def sliding_arm() -> ArmModel:
    """Turning, sliding, turning without limits, sliding; axes askew, those of the slides not of unit length."""
    return ArmModel.from_urdf(
        urdf(
            link("base"),
            *(link(f"link_{i}", 3.0 - 0.5 * i) for i in range(1, 5)),
            joint("turn_1", "base", "link_1", axis="0 1 0"),
            joint("slide_2", "link_1", "link_2", "prismatic", "3 0 4"),
            joint("turn_3", "link_2", "link_3", "continuous", "0 -0.8 0.6", ""),
            joint("slide_4", "link_3", "link_4", "prismatic", "0 3 4"),
        )
    )


def two_joint_arm() -> ArmModel:
    """The first two joints of the TM5-900, the others locked at zero."""
    return ArmModel.load("tm5-900", joints=["joint_1", "joint_2"])


def random_states(rng: np.random.Generator, samples: int, n: int, speed: float = np.pi) -> tuple[Array, Array, Array]:
    """Angles within ± π, speeds within ± `speed`, accelerations within ± 10."""
    return tuple(rng.uniform(-bound, bound, (samples, n)) for bound in (np.pi, speed, 10.0))


def multisine(
    rng: np.random.Generator, time: Float[Array, " T"], n: int, harmonics: int = 5, period: float = 10.0
) -> tuple[Array, Array, Array]:
    """Periodic motion of n joints with exact derivatives; about 1 rad and 1.5 rad/s."""
    k = np.arange(1, harmonics + 1)
    omega = 2 * np.pi * k / period
    phase = rng.uniform(0, 2 * np.pi, (n, harmonics))
    size = rng.uniform(0.5, 1.0, (n, harmonics)) / k
    angle = omega * time[:, None, None] + phase
    q = (size * np.sin(angle)).sum(axis=-1)
    dq = (size * omega * np.cos(angle)).sum(axis=-1)
    return q, dq, -(size * omega**2 * np.sin(angle)).sum(axis=-1)


def exact_motion(
    time: Float[Array, " T"],
    states: tuple[Array, Array, Array],
    tau: Float[Array, "T n"],
    joints: Sequence[str],
    name: str = "run",
    payload: Payload | None = None,
) -> Motion:
    """A motion whose states are the true ones, not smoothed."""
    rate = 1.0 / float(time[1] - time[0])
    q, dq, ddq = (freeze(values) for values in states)
    std = freeze(np.full((3, q.shape[1]), 1e-4))
    return Motion(name, tuple(joints), freeze(time), q, dq, ddq, freeze(tau), Lowpass.design(rate), std, payload)


def made_motions(
    arm: ArmModel,
    law: Law | LossParameters,
    seeds: Sequence[int],
    duration: float = 20.0,
    rate: float = 100.0,
    noise: float = 0.0,
    payload: Payload | None = None,
) -> list[Motion]:
    """Multisine runs of an arm whose torque is `law(q, dq, ddq)`, or its own with losses, plus white noise [N m]."""
    loaded, motions = arm.with_payload(payload), []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        time = np.arange(int(duration * rate)) / rate
        states = multisine(rng, time, arm.n)
        own = law(*states) if callable(law) else loaded.inverse_dynamics(*states) + law.torque(*states[1:])
        tau = own + noise * rng.standard_normal((len(time), arm.n))
        motions.append(exact_motion(time, states, tau, arm.joint_names, f"run_{seed}", payload))
    return motions


def made_session(arm: ArmModel, law: Law, seeds: Sequence[int], duration: float = 8.0, rate: float = 125.0) -> Session:
    """The same as recordings: positions with 20 µrad of noise, one clock."""
    runs, start = [], 0.0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        time = np.arange(int(duration * rate)) / rate
        q, dq, ddq = multisine(rng, time, arm.n)
        noisy = q + 2e-5 * rng.standard_normal(q.shape)
        runs.append(Recording(f"run_{seed}", arm.joint_names, start + time, noisy, law(q, dq, ddq)))
        start += duration + 1.0
    return Session("made_up", tuple(runs), robot="tm5-900", path=Path("made_up"))
