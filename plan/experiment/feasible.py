"""May the arm do this? Limits of position, speed and torque, and nothing near another, proven at
every instant.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError, RobotError
from ident.outputs import real_path
from ident.robot.arm import ArmModel
from ident.robot.names import find_urdf
from ident.trajectories.motion_limits import MotionLimits, thin
from ident.trajectories.reference import ReferenceMotion
from plan.command_options import ExciteOptions
from plan.geometry.pairs import FLOOR, read_disabled
from plan.geometry.scene import Scene
from plan.geometry.tool import hang
from plan.problem.task_file import Surroundings, floor_box, load_surroundings

# Distances that a proof tries [m]; the first is kept: an arm under test follows its commands by
# some millimetres only.
MARGINS = (0.01, 0.005, 0.001)
# Largest move of a joint between two looks of the quick check [rad].
STEP = 0.04
# Positions by chance, at one of which at least each two shapes must keep their distance.
POSITIONS = 500
LEAVE_OUT = "give other --shapes, or leave the pair out by an SRDF (srdf of --scene)"
# Positions that the proof walks over at once.
STRIDE = 4096
HIGHEST_FLOOR = 10.0
OPEN = Surroundings(Path("--scene"))
"""Nothing at all around an arm."""


class Feasibility:
    """What one arm may be asked to do.

    Args:
        arm: The arm.
        stand_in: What stands in for links without collision geometry.
        around: Obstacles, the floor, what is carried, and limits inside the robot's.

    Raises:
        RobotError: A link has no collision geometry and nothing stands in: then nothing can be
        proven. InputError: What stands around is no scene of this arm.
    """

    def __init__(
        self, arm: ArmModel, stand_in: str | None = None, around: Surroundings = OPEN
    ) -> None:
        limits = MotionLimits(arm)
        if around.lower is not None:
            limits.lower = np.fmax(limits.lower, around.lower)
        if around.upper is not None:
            limits.upper = np.fmin(limits.upper, around.upper)
        if around.speed is not None:
            limits.speed = np.fmin(limits.speed, around.speed)
        self.limits = limits
        empty = np.flatnonzero(limits.lower >= limits.upper)
        if len(empty):
            joint = arm.joint_names[empty[0]]
            what = f"[limits] leave {joint} no room inside the robot's own limits"
            raise InputError(around.source, what, "widen lower_deg and upper_deg")
        _, _, self.carried = hang(arm, around.attached, around.payload, around.payload_link)
        self.scene = Scene.build(
            arm,
            around.obstacles,
            stand_in=stand_in,
            carried=around.attached,
            disabled=None if around.srdf is None else read_disabled(around.srdf, arm),
        )

    def require_room(self) -> None:
        """Raises RobotError, with the pair, where two shapes are too near one another at whatever
        position is tried.
        """
        limits = self.limits
        bounded = np.isfinite(limits.upper - limits.lower)
        low = np.where(bounded, limits.lower, -np.pi)
        high = np.where(bounded, limits.upper, np.pi)
        rng = np.random.default_rng(0)
        gaps = self.scene.gaps(rng.uniform(low, high, (POSITIONS, len(low))))
        most = gaps.max(axis=0, initial=-np.inf)
        if len(most) and most.min() <= MARGINS[0]:
            pair = int(most.argmin())
            best = 1e3 * float(most.min())
            reads = f"overlap by {-best:.0f} mm" if best < 0.0 else f"are {best:.0f} mm apart"
            tried = f"of {POSITIONS} positions within the limits"
            what = f"{self.scene.pair_name(pair)} {reads} at best, {tried}"
            remedy = LEAVE_OUT
            if FLOOR in self.scene.names_of(pair):
                remedy = "lower the floor (--floor METRES, or none)"
            raise RobotError(self.scene.arm.name, what, remedy)

    def allows(self, motion: ReferenceMotion) -> bool:
        """Whether a motion keeps all limits and, by the quick check, its distance from itself."""
        limits = self.limits
        if (motion.q < limits.lower).any() or (motion.q > limits.upper).any():
            return False
        if limits.first_pace(motion) is None:
            return False
        return bool(self.scene.separation(thin(motion.q, STEP)).min() > MARGINS[0])

    def clearance(self, motion: ReferenceMotion) -> float:
        """A distance that the links keep at every instant, by Coal [m].

        0 where they can't be proven to keep any.

        From a position in which a pair is d apart, it can't be nearer than c before the joints have
        moved by (d − c) / lever; the walk goes on from the last position before that.
        """
        if len(self.scene.pairs) == 0:
            return 1.0
        if self.scene.distances(motion.q[0]).min() <= 0.0:  # inside a closed mesh, too
            return 0.0
        moved = np.abs(np.diff(motion.q, axis=0, prepend=motion.q[:1]))
        travel = np.cumsum(moved, axis=0)
        for margin in MARGINS:
            if self._keeps(motion.q, travel, margin):
                return margin
        return 0.0

    def _keeps(self, q: Float[Array, "K n"], travel: Float[Array, "K n"], target: float) -> bool:
        """Whether every pair is proven to keep a distance along a densely sampled path."""
        tick = 0
        while True:
            left = self.scene.proximity.distances(q[tick]) - target
            if left.min() <= 0.0 or tick == len(q) - 1:
                return bool(left.min() > 0.0)
            ahead = travel[tick + 1 : tick + 1 + STRIDE]
            moved = (ahead - travel[tick]) @ self.scene.levers.T
            short = np.flatnonzero((moved > left).any(axis=1))
            if len(short) and short[0] == 0:
                return False  # a single tick could bring them too near
            tick += int(short[0]) if len(short) else len(moved)


def _is_of_another(around: Surroundings, arm: ArmModel) -> bool:
    """Whether a scene names another robot than the arm."""
    if around.robot is None or arm.source is None:
        return False
    return real_path(find_urdf(around.robot)) != real_path(arm.source)


def surroundings_of(arm: ArmModel, options: ExciteOptions) -> Surroundings:
    """The surroundings that options name.

    Without a word of a floor, nothing goes below the base plane.

    Raises:
        InputError: The floor's height is no number.
        InputError: The scene file is at fault, or another robot's.
    """
    around = OPEN if options.scene is None else load_surroundings(options.scene, arm.sliding_joints)
    if _is_of_another(around, arm):
        what = f"it is for {around.robot!r}, the robot is {arm.name!r}"
        raise InputError(around.source, what, "give its --robot")
    if options.floor != "none" and all(box.name != FLOOR for box in around.obstacles):
        try:
            height = float(options.floor)
        except ValueError:
            height = math.nan
        if not abs(height) <= HIGHEST_FLOOR:
            what = f"{options.floor!r} is no height"
            raise InputError("--floor", what, f"give metres within {HIGHEST_FLOOR:g}, or none")
        around = replace(around, obstacles=(*around.obstacles, floor_box(height)))
    if options.top_speed is not None:
        speed = np.where(arm.sliding_joints, np.inf, math.radians(options.top_speed))
        if around.speed is not None:
            speed = np.minimum(speed, around.speed)
        around = replace(around, speed=speed)
    return around
