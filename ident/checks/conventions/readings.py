"""What each reading of the motion makes of the model: sums from which every reading of the torque
follows.

Beside a rigid torque r, each joint's torque holds friction, its rotor and an offset,

    tau_j = s_j r_j + b tanh(dq_j / eps) + c dq_j + d ddq_j + o_j,    b, c, d >= 0,

with a size s_j near one for masses and gains that are off. r is linear in gravity's vector. Of each
joint and reading of the motion a matrix of inner products is kept, from which friction, rotor and
offset are projected out: what is left of any column of torque, of either sign, under any gravity,
is a quadratic form in it.

An offset is held to what a drive can have: a share of its square counts as unexplained. Where a
joint stands, friction holds it with an unknown part of its level: such rows count less, but they
count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.checks.conventions.description import (
    ALONG_AXIS,
    DESCRIPTION,
    MASSES,
    scale_length,
    size_price,
)
from ident.checks.conventions.hypothesis import Hypothesis, states_as
from ident.checks.filtered_run import CLOCK
from ident.records import read_group
from ident.robot.arm import ArmModel
from ident.robot.gravity import gravity_along_axes

LIMIT = read_group(__file__, "readings")

AXES = np.eye(3)
GRAVITY = 9.81
# Travel beside the median column's below which a column stands (chosen: it only leads to one more
# order that is weighed).
STANDS = 0.01


@dataclass(frozen=True, eq=False)
class Log:
    """States of a recording as its file has them, thinned out; columns in the file's order."""

    q: Float[Array, "T n"]  # [as recorded]
    dq: Float[Array, "T n"]
    ddq: Float[Array, "T n"]
    tau: Float[Array, "T n"]

    def thinned(self, count: int) -> Log:
        """Every k-th state, so that at most `count` are left."""
        step = max(1, -(-len(self.q) // count))
        return Log(self.q[::step], self.dq[::step], self.ddq[::step], self.tau[::step])


def usual_orders(log: Log, model: Model) -> tuple[tuple[int, ...], ...]:
    """Orders in which logs have all columns otherwise: those of the robot's names, and what stands
    behind all that moves. A gripper's column often stands amid the arm's.
    """
    travel = np.ptp(log.q, axis=0)
    stands = travel <= STANDS * np.median(travel)
    order = (*map(int, np.flatnonzero(~stands)), *map(int, np.flatnonzero(stands)))
    known = model.usual_orders
    is_new = order not in (*known, tuple(range(len(order))))
    return (*known, order) if is_new else known


class Sums(NamedTuple):
    """Of k readings of the motion: inner products, friction, rotor and offset projected out.

    Columns: gravity along the base's axes, the inertial torque, then every column of effort.
    """

    left: Float[Array, "k n m m"]
    # Coefficient of Coulomb and viscous friction and of the rotor, by column.
    friction: Float[Array, "k n 3 m"]
    spread: Float[Array, "k n 3"]  # variance of each coefficient for a residual of variance one
    variance: Float[Array, " n"]  # of each column of effort; of own ones shape (k, n, 1, 1)
    # Of which limits joints get out, and how many another unit leaves without motion.
    beyond: Float[Array, " k"]


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
        alphabetical = tuple(sorted(names).index(name) for name in names)
        plain = tuple(range(len(names)))
        return tuple(order for order in (alphabetical, plain[::-1]) if order != plain)

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
        out = np.clip(np.maximum(below, above) / LIMIT.limit_margin, 0.0, 1.0)
        fast = _over(np.abs(dq).max(axis=1), self.limits.speed)
        return np.asarray(out.max(axis=-1) + fast.max(axis=-1))

    def beyond_effort(self, effort: Float[Array, " n"]) -> Float[Array, " n"]:
        """Whether each joint's largest effort [N m or N] is beyond its limit, half of it where it
        is so by half the margin.
        """
        return _over(effort, self.limits.effort)


def _over(values: Array, limits: Float[Array, " n"]) -> Array:
    """How far values are beyond limits, as a share of the margin; 1 at most."""
    return np.clip((values / limits - 1.0) / (CLOCK.over_limit - 1.0), 0.0, 1.0)


def read(log: Log, model: Model, readings: Sequence[Hypothesis]) -> Sums:
    """The sums of some readings of the motion, one after the other in one pass."""
    sliding, count, n = model.sliding, len(readings), log.q.shape[1]
    q, dq, ddq = states_as(readings, (log.q, log.dq, log.ddq), sliding)
    flat = [values.reshape(-1, n) for values in (q, dq, ddq)]
    rigid = model.parts(*flat).reshape(count, -1, n, 4)
    samples = rigid.shape[1]
    friction = np.stack([np.tanh(dq / LIMIT.transition), dq, ddq, np.ones_like(dq)], axis=-1)
    effort = np.broadcast_to(log.tau[None, :, None, :], (count, samples, n, n))
    table = np.concatenate([friction, rigid, effort], axis=-1)
    weight = np.where(np.abs(dq) > LIMIT.standing, 1.0, LIMIT.rest_weight)
    weight = weight / np.sqrt((weight**2).mean(axis=1, keepdims=True))
    table = (table * weight[..., None]).transpose(0, 2, 1, 3)
    gram = table.transpose(0, 1, 3, 2) @ table / samples
    beside, cross, rest = gram[..., :4, :4], gram[..., :4, 4:], gram[..., 4:, 4:]
    scale = np.sqrt(np.maximum(np.diagonal(beside, axis1=-2, axis2=-1), 1e-12))
    ridge = np.zeros(4)
    ridge[3] = LIMIT.offset_cost
    inverse = np.linalg.inv(
        beside / (scale[..., :, None] * scale[..., None, :]) + np.diag(ridge) + 1e-9 * np.eye(4)
    ) / (scale[..., :, None] * scale[..., None, :])
    coefficients = inverse @ cross
    left = rest - cross.transpose(0, 1, 3, 2) @ coefficients
    spread = np.diagonal(inverse, axis1=-2, axis2=-1)[..., :3]
    has_unit = np.array([[unit != "" for unit in reading.unit] for reading in readings])
    still = (has_unit & (np.ptp(q, axis=1) < LIMIT.least_travel)).sum(axis=1)
    return Sums(
        left,
        coefficients[..., :3, :],
        spread,
        log.tau.var(axis=0),
        model.beyond_limits(q, dq) + still,
    )


def own_columns(sums: Sums, columns: Array) -> Sums:
    """The sums with the one column of effort that is each joint's own in place of all of them.

    Args:
        sums: Of k readings of the motion.
        columns: Column of effort of each joint, by reading, shape (k, n).
    """
    count, n = columns.shape
    wanted = np.broadcast_to(np.arange(5), (count, n, 5)).copy()
    wanted[..., 4] = 4 + columns
    rows = np.take_along_axis(sums.left, wanted[..., :, None], axis=2)
    left = np.take_along_axis(rows, wanted[..., None, :], axis=3)
    friction = np.take_along_axis(sums.friction, wanted[..., None, :], axis=3)
    variance = sums.variance[columns][:, :, None, None]
    return Sums(left, friction, sums.spread, variance, sums.beyond)


def unexplained(
    sums: Sums, gravity: Float[Array, "k g 3"], size: Float[Array, "k g"]
) -> tuple[Float[Array, "k n g n 2"], Float[Array, "k n g n 2"]]:
    """What each column of effort costs as each joint's, under each gravity, with either sign; and
    at which size.

    The cost is the logarithm of the share of its variance that is left, and what a size other than
    the usual one is unlikely: as a URDF's masses are off, or, where the size is told, as an effort
    is in another unit. Friction that drives instead of braking is left in.

    Args:
        sums: Of k readings of the motion.
        gravity: Vectors in the base's frame, by reading; zero where gravity is not in the effort
            [m/s²].
        size: The usual size of the joints' torques, the model's being one.
    """
    usual = size[:, None, :, None]
    other_unit = scale_length(sums.left.shape[1]) / DESCRIPTION.observations
    # Amounts of the rigid torque's columns.
    vectors = np.concatenate([gravity, np.ones_like(gravity[..., :1])], axis=-1)
    rigid, mixed = sums.left[:, :, :4, :4], sums.left[:, :, :4, 4:]
    along = vectors[:, None] @ mixed
    square = np.maximum(_squares(vectors, rigid), 1e-12)[..., None]
    own = np.diagonal(sums.left[:, :, 4:, 4:], axis1=2, axis2=3)[:, :, None, :]
    by_rigid = vectors[:, None] @ sums.friction[..., :4].swapaxes(-1, -2)
    by_effort = sums.friction[..., 4:].transpose(0, 1, 3, 2)[:, :, None]  # k n 1 t 3
    variance = np.maximum(sums.variance, 1e-300)
    costs, sizes = [], []
    for sign in (1.0, -1.0):
        free = sign * along / square
        best = np.clip(free, usual / LIMIT.most_size, usual * LIMIT.most_size)
        tried = np.stack([usual * (best / usual) ** share for share in LIMIT.shares])
        rest = own - 2.0 * tried * sign * along + tried**2 * square
        friction = sign * by_effort - tried[..., None] * by_rigid[..., None, :]
        wrong = np.minimum(friction, 0.0) ** 2 / sums.spread[:, :, None, None, :]
        share_left = (np.maximum(rest, 0.0) + wrong.sum(axis=-1)) / variance
        unlikely = size_price(np.log(tried / usual))
        told = is_told(free, own, square) & is_other_unit(best / usual)
        unlikely[-1] = np.where(told, np.minimum(unlikely[-1], other_unit), unlikely[-1])
        cost = np.log(share_left + LIMIT.floor) + unlikely
        chosen = np.argmin(cost, axis=0)[None]
        costs.append(np.take_along_axis(cost, chosen, axis=0)[0])
        sizes.append(np.take_along_axis(tried, chosen, axis=0)[0])
    return np.stack(costs, axis=-1), np.stack(sizes, axis=-1)


def _squares(
    vectors: Float[Array, "k g 4"], rigid: Float[Array, "k n 4 4"]
) -> Float[Array, "k n g"]:
    """Mean square of the rigid torque under each gravity, by joint."""
    return np.asarray(((vectors[:, None] @ rigid) * vectors[:, None]).sum(axis=-1))


def is_told(size: Array, own: Array, square: Array) -> Bool[Array, ...]:
    """Whether a torque of mean square `own` tells its size over a rigid one of mean square
    `square`.

    The error of its logarithm is what is left over so many independent states.
    """
    left = np.maximum(own - size**2 * square, 0.0)
    error = left / square / MASSES.independent / np.maximum(size, 1e-12) ** 2
    return np.asarray((size > 0.0) & (error < DESCRIPTION.size_spread**2))


def is_other_unit(factor: Array) -> Bool[Array, ...]:
    """Whether a size over the usual one lies where rather another unit than masses that are off
    makes it.
    """
    return np.asarray(np.abs(np.log(factor)) > np.log(MASSES.other_unit))


def common_size(sums: Sums, gravity: Float[Array, "k g 3"], columns: Array) -> Float[Array, "k g"]:
    """The size that the joints' torques have together, each by how much of its torque the rigid one
    explains.

    Args:
        sums: Of k readings of the motion.
        gravity: Vectors in the base's frame, by reading [m/s²].
        columns: Column of effort of each joint, by reading, shape (k, n).
    """
    vectors = np.concatenate([gravity, np.ones_like(gravity[..., :1])], axis=-1)
    square = _squares(vectors, sums.left[:, :, :4, :4])
    along = vectors[:, None] @ sums.left[:, :, :4, 4:]
    own = np.diagonal(sums.left[:, :, 4:, 4:], axis1=2, axis2=3)
    along = np.take_along_axis(along, columns[:, :, None, None], axis=-1)[..., 0]
    own = np.take_along_axis(own, columns[:, :, None], axis=-1)
    size = np.abs(along) / np.maximum(square, 1e-12)
    weight = along**2 / np.maximum(square * own, 1e-300)
    logs = np.log(np.clip(size, 1.0 / LIMIT.most_size, LIMIT.most_size))
    return np.asarray(np.exp((weight * logs).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-12)))


def likeliest_gravity(
    sums: Sums, columns: Array, signs: Array, sizes: Float[Array, " n"], left: Float[Array, " n"]
) -> Float[Array, " 3"]:
    """The gravity that one reading's torques follow best, each weighed by what it leaves [m/s²].

    Args:
        sums: Of one reading of the motion.
        columns, signs, sizes: Column of effort of each joint, its sign, and its size over the
            model's.
        left: Variance of each joint's torque that is left [(N m)²].
    """
    rows = np.arange(len(columns))
    table, effort = sums.left[0], 4 + columns
    weight = (sizes / left)[:, None]
    target = (
        weight * (signs[:, None] * table[rows, :3, effort] - sizes[:, None] * table[:, :3, 3])
    ).sum(axis=0)
    normal = ((weight * sizes[:, None])[..., None] * table[:, :3, :3]).sum(axis=0)
    # Directions that no torque tells stay as far out as they were: zero.
    values, axes = np.linalg.eigh(normal)
    told = values > LIMIT.told_share * max(float(values[-1]), 1e-300)
    return np.asarray(axes[:, told] @ ((axes[:, told].T @ target) / values[told]))


def telling(log: Log) -> Bool[Array, " n"]:
    """Which columns of effort change at all."""
    spread = log.tau.std(axis=0)
    return np.asarray(spread > 1e-6 * max(float(np.abs(log.tau).max()), 1e-300))


def moving(log: Log) -> Bool[Array, " n"]:
    """Whether each joint moves at all."""
    return np.asarray(np.ptp(log.q, axis=0) > LIMIT.least_travel)


def evidence_of_columns(log: Log) -> Float[Array, " n"]:
    """Weight of each column of effort: 1 where its joint moves, less where it stands (friction
    holds it), 0 where the column never changes.
    """
    return np.where(telling(log), np.where(moving(log), 1.0, LIMIT.rest_weight**2), 0.0)
