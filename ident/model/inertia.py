"""Link inertias from motions: base parameters by rank-revealing QR, or physically consistent ones by an LMI.

Only some combinations of the 10 n inertial numbers act on the joint torques: the base parameters. `nominal` keeps the
URDF's inertias; `base` fits the base parameters and changes the URDF's numbers as little as that needs; `consistent`
searches all numbers near the URDF's under the condition that every link could be a real body. Loss figures are
unknowns of the same problem, so that friction is not mistaken for mass.

`fit_inertia` gives the diagnosis the arm that it linearises about, from the same rows as its effects; a hybrid model's
inertias come from the joint estimate (`ident.model.identification`), which leaves reversals out and knows friction that
changes from run to run. One in the place of the other would move the diagnosis's calibrated gates.

Source: Gautier 1991 (base parameters by QR); Wensing, Kim and Slotine 2018 (pseudo-inertia LMI).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.model.bounded import solve_bounded
from ident.model.loss import LossModel, loss_columns
from ident.motion.motion import Motion
from ident.numerics import factor_by_pivots
from ident.robot.arm import ArmModel

if TYPE_CHECKING:
    import cvxpy as cp

Mode = Literal["nominal", "base", "consistent"]
PER_LINK = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
# Columns whose pivot is smaller than this share of the largest act on no joint torque.
RANK_TOLERANCE = 1e-9
# How far a URDF's inertia may be off before we look for another cause, as a share of the link's own scale.
PRIOR_SHARE = {"base": 2.0, "consistent": 0.3}
# Links lighter than this have no scale of their own [kg, m].
LEAST_MASS, LEAST_LENGTH = 0.2, 0.06
STATES_FOR_RANK = 200


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Which combinations of inertial numbers act on the joint torques: β = B π.

    Attributes:
        columns: Indices of the r independent regressor columns.
        mapping: B, shape (r, 10n).
        names: Names of the independent columns, such as `link_2.mx`.
    """

    columns: tuple[int, ...]
    mapping: Float[Array, "r 10n"]
    names: tuple[str, ...]

    @property
    def rank(self) -> int:
        return len(self.columns)


@dataclass(frozen=True, eq=False)
class InertiaResults:
    """What `fit_inertia` found.

    Attributes:
        arm: The arm with its identified inertias.
        base: The base parameters.
        change: Change of the base parameters against the URDF, shape (r,).
        std: Their standard deviations; the prior's where the data are silent.
        informed: Share of each base parameter's prior variance that the data take away, 0 (silent) to 1.
        condition_number: Of the column-scaled, whitened base regressor: over 100 is poor excitation.
    """

    arm: ArmModel
    base: BaseParameters
    change: Float[Array, " r"]
    std: Float[Array, " r"]
    informed: Float[Array, " r"]
    condition_number: float


def base_parameters(arm: ArmModel) -> BaseParameters:
    """Base parameters of an arm's structure, from random states (fixed seed: the result is a property of the arm)."""
    rng = np.random.default_rng(0)
    q, dq, ddq = (rng.uniform(-np.pi, np.pi, (STATES_FOR_RANK, arm.n)) for _ in range(3))
    rows = arm.regressor(q, dq, ddq).reshape(-1, 10 * arm.n)
    factor, order = factor_by_pivots(rows)
    pivots = np.abs(np.diag(factor))
    rank = int(np.sum(pivots > RANK_TOLERANCE * pivots[0]))
    columns, others = order[:rank], order[rank:]
    mapping = np.zeros((rank, 10 * arm.n))
    mapping[:, columns] = np.eye(rank)
    mapping[:, others] = np.linalg.solve(factor[:rank, :rank], factor[:rank, rank : 10 * arm.n])
    names = tuple(f"{arm.links[i // 10]}.{PER_LINK[i % 10]}" for i in columns)
    return BaseParameters(tuple(int(i) for i in columns), freeze(mapping), names)


