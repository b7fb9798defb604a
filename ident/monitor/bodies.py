"""Masses and centres of links, what the flange carries, and how late the torque is, in one session.

All joints together, through the common filter and clear of reversals, with each joint's losses:

    tau = Y (π + δ) + rotor ddq + viscous dq + coulomb sign(dq) + offset − delay · d(Y π)/dt

The links' changes δ have a normal prior as wide as URDFs are wrong by: what recordings don't
determine stays as wide as that. What the flange carries is found apart, with the links as they are:
a body at the last link, without a prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from ident.arrays import Array, Float, Int
from ident.monitor.estimates import PIECE_S, ParameterEstimate
from ident.motion.motion import Motion
from ident.regression.settings import USUAL_REGRESSION
from ident.robot.arm import ArmModel
from ident.robot.tolerance import parameter_scale

AXES = ("x", "y", "z")
# Losses of a joint beside its bodies: rotor, damping, dry friction, offset.
LOSSES = 4
# Fewer pieces tell no error.
LEAST_PIECES = 10
# What belongs to no joint and no link.
FLANGE = "flange"
ARM = "arm"
REACH = float(ndtri(0.975))

Estimated = dict[tuple[str, str], ParameterEstimate]


@dataclass(frozen=True, eq=False)
class SessionRows:
    """Rows of all joints, each over its joint's noise."""

    columns: Float[Array, "R k"]  # ten a link, then the delay's, then those of each joint's losses
    torque: Float[Array, " R"]  # measured less the reference's
    piece: Int[Array, " R"]  # rows of one piece are not independent


def estimate_bodies(motions: Sequence[Motion], reference: ArmModel) -> Estimated:
    """Masses, centres, payload and delay that a session's motions tell.

    Args:
        motions, reference: The session's runs, and the arm that changes are counted from.
    """
    reference = reference.keeping(motions[0].joints)
    table = gather_table(motions, reference)
    if table is None:
        return {}
    return {**_links(table, reference), **_flange_and_delay(table, reference)}


