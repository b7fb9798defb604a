"""What is left to the URDF's masses and the torque's unit once a log is read: one factor, one
joint's, one body, or all of them.

All masses by one factor are seen by sizes that agree among the joints better than with one; the
effort of one joint in another unit by its size; a body at the end of the arm that the URDF lacks,
or has too much, by what all joints carry of it: mass and first moment in the last link's frame, to
which every joint's torque is linear.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.checks.conventions.description import (
    BODY_PARAMETERS,
    DESCRIPTION,
    SEARCH,
    load_price,
    scale_length,
    size_price,
)
from ident.checks.conventions.hypothesis import AS_STATED, COMPENSATED, Hypothesis
from ident.checks.conventions.readings import LIMIT as READING
from ident.checks.conventions.readings import Log, Model, is_other_unit, is_told
from ident.records import read_group
from ident.robot.arm import ArmModel

LIMIT = read_group(__file__, "masses")


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
    sign = np.array(hypothesis.direction) * np.array(hypothesis.effort_sign)
    tau = log.tau[:, np.array(hypothesis.effort_order)] * sign
    return q, dq, ddq, tau


def beside_friction(
    columns: Float[Array, "T n k"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]
) -> Float[Array, "n t k"]:
    """Columns of each joint's torque with friction, rotor and offset projected out.

    Rows of a joint that stands count less. The offset's cost is a row more, in which nothing is
    measured.
    """
    samples, n, _ = columns.shape
    weight = np.where(np.abs(dq) > READING.standing, 1.0, READING.rest_weight)
    weight = (weight / np.sqrt(np.mean(weight**2, axis=0))).T[..., None]
    friction = [np.tanh(dq / READING.transition), dq, ddq, np.ones_like(dq)]
    held = weight * np.stack(friction).transpose(2, 1, 0)
    offset = np.zeros((n, 1, len(friction)))
    offset[..., -1] = np.sqrt(READING.offset_cost * samples)
    beside, _ = np.linalg.qr(np.concatenate([held, offset], axis=1))
    wanted = weight * columns.transpose(1, 0, 2)
    wanted = np.concatenate([wanted, np.zeros((n, 1, wanted.shape[-1]))], axis=1)
    return np.asarray(wanted - beside @ (beside.transpose(0, 2, 1) @ wanted))


def read_as(log: Log, model: Model, hypothesis: Hypothesis) -> Reading:
    """A log read as a hypothesis has it."""
    arm = arm_of(hypothesis, model)
    q, dq, ddq, tau = states_of(log, model, hypothesis)
    rigid = hypothesis.mass_factor * arm.inverse_dynamics(q, dq, ddq)
    last_link = 10 * (log.q.shape[1] - 1)
    table = arm.regressor(q, dq, ddq, range(last_link, last_link + BODY_PARAMETERS))
    columns = np.concatenate([np.stack([tau, rigid], axis=-1), table], axis=-1)
    left = beside_friction(columns, dq, ddq)
    order = np.array(hypothesis.effort_order)
    beyond = model.beyond_effort(np.abs(log.tau).max(axis=0)[order])
    return Reading(left[..., 0], left[..., 1], left[..., 2:], log.tau.var(axis=0)[order], beyond)


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
    return Products(
        (reading.tau**2).mean(axis=1),
        (transposed @ reading.tau[..., None])[..., 0] / samples,
        transposed @ parts / samples,
        np.maximum(reading.variance, 1e-300),
        reading.beyond,
    )


def amounts(factor: float, body: Float[Array, " 4"] | None = None) -> Float[Array, " 5"]:
    """How much of each of `Products`' parts a torque has: a factor of all masses, and a body.

    Args:
        factor: Of the rigid torque.
        body: Mass [kg] and first moment [kg m] of a body at the last link; none if None.
    """
    return np.concatenate([[factor], np.zeros(BODY_PARAMETERS) if body is None else body])


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
    own = products.torque
    free = along / square
    best = np.clip(free, 1.0 / READING.most_size, READING.most_size)
    tried = best[None] ** np.array(READING.shares)[:, None]
    rest = np.maximum(own - 2.0 * tried * along + tried**2 * square, 0.0)
    explained = np.log(rest / products.variance + READING.floor)
    cost = explained + size_price(np.log(tried))
    chosen = np.argmin(cost, axis=0)
    joints = np.arange(len(best))
    costs, sizes = cost[chosen, joints], tried[chosen, joints]
    price_of_unit = scale_length(len(best)) / DESCRIPTION.observations
    # In another unit it may be within its limit.
    in_other_unit = explained[-1] + price_of_unit - SEARCH.limit_cost * products.beyond
    is_possible = is_told(free, own, square) & is_other_unit(best)
    other = is_possible & (in_other_unit < costs)
    scaled = np.where(other, explained[-1], costs)
    gains = np.where(is_possible & ~other, costs - explained[-1], 0.0)
    joint = int(np.argmax(gains))
    doubtful = (
        (joint, float(explained[-1, joint]), float(best[joint])) if gains[joint] > 0.0 else ()
    )
    return SizedTorque(costs, sizes, scaled, np.where(other, best, sizes), other, *doubtful)


def sizes_beside(
    products: Products, amount: Float[Array, " 5"]
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Logarithm of each joint's size over the model's with so much of each part, and its variance;
    infinite where nothing tells it.
    """
    square = np.maximum((products.parts @ amount) @ amount, 1e-12)
    along = products.along @ amount
    size = along / square
    left = np.maximum(products.torque - size * along, 0.0)
    # States follow one another: a few are independent.
    error = left / square / LIMIT.independent
    told = (size > 0.0) & (along > 0.0)
    return np.log(np.where(told, size, 1.0)), np.where(
        told, error / np.maximum(size, 1e-12) ** 2, np.inf
    )


