"""May the arm do this? Limits of position, speed and torque, and no link near another, proven at every instant."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.robot.arm import ArmModel
from ident.trajectories.limits import MotionLimits, thin
from ident.trajectories.reference import ReferenceMotion
from plan.errors import SceneError
from plan.geometry.arm_shapes import StandIn
from plan.geometry.link_pairs import read_disabled
from plan.geometry.scene import Scene
from plan.geometry.tool import record_carried
from plan.problem.task_file import Surroundings

# Links keep this distance [m]: an arm under test doesn't follow its commands to the millimetre.
MARGIN = 0.01
# Largest move of a joint between two looks of the quick check [rad].
STEP = 0.04
# Positions that the proof walks over at once.
STRIDE = 4096


class Feasibility:
    """What one arm may be asked to do.

    Args:
        arm: The arm.
        stand_in: What stands in for links without collision geometry.
        around: Obstacles, the floor, what is carried, and limits inside the robot's; none if not given.

    Raises:
        RobotError: A link has no collision geometry and nothing stands in: then nothing can be proven.
        SceneError: What stands around is no scene of this arm.
    """

    def __init__(self, arm: ArmModel, stand_in: StandIn | None = None, around: Surroundings | None = None) -> None:
        self.limits = MotionLimits(arm)
        self.carried: tuple[dict[str, object], ...] = ()
        if around is None:
            self.scene = Scene.build(arm, stand_in=stand_in)
            return
        _narrow(self.limits, around)
        self.carried = record_carried(arm, around.attached, around.payload, around.payload_link)
        self.scene = Scene.build(
            arm,
            around.obstacles,
            stand_in=stand_in,
            carried=around.attached,
            disabled=None if around.srdf is None else read_disabled(around.srdf, arm),
        )

    def allows(self, motion: ReferenceMotion) -> bool:
        """Whether a motion keeps all limits and, by the quick check, its distance from itself."""
        limits = self.limits
        if (motion.q < limits.lower).any() or (motion.q > limits.upper).any():
            return False
        if limits.excess(motion.q, motion.dq, motion.ddq) > 1.0:
            return False
        return bool(self.scene.separation(thin(motion.q, STEP)).min() > MARGIN)

    def clearance(self, motion: ReferenceMotion) -> float:
        """A distance that the links keep at every instant, by Coal [m]; 0 where they can't be proven to keep any.

        From a position in which a pair is d apart, it can't be nearer than c before the joints have moved by
        (d − c) / lever; the walk goes on from the last position before that.
        """
        if len(self.scene.pairs) == 0:
            return 1.0
        if self.scene.distances(motion.q[0]).min() <= 0.0:  # inside a closed mesh, too
            return 0.0
        travel = np.concatenate([np.zeros((1, motion.q.shape[1])), np.cumsum(np.abs(np.diff(motion.q, axis=0)), 0)])
        for target in (MARGIN, 0.5 * MARGIN, 0.1 * MARGIN):
            if _walk(self.scene, motion.q, travel, target):
                return target
        return 0.0


def _narrow(limits: MotionLimits, around: Surroundings) -> None:
    """Takes the limits of a scene file where they are narrower than the arm's."""
    if around.lower is not None:
        limits.lower = np.maximum(limits.lower, around.lower)
    if around.upper is not None:
        limits.upper = np.minimum(limits.upper, around.upper)
    if around.speed is not None:
        limits.speed = np.minimum(limits.speed, around.speed)
    if np.any(limits.lower >= limits.upper):
        j = int(np.flatnonzero(limits.lower >= limits.upper)[0])
        what = f"[limits] leave {limits.arm.joint_names[j]} no room inside the robot's own limits"
        raise SceneError(around.source, what, "widen lower_deg and upper_deg")


def _walk(scene: Scene, q: Float[Array, "K n"], travel: Float[Array, "K n"], target: float) -> bool:
    """Whether every pair is proven to keep a distance along a densely sampled path."""
    at = 0
    while True:
        spare = scene.proximity.distances(q[at]) - target
        if spare.min() <= 0.0:
            return False
        if at == len(q) - 1:
            return True
        moved = (travel[at + 1 : at + 1 + STRIDE] - travel[at]) @ scene.levers.T
        short = np.flatnonzero((moved > spare).any(axis=1))
        if len(short) and short[0] == 0:
            return False  # a single tick could bring them too near
        at += int(short[0]) if len(short) else len(moved)
