"""Limits of an arm that its motions keep: positions, speeds, torques, and room to itself."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import combinations

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from ident.errors import RobotError
from ident.robot.arm import ArmModel
from ident.trajectories.reference import ReferenceMotion

# Shares of the limits that motions may use: friction, payloads and tracking errors need the rest.
SPEED_SHARE = 0.85
TORQUE_SHARE = 0.55
POSITION_MARGIN = 0.05
CLEARANCE_M = 0.01
# Ranges and speeds beyond are no limits [rad, rad/s], and what is taken for such a speed.
LARGEST_RANGE = 20.0
LARGEST_SPEED = 50.0
USUAL_SPEED = 3.0
# Largest move of a joint between two collision checks [rad].
CHECK_STEP = 0.04
# One of how many ticks is held against the torque limits.
STRIDE = 10
# Poses by which links that always touch are told, and in which share of them they do.
HOUSING_POSES = 40
HOUSING_SHARE = 0.9
# Poses that are drawn where the arm can't stand in the middle of its limits, how many more about
# each it has to stand in, and how far off these are, as a share of the joints' ranges.
DRAWN_POSES = 4000
NEAR_POSES = 8
NEAR_SHARE = 0.05

Collisions = tuple[pin.Model, pin.Data, pin.GeometryModel, pin.GeometryData]
"""The arm, its shapes, and Pinocchio's room for both."""


