"""The baseline that every effect is judged against: the user's arm after the best tuning of what it
has.

Tunable are the link inertias (held near the URDF by a prior), rotor inertia, viscous and Coulomb
friction. What that tuning can explain is no effect; what an effect explains beyond it is its
visible part.

It is tuned wherever a joint moves, reversals included: effects are looked for there too. A hybrid
model's estimates come from `ident.fitting.identification`, which leaves reversals out and knows
friction that changes from run to run.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, Int
from ident.errors import RecordingError
from ident.model.bodies import solve_partly_non_negative
from ident.model.inertia import BaseParameters, base_parameters, base_prior, lift_base
from ident.model.linearisation import LEAST_MOVING, Sliding, fit_sliding
from ident.model.loss import TRANSITION_GRID, LossParameters
from ident.motion.motion import Motion
from ident.regression.settings import USUAL_REGRESSION, RegressionSettings
from ident.robot.arm import ArmModel
from ident.robot.tolerance import parameter_scale

# Losses that can't be negative: motor inertia, viscous and Coulomb friction.
LOSSES = 3


@dataclass(frozen=True)
class UrdfError:
    """How far off a URDF's inertias are believed to be."""

    scale: float = 1.0  # of each link's numbers in their own size, in units of the usual belief
    # Of every link's centre of mass besides, root mean square distance [m]: what a drawing's other
    # origin or a hose's weight does to a short link as much as to a long one.
    com_m: float = 0.0
    # Links that are believed as any URDF's all the same: what is off there is to have a name.
    usual: frozenset[int] = frozenset()

    def divided(self, factor: float) -> UrdfError:
        """Both smaller by a factor."""
        return UrdfError(self.scale / factor, self.com_m / factor, self.usual)


@dataclass(frozen=True, eq=False)
class Baseline:
    """The tuned model."""

    nominal: ArmModel  # the arm as the URDF describes it
    arm: ArmModel  # the arm after tuning
    base: BaseParameters  # its base parameters
    # information on the base parameters' change that lies in the URDF, shape (r, r)
    prior: Float[Array, "r r"]
    loss: LossParameters  # tuned loss parameters
    sliding: Sliding  # how each joint's dry friction turns round
    # standard deviation of each link's inertial numbers, as believed
    number_std: Float[Array, " 10n"]
    settings: RegressionSettings = USUAL_REGRESSION  # what the regression counts with

    def prior_of(
        self, error: UrdfError, wrong_link: int | None = None, factor: float = 1.0
    ) -> Float[Array, "r r"]:
        """Information on the base parameters' change in a URDF that is so far off, and at one link
        more by a factor.
        """
        # What centres of mass so far off change of mass, first moments and moments of inertia.
        links = self.nominal.inertial_parameters.reshape(-1, 10)
        axis = error.com_m / np.sqrt(3.0)
        mass = links[:, :1]
        lever = np.linalg.norm(links[:, 1:4], axis=1, keepdims=True)
        moment = mass * axis
        inertia = 2.0 * lever * axis + mass * axis**2
        shifted = np.concatenate(
            [0.0 * mass, np.repeat(moment, 3, 1), np.repeat(inertia, 6, 1)], axis=1
        ).ravel()
        std = np.hypot(error.scale * self.number_std, shifted)
        for link in error.usual:
            std[10 * link : 10 * (link + 1)] = (
                min(error.scale, 1.0) * self.number_std[10 * link : 10 * (link + 1)]
            )
        if wrong_link is not None:
            std[10 * wrong_link : 10 * (wrong_link + 1)] *= factor
        return base_prior(self.base, std)


def fit_baseline(
    motions: Sequence[Motion],
    arm: ArmModel,
    share: float | None = None,
    settings: RegressionSettings = USUAL_REGRESSION,
    still: Collection[int] = (),
    sliding: Sliding | None = None,
) -> Baseline:
    """Tunes the arm by one least squares over where joints move; no loss is negative.

    It is solved twice from the sums of one pass over the runs: with equal weights, then with each
    joint's own noise.

    Args:
        motions: All runs.
        arm: The arm as its user has it.
        share: Standard deviation of its inertial numbers as a share of `parameter_scale`; that of a
            URDF if None.
        settings: What the regression counts with.
        still: Joints that stand still: they get no loss.
        sliding: How dry friction turns round, where that is not to be estimated.

    Raises:
        RecordingError: A joint hardly moves in any run.
    """
    share = settings.inertia_share if share is None else share
    base = base_parameters(arm)
    number_std = share * parameter_scale(arm)
    lift = lift_base(base, number_std)
    n = arm.n
    rank = base.rank
    moving = np.sum([motion.moving.sum(axis=0) for motion in motions], axis=0)
    for j in sorted(set(np.flatnonzero(moving < LEAST_MOVING).tolist()) - set(still)):
        what = f"{motions[0].joints[j]} hardly moves: its loss can't be fitted"
        raise RecordingError(motions[0].name, what, "add runs that move it, or lock it")
    sums = _sums_of_joints(motions, arm, base)
    sums[list(still)] = 0.0
    change = np.zeros(rank)
    noise = np.ones(n)
    for last in (False, True):
        widths = _transition_widths(sums, change)
        whole = np.zeros((rank + LOSSES * n + 1, rank + LOSSES * n + 1))
        whole[:rank, :rank] = lift.T @ (lift / number_std[:, None] ** 2)
        for j in range(n):
            of_joint = np.array([*range(rank), *(rank + LOSSES * j + np.arange(LOSSES)), -1])
            columns = np.array([*range(rank), rank, rank + 1, rank + LOSSES + widths[j], -1])
            whole[np.ix_(of_joint, of_joint)] += sums[j][np.ix_(columns, columns)] / noise[j] ** 2
        solution = solve_partly_non_negative(whole, range(rank, rank + LOSSES * n))
        change = solution[:rank]
        (rotor, viscous, coulomb) = solution[rank:].reshape(n, LOSSES).T
        loss = LossParameters(
            rotor, viscous, coulomb, np.zeros(n), np.asarray(TRANSITION_GRID)[widths]
        )
        tuned = arm.with_inertial_parameters(arm.inertial_parameters + lift @ change)
        noise = noise if last else _effective_noise(motions, tuned, loss)
    if sliding is None:
        sliding = fit_sliding(motions, [rigid_torque(tuned, motion) for motion in motions])
    return Baseline(
        arm, tuned, base, base_prior(base, number_std), loss, sliding, number_std, settings
    )


