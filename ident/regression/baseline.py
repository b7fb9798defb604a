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
# Columns of motion that a joint's losses follow: acceleration and speed.
MOTIONS = 2
# Share of the URDF's information that a solution beside any links whatever keeps: next to nothing,
# so that what no motion shows stays where the URDF has it (chosen: for the solution's numbers).
ANY_LINKS = 1e-6
# Columns of what else an arm's rest and place may put on a joint: see `_of_place`.
PLACES = 6
# Share below which a column is none, and an eigenvalue of columns of size one is another's (chosen:
# beyond rounding).
ALIKE = 1e-10


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
        """A copy whose scale and distance of centres are divided by a factor."""
        return UrdfError(self.scale / factor, self.com_m / factor, self.usual)


@dataclass(frozen=True, eq=False)
class Baseline:
    """The tuned model.

    Attributes:
        nominal: The arm as the URDF describes it.
        arm: The arm after tuning.
        base: Its base parameters.
        prior: Information on the base parameters' change that lies in the URDF, shape (r, r).
        loss: Tuned loss parameters.
        sliding: How each joint's dry friction turns round.
        number_std: Standard deviation of each link's inertial numbers, as believed.
        settings: What the regression counts with.
    """

    nominal: ArmModel
    arm: ArmModel
    base: BaseParameters
    prior: Float[Array, "r r"]
    loss: LossParameters
    sliding: Sliding
    number_std: Float[Array, " 10n"]
    settings: RegressionSettings = USUAL_REGRESSION

    def prior_of(
        self, error: UrdfError, wrong_link: int | None = None, factor: float = 1.0
    ) -> Float[Array, "r r"]:
        """Information on the base parameters' change in a URDF that is so far off.

        Args:
            error: How far its inertias are believed to be off.
            wrong_link: Index of a link that is off by more; none if None.
            factor: By how many times more.
        """
        shifted = self._shift_by_centres(error.com_m)
        std = np.hypot(error.scale * self.number_std, shifted)
        for link in error.usual:
            numbers = slice(10 * link, 10 * (link + 1))
            std[numbers] = min(error.scale, 1.0) * self.number_std[numbers]
        if wrong_link is not None:
            std[10 * wrong_link : 10 * (wrong_link + 1)] *= factor
        return base_prior(self.base, std)

    def _shift_by_centres(self, com_m: float) -> Float[Array, " 10n"]:
        """What centres of mass so far off change of mass, first moments and moments of inertia."""
        links = self.nominal.inertial_parameters.reshape(-1, 10)
        axis = com_m / np.sqrt(3.0)
        mass = links[:, :1]
        lever = np.linalg.norm(links[:, 1:4], axis=1, keepdims=True)
        moment = mass * axis
        inertia = 2.0 * lever * axis + mass * axis**2
        numbers = [0.0 * mass, np.repeat(moment, 3, 1), np.repeat(inertia, 6, 1)]
        return np.concatenate(numbers, axis=1).ravel()


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
    joint's own noise. How friction turns round is found beside links of any inertia and torques of
    the joint's place: a load that the URDF lacks, a spring or a tilt would else be taken for it.

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
    _require_moving(motions, still)
    sums = _sums_of_joints(motions, arm, base)
    sums[list(still)] = 0.0
    prior = lift.T @ (lift / number_std[:, None] ** 2)
    of_any_links = np.zeros(base.rank)
    noise = np.ones(arm.n)
    for last in (False, True):
        widths = _transition_widths(sums, of_any_links)
        of_any_links, _, of_place = _solve(sums, ANY_LINKS * prior, widths, noise, PLACES)
        change, losses, _ = _solve(sums, prior, widths, noise)
        rotor, viscous, coulomb = losses.T
        speeds = np.asarray(TRANSITION_GRID)[widths]
        loss = LossParameters(rotor, viscous, coulomb, np.zeros(arm.n), speeds)
        tuned = arm.with_inertial_parameters(arm.inertial_parameters + lift @ change)
        if not last:
            noise = _effective_noise(motions, tuned, loss)
    if sliding is None:
        loaded = arm.with_inertial_parameters(arm.inertial_parameters + lift @ of_any_links)
        rigid = []
        beside = []
        for motion in motions:
            placed = np.einsum("tnk,nk->tn", _of_place(arm, motion), of_place)
            rigid.append(rigid_torque(tuned, motion))
            beside.append(rigid_torque(loaded, motion) + placed)
        sliding = fit_sliding(motions, rigid, beside, base.rank + PLACES)
    return Baseline(
        nominal=arm,
        arm=tuned,
        base=base,
        prior=base_prior(base, number_std),
        loss=loss,
        sliding=sliding,
        number_std=number_std,
        settings=settings,
    )


def _require_moving(motions: Sequence[Motion], still: Collection[int]) -> None:
    """Raises RecordingError where a joint that is not known to stand still hardly moves."""
    moving = np.sum([motion.moving.sum(axis=0) for motion in motions], axis=0)
    hardly = set(np.flatnonzero(moving < LEAST_MOVING).tolist())
    for j in sorted(hardly - set(still)):
        what = f"{motions[0].joints[j]} hardly moves: its loss can't be fitted"
        raise RecordingError(motions[0].name, what, "add runs that move it, or lock it")


