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
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.checks.conventions.description import scale_length, size_price
from ident.checks.conventions.hypothesis import Hypothesis, states_as
from ident.checks.conventions.model import Model
from ident.checks.conventions.settings import DESCRIPTION, MASSES
from ident.checks.conventions.settings import READINGS as LIMIT

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
        return Log(
            self.q[::step],
            self.dq[::step],
            self.ddq[::step],
            self.tau[::step],
        )


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


def read(log: Log, model: Model, readings: Sequence[Hypothesis]) -> Sums:
    """The sums of some readings of the motion, one after the other in one pass."""
    count = len(readings)
    n = log.q.shape[1]
    q, dq, ddq = states_as(readings, (log.q, log.dq, log.ddq), model.sliding)
    flat = [values.reshape(-1, n) for values in (q, dq, ddq)]
    rigid = model.parts(*flat).reshape(count, -1, n, 4)
    samples = rigid.shape[1]
    effort = np.broadcast_to(log.tau[None, :, None, :], (count, samples, n, n))
    friction = np.stack(
        [
            np.tanh(dq / LIMIT.transition),
            dq,
            ddq,
            np.ones_like(dq),
        ],
        axis=-1,
    )
    table = np.concatenate([friction, rigid, effort], axis=-1)
    weighed = table * _weight_of_rows(dq)[..., None]
    by_joint = weighed.transpose(0, 2, 1, 3)
    gram = by_joint.transpose(0, 1, 3, 2) @ by_joint / samples
    left, coefficients, spread = _without_friction(gram)
    travel = np.ptp(q, axis=1)
    has_unit = np.array([_have_unit(reading) for reading in readings])
    is_still = has_unit & (travel < LIMIT.least_travel)
    return Sums(
        left=left,
        friction=coefficients[..., :3, :],
        spread=spread,
        variance=log.tau.var(axis=0),
        beyond=model.beyond_limits(q, dq) + is_still.sum(axis=1),
    )


def _have_unit(reading: Hypothesis) -> list[bool]:
    """Whether each joint's position is in another unit than the log states."""
    return [unit != "" for unit in reading.unit]


def _weight_of_rows(dq: Float[Array, "k T n"]) -> Float[Array, "k T n"]:
    """Root of each row's weight: less where a joint stands, of mean square one."""
    is_moving = np.abs(dq) > LIMIT.standing
    weight = np.where(is_moving, 1.0, LIMIT.rest_weight)
    mean_square = (weight**2).mean(axis=1, keepdims=True)
    return np.asarray(weight / np.sqrt(mean_square))


def _without_friction(
    gram: Float[Array, "k n c c"],
) -> tuple[Float[Array, "k n m m"], Float[Array, "k n 4 m"], Float[Array, "k n 3"]]:
    """Inner products once friction, rotor and offset, the first four columns, are projected out.

    Args:
        gram: Inner products of all columns.

    Returns:
        What is left of the other columns; the coefficients of the first four on each of them; and
        the variance of the first three for a residual of variance one.
    """
    beside = gram[..., :4, :4]
    cross = gram[..., :4, 4:]
    rest = gram[..., 4:, 4:]
    power = np.diagonal(beside, axis1=-2, axis2=-1)
    scale = np.sqrt(np.maximum(power, 1e-12))
    scales = scale[..., :, None] * scale[..., None, :]
    ridge = np.zeros(4)
    ridge[3] = LIMIT.offset_cost
    scaled = beside / scales + np.diag(ridge) + 1e-9 * np.eye(4)
    inverse = np.linalg.inv(scaled) / scales
    coefficients = inverse @ cross
    left = rest - cross.transpose(0, 1, 3, 2) @ coefficients
    spread = np.diagonal(inverse, axis1=-2, axis2=-1)[..., :3]
    return left, coefficients, spread


def own_columns(sums: Sums, columns: Array) -> Sums:
    """The sums with the one column of effort that is each joint's own in place of all of them.

    Args:
        sums: Of k readings of the motion.
        columns: Column of effort of each joint, by reading, shape (k, n).
    """
    count, n = columns.shape
    wanted = np.broadcast_to(np.arange(5), (count, n, 5)).copy()
    wanted[..., 4] = 4 + columns
    in_rows = wanted[..., :, None]
    in_columns = wanted[..., None, :]
    rows = np.take_along_axis(sums.left, in_rows, axis=2)
    return Sums(
        left=np.take_along_axis(rows, in_columns, axis=3),
        friction=np.take_along_axis(sums.friction, in_columns, axis=3),
        spread=sums.spread,
        variance=sums.variance[columns][:, :, None, None],
        beyond=sums.beyond,
    )