def common_factor(products: Products) -> tuple[float, float]:
    """The factor by which all joints' torques are off together, and what their agreeing on it says
    for it [nats].

    A joint in another unit than the others is none of them.

    Returns:
        1 and 0 nats where too few joints tell a size.
    """
    logs, variance = sizes_beside(products, amounts(1.0))
    weight = _agreeing(logs, variance)
    if weight is None:
        return 1.0, 0.0
    middle = float(weight @ logs / weight.sum())
    around_one, around_it = (
        _spread_around(logs, centre, weight, variance) for centre in (0.0, middle)
    )
    return float(np.exp(middle)), _gain_of_spreads(around_one, around_it, variance[weight > 0.0])


def gain_of_agreeing(
    products: Products, before: Float[Array, " 5"], after: Float[Array, " 5"]
) -> float:
    """By how much the joints' sizes agree better with one, beside so much of each part [nats]."""
    logs, variance = sizes_beside(products, before)
    others, other_variance = sizes_beside(products, after)
    weight = _agreeing(others, other_variance)
    if weight is None:
        return 0.0
    around_before = _spread_around(logs, 0.0, weight, variance)
    around_after = _spread_around(others, 0.0, weight, other_variance)
    return _gain_of_spreads(around_before, around_after, other_variance[weight > 0.0])


def _gain_of_spreads(before: float, after: float, error: Float[Array, " k"]) -> float:
    """What sizes say for the centre around which they scatter less [nats].

    Those that lie as near together as sound URDFs' do are the likelier the nearer, by the spread
    that they have in place of the usual one, each beside its own error,

        1/2 sum log((before² + error²) / (after² + error²)).
    """
    return 0.5 * float(np.log((before**2 + error) / (after**2 + error)).sum())


def _agreeing(logs: Float[Array, " n"], variance: Float[Array, " n"]) -> Float[Array, " n"] | None:
    """Weight of each joint's size, zero for those in another unit; None where too few tell it."""
    usual = float(DESCRIPTION.size_spread)
    telling_joints = usual**2 / (usual**2 + variance)
    if float(telling_joints.sum()) < LIMIT.fewest_sizes:
        return None
    weight = 1.0 / (LIMIT.scatter**2 + variance)
    apart = np.abs(logs - _weighted_median(logs, weight))
    return np.where(apart < np.log(LIMIT.other_unit), weight, 0.0)


