"""The arm about which a diagnosis linearises: its links near the URDF's, and losses joint by joint.

Wherever a joint moves, reversals included: effects are looked for there too. A hybrid model's estimates come from
`ident.model.identification`, which leaves reversals out and knows friction that changes from run to run; the
diagnosis' acceptance criteria were calibrated on this one.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.laws.motion import direction
from ident.model.convex import solve_partly_non_negative
from ident.model.inertia import BaseParameters, base_parameters, lift_base, parameter_scale
from ident.model.loss import TRANSITION_GRID, LossParameters, loss_columns
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel

# Samples in motion, all runs together, below which a joint has no loss to be fitted.
LEAST_MOVING = 20
# Losses that can't be negative: motor inertia, viscous and Coulomb friction.
LOSSES = 3


def tune_links(motions: Sequence[Motion], arm: ArmModel, share: float) -> tuple[ArmModel, BaseParameters]:
    """The arm with base parameters near the URDF's, fitted together with losses; and what these are.

    Args:
        motions: Runs; known payloads are part of the model.
        arm: The arm as its URDF describes it.
        share: Standard deviation of the URDF's numbers as a share of `parameter_scale`.
    """
    base, scale = base_parameters(arm), share * parameter_scale(arm)
    lift, n = lift_base(base, scale), arm.n
    rank, size = base.rank, base.rank + n * LOSSES
    targets = [motion.tau_filtered - motion.filtered(rigid_torque(arm, motion)) for motion in motions]
    widths = transition_speeds(motions, targets)
    grams = _joint_grams(motions, arm, base, targets, widths)
    believed = np.concatenate([(1 / scale)[:, None] * lift, np.zeros((len(scale), n * LOSSES))], axis=1)
    noise, tuned = np.ones(n), arm
    for _ in range(2):  # once with equal weights, once with each joint's own noise
        whole = np.zeros((size + 1, size + 1))
        for j in range(n):
            own = np.array([*range(rank), *range(rank + LOSSES * j, rank + LOSSES * (j + 1)), size])
            whole[np.ix_(own, own)] += grams[j] / noise[j] ** 2
        values, vectors = np.linalg.eigh(whole[:-1, :-1])
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T  # rootᵀ root: the sums over all joints
        target = np.linalg.lstsq(root.T, whole[:-1, -1], rcond=None)[0]
        table, goal = np.concatenate([root, believed]), np.concatenate([target, np.zeros(len(scale))])
        found = solve_partly_non_negative(table, goal, range(rank, size))
        tuned = arm.with_inertial_parameters(arm.inertial_parameters + lift @ found[:rank])
        noise = _effective_noise(motions, tuned, found[rank:].reshape(n, LOSSES), widths)
    return tuned, base


def _joint_grams(
    motions: Sequence[Motion], arm: ArmModel, base: BaseParameters, targets: Sequence[Array], widths: Array
) -> Float[Array, "n k k"]:
    """XᵀX of each joint over its moving rows: regressor, losses, and torque as the last column."""
    size = base.rank + LOSSES + 1
    grams = np.zeros((arm.n, size, size))
    for motion, target in zip(motions, targets, strict=True):
        rows = motion.filtered(arm.regressor(motion.q, motion.dq, motion.ddq, list(base.columns)))
        friction, moving = loss_columns(motion, widths)[..., :LOSSES], motion.moving
        for j in range(arm.n):
            there = moving[:, j]
            x = np.concatenate([rows[there, j], friction[there, j], target[there, j : j + 1]], axis=1)
            grams[j] += x.T @ x
    return grams


def _effective_noise(
    motions: Sequence[Motion], arm: ArmModel, losses: Float[Array, "n p"], widths: Array
) -> Float[Array, " n"]:
    """Standard deviation of each joint's residual, inflated by its correlation time: what one sample is worth."""
    sums, counts, inflation = np.zeros(arm.n), np.zeros(arm.n), np.zeros(arm.n)
    for motion in motions:
        left = motion.tau_filtered - motion.filtered(rigid_torque(arm, motion))
        left = left - np.einsum("tnk,nk->tn", loss_columns(motion, widths)[..., :LOSSES], losses)
        for j in range(arm.n):
            residual = left[motion.moving[:, j], j]
            if len(residual) > 10:
                sums[j] += residual @ residual
                inflation[j] += len(residual) * correlation_time(residual)
                counts[j] += len(residual)
    counts = np.maximum(counts, 1.0)
    return np.sqrt(np.maximum(sums, 1e-12) / counts * np.maximum(inflation / counts, 1.0))


