"""A robot's torque in the parts that a reading of a log needs."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ident.arrays import Array, Float
from ident.checks.conventions.description import ALONG_AXIS
from ident.checks.conventions.settings import READINGS as LIMIT
from ident.checks.settings import CLOCK
from ident.robot.arm import ArmModel
from ident.robot.gravity import gravity_along_axes


class Model:
    """A robot's torque in the parts that a reading needs."""

    def __init__(self, arm: ArmModel) -> None:
        self.arm = arm
        self.stated = np.array(arm.model.gravity.linear)
        self.sliding = np.asarray(arm.sliding_joints)
        self.limits = arm.known_limits
        self._free = arm.with_gravity(np.zeros(3))
        self._under: dict[bytes, ArmModel] = {}

    def under(self, gravity: Float[Array, " 3"]) -> ArmModel:
        """The arm under a gravity in the base's frame [m/s²]; made once."""
        key = np.asarray(gravity, dtype=float).tobytes()
        if key not in self._under:
            self._under[key] = self.arm.with_gravity(gravity)
        return self._under[key]

    @cached_property
    def mass(self) -> float:
        """Mass of all moving links [kg]."""
        return float(self.arm.inertial_parameters[::10].sum())

    @property
    def usual_orders(self) -> tuple[tuple[int, ...], ...]:
        """Orders in which logs have all columns otherwise: alphabetical, and from the tip on."""
        names = self.arm.joint_names
        by_name = sorted(names)
        alphabetical = tuple(by_name.index(name) for name in names)
        plain = tuple(range(len(names)))
        backwards = plain[::-1]
        return tuple(order for order in (alphabetical, backwards) if order != plain)

    @property
    def after_parallel(self) -> tuple[int, ...]:
        """Joints that turn about an axis along that of the joint before, as URDFs place both: their
        angles may be counted from the link before the last one.
        """
        chain = self.arm.chain
        joints = []
        for j in range(1, self.arm.n):
            axis = chain.rotations[j, 0] @ chain.axes[j]  # in the frame of the link before
            is_parallel = abs(float(axis @ chain.axes[j - 1])) > ALONG_AXIS
            if is_parallel and not self.sliding[j] and not self.sliding[j - 1]:
                joints.append(j)
        return tuple(joints)

    def parts(self, q: Array, dq: Array, ddq: Array) -> Float[Array, "T n 4"]:
        """Gravity torque along each axis of the base for 1 m/s², and the inertial torque [N m]."""
        inertial = self._free.inverse_dynamics(q, dq, ddq)
        gravity = gravity_along_axes(self.arm.chain, q)
        return np.concatenate([gravity, inertial[..., None]], axis=-1)

    def beyond_limits(
        self, q: Float[Array, "k T n"], dq: Float[Array, "k T n"]
    ) -> Float[Array, " k"]:
        """Of which limits joints get out, of position and of speed, by reading; half of one where a
        joint does so by half the margin.

        A URDF's limits are the arm's or they are not: the second joint beyond them says no more.
        """
        below = self.limits.lower - q.min(axis=1)
        above = q.max(axis=1) - self.limits.upper
        farthest = np.maximum(below, above)
        out = np.clip(farthest / LIMIT.limit_margin, 0.0, 1.0)
        fastest = np.abs(dq).max(axis=1)
        fast = _over(fastest, self.limits.speed)
        return np.asarray(out.max(axis=-1) + fast.max(axis=-1))

    def beyond_effort(self, effort: Float[Array, " n"]) -> Float[Array, " n"]:
        """Whether each joint's largest effort [N m or N] is beyond its limit, half of it where it
        is so by half the margin.
        """
        return _over(effort, self.limits.effort)


def _over(values: Array, limits: Float[Array, " n"]) -> Array:
    """How far values are beyond limits, as a share of the margin; 1 at most."""
    beyond = values / limits - 1.0
    margin = CLOCK.over_limit - 1.0
    return np.clip(beyond / margin, 0.0, 1.0)