def _weighted_median(values: Float[Array, " n"], weight: Float[Array, " n"]) -> float:
    """The value below and above which lies half of the weight."""
    order = np.argsort(values)
    share = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(share, 0.5 * share[-1])])


def _spread_around(
    logs: Float[Array, " n"],
    centre: float,
    weight: Float[Array, " n"],
    variance: Float[Array, " n"],
) -> float:
    """Standard deviation of sizes around a centre, their errors taken off: between what URDFs have
    at least and what joints have usually.
    """
    agreeing = weight > 0.0
    square = (logs[agreeing] - centre) ** 2 - variance[agreeing]
    mean = float(weight[agreeing] @ square / weight[agreeing].sum())
    lowest, highest = float(LIMIT.scatter), float(DESCRIPTION.size_spread)
    return float(np.clip(np.sqrt(max(mean, 0.0)), lowest, highest))


def end_body(products: Products, factor: float | None = None) -> Float[Array, " 5"]:
    """Factor of all masses, and mass and first moment at the last link that the torques ask for
    beside the model's.

    Each joint counts by what it leaves.

    Args:
        products: A log's, and the URDF's torque.
        factor: Of all masses, where it is known.
    """
    is_given = factor is not None
    amount = amounts(1.0 if factor is None else factor)
    asked = slice(1, None) if is_given else slice(None)
    for _ in range(LIMIT.rounds):
        fit = cost_with(products, amount)
        # A joint in another unit tells nothing of a mass in kilograms.
        weight = np.where(fit.other_unit, 0.0, np.exp(-fit.costs)) / products.variance
        normal = np.tensordot(weight, products.parts, axes=1)
        target = weight @ products.along
        if is_given:
            target = target - amount[0] * normal[0]
        size = np.sqrt(np.maximum(np.diagonal(normal), 1e-300))[asked]
        scaled = normal[asked, asked] / (size[:, None] * size[None, :])
        scaled = scaled + LIMIT.ridge * np.eye(len(size))
        amount[asked] = np.linalg.solve(scaled, target[asked] / size) / size
        amount[0] = np.clip(amount[0], 1.0 / READING.most_size, READING.most_size)
    return amount


class Variant(NamedTuple):
    """A reading with what may be said of the masses beside it."""

    hypothesis: Hypothesis
    costs: Float[Array, " n"]  # of each joint
    sizes: Float[Array, " n"]  # of each joint's torque over the model's
    more: float = 0.0  # what a load of its mass is unlikely, less what sizes say that agree


def variants(hypothesis: Hypothesis, log: Log, model: Model) -> Iterator[Variant]:
    """A reading alone, with one factor of all masses, with a body at the end, and with both.

    Efforts of single joints in another unit are told with each of them, where they explain more
    than they cost.
    """
    products = products_of(read_as(log, model, replace(hypothesis, mass_factor=1.0)))
    yield from _variants(hypothesis, cost_with(products, amounts(1.0)))
    factor, agreement = common_factor(products)
    if is_unusual(factor):
        scaled = cost_with(products, amounts(factor))
        yield from _variants(
            replace(hypothesis, mass_factor=factor), scaled, -agreement / DESCRIPTION.observations
        )
    alone = end_body(products, 1.0)
    yield from _variants(
        _with_body(hypothesis, alone), cost_with(products, alone), _price_of_body(alone, model)
    )
    amount = end_body(products)
    if is_unusual(float(amount[0])):
        more = _price_of_body(amount, model)
        more -= gain_of_agreeing(products, alone, amount) / DESCRIPTION.observations
        yield from _variants(_with_body(hypothesis, amount), cost_with(products, amount), more)


def _with_body(hypothesis: Hypothesis, amount: Float[Array, " 5"]) -> Hypothesis:
    """The reading with a factor of all masses and a body."""
    factor, mass, x, y, z = (float(value) for value in amount)
    return replace(hypothesis, mass_factor=factor, body=(mass, x, y, z))


def _price_of_body(amount: Float[Array, " 5"], model: Model) -> float:
    """What a body of its mass costs at the end of an arm whose masses are multiplied."""
    return load_price(abs(float(amount[1])) / (float(amount[0]) * model.mass))


