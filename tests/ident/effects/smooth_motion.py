"""Sessions of made-up smooth motion, as the effects see them."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ident.effects.base import Interval, RunContext, SessionContext
from ident.motion.filter import Lowpass
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel

RATE = 200.0
COULOMB = np.array([8.0, 8.0, 6.0, 2.0, 2.0, 2.0])
VISCOUS = np.array([10.0, 10.0, 8.0, 3.0, 3.0, 2.0])
# Fits an effect to the torque of every run at a joint.
Recover = Callable[..., dict[str, Interval]]
GEARS = np.array([100.0, 100.0, 100.0, 80.0, 80.0, 80.0])


def make_run(
    arm: ArmModel, rng: np.random.Generator, name: str, start: float, seconds: float, size: float, late: float = 0.0
) -> RunContext:
    """A run of five sines a joint, slow enough for every filter; `late` delays all of it [s]."""
    time = start + np.arange(int(seconds * RATE)) / RATE
    omega = 2 * np.pi * rng.uniform(0.05, 0.6, (5, arm.n))
    phase = rng.uniform(0, 2 * np.pi, (5, arm.n))
    amplitude = size * rng.uniform(0.1, 0.4, (5, arm.n))
    angle = omega * (time - start - late)[:, None, None] + phase
    q = (amplitude * np.sin(angle)).sum(axis=1)
    dq = (amplitude * omega * np.cos(angle)).sum(axis=1)
    ddq = -(amplitude * omega**2 * np.sin(angle)).sum(axis=1)
    return make_context(arm, name, time, q, dq, ddq)


def make_context(arm: ArmModel, name: str, time: Any, q: Any, dq: Any, ddq: Any) -> RunContext:
    """What effects are reported of a motion, with friction of a typical arm."""
    std = np.tile([[1e-5], [1e-3], [1e-1]], (1, arm.n))
    rigid, direction = arm.inverse_dynamics(q, dq, ddq), np.tanh(dq / 0.01)
    friction = COULOMB[: arm.n] * direction + VISCOUS[: arm.n] * dq
    motion = Motion(name, arm.joint_names, time, q, dq, ddq, rigid + friction, Lowpass.design(RATE), std)
    return RunContext(motion, arm, rigid, rigid, friction, direction)


def make_session(
    arm: ArmModel, seconds: float = 20.0, runs: int = 4, size: float = 1.0, pause: float = 2.0, late: float = 0.0
) -> SessionContext:
    """Runs with pauses between them, on one clock."""
    rng = np.random.default_rng(1)
    found = tuple(make_run(arm, rng, f"run_{k}", k * (seconds + pause), seconds, size, late) for k in range(runs))
    return SessionContext(found, True, arm.joint_names, GEARS, arm.effort_limit)


def edit_runs(session: SessionContext, change: Callable[[RunContext], RunContext]) -> SessionContext:
    """The session with every run changed."""
    return replace(session, runs=tuple(change(run) for run in session.runs))
