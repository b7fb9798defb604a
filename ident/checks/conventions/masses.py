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

from ident.arrays import Array, Float
from ident.checks.conventions.description import load_price
from ident.checks.conventions.hypothesis import Hypothesis
from ident.checks.conventions.model import Model
from ident.checks.conventions.products import (
    Products,
    SizedTorque,
    amounts,
    beside_friction,
    cost_with,
    products_of,
    read_as,
    states_of,
)
from ident.checks.conventions.readings import Log
from ident.checks.conventions.settings import DESCRIPTION
from ident.checks.conventions.settings import MASSES as LIMIT
from ident.checks.conventions.settings import READINGS as READING


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
    logs = np.log(np.where(told, size, 1.0))
    variance = error / np.maximum(size, 1e-12) ** 2
    return logs, np.where(told, variance, np.inf)


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
    around_one = _spread_around(logs, 0.0, weight, variance)
    around_middle = _spread_around(logs, middle, weight, variance)
    error = variance[weight > 0.0]
    gain = _gain_of_spreads(around_one, around_middle, error)
    return float(np.exp(middle)), gain


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
    variance_before = before**2 + error
    variance_after = after**2 + error
    return 0.5 * float(np.log(variance_before / variance_after).sum())


def _agreeing(logs: Float[Array, " n"], variance: Float[Array, " n"]) -> Float[Array, " n"] | None:
    """Weight of each joint's size, zero for those in another unit; None where too few tell it."""
    usual = float(DESCRIPTION.size_spread)
    telling_joints = usual**2 / (usual**2 + variance)
    if float(telling_joints.sum()) < LIMIT.fewest_sizes:
        return None
    weight = 1.0 / (LIMIT.scatter**2 + variance)
    middle = _weighted_median(logs, weight)
    apart = np.abs(logs - middle)
    return np.where(apart < np.log(LIMIT.other_unit), weight, 0.0)


def _weighted_median(values: Float[Array, " n"], weight: Float[Array, " n"]) -> float:
    """The value below and above which lies half of the weight."""
    order = np.argsort(values)
    share = np.cumsum(weight[order])
    middle = np.searchsorted(share, 0.5 * share[-1])
    return float(values[order][middle])


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
    spread = np.sqrt(max(mean, 0.0))
    return float(np.clip(spread, float(LIMIT.scatter), float(DESCRIPTION.size_spread)))


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
        trust = np.where(fit.other_unit, 0.0, np.exp(-fit.costs))
        weight = trust / products.variance
        normal = np.tensordot(weight, products.parts, axes=1)
        target = weight @ products.along
        if is_given:
            target = target - amount[0] * normal[0]
        power = np.maximum(np.diagonal(normal), 1e-300)
        size = np.sqrt(power)[asked]
        scaled = normal[asked, asked] / (size[:, None] * size[None, :])
        scaled = scaled + LIMIT.ridge * np.eye(len(size))
        solution = np.linalg.solve(scaled, target[asked] / size)
        amount[asked] = solution / size
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
    unscaled = replace(hypothesis, mass_factor=1.0)
    products = products_of(read_as(log, model, unscaled))
    yield from _variants(hypothesis, cost_with(products, amounts(1.0)))
    factor, agreement = common_factor(products)
    if is_unusual(factor):
        multiplied = replace(hypothesis, mass_factor=factor)
        fit = cost_with(products, amounts(factor))
        yield from _variants(multiplied, fit, -agreement / DESCRIPTION.observations)
    alone = end_body(products, 1.0)
    fit = cost_with(products, alone)
    yield from _variants(_with_body(hypothesis, alone), fit, _price_of_body(alone, model))
    amount = end_body(products)
    if is_unusual(float(amount[0])):
        agreement = gain_of_agreeing(products, alone, amount)
        more = _price_of_body(amount, model)
        more -= agreement / DESCRIPTION.observations
        fit = cost_with(products, amount)
        yield from _variants(_with_body(hypothesis, amount), fit, more)


def _with_body(hypothesis: Hypothesis, amount: Float[Array, " 5"]) -> Hypothesis:
    """The reading with a factor of all masses and a body."""
    factor, mass, x, y, z = (float(value) for value in amount)
    return replace(hypothesis, mass_factor=factor, body=(mass, x, y, z))