def parameter_scale(arm: ArmModel) -> Float[Array, " 10n"]:
    """Natural size of each inertial number: mass, mass × length and mass × length² of its link."""
    links = arm.inertial_parameters.reshape(arm.n, 10)
    mass = np.maximum(links[:, 0], LEAST_MASS)
    lever = np.linalg.norm(links[:, 1:4], axis=1) / mass
    radius = np.sqrt(np.maximum(links[:, 4] + links[:, 6] + links[:, 9], 0.0) / (2 * mass))
    length = np.maximum(np.maximum(lever, radius), LEAST_LENGTH)
    scale = np.concatenate(
        [mass[:, None], np.repeat((mass * length)[:, None], 3, 1), np.repeat((mass * length**2)[:, None], 6, 1)], 1
    )
    return freeze(scale.ravel())


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations of each joint's torque on (Δβ, its own loss figures), not whitened.

    Attributes:
        information: XᵀX of each joint, shape (n, r + p, r + p).
        score: Xᵀy of each joint, shape (n, r + p).
        rank: Number r of base parameters; p loss figures follow.
    """

    information: Float[Array, "n k k"]
    score: Float[Array, "n k"]
    rank: int

    def whitened(self, spread: Float[Array, " n"]) -> tuple[Float[Array, "m m"], Float[Array, " m"]]:
        """All joints in one system of r + n p unknowns, each joint weighted by its noise."""
        n, size = self.score.shape
        r, p = self.rank, size - self.rank
        information, score = np.zeros((r + n * p, r + n * p)), np.zeros(r + n * p)
        for j in range(n):
            index = np.array([*range(r), *range(r + p * j, r + p * (j + 1))])
            information[np.ix_(index, index)] += self.information[j] / spread[j] ** 2
            score[index] += self.score[j] / spread[j] ** 2
        return information, score


def fit_inertia(
    motions: Sequence[Motion],
    arm: ArmModel,
    mode: Mode,
    loss: LossModel | None = None,
    prior_share: float | None = None,
) -> InertiaResults:
    """Identifies link inertias together with the loss figures.

    Args:
        motions: Training runs; known payloads are part of the model.
        arm: The arm as its URDF describes it.
        mode: `base` or `consistent`; `nominal` returns the arm as it is.
        loss: Which loss figures are unknown too.
        prior_share: Standard deviation of the URDF's numbers as a share of `parameter_scale`; the mode's own if None.

    Raises:
        ValueError: Unknown mode.
    """
    if mode not in ("nominal", "base", "consistent"):
        raise ValueError(f"unknown inertia mode {mode!r}")
    loss = loss or LossModel()
    base = base_parameters(arm)
    scale = (prior_share or PRIOR_SHARE.get(mode, PRIOR_SHARE["base"])) * parameter_scale(arm)
    widths = loss.transition_speeds(motions, [_known_torque(arm, motion) for motion in motions])
    normal = _assemble(motions, arm, base, loss, widths)
    spread, change = np.ones(arm.n), np.zeros(10 * arm.n)
    fitted = arm
    if mode != "nominal":
        for _ in range(2):  # once with equal weights, once with each joint's own noise
            change, losses = _solve(*normal.whitened(spread), arm, base, mode, scale)
            fitted = arm.with_inertial_parameters(arm.inertial_parameters + change)
            spread = _effective_noise(motions, fitted, losses, widths)
    information, _ = normal.whitened(spread)
    prior = base.mapping * scale**2 @ base.mapping.T
    posterior = _posterior(free_of(information, base.rank), prior)
    return InertiaResults(
        arm=fitted,
        base=base,
        change=freeze(base.mapping @ change),
        std=freeze(np.sqrt(np.diag(posterior))),
        informed=freeze(1.0 - np.diag(posterior) / np.diag(prior)),
        condition_number=compute_condition(information[: base.rank, : base.rank]),
    )


def _assemble(
    motions: Sequence[Motion], arm: ArmModel, base: BaseParameters, loss: LossModel, widths: Array
) -> _Normal:
    """One pass over the runs; memory grows with the longest run, not with the recording."""
    n, used, columns = arm.n, (4 if loss.offset else 3), list(base.columns)
    size = base.rank + used
    information, score = np.zeros((n, size, size)), np.zeros((n, size))
    for motion in motions:
        rows = motion.filtered(arm.regressor(motion.q, motion.dq, motion.ddq, columns))
        target = motion.tau_filtered - motion.filtered(_known_torque(arm, motion))
        friction, moving = loss_columns(motion, widths)[..., :used], motion.moving
        for j in range(n):
            x = np.concatenate([rows[moving[:, j], j], friction[moving[:, j], j]], axis=1)
            information[j] += x.T @ x
            score[j] += x.T @ target[moving[:, j], j]
    return _Normal(information, score, base.rank)


def _solve(
    information: Array, score: Array, arm: ArmModel, base: BaseParameters, mode: str, scale: Array
) -> tuple[Array, Array]:
    """Most probable change of the inertial numbers, and the loss figures (non-negative but for offsets)."""
    values, vectors = np.linalg.eigh(information)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T  # rootᵀ root = information
    target = np.linalg.lstsq(root.T, score, rcond=None)[0]
    figures = (len(score) - base.rank) // arm.n
    bounded = [figures * j + k for j in range(arm.n) for k in range(3)]
    if mode == "base":
        lift = lift_base(base, scale)
        believed = np.concatenate([(1 / scale)[:, None] * lift, np.zeros((len(scale), arm.n * figures))], axis=1)
        tables = ((root, target), (believed, np.zeros(len(scale))))
        found = solve_bounded(tables, [base.rank + k for k in bounded])
        return np.asarray(lift @ found[: base.rank]), found[base.rank :].reshape(arm.n, figures)
    import cvxpy as cp  # slow to load: only where bodies are to be possible

    losses, unknown = cp.Variable(arm.n * figures), cp.Variable(10 * arm.n)
    change = cp.multiply(scale, unknown)
    misfit = root[:, : base.rank] @ (base.mapping @ change) + root[:, base.rank :] @ losses - target
    objective = cp.sum_squares(misfit) + cp.sum_squares(cp.multiply(1 / scale, change))
    links = arm.inertial_parameters + change
    constraints = [losses[k] >= 0 for k in bounded]
    constraints += [_pseudo_inertia(links[10 * i : 10 * i + 10]) >> 0 for i in range(arm.n)]
    cp.Problem(cp.Minimize(objective), constraints).solve(solver=cp.CLARABEL)
    return np.asarray(change.value), np.asarray(losses.value).reshape(arm.n, figures)


def lift_base(base: BaseParameters, scale: Float[Array, " 10n"]) -> Float[Array, "10n r"]:
    """Smallest change of the inertial numbers, in units of their scale, that changes the base parameters by one."""
    weighted = base.mapping * scale**2
    return weighted.T @ np.linalg.inv(weighted @ base.mapping.T)


def _pseudo_inertia(link: cp.Expression) -> cp.Expression:
    """The 4 × 4 matrix that is positive semidefinite for every body that can exist.

    Source: Wensing, Kim and Slotine 2018, eq. 12.
    """
    import cvxpy as cp

    mass, mx, my, mz, xx, xy, yy, xz, yz, zz = (link[k] for k in range(10))
    half = 0.5 * (xx + yy + zz)
    return cp.bmat(
        [
            [half - xx, -xy, -xz, mx],
            [-xy, half - yy, -yz, my],
            [-xz, -yz, half - zz, mz],
            [mx, my, mz, mass],
        ]
    )


def _known_torque(arm: ArmModel, motion: Motion) -> Float[Array, "T n"]:
    return arm.with_payload(motion.payload).inverse_dynamics(motion.q, motion.dq, motion.ddq)


def _effective_noise(
    motions: Sequence[Motion], arm: ArmModel, losses: Float[Array, "n p"], widths: Array
) -> Float[Array, " n"]:
    """Standard deviation of each joint's residual, inflated by its correlation time: what one sample is worth."""
    sums, counts, inflation = np.zeros(arm.n), np.zeros(arm.n), np.zeros(arm.n)
    for motion in motions:
        left = motion.tau_filtered - motion.filtered(_known_torque(arm, motion))
        left = left - np.einsum("tnk,nk->tn", loss_columns(motion, widths)[..., : losses.shape[1]], losses)
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