def is_unusual(factor: float) -> bool:
    """Whether a factor of all masses is farther from one than URDFs and gains usually are."""
    return bool(abs(np.log(factor)) > np.log(LIMIT.usual_factor))


def _variants(hypothesis: Hypothesis, fit: SizedTorque, more: float = 0.0) -> Iterator[Variant]:
    """A reading, and with the joints that are in another unit where there are any.

    Once more with the joint of which that explains some of what it costs: a rival.
    """
    yield Variant(hypothesis, fit.plain_costs, fit.plain_sizes, more)
    scales = {int(j): float(fit.sizes[j]) for j in np.flatnonzero(fit.other_unit)}
    if scales:
        yield _scaled(hypothesis, scales, fit.costs, fit.sizes, more)
    if fit.doubtful is not None:
        scales[fit.doubtful] = fit.doubtful_size
        costs = fit.costs.copy()
        costs[fit.doubtful] = fit.doubtful_cost
        sizes = fit.sizes.copy()
        sizes[fit.doubtful] = fit.doubtful_size
        yield _scaled(hypothesis, scales, costs, sizes, more)


def _scaled(
    hypothesis: Hypothesis,
    scales: dict[int, float],
    costs: Float[Array, " n"],
    sizes: Float[Array, " n"],
    more: float,
) -> Variant:
    """A reading with some joints' efforts in units of their own, their sizes by joint."""
    return Variant(
        replace(hypothesis, effort_scale=tuple(sorted(scales.items()))), costs, sizes, more
    )


def guessed_masses(log: Log, model: Model) -> Variant | None:
    """The log as it is, and the links that its torques ask for in place of the URDF's.

    Weighted least squares from the URDF's parameters on, each joint by what it leaves, in the
    directions that the motion tells: their number is the length of the description. None of an arm
    of one joint, whose zero, direction and centre of mass are one.

    Source: base parameters as in Gautier and Khalil, Direct calculation of minimum set of inertial
    parameters of serial robots, IEEE T-RA 6 (1990).
    """
    plain = Hypothesis.as_it_is(log.q.shape[1])
    if log.q.shape[1] < 2:
        return None
    q, dq, ddq, tau = states_of(log, model, plain)
    nominal = model.arm.inertial_parameters
    table = model.arm.regressor(q, dq, ddq)
    rest = tau - table @ nominal
    left = beside_friction(np.concatenate([rest[..., None], table], axis=-1), dq, ddq)
    target, columns = left[..., 0], left[..., 1:]
    transposed = columns.transpose(0, 2, 1)
    squares = transposed @ columns
    along = (transposed @ target[..., None])[..., 0]
    variance = np.maximum(log.tau.var(axis=0), 1e-300)
    change = np.zeros_like(nominal)
    told = 0
    share = np.ones_like(variance)
    for _ in range(LIMIT.rounds):
        weight = 1.0 / (share * variance)
        normal = np.tensordot(weight, squares, axes=1)
        wanted = weight @ along
        change, told = _least_change(normal, wanted)
        share = ((target - columns @ change) ** 2).mean(axis=1) / variance + READING.floor
    guess = replace(plain, parameters=tuple((nominal + change).tolist()))
    fit = cost_with(products_of(read_as(log, model, guess)), amounts(1.0))
    length = 0.5 * told * np.log(LIMIT.independent)
    return Variant(guess, fit.plain_costs, fit.plain_sizes, length / DESCRIPTION.observations)


def _least_change(
    normal: Float[Array, "p p"], wanted: Float[Array, " p"]
) -> tuple[Float[Array, " p"], int]:
    """The shortest solution of normal equations in the directions that are told, and how many
    are.
    """
    size = np.sqrt(np.maximum(np.diagonal(normal), 0.0))
    scale = np.where(size > READING.told_share * size.max(), 1.0 / np.maximum(size, 1e-300), 0.0)
    values, axes = np.linalg.eigh(normal * scale[:, None] * scale[None, :])
    is_told_axis = values > READING.told_share * max(float(values[-1]), 1e-300)
    axes, values = axes[:, is_told_axis], values[is_told_axis]
    return np.asarray(scale * (axes @ ((axes.T @ (scale * wanted)) / values))), len(values)
