"""LossModel: motor inertia, viscous damping and Coulomb friction of each joint, by convex least squares.

    τ_loss = B_m ddq + C_m dq + f_c sign(dq) (+ offset)

A hybrid model's figures come from the joint estimate of all that is linear (`ident.model.identification`). `LossModel`
is what the diagnosis linearises about: joint by joint, wherever a joint moves, reversals included, for its effects are
looked for there too and its gates were calibrated on that baseline. So both stand side by side.

Source: paper, eq. 3 and 5; one three-column problem a joint (the printed row form lacks the joint's index).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.errors import RecordingError
from ident.model.bounded import solve_bounded
from ident.motion.motion import Motion
from ident.numerics import student_quantile

NAMES = ("motor_inertia", "viscous", "coulomb", "offset")
UNITS = ("kg m²", "N m s/rad", "N m", "N m")
# Length of the blocks whose scores are taken as independent: several times the correlation time of residuals of
# arms (0.1 to 0.3 s) [s].
BLOCK_DURATION = 1.5
# Widths tried where none is given [rad/s].
TRANSITION_GRID = (0.002, 0.005, 0.01, 0.02, 0.04, 0.08)
# Residuals beyond this many robust standard deviations count linearly in the robust fit (Huber's k).
HUBER_KNEE = 1.345
# Samples in motion, all runs together, below which a joint has no loss to be fitted.
LEAST_MOVING = 20


@dataclass(frozen=True, eq=False)
class LossParameters:
    """Loss figures of n joints, in SI units for revolute joints.

    Attributes:
        motor_inertia: B_m, rotor inertia seen at the joint [kg m²].
        viscous: C_m [N m s/rad].
        coulomb: f_c [N m].
        offset: Constant torque [N m].
        transition_speed: Width v₀ of the sign's transition, tanh(dq / v₀); 0 is a pure sign, as in the paper [rad/s].
    """

    motor_inertia: Float[Array, " n"]
    viscous: Float[Array, " n"]
    coulomb: Float[Array, " n"]
    offset: Float[Array, " n"]
    transition_speed: Float[Array, " n"]

    def __post_init__(self) -> None:
        for name in (*NAMES, "transition_speed"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

    @classmethod
    def zero(cls, n: int) -> LossParameters:
        """No loss at all."""
        return cls(*(np.zeros(n) for _ in range(5)))

    def torque(self, dq: Float[Array, "T n"], ddq: Float[Array, "T n"]) -> Float[Array, "T n"]:
        """Loss torque [N m]. Source: paper, eq. 3."""
        slip = direction(dq, self.transition_speed)
        return self.motor_inertia * ddq + self.viscous * dq + self.coulomb * slip + self.offset


@dataclass(frozen=True, eq=False)
class LossResults:
    """What `LossModel.fit` found.

    Attributes:
        params: The figures.
        joints: Joint names.
        covariance: Covariance of (B_m, C_m, f_c, offset) of each joint, shape (n, 4, 4); block sandwich, so it
            respects autocorrelation.
        blocks: Number of independent blocks behind the covariance.
        residual_rms: Root mean square of what is left, where the joint moves [N m].
        at_bound: Names of figures that came to rest on zero, per joint: the data wanted them negative.
        dof: Degrees of freedom of each standard deviation; one a block if None.
    """

    params: LossParameters
    joints: tuple[str, ...]
    covariance: Float[Array, "n 4 4"]
    blocks: int
    residual_rms: Float[Array, " n"]
    at_bound: tuple[tuple[str, ...], ...]
    dof: Float[Array, "n 4"] | None = None

    def conf_int(self, level: float = 0.95) -> Float[Array, "n 4 2"]:
        """Confidence intervals of (B_m, C_m, f_c, offset), by Student's t with each one's degrees of freedom."""
        dof = np.asarray(max(1, self.blocks - len(NAMES)) if self.dof is None else np.minimum(self.dof, 1e6))
        reach = student_quantile(0.5 + level / 2, dof)
        std = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        values = np.stack([getattr(self.params, name) for name in NAMES], axis=1)
        return np.stack([values - reach * std, values + reach * std], axis=-1)

    def summary(self) -> str:
        """A table in text: one row a joint and figure."""
        limits = self.conf_int()
        lines = [f"{'joint':<22}{'figure':<15}{'value':>10}  {'95 % interval':<24}unit"]
        for j, joint in enumerate(self.joints):
            for k, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True)):
                value = getattr(self.params, name)[j]
                if limits[j, k, 0] == limits[j, k, 1] == 0.0:
                    continue  # was not fitted
                note = "  on its bound" if name in self.at_bound[j] else ""
                interval = f"[{limits[j, k, 0]:.4g}, {limits[j, k, 1]:.4g}]"
                lines.append(f"{joint:<22}{name:<15}{value:>10.4g}  {interval:<24}{unit}{note}")
        return "\n".join(lines)


@dataclass(frozen=True)
class LossFigure:
    """One loss figure with its 95 % interval, for reports."""

    joint: str
    name: str
    value: float
    low: float
    high: float
    unit: str


def loss_figures(loss: LossResults) -> tuple[LossFigure, ...]:
    """Those that were fitted, one by one."""
    limits = loss.conf_int()
    return tuple(
        LossFigure(
            joint, name, float(getattr(loss.params, name)[j]), float(limits[j, k, 0]), float(limits[j, k, 1]), unit
        )
        for j, joint in enumerate(loss.joints)
        for k, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True))
        if not (name == "offset" and limits[j, k, 0] == limits[j, k, 1] == 0.0)
    )


def direction(dq: Float[Array, "T n"], transition_speed: Float[Array, " n"]) -> Float[Array, "T n"]:
    """Direction of motion in [-1, 1]: tanh(dq / v₀), or sign(dq) where v₀ = 0."""
    width = np.asarray(transition_speed, dtype=float)
    return np.where(width > 0.0, np.tanh(dq / np.where(width > 0.0, width, 1.0)), np.sign(dq))


def loss_columns(motion: Motion, transition_speed: Float[Array, " n"]) -> Float[Array, "t n 4"]:
    """Filtered regressor columns of a run: ddq, dq, direction, one."""
    slip = direction(motion.dq, transition_speed)
    return motion.filtered(np.stack([motion.ddq, motion.dq, slip, np.ones_like(motion.dq)], axis=-1))


@dataclass(frozen=True)
class LossModel:
    """Fits loss figures to what the rigid arm leaves of the measured torque.

    Attributes:
        offset: Whether a constant torque is fitted too.
        robust: Huber's loss instead of squares: spikes at reversals lose their pull.
        transition_speed: As in `LossParameters`, one width for all joints [rad/s]; None finds each joint's own. The
            shape of Coulomb friction near standstill is the first thing that a fixed width gets wrong.
    """

    offset: bool = False
    robust: bool = False
    transition_speed: float | None = None

    def fit(
        self, motions: Sequence[Motion], analytic: Sequence[Float[Array, "T n"]], still: Collection[int] = ()
    ) -> LossResults:
        """Fits every joint by itself, where it moves.

        Args:
            motions: Training runs.
            analytic: Modelled rigid torque of each run [N m], not filtered.
            still: Joints that are not asked for: they get no loss.

        Raises:
            RecordingError: A joint hardly moves in any run.
        """
        joints = motions[0].joints
        widths = self.transition_speeds(motions, analytic)
        rows = [loss_columns(motion, widths) for motion in motions]
        targets = [m.tau_filtered - m.filtered(torque) for m, torque in zip(motions, analytic, strict=True)]
        nothing = np.zeros(4), np.zeros((4, 4)), 0, 0.0, ()
        fits = [nothing if j in still else self._fit_joint(j, motions, rows, targets) for j in range(len(joints))]
        values = np.stack([fit[0] for fit in fits], axis=1)
        return LossResults(
            params=LossParameters(values[0], values[1], values[2], values[3], widths),
            joints=joints,
            covariance=np.stack([fit[1] for fit in fits]),
            blocks=min((fit[2] for j, fit in enumerate(fits) if j not in still), default=0),
            residual_rms=freeze([fit[3] for fit in fits]),
            at_bound=tuple(fit[4] for fit in fits),
        )

    def transition_speeds(self, motions: Sequence[Motion], analytic: Sequence[Float[Array, "T n"]]) -> Array:
        """Each joint's transition width: the one given, or that of least squares on a grid [rad/s]."""
        n = motions[0].n
        if self.transition_speed is not None:
            return np.full(n, self.transition_speed)
        misfit = np.zeros((len(TRANSITION_GRID), n))
        targets = [m.tau_filtered - m.filtered(torque) for m, torque in zip(motions, analytic, strict=True)]
        rows = [loss_columns(motion, np.full(n, TRANSITION_GRID[0])) for motion in motions]
        for k, width in enumerate(TRANSITION_GRID):
            for row, motion in zip(rows, motions, strict=True):  # of all columns the width bends one
                row[..., 2] = motion.filtered(direction(motion.dq, np.full(n, width)))
            for j in range(n):
                x = np.concatenate([row[motion.moving[:, j], j] for row, motion in zip(rows, motions, strict=True)])
                y = np.concatenate([t[motion.moving[:, j], j] for t, motion in zip(targets, motions, strict=True)])
                left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
                misfit[k, j] = left @ left
        return np.asarray(TRANSITION_GRID)[np.argmin(misfit, axis=0)]

    def _fit_joint(
        self, j: int, motions: Sequence[Motion], rows: Sequence[Array], targets: Sequence[Array]
    ) -> tuple[Array, Array, int, float, tuple[str, ...]]:
        used = [0, 1, 2, 3] if self.offset else [0, 1, 2]
        moving = [motion.moving[:, j] for motion in motions]
        blocks: list[Array] = []
        for motion, there in zip(motions, moving, strict=True):
            label = (motion.time[motion.coarse][there] - motion.time[0]) // BLOCK_DURATION
            blocks.append(label + (blocks[-1].max(initial=-1) + 1 if blocks else 0))
        x = np.concatenate([row[there, j][:, used] for row, there in zip(rows, moving, strict=True)])
        y = np.concatenate([target[there, j] for target, there in zip(targets, moving, strict=True)])
        block = np.concatenate(blocks)
        if len(y) < LEAST_MOVING:
            name = motions[0].joints[j]
            raise RecordingError(
                motions[0].name, f"{name} hardly moves: its loss can't be fitted", "add runs that move it, or lock it"
            )
        estimate = self._solve(x, y)
        residual = y - x @ estimate
        covariance = np.zeros((4, 4))
        cells, count = _block_sandwich(x, residual, block)
        covariance[np.ix_(used, used)] = cells
        values = np.zeros(4)
        values[used] = estimate
        scale = np.sqrt(np.diag(covariance))
        bound = tuple(NAMES[k] for k in range(3) if values[k] <= 1e-3 * scale[k] + 1e-12)
        return values, covariance, count, float(np.sqrt(np.mean(residual**2))), bound

    def _solve(self, x: Float[Array, "T k"], y: Float[Array, " T"]) -> Float[Array, " k"]:
        """Non-negative least squares, or Huber's loss; the offset's sign is free."""
        scale = np.maximum(np.linalg.norm(x, axis=0) / np.sqrt(len(x)), 1e-12)
        if not self.robust:
            # The triangular factor holds all that squares need of the rows: three numbers instead of 10⁴.
            basis, factor = np.linalg.qr(x / scale)
            return solve_bounded([(factor, basis.T @ y)], range(3)) / scale
        import cvxpy as cp  # slow to load: only for Huber's loss

        unknown = cp.Variable(x.shape[1])
        start = np.linalg.lstsq(x / scale, y, rcond=None)[0]
        knee = HUBER_KNEE * 1.4826 * np.median(np.abs(y - (x / scale) @ start)) + 1e-9
        objective = cp.sum(cp.huber((y - (x / scale) @ unknown) / knee, 1))
        cp.Problem(cp.Minimize(objective), [unknown[:3] >= 0]).solve(solver=cp.CLARABEL)
        return np.asarray(unknown.value) / scale


def _block_sandwich(x: Array, residual: Array, block: Array) -> tuple[Float[Array, "k k"], int]:
    """Covariance of least squares whose errors are correlated within blocks (White's sandwich, by cluster)."""
    bread = np.linalg.pinv(x.T @ x)
    labels, index = np.unique(block, return_inverse=True)
    scores = np.zeros((len(labels), x.shape[1]))
    np.add.at(scores, index, x * residual[:, None])
    correction = len(labels) / max(1, len(labels) - x.shape[1])
    return correction * bread @ (scores.T @ scores) @ bread, len(labels)