def correlation_time(residual: Float[Array, " T"]) -> float:
    """Samples that one independent sample is worth: 1 + 2 Σ ρ_k, up to where ρ first falls below 0.05."""
    centred = residual - residual.mean()
    size = 1 << (2 * len(centred) - 1).bit_length()
    spectrum = np.fft.rfft(centred, size)
    covariance = np.fft.irfft(spectrum * spectrum.conj(), size)[: len(centred) // 2]
    if covariance[0] <= 0.0:
        return 1.0
    rho = covariance / covariance[0]
    end = int(np.argmax(rho < 0.05)) or len(rho)
    return float(1.0 + 2.0 * rho[1:end].sum())


def fit_losses(
    motions: Sequence[Motion], rigid: Sequence[Float[Array, "T n"]], still: Collection[int] = ()
) -> LossParameters:
    """Losses of each joint by itself, by least squares where it moves.

    Args:
        motions: Runs.
        rigid: Modelled rigid torque of each run [N m], not filtered.
        still: Joints that are left out: they get no loss.

    Raises:
        RecordingError: A joint hardly moves in any run.
    """
    targets = [motion.tau_filtered - motion.filtered(torque) for motion, torque in zip(motions, rigid, strict=True)]
    widths = transition_speeds(motions, targets)
    rows = [loss_columns(motion, widths)[..., :LOSSES] for motion in motions]
    values = np.zeros((LOSSES, motions[0].n))
    for j in sorted(set(range(motions[0].n)) - set(still)):
        x, y = _moving(j, motions, rows, targets)
        if len(y) < LEAST_MOVING:
            what = f"{motions[0].joints[j]} hardly moves: its loss can't be fitted"
            raise RecordingError(motions[0].name, what, "add runs that move it, or lock it")
        scale = np.maximum(np.linalg.norm(x, axis=0), 1e-12)
        values[:, j] = solve_partly_non_negative(x / scale, y, range(LOSSES)) / scale
    rotor, viscous, coulomb = values
    return LossParameters(rotor, viscous, coulomb, np.zeros(motions[0].n), widths)


def transition_speeds(motions: Sequence[Motion], targets: Sequence[Float[Array, "t n"]]) -> Float[Array, " n"]:
    """Each joint's transition width that leaves least of its torque [rad/s].

    Args:
        motions: Runs.
        targets: Filtered torque beside the rigid arm's [N m].
    """
    n = motions[0].n
    misfit = np.zeros((len(TRANSITION_GRID), n))
    rows = [loss_columns(motion, np.full(n, TRANSITION_GRID[0])) for motion in motions]
    for k, width in enumerate(TRANSITION_GRID):
        for row, motion in zip(rows, motions, strict=True):  # of all columns the width bends one
            row[..., 2] = motion.filtered(direction(motion.dq, np.full(n, width)))
        for j in range(n):
            x, y = _moving(j, motions, rows, targets)
            left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
            misfit[k, j] = left @ left
    return np.asarray(TRANSITION_GRID)[np.argmin(misfit, axis=0)]


def _moving(
    j: int, motions: Sequence[Motion], rows: Sequence[Float[Array, "t n k"]], targets: Sequence[Float[Array, "t n"]]
) -> tuple[Float[Array, "T k"], Float[Array, " T"]]:
    """Columns and torque of one joint where it moves."""
    masks = [motion.moving[:, j] for motion in motions]
    x = np.concatenate([row[mask, j] for row, mask in zip(rows, masks, strict=True)])
    return x, np.concatenate([target[mask, j] for target, mask in zip(targets, masks, strict=True)])


def rigid_torque(arm: ArmModel, motion: Motion) -> Float[Array, "T n"]:
    """Rigid torque of a run with its known payload [N m]."""
    return arm.with_payload(motion.payload).inverse_dynamics(motion.q, motion.dq, motion.ddq)
