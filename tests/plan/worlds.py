"""Arms, models and tasks that the planner's tests share."""

import re
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from ident.model.loss import LossParameters
from ident.model.net_bounds import NetBounds
from ident.robot.arm import ArmModel
from plan.dynamics.compiled_nets import CompiledDenseNet, CompiledJointNets
from plan.dynamics.power import ChainTorque
from plan.geometry.scene import Scene
from plan.geometry.solids import Box
from plan.initial.vias import straight
from plan.planners.base import Ledger
from plan.problem.problem import Limits, PlanningProblem

START, GOAL = np.radians([50.0, 0.0, -120.0]), np.radians([80.0, 30.0, -90.0])
MONITOR = Box("monitor", 0, np.eye(3), [0.04, -0.47, 0.56], [0.06, 0.06, 0.06])


@cache
def three_joints() -> ArmModel:
    """The TM5-900 with its wrist frozen at zero."""
    return ArmModel.load("tm5-900").locked(["joint_4", "joint_5", "joint_6"], [0.0, 0.0, 0.0])


def losses(n: int = 3) -> LossParameters:
    """Losses of the size that a fit of the TM5-900 gives."""
    return LossParameters(
        motor_inertia=np.linspace(0.9, 0.5, n),
        viscous=np.linspace(8.0, 5.0, n),
        coulomb=np.linspace(8.0, 5.0, n),
        offset=np.linspace(0.3, -0.2, n),
        transition_speed=np.full(n, 0.01),
    )


def joint_nets(n: int = 3, seed: int = 0) -> CompiledJointNets:
    """A net of the default kind with random weights, a few N m large."""
    rng = np.random.default_rng(seed)
    widths = (6, 16, 10, 1)
    joints = [
        [(rng.normal(size=shape), 0.3 * rng.normal(size=shape[1])) for shape in pairwise(widths)] for _ in range(n)
    ]
    for (first, _), *_ in joints:
        first *= np.array([0.3, 0.1, 1.0, 1.0, 0.02, 0.02])[:, None]
    return CompiledJointNets(tuple(joints), NetBounds(np.full((3, n), -np.inf), np.full((3, n), np.inf)))


def bounded_nets() -> CompiledJointNets:
    """The same with a training, and torques, that end well inside what tests ask for."""
    edge = np.outer([0.7, 2.0, 5.0], [1.0, 0.8, 1.2])
    return replace(joint_nets(), bounds=NetBounds(-0.9 * edge, edge, np.full(3, -2.0), np.full(3, 1.5)))


def dense_net(n: int = 3, seed: int = 0) -> CompiledDenseNet:
    """A net of the paper's kind with random weights."""
    rng = np.random.default_rng(seed)
    shapes = pairwise((3 * n, 16, 12, n))
    return CompiledDenseNet([(rng.normal(size=one) / np.sqrt(one[0]), 0.3 * rng.normal(size=one[1])) for one in shapes])


def model(net: CompiledDenseNet | CompiledJointNets | None = None) -> ChainTorque:
    """The three-joint arm with losses."""
    return ChainTorque(three_joints().chain, losses(), net)


def problem(*obstacles: Box, duration: float = 0.65, vias: int = 2, clearance: float = 0.005, **changes: object):  # type: ignore[no-untyped-def]
    """The paper's task of table 3, with obstacles if given."""
    arm = three_joints()
    task = PlanningProblem(
        scene=Scene.build(arm, obstacles),
        model=model(),
        limits=Limits(arm.lower, arm.upper, arm.velocity_limit, arm.effort_limit, clearance),
        start=START,
        goal=GOAL,
        vias=straight(START, GOAL, vias),
        durations=np.full(vias + 1, duration / (vias + 1)),
    )
    return replace(task, **changes)  # type: ignore[arg-type]


def ledger(evaluations: int = 10**7, seconds: float = 300.0, **options: object) -> Ledger:
    """A ledger with a wide budget."""
    return Ledger(evaluations, seconds, **options)  # type: ignore[arg-type]


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """A rotation drawn evenly."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def on_wheels(folder: Path) -> Path:
    """The TM5-900 on a base that slides and turns, without a drive and without mass."""
    text = ArmModel.load("tm5-900").urdf.replace('name="tm5_900"', 'name="on_wheels"')
    joints = (("slide", "prismatic", "1 0 0"), ("yaw", "revolute", "0 0 1"))
    hanging = re.findall(r'<child link="([^"]+)"', text)
    (root,) = (link for link in re.findall(r'<link name="([^"]+)"', text) if link not in hanging)
    parents, children = ("floor", "slider"), ("slider", root)
    added = '<link name="floor"/><link name="slider"/>'
    for (name, kind, axis), parent, child in zip(joints, parents, children, strict=True):
        limit = '<limit lower="-3" upper="3" effort="0" velocity="0"/>'
        added += f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        added += f'<axis xyz="{axis}"/>{limit}</joint>'
    (folder / "on_wheels.urdf").write_text(text.replace("</robot>", f"{added}</robot>"))
    return folder / "on_wheels.urdf"
