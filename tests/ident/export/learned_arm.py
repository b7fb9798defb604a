"""A made-up arm whose friction grows with its load, bends, and remembers: a fit of it has laws, net and memory."""

from dataclasses import replace

import numpy as np

from ident.command_options import FitOptions
from ident.fitting.fit import fit_hybrid
from ident.model.hybrid import HybridModel
from ident.model.linearisation import stop_operator
from ident.model.memory import JointMemory
from ident.model.nearness import Nearness
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.made_up import exact_motion, multisine, two_joint_arm

RATE = 100.0
RUNS = 5


def learned_runs(arm: ArmModel, seed: int = 5) -> list[Motion]:
    """Runs with friction that grows with the load, a bend that a net may learn, and a hysteresis."""
    rng = np.random.default_rng(seed)
    time = np.arange(900) / RATE
    motions = []
    for k in range(RUNS):
        q, dq, ddq = multisine(rng, time, 2)
        rigid = arm.inverse_dynamics(q, dq, ddq)
        hidden = 2.0 * stop_operator(np.ascontiguousarray(q[:, 0]), 0.1) / 0.1
        loaded = 0.15 * np.abs(rigid[:, 1]) * np.tanh(dq[:, 1] / 0.01) + 1.5 * np.sin(3.0 * dq[:, 1])
        tau = rigid + 6.0 * dq + 5.0 * np.tanh(dq / 0.01) + np.column_stack([hidden, loaded])
        tau = tau + 0.1 * rng.standard_normal(dq.shape)
        motions.append(exact_motion(time, (q, dq, ddq), tau, arm.joint_names, f"run_{k}"))
    return motions


def fit_learned(motions: list[Motion]) -> HybridModel:
    """The default fit: it has laws, nets and memories."""
    model = fit_hybrid(motions, two_joint_arm(), FitOptions()).model
    assert model.named
    assert model.net is not None
    assert model.memory is not None
    assert model.memory.kept.any()
    return model


def forget(model: HybridModel, joint: int) -> HybridModel:
    """The same without what a joint remembers: there its net counts."""
    assert model.memory is not None
    trees = list(model.memory.trees)
    trees[joint] = None
    return replace(model, memory=JointMemory(tuple(trees), model.memory.nearness, model.memory.gate))


def within_reach(model: HybridModel, reach: float) -> HybridModel:
    """The same with memories that reach so far beyond the poses that were seen [rad]."""
    assert model.memory is not None
    poses = model.memory.nearness.poses
    nearness = Nearness(poses, np.full(poses.shape[1], reach))
    return replace(model, memory=replace(model.memory, nearness=nearness))