def gather_table(motions: Sequence[Motion], reference: ArmModel) -> SessionRows | None:
    """The rows of a session; None where it is too short.

    Args:
        motions, reference: The session's runs, and the arm that changes are counted from.
    """
    n = reference.n
    tables: list[list[Array]] = [[] for _ in range(n)]
    torques: list[list[Array]] = [[] for _ in range(n)]
    pieces: list[list[Array]] = [[] for _ in range(n)]
    first = 0
    for motion in motions:
        arm = reference.with_payload(motion.payload)
        rigid = arm.inverse_dynamics(motion.q, motion.dq, motion.ddq)
        late = motion.filtered(-np.gradient(rigid, motion.interval, axis=0))
        error = motion.tau_filtered - motion.filtered(rigid)
        bodies = reference.regressor(motion.q, motion.dq, motion.ddq)
        number = ((motion.time[motion.coarse] - motion.time[0]) // PIECE_S).astype(int)
        for j in range(n):
            rows = motion.settled[:, j]
            speed = motion.dq[:, j]
            columns = np.column_stack([motion.ddq[:, j], speed, np.sign(speed)])
            filtered = motion.filtered(columns)
            losses = np.zeros((len(filtered), LOSSES * n))
            losses[:, LOSSES * j : LOSSES * j + 3] = filtered
            losses[:, LOSSES * j + 3] = 1.0
            of_bodies = motion.filtered(bodies[:, j])
            whole = np.column_stack([of_bodies, late[:, j], losses])
            tables[j].append(whole[rows])
            torques[j].append(error[rows, j])
            pieces[j].append(first + number[rows])
        first += int(number[-1]) + 1
    return _weighted(tables, torques, pieces)


def _weighted(
    tables: Sequence[Sequence[Array]],
    torques: Sequence[Sequence[Array]],
    pieces: Sequence[Sequence[Array]],
) -> SessionRows | None:
    """Each joint's rows over what its losses and bodies leave there."""
    columns = []
    torque = []
    for parts, error in zip(tables, torques, strict=True):
        x = np.concatenate(parts)
        y = np.concatenate(error)
        if len(y) <= x.shape[1]:
            continue
        size = np.linalg.norm(x, axis=0)
        scaled = x / np.where(size > 0.0, size, 1.0)
        left = y - scaled @ np.linalg.lstsq(scaled, y, rcond=1e-9)[0]
        noise = max(float(np.std(left)), 1e-9)
        columns.append(x / noise)
        torque.append(y / noise)
    if len(columns) < len(tables):
        return None
    number = np.concatenate([np.concatenate(numbers) for numbers in pieces])
    if len(np.unique(number)) < LEAST_PIECES:
        return None
    return SessionRows(np.concatenate(columns), np.concatenate(torque), number)


def solve(
    table: SessionRows, chosen: Int[Array, " k"], spread: Float[Array, " k"]
) -> tuple[Float[Array, " k"], Float[Array, "k k"]]:
    """Estimates of some columns' coefficients and their covariance, by how pieces differ.

    Args:
        table, chosen: The rows, and the columns that are in the model.
        spread: Prior standard deviation of each coefficient; infinite for none.

    Source: Liang and Zeger 1986, the sandwich over clusters; the prior is one more observation.
    """
    x = table.columns[:, chosen]
    length = np.linalg.norm(x, axis=0)
    has_prior = np.isfinite(spread)
    # In units of the prior, or of what makes a column's length one.
    unit = np.where(has_prior, spread, 1.0 / np.where(length > 0.0, length, 1.0))
    x = x * unit
    precision = np.diag(has_prior.astype(float))
    bread = np.linalg.pinv(x.T @ x + precision, rcond=1e-12, hermitian=True)
    beta = bread @ (x.T @ table.torque)
    left = table.torque - x @ beta
    names, index = np.unique(table.piece, return_inverse=True)
    scores = np.zeros((len(names), x.shape[1]))
    np.add.at(scores, index, x * left[:, None])
    count = len(names)
    squares = scores.T @ scores * count / max(1, count - 1)
    meat = squares + precision
    return beta * unit, bread @ meat @ bread * np.outer(unit, unit)


def _links(table: SessionRows, reference: ArmModel) -> Estimated:
    """Mass and centre of each link; what recordings don't tell is the URDF's, with its
    tolerance.
    """
    n = reference.n
    spread = np.full(table.columns.shape[1], np.inf)
    spread[: 10 * n] = USUAL_REGRESSION.inertia_share * parameter_scale(reference)
    change, covariance = solve(table, np.arange(len(spread)), spread)
    whole = reference.inertial_parameters + change[: 10 * n]
    estimates: Estimated = {}
    for k, link in enumerate(reference.links):
        places = 10 * k + np.arange(4)
        mass = whole[places[0]]
        moment = whole[places[1:]]
        block = covariance[np.ix_(places, places)]
        estimates[link, "mass_kg"] = _estimate(mass, block[0, 0])
        if mass <= 0.0:
            continue
        for axis, name in enumerate(AXES):
            slope = np.zeros(4)
            slope[0] = -moment[axis] / mass**2
            slope[1 + axis] = 1.0 / mass
            variance = slope @ block @ slope
            estimates[link, f"centre_{name}_m"] = _estimate(moment[axis] / mass, variance)
    return estimates


def _flange_and_delay(table: SessionRows, reference: ArmModel) -> Estimated:
    """A body at the last link and how late the torque is, with the links as they are."""
    n = reference.n
    body = 10 * (n - 1) + np.arange(4)
    chosen = np.concatenate([body, np.arange(10 * n, table.columns.shape[1])])
    values, covariance = solve(table, chosen, np.full(len(chosen), np.inf))
    names = ("payload_kg", *(f"payload_moment_{name}_kgm" for name in AXES))
    estimates: Estimated = {}
    for k, name in enumerate(names):
        estimates[FLANGE, name] = _estimate(values[k], covariance[k, k])
    estimates[ARM, "delay_s"] = _estimate(values[4], covariance[4, 4])
    return estimates


def _estimate(value: float, variance: float) -> ParameterEstimate:
    std = float(np.sqrt(max(variance, 0.0)))
    return ParameterEstimate(
        float(value), float(value) - REACH * std, float(value) + REACH * std, std
    )
