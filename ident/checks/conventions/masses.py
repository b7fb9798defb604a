"""What is left to the URDF's masses and the torque's unit once a log is read: one factor, one joint's, or one body.

All masses by one factor are seen by sizes that agree among the joints better than with one; the effort of one joint in
another unit by its size; a body at the end of the arm that the URDF lacks, or has too much, by what all joints carry of
it: mass and first moment in the last link's frame, to which every joint's torque is linear.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Float
from ident.checks.conventions.hypothesis import AS_STATED, COMPENSATED, Hypothesis
from ident.checks.conventions.readings import LIMIT as READING
from ident.checks.conventions.readings import Log, Model
from ident.records import read_group

LIMIT = read_group(__file__, "masses")

BODY_PARAMETERS = 4  # mass and first moment


class Reading(NamedTuple):
    """A log under a hypothesis: what each joint's torque is held against, friction, rotor and offset projected out."""

    tau: Float[Array, "n T"]
    rigid: Float[Array, "n T"]
    body: Float[Array, "n T 4"]  # torque by mass [1 kg] and first moment [1 kg m] at the last link
    variance: Float[Array, " n"]  # of the recorded torque [(N m)²]


def gravity_of(hypothesis: Hypothesis, model: Model) -> Float[Array, " 3"]:
    """Gravity in the base's frame, as a hypothesis has it in the effort [m/s²]."""
    if hypothesis.gravity == AS_STATED:
        return model.stated
    if hypothesis.gravity == COMPENSATED:
        return np.zeros(3)
    return np.array(hypothesis.gravity, dtype=float)


def read_as(log: Log, model: Model, hypothesis: Hypothesis) -> Reading:
    """A log read as a hypothesis has it."""
    sliding, n = model.sliding, log.q.shape[1]
    q = hypothesis.angles(log.q, sliding)
    dq, ddq = hypothesis.rates(log.dq, sliding), hypothesis.rates(log.ddq, sliding)
    arm = model.arm.with_gravity(gravity_of(hypothesis, model))
    columns = np.array(hypothesis.effort_order)
    tau = log.tau[:, columns] * np.array(hypothesis.direction) * np.array(hypothesis.effort_sign)
    rigid = hypothesis.mass_factor * arm.inverse_dynamics(q, dq, ddq)
    first = 10 * (n - 1)
    table = arm.regressor(q, dq, ddq, range(first, first + BODY_PARAMETERS))
    taus, rigids, bodies = [], [], []
    for j in range(n):
        weight = np.where(np.abs(dq[:, j]) > READING.standing, 1.0, READING.rest_weight)
        weight = weight / np.sqrt(np.mean(weight**2))
        held = np.column_stack([np.tanh(dq[:, j] / READING.transition), dq[:, j], ddq[:, j], np.ones(len(q))])
        # The offset's cost is a row more, in which nothing is measured.
        price = np.zeros((1, 4))
        price[0, 3] = np.sqrt(READING.offset_cost * len(q))
        beside, _ = np.linalg.qr(np.concatenate([held * weight[:, None], price]))
        wanted = np.column_stack([tau[:, j], rigid[:, j], table[:, j]]) * weight[:, None]
        wanted = np.concatenate([wanted, np.zeros((1, wanted.shape[1]))])
        wanted = wanted - beside @ (beside.T @ wanted)
        taus.append(wanted[:, 0])
        rigids.append(wanted[:, 1])
        bodies.append(wanted[:, 2:])
    return Reading(np.array(taus), np.array(rigids), np.array(bodies), log.tau.var(axis=0)[columns])


