"""Parameters of an arm in one session, joint by joint, always by the same regression, so that days can be compared.

    tau = gain · rigid(q, dq, ddq) + rotor · ddq + viscous · dq + coulomb · sign(dq) + offset

clear of reversals and through the common filter; the rigid torque is that of the reference arm (the URDF, or a model
fitted once). The gain is estimated where gravity moves the joint: elsewhere nothing parts it from the rotor's inertia.
What these leave is the gap. A reference that is wrong shifts an estimate by the same amount every day, as long as the
motions are the same; other motions every day widen the day-to-day spread, against which every change is tested.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from ident.arrays import Array, Float, Int
from ident.checks.filtered_run import USUAL_EFFORT
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel

# Parameter -> unit.
UNITS = {
    "gain": "1",
    "rotor": "kg m²",
    "viscous": "N m s/rad",
    "coulomb": "N m",
    "offset": "N m",
    "gap": "N m",
}
TERMS = ("gain", "rotor", "viscous", "coulomb", "offset")
# Pieces whose errors are taken as independent: several times the correlation time of residuals (0.1 to 0.3 s) [s].
PIECE_S = 1.5
# Fewer samples, or fewer pieces, give no estimate.
LEAST_ROWS, LEAST_PIECES = 100, 6
# Where so little of the moving samples is clear of reversals, all moving ones are used.
LEAST_SETTLED = 0.1


def unit_of(name: str) -> str:
    """What stands behind a parameter's number: a blank and its unit, if it has one."""
    return "" if UNITS[name] == "1" else f" {UNITS[name]}"


@dataclass(frozen=True)
class ParameterEstimate:
    """An estimate with its 95 % interval and its standard deviation."""

    value: float
    low: float
    high: float
    std: float


Estimates = Mapping[tuple[str, str], ParameterEstimate]
"""By joint and parameter (`UNITS`)."""


def estimate_session(motions: Sequence[Motion], reference: ArmModel) -> dict[tuple[str, str], ParameterEstimate]:
    """All parameters that a session's motions give an estimate of."""
    rigid, gravity = [], []
    for motion in motions:
        arm = reference.with_payload(motion.payload)
        rigid.append(motion.filtered(arm.inverse_dynamics(motion.q, motion.dq, motion.ddq)))
        gravity.append(arm.gravity(motion.q[motion.coarse]))
    change = np.concatenate(gravity).std(axis=0)
    heavy = (change > USUAL_EFFORT.heavy_share * change.max()) & (change > USUAL_EFFORT.heavy_Nm)
    return {
        (joint, name): one
        for j, joint in enumerate(motions[0].joints)
        for name, one in _of_joint(motions, rigid, j, bool(heavy[j])).items()
    }


def _of_joint(motions: Sequence[Motion], rigid: Sequence[Array], j: int, heavy: bool) -> dict[str, ParameterEstimate]:
    """By least squares over the samples that count; errors by their pieces, as if those were independent."""
    settled = sum(int(motion.settled[:, j].sum()) for motion in motions)
    moving = sum(int(motion.moving[:, j].sum()) for motion in motions)
    tables, torques, pieces, first = [], [], [], 0
    for motion, torque in zip(motions, rigid, strict=True):
        rows = (motion.moving if settled < LEAST_SETTLED * moving else motion.settled)[:, j]
        tables.append(term_columns(motion, torque, j)[rows])
        torques.append(motion.tau_filtered[rows, j])
        number = ((motion.time[motion.coarse] - motion.time[0]) // PIECE_S).astype(int)
        pieces.append(first + number[rows])
        first += int(number[-1]) + 1
    x, y, piece = np.concatenate(tables), np.concatenate(torques), np.concatenate(pieces)
    if not heavy:
        y, x = y - x[:, 0], x[:, 1:]
    names, count = TERMS if heavy else TERMS[1:], len(np.unique(piece))
    if len(y) < LEAST_ROWS or count < LEAST_PIECES:
        return {}
    size, free = np.linalg.norm(x, axis=0), max(1, count - len(names))
    scaled = x / np.where(size > 0.0, size, 1.0)
    beta = np.linalg.lstsq(scaled, y, rcond=1e-9)[0]
    left = y - scaled @ beta
    bread = np.linalg.pinv(scaled.T @ scaled, rcond=1e-9, hermitian=True)
    scores = np.zeros((piece.max() + 1, scaled.shape[1]))
    np.add.at(scores, piece, scaled * left[:, None])
    covariance = bread @ (scores.T @ scores) @ bread * count / free
    std = np.sqrt(np.diag(covariance))
    reach = float(stdtrit(free, 0.975))
    found = {}
    for name, value, error, norm in zip(names, beta, std, size, strict=True):
        if norm > 0.0:
            middle, own = float(value / norm), float(error / norm)
            found[name] = ParameterEstimate(middle, middle - reach * own, middle + reach * own, own)
    return {**found, "gap": _gap(left, piece, reach)}


def term_columns(motion: Motion, rigid: Float[Array, "t n"], j: int) -> Float[Array, "t 5"]:
    """What each of `TERMS` multiplies at a joint, through the common filter."""
    filtered = motion.filtered(np.column_stack([motion.ddq[:, j], motion.dq[:, j], np.sign(motion.dq[:, j])]))
    return np.column_stack([rigid[:, j], filtered, np.ones(len(filtered))])


def _gap(left: Float[Array, " t"], piece: Int[Array, " t"], reach: float) -> ParameterEstimate:
    """Root mean square of what is left, with its error over pieces."""
    count = np.bincount(piece)
    mean = np.bincount(piece, left**2)[count > 0] / count[count > 0]
    weight = count[count > 0] / len(left)
    square = float(weight @ mean)
    error = float(np.sqrt(np.sum((weight * (mean - square)) ** 2)))
    value = float(np.sqrt(square))
    std = error / max(2.0 * value, 1e-300)
    return ParameterEstimate(value, max(0.0, value - reach * std), value + reach * std, std)