def _solve(
    sums: Float[Array, "n p p"],
    prior: Float[Array, "r r"],
    widths: Int[Array, " n"],
    noise: Float[Array, " n"],
    places: int = 0,
) -> tuple[Float[Array, " r"], Float[Array, "n l"], Float[Array, "n k"]]:
    """Base parameters, losses and torques of place of least squares; no loss is negative.

    Args:
        sums: As `_sums_of_joints` has them.
        prior: Information on the base parameters that lies in the URDF.
        widths: Place in the grid of each joint's transition width.
        noise: By which each joint's rows are divided [N m].
        places: How many of each joint's torques of place are solved for.

    Returns:
        The change of the base parameters; each joint's losses; and the coefficients of its torques
        of place, which are of either sign.
    """
    n = len(sums)
    rank = len(prior)
    first_place = rank + LOSSES * n
    unknown = first_place + places * n
    whole = np.zeros((unknown + 1, unknown + 1))
    whole[:rank, :rank] = prior
    for j in range(n):
        losses = rank + LOSSES * j + np.arange(LOSSES)
        of_place = first_place + places * j + np.arange(places)
        unknowns = np.array([*range(rank), *losses, *of_place, -1])
        in_motion = rank + MOTIONS
        of_places = in_motion + len(TRANSITION_GRID) + np.arange(places)
        columns = np.array([*range(in_motion), in_motion + widths[j], *of_places, -1])
        of_joint = sums[j][np.ix_(columns, columns)] / noise[j] ** 2
        whole[np.ix_(unknowns, unknowns)] += of_joint
    solution = solve_partly_non_negative(whole, range(rank, first_place))
    of_losses = solution[rank:first_place].reshape(n, LOSSES)
    return solution[:rank], of_losses, solution[first_place:].reshape(n, places)


def rigid_torque(arm: ArmModel, motion: Motion) -> Float[Array, "T n"]:
    """Rigid torque of a run with its known payload [N m]."""
    return arm.with_payload(motion.payload).inverse_dynamics(motion.q, motion.dq, motion.ddq)


def _sums_of_joints(
    motions: Sequence[Motion], arm: ArmModel, base: BaseParameters
) -> Float[Array, "n p p"]:
    """Sums of squares and products over each joint's moving rows.

    Columns: base parameters, acceleration, speed, direction at each width of the grid, torques of
    place, and the torque beside the rigid arm's.
    """
    size = base.rank + MOTIONS + len(TRANSITION_GRID) + PLACES + 1
    sums = np.zeros((arm.n, size, size))
    for motion in motions:
        regressor = arm.regressor(motion.q, motion.dq, motion.ddq, list(base.columns))
        rows = motion.filtered(regressor)
        turning = [np.tanh(motion.dq / width) for width in TRANSITION_GRID]
        losses = np.stack([motion.ddq, motion.dq, *turning], axis=-1)
        rigid = rigid_torque(arm, motion)[..., None]
        beside = np.concatenate([losses, _of_place(arm, motion), rigid], axis=-1)
        filtered = motion.filtered(beside)
        filtered[..., -1] = motion.tau_filtered - filtered[..., -1]
        for j in range(arm.n):
            there = motion.moving[:, j]
            x = np.concatenate([rows[there, j], filtered[there, j]], axis=1)
            sums[j] += x.T @ x
    return sums


def _of_place(arm: ArmModel, motion: Motion) -> Float[Array, "T n k"]:
    """Torques of each joint that follow from where the arm is, other than its links' weight.

    An offset; a spring, or a load on a lever, by the joint's own angle; and gravity across the
    one that the URDF's base has, as where it is tilted.
    """
    ones = np.ones_like(motion.q)
    springs = [motion.q, np.cos(motion.q), np.sin(motion.q)]
    _, _, across = np.linalg.svd(np.reshape(arm.model.gravity.linear, (1, 3)))
    tilts = []
    for axis in across[1:]:
        torque = arm.with_gravity(axis).gravity(motion.q)
        # None but for rounding, of a joint whose axis lies along it.
        is_felt = np.abs(torque).max(axis=0) > ALIKE * np.abs(torque).max()
        tilts.append(np.where(is_felt, torque, 0.0))
    return np.stack([ones, *springs, *tilts], axis=-1)


def _transition_widths(sums: Float[Array, "n p p"], change: Float[Array, " r"]) -> Int[Array, " n"]:
    """Place in the grid of each joint's transition width that leaves least torque beside changed
    base parameters and torques of place.
    """
    rank = len(change)
    moments = sums[..., -1] - sums[..., :rank] @ change
    motions = rank + np.arange(MOTIONS)
    first_width = rank + MOTIONS
    places = first_width + len(TRANSITION_GRID) + np.arange(PLACES)
    size = np.sqrt(np.maximum(np.diagonal(sums, axis1=1, axis2=2), 1e-300))
    scaled = sums / size[:, :, None] / size[:, None, :]
    explained = []
    for k in range(len(TRANSITION_GRID)):
        columns = np.array([*motions, first_width + k, *places])
        # Torques of place may be each other's, as where gravity turns about one axis alone.
        inverse = np.linalg.pinv(scaled[:, columns[:, None], columns], ALIKE, hermitian=True)
        score = moments[:, columns] / size[:, columns]
        explained.append(np.einsum("nk,nkl,nl->n", score, inverse, score))
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
    square = np.maximum(sums, 1e-12) / counts
    return np.sqrt(square * np.maximum(inflation / counts, 1.0))


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