def _price_of_body(amount: Float[Array, " 5"], model: Model) -> float:
    """What a body of its mass costs at the end of an arm whose masses are multiplied."""
    factor = float(amount[0])
    mass = abs(float(amount[1]))
    return load_price(mass / (factor * model.mass))


def is_unusual(factor: float) -> bool:
    """Whether a factor of all masses is farther from one than URDFs and gains usually are."""
    return bool(abs(np.log(factor)) > np.log(LIMIT.usual_factor))


def _variants(hypothesis: Hypothesis, fit: SizedTorque, more: float = 0.0) -> Iterator[Variant]:
    """A reading, and with the joints that are in another unit where there are any.

    Once more with the joint of which that explains some of what it costs: a rival.
    """
    yield Variant(hypothesis, fit.plain_costs, fit.plain_sizes, more)
    scales = {}
    for joint in np.flatnonzero(fit.other_unit).tolist():
        scales[joint] = float(fit.sizes[joint])
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
    by_joint = tuple(sorted(scales.items()))
    scaled = replace(hypothesis, effort_scale=by_joint)
    return Variant(scaled, costs, sizes, more)


def guessed_masses(log: Log, model: Model) -> Variant | None:
    """The log as it is, and the links that its torques ask for in place of the URDF's.

    Weighted least squares from the URDF's parameters on, each joint by what it leaves, in the
    directions that the motion tells: their number is the length of the description. None of an arm
    of one joint, whose zero, direction and centre of mass are one.

    Source: base parameters as in Gautier and Khalil, Direct calculation of minimum set of inertial
    parameters of serial robots, IEEE T-RA 6 (1990).
    """
    n = log.q.shape[1]
    if n < 2:
        return None
    plain = Hypothesis.as_it_is(n)
    q, dq, ddq, tau = states_of(log, model, plain)
    nominal = model.arm.inertial_parameters
    table = model.arm.regressor(q, dq, ddq)
    rest = tau - table @ nominal
    columns = np.concatenate([rest[..., None], table], axis=-1)
    left = beside_friction(columns, dq, ddq)
    variance = np.maximum(log.tau.var(axis=0), 1e-300)
    change, told = _change_of_links(left[..., 0], left[..., 1:], variance)
    guess = replace(plain, parameters=tuple((nominal + change).tolist()))
    products = products_of(read_as(log, model, guess))
    fit = cost_with(products, amounts(1.0))
    length = 0.5 * told * np.log(LIMIT.independent)
    return Variant(
        hypothesis=guess,
        costs=fit.plain_costs,
        sizes=fit.plain_sizes,
        more=length / DESCRIPTION.observations,
    )


def _change_of_links(
    target: Float[Array, "n t"], columns: Float[Array, "n t p"], variance: Float[Array, " n"]
) -> tuple[Float[Array, " p"], int]:
    """Change of all inertial numbers that torques ask for, and how many directions tell it.

    Args:
        target: Torque of each joint that the URDF's numbers leave, friction projected out.
        columns: Torque by each inertial number, likewise.
        variance: Of each joint's recorded torque.
    """
    transposed = columns.transpose(0, 2, 1)
    squares = transposed @ columns
    along = (transposed @ target[..., None])[..., 0]
    change = np.zeros(columns.shape[-1])
    told = 0
    share = np.ones_like(variance)
    for _ in range(LIMIT.rounds):
        weight = 1.0 / (share * variance)
        normal = np.tensordot(weight, squares, axes=1)
        change, told = _least_change(normal, weight @ along)
        residual = target - columns @ change
        mean_square = (residual**2).mean(axis=1)
        share = mean_square / variance + READING.floor
    return change, told


def _least_change(
    normal: Float[Array, "p p"], wanted: Float[Array, " p"]
) -> tuple[Float[Array, " p"], int]:
    """The shortest solution of normal equations in the directions that are told, and how many
    are.
    """
    size = np.sqrt(np.maximum(np.diagonal(normal), 0.0))
    is_seen = size > READING.told_share * size.max()
    scale = np.where(is_seen, 1.0 / np.maximum(size, 1e-300), 0.0)
    scaled = normal * scale[:, None] * scale[None, :]
    values, axes = np.linalg.eigh(scaled)
    largest = max(float(values[-1]), 1e-300)
    is_told_axis = values > READING.told_share * largest
    axes = axes[:, is_told_axis]
    values = values[is_told_axis]
    along_axes = (axes.T @ (scale * wanted)) / values
    change = scale * (axes @ along_axes)
    return np.asarray(change), len(values)