class _Efforts(NamedTuple):
    """Columns of effort beside the rigid torque, as each joint's, under each gravity."""

    along: Float[Array, "k n g m"]  # inner product with the rigid torque
    square: Float[Array, "k n g 1"]  # mean square of the rigid torque
    power: Float[Array, "k n 1 m"]  # mean square of each column of effort
    by_rigid: Float[Array, "k n g 1 3"]  # friction's coefficients on the rigid torque
    by_effort: Float[Array, "k n 1 m 3"]  # and on each column of effort
    spread: Float[Array, "k n 1 1 3"]  # variance of these for a residual of variance one
    variance: Array  # of each column of effort


def _efforts_of(sums: Sums, gravity: Float[Array, "k g 3"]) -> _Efforts:
    """The inner products that costs follow from."""
    vectors = _amounts(gravity)
    rigid = sums.left[:, :, :4, :4]
    mixed = sums.left[:, :, :4, 4:]
    efforts = sums.left[:, :, 4:, 4:]
    square = np.maximum(_squares(vectors, rigid), 1e-12)
    power = np.diagonal(efforts, axis1=2, axis2=3)
    of_rigid = sums.friction[..., :4].swapaxes(-1, -2)
    by_rigid = vectors[:, None] @ of_rigid
    by_effort = sums.friction[..., 4:].transpose(0, 1, 3, 2)
    return _Efforts(
        along=vectors[:, None] @ mixed,
        square=square[..., None],
        power=power[:, :, None, :],
        by_rigid=by_rigid[..., None, :],
        by_effort=by_effort[:, :, None],
        spread=sums.spread[:, :, None, None, :],
        variance=np.maximum(sums.variance, 1e-300),
    )


def _amounts(gravity: Float[Array, "k g 3"]) -> Float[Array, "k g 4"]:
    """Amounts of the rigid torque's columns under each gravity: the inertial torque has one."""
    return np.concatenate([gravity, np.ones_like(gravity[..., :1])], axis=-1)


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
    efforts = _efforts_of(sums, gravity)
    costs = []
    sizes = []
    for sign in (1.0, -1.0):
        cost, chosen = _cost_of_sign(efforts, usual, sign)
        costs.append(cost)
        sizes.append(chosen)
    return np.stack(costs, axis=-1), np.stack(sizes, axis=-1)


def _cost_of_sign(efforts: _Efforts, usual: Array, sign: float) -> tuple[Array, Array]:
    """The least cost of each column of effort with one sign, and the size that has it.

    Args:
        efforts: What the columns have in common with the rigid torque.
        usual: The usual size of the joints' torques.
        sign: 1, or -1 where the torque has the other sign.
    """
    n = efforts.along.shape[1]
    other_unit = scale_length(n) / DESCRIPTION.observations
    along = efforts.along
    square = efforts.square
    power = efforts.power
    free = sign * along / square
    best = np.clip(free, usual / LIMIT.most_size, usual * LIMIT.most_size)
    factor = best / usual
    tried = np.stack([usual * factor**share for share in LIMIT.shares])
    rest = power - 2.0 * tried * sign * along + tried**2 * square
    friction = sign * efforts.by_effort - tried[..., None] * efforts.by_rigid
    driving = np.minimum(friction, 0.0)
    wrong = driving**2 / efforts.spread
    unexplained_power = np.maximum(rest, 0.0) + wrong.sum(axis=-1)
    share_left = unexplained_power / efforts.variance
    unlikely = size_price(np.log(tried / usual))
    told = is_told(free, power, square) & is_other_unit(factor)
    cheaper = np.minimum(unlikely[-1], other_unit)
    unlikely[-1] = np.where(told, cheaper, unlikely[-1])
    cost = np.log(share_left + LIMIT.floor) + unlikely
    chosen = np.argmin(cost, axis=0)[None]
    least = np.take_along_axis(cost, chosen, axis=0)[0]
    size = np.take_along_axis(tried, chosen, axis=0)[0]
    return least, size


