"""A log under a hypothesis: inner products of its torques, and what each joint costs by them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.checks.conventions.description import BODY_PARAMETERS, scale_length, size_price
from ident.checks.conventions.hypothesis import AS_STATED, COMPENSATED, Hypothesis
from ident.checks.conventions.model import Model
from ident.checks.conventions.readings import Log, is_other_unit, is_told
from ident.checks.conventions.settings import DESCRIPTION, SEARCH
from ident.checks.conventions.settings import READINGS as READING
from ident.robot.arm import ArmModel


class Reading(NamedTuple):
    """A log under a hypothesis: what each joint's torque is held against, friction, rotor and
    offset projected out.
    """

    tau: Float[Array, "n T"]
    rigid: Float[Array, "n T"]
    body: Float[Array, "n T 4"]  # torque by mass [1 kg] and first moment [1 kg m] at the last link
    variance: Float[Array, " n"]  # of the recorded torque [(N m)²]
    beyond: Float[Array, " n"]  # whether it is beyond the joint's limit


def gravity_of(hypothesis: Hypothesis, model: Model) -> Float[Array, " 3"]:
    """Gravity in the base's frame, as a hypothesis has it in the effort [m/s²]."""
    if hypothesis.gravity == AS_STATED:
        return model.stated
    if hypothesis.gravity == COMPENSATED:
        return np.zeros(3)
    return np.array(hypothesis.gravity, dtype=float)


def arm_of(hypothesis: Hypothesis, model: Model) -> ArmModel:
    """The arm under a hypothesis's gravity, with its own links where the URDF's are guesses."""
    arm = model.under(gravity_of(hypothesis, model))
    if hypothesis.parameters is None:
        return arm
    return arm.with_inertial_parameters(np.array(hypothesis.parameters))


def states_of(
    log: Log, model: Model, hypothesis: Hypothesis
) -> tuple[Float[Array, "T n"], Float[Array, "T n"], Float[Array, "T n"], Float[Array, "T n"]]:
    """Angles, their first and second derivatives and the torque, as a hypothesis has them."""
    sliding = model.sliding
    q = hypothesis.angles(log.q, sliding)
    dq = hypothesis.rates(log.dq, sliding)
    ddq = hypothesis.rates(log.ddq, sliding)
    direction = np.array(hypothesis.direction)
    sign = direction * np.array(hypothesis.effort_sign)
    columns = np.array(hypothesis.effort_order)
    tau = log.tau[:, columns] * sign
    return q, dq, ddq, tau


def beside_friction(
    columns: Float[Array, "T n k"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]
) -> Float[Array, "n t k"]:
    """Columns of each joint's torque with friction, rotor and offset projected out.

    Rows of a joint that stands count less. The offset's cost is a row more, in which nothing is
    measured.
    """
    samples, n, _ = columns.shape
    is_moving = np.abs(dq) > READING.standing
    weight = np.where(is_moving, 1.0, READING.rest_weight)
    mean_square = np.mean(weight**2, axis=0)
    weight = (weight / np.sqrt(mean_square)).T[..., None]
    friction = [
        np.tanh(dq / READING.transition),
        dq,
        ddq,
        np.ones_like(dq),
    ]
    held = weight * np.stack(friction).transpose(2, 1, 0)
    offset = np.zeros((n, 1, len(friction)))
    offset[..., -1] = np.sqrt(READING.offset_cost * samples)
    with_offset = np.concatenate([held, offset], axis=1)
    beside, _ = np.linalg.qr(with_offset)
    measured = weight * columns.transpose(1, 0, 2)
    nothing = np.zeros((n, 1, measured.shape[-1]))
    wanted = np.concatenate([measured, nothing], axis=1)
    explained = beside @ (beside.transpose(0, 2, 1) @ wanted)
    return np.asarray(wanted - explained)


def read_as(log: Log, model: Model, hypothesis: Hypothesis) -> Reading:
    """A log read as a hypothesis has it."""
    arm = arm_of(hypothesis, model)
    q, dq, ddq, tau = states_of(log, model, hypothesis)
    rigid = hypothesis.mass_factor * arm.inverse_dynamics(q, dq, ddq)
    last_link = 10 * (log.q.shape[1] - 1)
    of_body = range(last_link, last_link + BODY_PARAMETERS)
    table = arm.regressor(q, dq, ddq, of_body)
    torques = np.stack([tau, rigid], axis=-1)
    columns = np.concatenate([torques, table], axis=-1)
    left = beside_friction(columns, dq, ddq)
    order = np.array(hypothesis.effort_order)
    largest = np.abs(log.tau).max(axis=0)
    return Reading(
        tau=left[..., 0],
        rigid=left[..., 1],
        body=left[..., 2:],
        variance=log.tau.var(axis=0)[order],
        beyond=model.beyond_effort(largest[order]),
    )


