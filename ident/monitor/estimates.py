"""Parameters of an arm in one session, joint by joint.

Always by the same regression, so that days can be compared:

    tau = gain · rigid(q, dq, ddq) + rotor · ddq + viscous · dq + coulomb · sign(dq) + offset

clear of reversals and through the common filter; the rigid torque is that of the reference arm (the
URDF, or a model fitted once). The gain is estimated where gravity moves the joint: elsewhere
nothing parts it from the rotor's inertia. What these leave is the gap. A reference that is wrong
shifts an estimate by the same amount every day, as long as the motions are the same; other motions
every day widen the day-to-day spread, against which every change is tested.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from ident.arrays import Array, Bool, Float, Int
from ident.checks.settings import USUAL_EFFORT
from ident.monitor.parameters import TERMS
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel

# Pieces whose errors are taken as independent: several times the correlation time of residuals (0.1
# to 0.3 s) [s].
PIECE_S = 1.5
# Fewer samples, or fewer pieces, give no estimate.
LEAST_ROWS = 100
LEAST_PIECES = 6
# Where so little of the moving samples is clear of reversals, all moving ones are used.
LEAST_SETTLED = 0.1
# Directions of the columns below this share of the largest are rounding.
ROUNDING = 1e-9
# Upper end of the 95 % interval, as a share of all draws.
UPPER = 0.975


@dataclass(frozen=True)
class ParameterEstimate:
    """An estimate with its 95 % interval and its standard deviation."""

    value: float
    low: float
    high: float
    std: float


Estimates = Mapping[tuple[str, str], ParameterEstimate]
"""By joint and parameter (`ident.monitor.parameters.UNITS`)."""


@dataclass(frozen=True, eq=False)
class _JointRows:
    """What the samples of one joint say that count, of all motions."""

    columns: Float[Array, "t k"]  # what each term multiplies
    torque: Float[Array, " t"]  # measured [N m]
    piece: Int[Array, " t"]  # number of the piece that a sample lies in

    @property
    def pieces(self) -> int:
        """How many pieces there are."""
        return len(np.unique(self.piece))

    def with_known_gain(self) -> _JointRows:
        """The same with a gain of one taken off, so that it needs no estimate."""
        rest = self.torque - self.columns[:, 0]
        return _JointRows(self.columns[:, 1:], rest, self.piece)


def estimate_session(
    motions: Sequence[Motion], reference: ArmModel
) -> dict[tuple[str, str], ParameterEstimate]:
    """All parameters that a session's motions give an estimate of.

    Args:
        motions: Runs of the session.
        reference: The arm whose rigid torque the gain is of.
    """
    rigid = []
    gravity = []
    for motion in motions:
        arm = reference.with_payload(motion.payload)
        rigid.append(motion.filtered(arm.inverse_dynamics(motion.q, motion.dq, motion.ddq)))
        gravity.append(arm.gravity(motion.q[motion.coarse]))
    change = np.concatenate(gravity).std(axis=0)
    heavy = (change > USUAL_EFFORT.heavy_share * change.max()) & (change > USUAL_EFFORT.heavy_Nm)
    estimates = {}
    for j, joint in enumerate(motions[0].joints):
        rows = _rows_of_joint(motions, rigid, j)
        for name, estimate in _estimate_joint(rows, bool(heavy[j])).items():
            estimates[joint, name] = estimate
    return estimates


def _rows_of_joint(motions: Sequence[Motion], rigid: Sequence[Array], j: int) -> _JointRows:
    """The samples of a joint that count: clear of reversals, or moving where few are."""
    settled = sum(int(motion.settled[:, j].sum()) for motion in motions)
    moving = sum(int(motion.moving[:, j].sum()) for motion in motions)
    takes_moving = settled < LEAST_SETTLED * moving
    columns = []
    torques = []
    pieces = []
    first = 0
    for motion, torque in zip(motions, rigid, strict=True):
        counts: Bool[Array, "t n"] = motion.moving if takes_moving else motion.settled
        rows = counts[:, j]
        columns.append(term_columns(motion, torque, j)[rows])
        torques.append(motion.tau_filtered[rows, j])
        elapsed = motion.time[motion.coarse] - motion.time[0]
        piece = (elapsed // PIECE_S).astype(int)
        pieces.append(first + piece[rows])
        first += int(piece[-1]) + 1
    return _JointRows(np.concatenate(columns), np.concatenate(torques), np.concatenate(pieces))


def _estimate_joint(rows: _JointRows, heavy: bool) -> dict[str, ParameterEstimate]:
    """By least squares; errors by their pieces, as if those were independent.

    Args:
        rows: Samples of the joint.
        heavy: Whether gravity moves it, so that its gain can be told.
    """
    names = TERMS if heavy else TERMS[1:]
    rows = rows if heavy else rows.with_known_gain()
    count = rows.pieces
    if len(rows.torque) < LEAST_ROWS or count < LEAST_PIECES:
        return {}
    size = np.linalg.norm(rows.columns, axis=0)
    scaled = rows.columns / np.where(size > 0.0, size, 1.0)
    beta = np.linalg.lstsq(scaled, rows.torque, rcond=ROUNDING)[0]
    left = rows.torque - scaled @ beta
    free = max(1, count - len(names))
    std = np.sqrt(np.diag(_piecewise_covariance(scaled, left, rows.piece) * count / free))
    reach = float(stdtrit(free, UPPER))
    estimates = {}
    for name, value, error, norm in zip(names, beta, std, size, strict=True):
        if norm > 0.0:
            middle = float(value / norm)
            deviation = float(error / norm)
            half = reach * deviation
            estimates[name] = ParameterEstimate(middle, middle - half, middle + half, deviation)
    return {**estimates, "gap": _gap(left, rows.piece, reach)}


def _piecewise_covariance(
    columns: Float[Array, "t k"], left: Float[Array, " t"], piece: Int[Array, " t"]
) -> Float[Array, "k k"]:
    """Covariance of coefficients whose errors are independent from piece to piece alone."""
    bread = np.linalg.pinv(columns.T @ columns, rcond=ROUNDING, hermitian=True)
    scores = np.zeros((piece.max() + 1, columns.shape[1]))
    np.add.at(scores, piece, columns * left[:, None])
    return np.asarray(bread @ (scores.T @ scores) @ bread)


def term_columns(motion: Motion, rigid: Float[Array, "t n"], j: int) -> Float[Array, "t 5"]:
    """What each of `TERMS` multiplies at a joint, through the common filter.

    Args:
        motion: The run.
        rigid: Torque of the rigid arm along it [N m], through that filter already.
        j: Number of the joint.

    Returns:
        Rigid torque, acceleration, speed, sign of the speed, and ones.
    """
    speed = motion.dq[:, j]
    states = np.column_stack([motion.ddq[:, j], speed, np.sign(speed)])
    filtered = motion.filtered(states)
    return np.column_stack([rigid[:, j], filtered, np.ones(len(filtered))])


def _gap(left: Float[Array, " t"], piece: Int[Array, " t"], reach: float) -> ParameterEstimate:
    """Root mean square of what is left, with its error over pieces [N m]."""
    samples = np.bincount(piece)
    there = samples > 0
    mean = np.bincount(piece, left**2)[there] / samples[there]
    weight = samples[there] / len(left)
    square = float(weight @ mean)
    error = float(np.sqrt(np.sum((weight * (mean - square)) ** 2)))
    value = float(np.sqrt(square))
    std = error / max(2.0 * value, 1e-300)
    return ParameterEstimate(value, max(0.0, value - reach * std), value + reach * std, std)