def cost_at(reading: Reading, rigid: Float[Array, "n T"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """What each joint costs with a rigid torque, its size chosen, and that size (see `readings.unexplained`)."""
    square = np.maximum((rigid**2).mean(axis=1), 1e-12)
    along = (reading.tau * rigid).mean(axis=1)
    own = (reading.tau**2).mean(axis=1)
    best = np.clip(along / square, 1.0 / READING.most_size, READING.most_size)
    tried = best[None] ** np.array(READING.shares)[:, None]
    left = np.maximum(own - 2.0 * tried * along + tried**2 * square, 0.0) / np.maximum(reading.variance, 1e-300)
    cost = np.log(left + READING.floor) + READING.size_cost * np.log(tried) ** 2
    chosen = np.argmin(cost, axis=0)
    joints = np.arange(len(best))
    return cost[chosen, joints], tried[chosen, joints]


def free_sizes(reading: Reading) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Logarithm of each joint's size over the model's, and its variance; infinite where nothing tells it."""
    square = (reading.rigid**2).mean(axis=1)
    along = (reading.tau * reading.rigid).mean(axis=1)
    size = along / np.maximum(square, 1e-12)
    left = np.maximum((reading.tau**2).mean(axis=1) - size * along, 0.0)
    # States follow one another: a few are independent.
    error = left / np.maximum(square, 1e-12) / LIMIT.independent
    told = (size > 0.0) & (along > 0.0)
    return np.log(np.where(told, size, 1.0)), np.where(told, error / np.maximum(size, 1e-12) ** 2, np.inf)


def common_factor(reading: Reading) -> tuple[float, float]:
    """The factor by which all joints' torques are off together, and what it explains [nats].

    Sizes scatter around it as those of a URDF that is off do around one, by an unknown spread.
    """
    logs, variance = free_sizes(reading)
    weight = 1.0 / (1.0 + variance / LIMIT.scatter**2)
    total = float(weight.sum())
    if total < LIMIT.fewest_sizes:
        return 1.0, 0.0
    middle = float(weight @ logs / total)
    least = total * LIMIT.scatter**2
    around_one, around_it = (float(weight @ (logs - centre) ** 2) + least for centre in (0.0, middle))
    return float(np.exp(middle)), 0.5 * total * float(np.log(around_one / around_it))


def end_body(reading: Reading) -> Float[Array, " 4"]:
    """Mass and first moment at the last link that the torques ask for beside the model's.

    Each joint counts by what it leaves.
    """
    found = np.zeros(BODY_PARAMETERS)
    costs, _ = cost_at(reading, reading.rigid)
    for _ in range(LIMIT.rounds):
        left = np.exp(costs) * np.maximum(reading.variance, 1e-300)
        weight = 1.0 / left
        rest = reading.tau - reading.rigid
        normal = np.einsum("j,jtp,jtq->pq", weight, reading.body, reading.body)
        target = np.einsum("j,jtp,jt->p", weight, reading.body, rest)
        size = np.sqrt(np.maximum(np.diagonal(normal), 1e-300))
        scaled = normal / (size[:, None] * size[None, :]) + LIMIT.ridge * np.eye(BODY_PARAMETERS)
        found = np.linalg.solve(scaled, target / size) / size
        costs, _ = cost_at(reading, reading.rigid + reading.body @ found)
    return np.asarray(found)


class Variant(NamedTuple):
    """A reading with what may be said of the masses beside it."""

    hypothesis: Hypothesis
    more: float  # what it costs more, or less, than the reading alone [nats]
    costs: Float[Array, " n"]  # of each joint
    sizes: Float[Array, " n"]  # of each joint's torque over the model's


def variants(hypothesis: Hypothesis, log: Log, model: Model) -> Iterator[Variant]:
    """A reading alone; with one factor of all masses; with other units of single efforts; with a body at the end."""
    reading = read_as(log, model, hypothesis)
    costs, sizes = cost_at(reading, reading.rigid)
    yield Variant(hypothesis, 0.0, costs, sizes)
    factor, gain = common_factor(reading)
    if abs(np.log(factor)) > np.log(LIMIT.usual_factor) and hypothesis.mass_factor == 1.0:
        at_factor, sizes_then = cost_at(reading, factor * reading.rigid)
        yield Variant(replace(hypothesis, mass_factor=factor), LIMIT.factor_cost - gain, at_factor, sizes_then)
    logs, variance = free_sizes(reading)
    off = (np.abs(logs) > np.log(LIMIT.other_unit)) & (variance < LIMIT.scatter)
    if off.any():
        rest = reading.tau - np.exp(logs)[:, None] * reading.rigid
        free = np.log((rest**2).mean(axis=1) / np.maximum(reading.variance, 1e-300) + READING.floor)
        at_scale = np.where(off, free, costs)
        scales = tuple((int(j), float(np.exp(logs[j]))) for j in np.flatnonzero(off))
        more = LIMIT.scale_cost * len(scales) + float((at_scale - costs).sum())
        yield Variant(replace(hypothesis, effort_scale=scales), more, at_scale, sizes)
    body = end_body(reading)
    with_body, sizes_then = cost_at(reading, reading.rigid + reading.body @ body)
    mass, x, y, z = (float(value) for value in body)
    # Arms carry less than they weigh.
    heavy = LIMIT.heavy_cost * float(np.log1p(abs(mass) / model.arm.inertial_parameters[::10].sum())) ** 2
    more = LIMIT.body_cost + heavy + float((with_body - costs).sum())
    yield Variant(replace(hypothesis, body=(mass, x, y, z)), more, with_body, sizes_then)