class Products(NamedTuple):
    """Inner products of a reading's torques, by joint: sizes and bodies follow from them alone.

    Parts are the rigid torque, then what a body's mass and first moment add to it.
    """

    torque: Float[Array, " n"]  # mean square of the recorded torque
    along: Float[Array, "n 5"]  # of the recorded torque with each part
    parts: Float[Array, "n 5 5"]  # of the parts with one another
    variance: Float[Array, " n"]  # of the recorded torque before friction was projected out
    beyond: Float[Array, " n"]  # whether it is beyond the joint's limit


def products_of(reading: Reading) -> Products:
    """Mean inner products of a reading's torques over its samples, by joint."""
    parts = np.concatenate([reading.rigid[..., None], reading.body], axis=-1)
    samples = parts.shape[1]
    transposed = parts.transpose(0, 2, 1)
    torque = reading.tau[..., None]
    return Products(
        torque=(reading.tau**2).mean(axis=1),
        along=(transposed @ torque)[..., 0] / samples,
        parts=transposed @ parts / samples,
        variance=np.maximum(reading.variance, 1e-300),
        beyond=reading.beyond,
    )


def amounts(factor: float, body: Float[Array, " 4"] | None = None) -> Float[Array, " 5"]:
    """How much of each of `Products`' parts a torque has: a factor of all masses, and a body.

    Args:
        factor: Of the rigid torque.
        body: Mass [kg] and first moment [kg m] of a body at the last link; none if None.
    """
    if body is None:
        body = np.zeros(BODY_PARAMETERS)
    return np.concatenate([[factor], body])


class SizedTorque(NamedTuple):
    """What each joint costs with a rigid torque, its size chosen."""

    plain_costs: Float[Array, " n"]  # all joints in one unit
    plain_sizes: Float[Array, " n"]  # of each joint's torque over the model's
    costs: Float[Array, " n"]  # some in another unit, without what that is unlikely
    sizes: Float[Array, " n"]
    other_unit: Bool[Array, " n"]  # whether the size is another unit's
    doubtful: int | None = None  # joint whose size may be, but explains less than that costs
    doubtful_cost: float = 0.0  # of that joint in another unit, without what that is unlikely
    doubtful_size: float = 1.0


def cost_with(products: Products, amount: Float[Array, " 5"]) -> SizedTorque:
    """What each joint costs with so much of each part (see `readings.unexplained`)."""
    square = np.maximum((products.parts @ amount) @ amount, 1e-12)
    along = products.along @ amount
    power = products.torque
    free = along / square
    best = np.clip(free, 1.0 / READING.most_size, READING.most_size)
    shares = np.array(READING.shares)[:, None]
    tried = best[None] ** shares
    rest = np.maximum(power - 2.0 * tried * along + tried**2 * square, 0.0)
    explained = np.log(rest / products.variance + READING.floor)
    cost = explained + size_price(np.log(tried))
    chosen = np.argmin(cost, axis=0)
    joints = np.arange(len(best))
    costs = cost[chosen, joints]
    sizes = tried[chosen, joints]
    # In another unit it may be within its limit.
    by_best = explained[-1]
    price_of_unit = scale_length(len(best)) / DESCRIPTION.observations
    in_other_unit = by_best + price_of_unit - SEARCH.limit_cost * products.beyond
    is_possible = is_told(free, power, square) & is_other_unit(best)
    other = is_possible & (in_other_unit < costs)
    fit = SizedTorque(
        plain_costs=costs,
        plain_sizes=sizes,
        costs=np.where(other, by_best, costs),
        sizes=np.where(other, best, sizes),
        other_unit=other,
    )
    gains = np.where(is_possible & ~other, costs - by_best, 0.0)
    joint = int(np.argmax(gains))
    if gains[joint] <= 0.0:
        return fit
    return fit._replace(
        doubtful=joint,
        doubtful_cost=float(by_best[joint]),
        doubtful_size=float(best[joint]),
    )