def free_of(information: Float[Array, "m m"], rank: int) -> Float[Array, "r r"]:
    """Information on the base parameters once the loss figures are free."""
    cross, own = information[:rank, rank:], information[rank:, rank:]
    return information[:rank, :rank] - cross @ np.linalg.pinv(own, hermitian=True) @ cross.T


def _posterior(information: Float[Array, "r r"], prior: Float[Array, "r r"]) -> Float[Array, "r r"]:
    """Covariance (information + prior⁻¹)⁻¹; the prior's root takes the units out before anything is inverted."""
    root = np.linalg.cholesky(prior)
    return root @ np.linalg.inv(root.T @ information @ root + np.eye(len(root))) @ root.T


def base_prior(base: BaseParameters, scale: Float[Array, " 10n"]) -> Float[Array, "r r"]:
    """Information on the base parameters that lies in trusting each inertial number to its scale."""
    return np.linalg.inv((base.mapping * scale**2) @ base.mapping.T)


def compute_condition(information: Array) -> float:
    """Condition number of the column-scaled regressor behind an information matrix."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values = np.linalg.eigvalsh(information / np.outer(size, size))
    if values[-1] <= 0.0:
        return float("inf")
    return float(np.sqrt(values[-1] / max(values[0], 1e-16 * values[-1])))
