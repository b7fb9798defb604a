"""What an arm may be asked to do: positions, speeds and torques within limits, and no link through another."""

from __future__ import annotations

from functools import cached_property
from itertools import combinations

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from ident.errors import RobotError
from ident.robot.arm import ArmModel
from ident.robot.traits import rated_torque

# Shares of the limits that motions may use: friction, payloads and tracking errors need the rest.
SPEED_SHARE = 0.85
TORQUE_SHARE = 0.55
POSITION_MARGIN = 0.05
CLEARANCE_M = 0.01
# Largest move of a joint between two collision checks [rad].
CHECK_STEP = 0.04


class MotionLimits:
    """Limits of one arm, for motion planning.

    Args:
        arm: The nominal model.
    """

    def __init__(self, arm: ArmModel) -> None:
        self.arm = arm
        bounded = np.array(arm.upper - arm.lower) < 20.0
        self.lower = np.where(bounded, arm.lower + POSITION_MARGIN, -np.pi)
        self.upper = np.where(bounded, arm.upper - POSITION_MARGIN, np.pi)
        speed = np.array(arm.velocity_limit)
        self.speed = SPEED_SHARE * np.where((speed > 0.0) & (speed < 50.0), speed, 3.0)
        self.torque = rated_torque(arm)

    @cached_property
    def centre(self) -> Float[Array, " n"]:
        """Where motions centre: zero if that is well inside the limits, else the middle [rad]."""
        middle, half = 0.5 * (self.lower + self.upper), 0.5 * (self.upper - self.lower)
        return np.where(np.abs(middle) < 0.5 * half, 0.0, middle)

    @cached_property
    def span(self) -> Float[Array, " n"]:
        """How far motions go from the centre: the joints that carry much move much [rad]."""
        room = np.minimum(self.upper - self.centre, self.centre - self.lower)
        strong = self.torque > 0.5 * self.torque.max()
        return np.minimum(0.8 * room, np.where(strong, 1.5, 1.0))

    def stays_within(
        self, q: Float[Array, "K n"], dq: Float[Array, "K n"], ddq: Float[Array, "K n"], stride: int = 10
    ) -> bool:
        """Whether a motion keeps all limits and touches nothing."""
        inside = (q >= self.lower).all() and (q <= self.upper).all()
        return bool(inside) and self.excess(q, dq, ddq, stride) <= 1.0 and not self.touches(q)

    def excess(
        self, q: Float[Array, "K n"], dq: Float[Array, "K n"], ddq: Float[Array, "K n"], stride: int = 10
    ) -> float:
        """Largest use of the speed and torque limits, 1 at the share that motions may use."""
        states = q[::stride], dq[::stride], ddq[::stride]
        # A guess of the rotor, as the controller's maker would have: it takes half of the torque in fast motion.
        rotor = (self.torque / 157.0) ** 1.55
        torque = np.abs(self.arm.inverse_dynamics(*states)) + rotor * np.abs(states[2])
        used = (torque / (TORQUE_SHARE * self.torque)).max()
        return float(max(used, (np.abs(dq) / self.speed).max()))

    def touches(self, q: Float[Array, "K n"]) -> bool:
        """Whether the arm comes nearer than the clearance to itself anywhere on a path."""
        if self._geometry is None:
            return False
        model, data, geometry, geometry_data = self._geometry
        return any(
            pin.computeCollisions(model, data, geometry, geometry_data, state, True) for state in thin(q, CHECK_STEP)
        )

    @cached_property
    def _geometry(self) -> tuple[pin.Model, pin.Data, pin.GeometryModel, pin.GeometryData] | None:
        """Collision pairs of links that are not neighbours; none where the URDF's meshes are not there."""
        try:
            geometry = self.arm.geometry.copy()
        except RobotError:
            return None
        geometry.removeAllCollisionPairs()
        for (i, one), (k, other) in combinations(enumerate(geometry.geometryObjects), 2):
            if abs(one.parentJoint - other.parentJoint) > 1:
                geometry.addCollisionPair(pin.CollisionPair(i, k))
        model = self.arm.model
        data, geometry_data = model.createData(), geometry.createData()
        for request in geometry_data.collisionRequests:
            request.security_margin = CLEARANCE_M
        # Pairs that touch in nearly every pose are coarse boxes of links that share a housing.
        poses = self.centre + self.span * np.random.default_rng(0).uniform(-1.0, 1.0, (40, self.arm.n))
        hits = np.zeros(len(geometry.collisionPairs))
        for pose in poses:
            pin.computeCollisions(model, data, geometry, geometry_data, pose, False)
            hits += [result.isCollision() for result in geometry_data.collisionResults]
        for pair in np.flatnonzero(hits > 0.9 * len(poses)):
            geometry_data.deactivateCollisionPair(int(pair))
        return model, data, geometry, geometry_data


def thin(q: Float[Array, "K n"], step: float) -> Float[Array, "m n"]:
    """Poses of a path at most about a step apart."""
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q, axis=0)).max(axis=1))])
    marks = np.arange(0.0, travel[-1] + step, step)
    return q[np.minimum(np.searchsorted(travel, marks), len(q) - 1)]