def rigid_torque(arm: ArmModel, motion: Motion) -> Float[Array, "T n"]:
    """Rigid torque of a run with its known payload [N m]."""
    return arm.with_payload(motion.payload).inverse_dynamics(motion.q, motion.dq, motion.ddq)


def _sums_of_joints(
    motions: Sequence[Motion], arm: ArmModel, base: BaseParameters
) -> Float[Array, "n p p"]:
    """Sums of squares and products over each joint's moving rows.

    Columns: base parameters, acceleration, speed, one, direction at each width of the grid, and the
    torque beside the rigid arm's.
    """
    sums = np.zeros((arm.n, *2 * (base.rank + LOSSES + len(TRANSITION_GRID) + 1,)))
    for motion in motions:
        rows = motion.filtered(arm.regressor(motion.q, motion.dq, motion.ddq, list(base.columns)))
        turning = [np.tanh(motion.dq / width) for width in TRANSITION_GRID]
        beside = [
            motion.ddq,
            motion.dq,
            np.ones_like(motion.dq),
            *turning,
            rigid_torque(arm, motion),
        ]
        filtered = motion.filtered(np.stack(beside, axis=-1))
        filtered[..., -1] = motion.tau_filtered - filtered[..., -1]
        for j in range(arm.n):
            there = motion.moving[:, j]
            x = np.concatenate([rows[there, j], filtered[there, j]], axis=1)
            sums[j] += x.T @ x
    return sums


def _transition_widths(sums: Float[Array, "n p p"], change: Float[Array, " r"]) -> Int[Array, " n"]:
    """Place in the grid of each joint's transition width that leaves least torque beside changed
    base parameters.
    """
    rank = len(change)
    explained = []
    moments = sums[..., -1] - sums[..., :rank] @ change
    for k in range(len(TRANSITION_GRID)):
        of_loss = np.array([rank, rank + 1, rank + 2, rank + LOSSES + k])
        inverse = np.linalg.pinv(sums[:, of_loss[:, None], of_loss], hermitian=True)
        explained.append(
            np.einsum("nk,nkl,nl->n", moments[:, of_loss], inverse, moments[:, of_loss])
        )
    return np.argmax(explained, axis=0)


def _effective_noise(
    motions: Sequence[Motion], arm: ArmModel, loss: LossParameters
) -> Float[Array, " n"]:
    """Standard deviation of each joint's residual, inflated by its correlation time: what one
    sample is worth.
    """
    sums = np.zeros(arm.n)
    counts = np.zeros(arm.n)
    inflation = np.zeros(arm.n)
    for motion in motions:
        known = rigid_torque(arm, motion) + loss.torque(motion.dq, motion.ddq)
        left = motion.tau_filtered - motion.filtered(known)
        for j in range(arm.n):
            residual = left[motion.moving[:, j], j]
            if len(residual) > 10:
                sums[j] += residual @ residual
                inflation[j] += len(residual) * correlation_time(residual)
                counts[j] += len(residual)
    counts = np.maximum(counts, 1.0)
    return np.sqrt(np.maximum(sums, 1e-12) / counts * np.maximum(inflation / counts, 1.0))


def correlation_time(residual: Float[Array, " T"]) -> float:
    """Samples that one independent sample is worth: 1 + 2 Σ ρ_k, up to where ρ first falls below
    0.05.
    """
    centred = residual - residual.mean()
    size = 1 << (2 * len(centred) - 1).bit_length()
    spectrum = np.fft.rfft(centred, size)
    covariance = np.fft.irfft(spectrum * spectrum.conj(), size)[: len(centred) // 2]
    if covariance[0] <= 0.0:
        return 1.0
    rho = covariance / covariance[0]
    end = int(np.argmax(rho < 0.05)) or len(rho)
    return float(1.0 + 2.0 * rho[1:end].sum())