class MotionLimits:
    """Limits of one arm, for motion planning.

    Args:
        arm: The nominal model.
    """

    def __init__(self, arm: ArmModel) -> None:
        self.arm = arm
        limits = arm.known_limits
        bounded = limits.upper - limits.lower < LARGEST_RANGE
        self.lower = np.where(bounded, limits.lower + POSITION_MARGIN, -np.pi)
        self.upper = np.where(bounded, limits.upper - POSITION_MARGIN, np.pi)
        speed = np.where(limits.speed < LARGEST_SPEED, limits.speed, USUAL_SPEED)
        self.speed = SPEED_SHARE * speed
        self.torque = arm.rated_torque

    @cached_property
    def centre(self) -> Float[Array, " n"]:
        """Where motions centre [rad].

        Zero if that is well inside the limits, else the middle; where the arm touches itself there
        or can't hold itself up, the pose nearest to it, of many that are drawn, about which it can
        move.
        """
        usual = self._middle
        if self.can_rest(usual[None]):
            return usual
        draws = np.random.default_rng(0)
        poses = draws.uniform(self.lower, self.upper, (DRAWN_POSES, self.arm.n))
        reach = self.upper - self.lower
        nearest = np.argsort(np.square((poses - usual) / reach).sum(axis=1))
        aside = NEAR_SHARE * reach * draws.uniform(-1.0, 1.0, (NEAR_POSES, self.arm.n))
        for pose in poses[nearest]:
            about = np.clip(pose + aside, self.lower, self.upper)
            if self.can_rest(np.vstack([pose, about])):
                return np.asarray(pose)
        return usual

    @cached_property
    def _middle(self) -> Float[Array, " n"]:
        """Zero where that is well inside the limits, else their middle [rad]."""
        middle = 0.5 * (self.lower + self.upper)
        half = 0.5 * (self.upper - self.lower)
        return np.where(np.abs(middle) < 0.5 * half, 0.0, middle)

    def can_rest(self, poses: Float[Array, "K n"]) -> bool:
        """Whether the arm can hold itself up in all poses, with torque that motions may use, and
        touches itself in none.
        """
        if (np.abs(self.arm.gravity(poses)) > TORQUE_SHARE * self.torque).any():
            return False
        return not self._touches_in(poses)

    @cached_property
    def span(self) -> Float[Array, " n"]:
        """How far motions go from the centre: the joints that carry much move much [rad]."""
        return self._span_about(self.centre)

    def _span_about(self, centre: Float[Array, " n"]) -> Float[Array, " n"]:
        room = np.minimum(self.upper - centre, centre - self.lower)
        strong = self.torque > 0.5 * self.torque.max()
        return np.minimum(0.8 * room, np.where(strong, 1.5, 1.0))

    def holds(self, q: Float[Array, "K n"]) -> bool:
        """Whether all positions lie within their limits."""
        return bool((q >= self.lower).all() and (q <= self.upper).all())

    def stays_within(self, motion: ReferenceMotion) -> bool:
        """Whether a motion keeps all limits and touches nothing."""
        if not self.holds(motion.q) or self.first_pace(motion) is None:
            return False
        return not self.touches(motion.q)

    def first_pace(
        self, motion: ReferenceMotion, paces: Sequence[float] | Float[Array, " k"] = (1.0,)
    ) -> float | None:
        """The first of some paces at which a motion uses no more of the limits than motions may.

        Of speed and torque. Torque beyond what holds the arm grows with the square of the pace, so
        one look at the motion tells of all.

        Args:
            motion: At a pace of one.
            paces: Factors of its speed.

        Returns:
            None if it is none of them.
        """
        q = motion.q[::STRIDE]
        dq = motion.dq[::STRIDE]
        ddq = motion.ddq[::STRIDE]
        held = self.arm.gravity(q)
        moving = self.arm.inverse_dynamics(q, dq, ddq) - held
        # A guess of the rotor, as the controller's maker would have: it takes half of the torque in
        # fast motion.
        rotor = (self.torque / 157.0) ** 1.55 * np.abs(ddq)
        fastest = (np.abs(motion.dq) / self.speed).max()
        for pace in map(float, paces):
            torque = np.abs(held + pace**2 * moving) + pace**2 * rotor
            if pace * fastest <= 1.0 and (torque <= TORQUE_SHARE * self.torque).all():
                return pace
        return None

    def touches(self, q: Float[Array, "K n"]) -> bool:
        """Whether the arm comes nearer than the clearance to itself anywhere on a path."""
        return self._touches_in(thin(q, CHECK_STEP))

    def _touches_in(self, poses: Float[Array, "K n"]) -> bool:
        """The same in any of some poses."""
        if self._geometry is None:
            return False
        return any(pin.computeCollisions(*self._geometry, pose, True) for pose in poses)

    @cached_property
    def _geometry(self) -> Collisions | None:
        """Collision pairs of links that are not neighbours.

        None where the URDF's meshes are not there.
        """
        try:
            geometry = self.arm.geometry.copy()
        except RobotError:
            return None
        geometry.removeAllCollisionPairs()
        for (i, shape), (k, other) in combinations(enumerate(geometry.geometryObjects), 2):
            if abs(shape.parentJoint - other.parentJoint) > 1:
                geometry.addCollisionPair(pin.CollisionPair(i, k))
        model = self.arm.model
        geometry_data = geometry.createData()
        for request in geometry_data.collisionRequests:
            request.security_margin = CLEARANCE_M
        collisions = (model, model.createData(), geometry, geometry_data)
        self._leave_out_housings(collisions)
        return collisions

    def _leave_out_housings(self, collisions: Collisions) -> None:
        """Switches off pairs that touch in nearly every pose.

        They are coarse boxes of links that share a housing.
        """
        _, _, geometry, geometry_data = collisions
        shares = np.random.default_rng(0).uniform(-1.0, 1.0, (HOUSING_POSES, self.arm.n))
        hits = np.zeros(len(geometry.collisionPairs))
        middle = self._middle
        for pose in middle + self._span_about(middle) * shares:
            pin.computeCollisions(*collisions, pose, False)
            hits += [result.isCollision() for result in geometry_data.collisionResults]
        for pair in np.flatnonzero(hits > HOUSING_SHARE * HOUSING_POSES):
            geometry_data.deactivateCollisionPair(int(pair))


def thin(q: Float[Array, "K n"], step: float) -> Float[Array, "m n"]:
    """Poses of a path at most about a step apart [rad]."""
    travel = np.cumsum(np.abs(np.diff(q, axis=0)).max(axis=1))
    travel = np.concatenate([[0.0], travel])
    marks = np.arange(0.0, travel[-1] + step, step)
    return q[np.minimum(np.searchsorted(travel, marks), len(q) - 1)]