def _squares(
    vectors: Float[Array, "k g 4"], rigid: Float[Array, "k n 4 4"]
) -> Float[Array, "k n g"]:
    """Mean square of the rigid torque under each gravity, by joint."""
    along = vectors[:, None]
    products = (along @ rigid) * along
    return np.asarray(products.sum(axis=-1))


def is_told(size: Array, power: Array, square: Array) -> Bool[Array, ...]:
    """Whether a torque of mean square `power` tells its size over a rigid one of mean square
    `square`.

    The error of its logarithm is what is left over so many independent states.
    """
    left = np.maximum(power - size**2 * square, 0.0)
    variance = left / square / MASSES.independent
    error = variance / np.maximum(size, 1e-12) ** 2
    is_small = error < DESCRIPTION.size_spread**2
    return np.asarray((size > 0.0) & is_small)


def is_other_unit(factor: Array) -> Bool[Array, ...]:
    """Whether a size over the usual one lies where rather another unit than masses that are off
    makes it.
    """
    distance = np.abs(np.log(factor))
    return np.asarray(distance > np.log(MASSES.other_unit))


def common_size(sums: Sums, gravity: Float[Array, "k g 3"], columns: Array) -> Float[Array, "k g"]:
    """The size that the joints' torques have together, each by how much of its torque the rigid one
    explains.

    Args:
        sums: Of k readings of the motion.
        gravity: Vectors in the base's frame, by reading [m/s²].
        columns: Column of effort of each joint, by reading, shape (k, n).
    """
    vectors = _amounts(gravity)
    rigid = sums.left[:, :, :4, :4]
    mixed = sums.left[:, :, :4, 4:]
    efforts = sums.left[:, :, 4:, 4:]
    square = _squares(vectors, rigid)
    along_every = vectors[:, None] @ mixed
    power_of_every = np.diagonal(efforts, axis1=2, axis2=3)
    along = np.take_along_axis(along_every, columns[:, :, None, None], axis=-1)[..., 0]
    power = np.take_along_axis(power_of_every, columns[:, :, None], axis=-1)
    size = np.abs(along) / np.maximum(square, 1e-12)
    weight = along**2 / np.maximum(square * power, 1e-300)
    bounded = np.clip(size, 1.0 / LIMIT.most_size, LIMIT.most_size)
    total = np.maximum(weight.sum(axis=1), 1e-12)
    mean_log = (weight * np.log(bounded)).sum(axis=1) / total
    return np.asarray(np.exp(mean_log))


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
    joints = np.arange(len(columns))
    table = sums.left[0]
    effort = 4 + columns
    weight = (sizes / left)[:, None]
    of_effort = signs[:, None] * table[joints, :3, effort]
    of_inertia = sizes[:, None] * table[:, :3, 3]
    target = (weight * (of_effort - of_inertia)).sum(axis=0)
    weight_of_square = (weight * sizes[:, None])[..., None]
    normal = (weight_of_square * table[:, :3, :3]).sum(axis=0)
    # Directions that no torque tells stay as far out as they were: zero.
    values, axes = np.linalg.eigh(normal)
    largest = max(float(values[-1]), 1e-300)
    told = values > LIMIT.told_share * largest
    told_axes = axes[:, told]
    amounts = (told_axes.T @ target) / values[told]
    return np.asarray(told_axes @ amounts)


def telling(log: Log) -> Bool[Array, " n"]:
    """Which columns of effort change at all."""
    spread = log.tau.std(axis=0)
    largest = max(float(np.abs(log.tau).max()), 1e-300)
    return np.asarray(spread > 1e-6 * largest)


def moving(log: Log) -> Bool[Array, " n"]:
    """Whether each joint moves at all."""
    return np.asarray(np.ptp(log.q, axis=0) > LIMIT.least_travel)


def evidence_of_columns(log: Log) -> Float[Array, " n"]:
    """Weight of each column of effort: 1 where its joint moves, less where it stands (friction
    holds it), 0 where the column never changes.
    """
    while_moving = np.where(moving(log), 1.0, LIMIT.rest_weight**2)
    return np.where(telling(log), while_moving, 0.0)
