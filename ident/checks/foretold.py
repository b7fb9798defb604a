"""Runs foretold by other runs of their session.

How far each joint's torque is off a model fitted to the others.

Of each joint

    tau_j = Y_j(q, dq, ddq) π + b tanh(dq_j / eps) + c dq_j + d ddq_j + o

is fitted to some runs, π held near the URDF's, and the root mean square of what it leaves in
another run is that run's error. Its logarithm has about the same scatter at every joint of sound
sessions, whatever the arm is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.checks.filtered_run import filter_run
from ident.checks.settings import BETWEEN_RUNS as LIMIT
from ident.recordings.recording import Recording
from ident.robot.arm import ArmModel
from ident.robot.tolerance import PRIOR_SHARE, parameter_scale

TRANSITION_RAD_S = 0.02  # as for the sign of a torque
LOSSES = 4  # columns of a joint's losses: dry and viscous friction, its rotor, an offset
ROUNDING = 1e-12  # of sums, below which columns are the same
LEAST_SQUARE = 1e-24  # [(N m)²], so that logarithms stay finite


@dataclass(frozen=True, eq=False)
class RunStates:
    """A run's filtered states, thinned out, shapes (T, n)."""

    name: str
    q: Float[Array, "T n"]
    dq: Float[Array, "T n"]
    ddq: Float[Array, "T n"]
    tau: Float[Array, "T n"]
    moves: Bool[Array, "T n"]  # whether a joint moves, by the speed as it was read at first

    def halves(self) -> tuple[RunStates, RunStates]:
        """Its first and its second half."""
        middle = len(self.q) // 2
        return self.at(slice(middle)), self.at(slice(middle, None))

    def at(self, rows: slice) -> RunStates:
        """The states of a slice of rows, as a new object."""
        return RunStates(
            self.name,
            self.q[rows],
            self.dq[rows],
            self.ddq[rows],
            self.tau[rows],
            self.moves[rows],
        )


def states_of(run: Recording) -> RunStates | None:
    """A run's filtered states, thinned out for comparison; None where it is too short."""
    motion = filter_run(run)
    if motion is None:
        return None
    step = max(1, len(motion.q) // LIMIT.states)
    dq = motion.dq[::step]
    moves = np.abs(dq) > TRANSITION_RAD_S
    return RunStates(
        run.name,
        motion.q[::step],
        dq,
        motion.ddq[::step],
        motion.tau[::step],
        moves,
    )


class RunTables:
    """Makes sums of runs.

    Inner products of a joint's columns and torque, each a mean over the run's states.
    """

    def __init__(self, arm: ArmModel, runs: Sequence[RunStates]) -> None:
        self._arm = arm
        self._stated = np.array(arm.inertial_parameters)
        scale = PRIOR_SHARE["consistent"] * parameter_scale(arm)
        self._directions = scale[:, None] * felt_directions(arm, scale)
        speed = np.concatenate([run.dq for run in runs]).std(axis=0)
        acceleration = np.concatenate([run.ddq for run in runs]).std(axis=0)
        torque = np.concatenate([run.tau for run in runs]).std(axis=0)
        torque = np.maximum(torque, 1e-9)
        # Columns of losses in units that no prior holds back: each may be as large as the whole
        # torque.
        units = [
            torque,
            torque / np.maximum(speed, 1e-6),
            torque / np.maximum(acceleration, 1e-6),
            torque,
        ]
        self._loss_scale: Float[Array, "n 4"] = np.column_stack(units)

    def table(self, run: RunStates) -> Float[Array, "n T c"]:
        """Each joint's columns in a run, and last what its torque is beyond the URDF's, shape (n,
        T, c).

        The columns are combinations of the inertial parameters that the joint feels, in units of
        the prior, then friction's, the rotor's and the offset's.
        """
        regressor = self._arm.regressor(run.q, run.dq, run.ddq).transpose(1, 0, 2)
        dry = np.tanh(run.dq / TRANSITION_RAD_S)
        offset = np.ones_like(run.dq)
        losses = np.stack([dry, run.dq, run.ddq, offset], axis=-1)
        losses = losses.transpose(1, 0, 2) * self._loss_scale[:, None, :]
        beyond = run.tau.T - regressor @ self._stated
        felt = regressor @ self._directions
        return np.concatenate([felt, losses, beyond[:, :, None]], axis=-1)

    def sums(self, run: RunStates) -> Float[Array, "n c c"]:
        """The inner products of a run's table.

        Of each joint a mean over the states in which it moves; 0 without any.

        A joint that stands is held by anything between minus and plus its dry friction, for as long
        as it stands.
        """
        moves = run.moves.T[:, :, None]
        table = self.table(run) * moves
        count = np.maximum(run.moves.sum(axis=0), 1)
        gram = table.transpose(0, 2, 1) @ table
        return np.asarray(gram / count[:, None, None])

    def foretell(self, run: RunStates, coefficients: Float[Array, "n p"]) -> Float[Array, "T n"]:
        """A run's torques by some coefficients [N m]."""
        table = self.table(run)
        columns = table[:, :, :-1]
        stated = table[:, :, -1].T
        beyond = np.einsum("jtp,jp->tj", columns, coefficients)
        return np.asarray(run.tau - stated + beyond)

    def errors_of(
        self, sums: Float[Array, "*R n c c"], others: Fit, own_losses: bool = False
    ) -> Float[Array, "*R n"]:
        """Logarithm of each joint's root mean square error in a run, or each of some.

        Not a number where the joint never moves.

        Args:
            sums: Of each run.
            others: What others say of all of them, or of each.
            own_losses: Whether friction, rotors and offsets are each run's own, for on a sound arm
                they drift, too.
        """
        left = left_beside_losses if own_losses else left_square
        square = left(sums, others.coefficients)
        moves = sums[..., -1, -1] > 0.0
        return np.where(moves, 0.5 * np.log(square), np.nan)

    def errors_among(
        self, sums: Float[Array, "R n c c"], own_losses: bool = False
    ) -> Float[Array, "R n"]:
        """Logarithm of each run's root mean square error by joint, foretold by all other runs.

        Args:
            sums: Of each run.
            own_losses: Whether friction, rotors and offsets are each run's own.
        """
        return self.errors_of(sums, fits_among(sums), own_losses)


def felt_directions(arm: ArmModel, scale: Float[Array, " m"]) -> Float[Array, "n m r"]:
    """Orthonormal combinations of the scaled inertial numbers that each joint's torque may feel.

    The prior is the same in every direction of these units, so a fit among them is that among all
    numbers. As many for every joint; one that feels fewer has no torque along the others.

    Args:
        arm: The arm, of m inertial numbers.
        scale: Scale of each.
    """
    rng = np.random.default_rng(0)
    shape = (len(scale), arm.n)
    q, dq, ddq = (rng.uniform(-np.pi, np.pi, shape) for _ in range(3))
    rows = (arm.regressor(q, dq, ddq) * scale).transpose(1, 0, 2)
    _, _, directions = np.linalg.svd(rows)
    rank = int(np.linalg.matrix_rank(rows).max())
    return np.asarray(directions[:, :rank].transpose(0, 2, 1))


@dataclass(frozen=True, eq=False)
class Fit:
    """What some runs say of each joint's coefficients; or several such fits, side by side.

    Attributes:
        coefficients: The likeliest.
        precision: Of them, each run an observation: samples of a run say much the same.
    """

    coefficients: Float[Array, "*R n p"]
    precision: Float[Array, "*R n p p"]

    def open_square(self, sums: Float[Array, "*R n c c"]) -> Float[Array, "*R n"]:
        """Mean square of what the coefficients leave open in a run, or each of some [(N m)²].

        Much, where it moves as none of them.
        """
        count = self.coefficients.shape[-1]
        covariance = solve_positive(self.precision, np.eye(count))
        across = sums[..., :count, :count].swapaxes(-1, -2)
        return np.asarray((covariance * across).sum(axis=(-1, -2)))


def fit(sums: Float[Array, "*R n c c"], runs: int) -> Fit:
    """Coefficients of each joint, the prior weighed against the noise that they leave.

    Args:
        sums: Inner products, a mean over runs; or several such means.
        runs: How many runs that are.

    Source: the prior's weight is found as in evidence maximisation (MacKay 1992), by fixed-point
    steps.
    """
    count = sums.shape[-1] - 1
    unit = np.eye(count)
    among = sums[..., :count, :count]
    target = sums[..., :count, -1:]
    noise = np.maximum(sums[..., -1, -1], LEAST_SQUARE)
    coefficients = np.zeros((*noise.shape, count))
    for _ in range(LIMIT.rounds):
        weight = (noise / LIMIT.states)[..., None, None]
        normal = among + weight * unit
        coefficients = solve_positive(normal, target)[..., 0]
        noise = left_square(sums, coefficients)
    precision = runs * among / noise[..., None, None] + unit
    return Fit(coefficients, precision)


def solve_positive(
    matrices: Float[Array, "*n p p"], right: Float[Array, "*n p k"]
) -> Float[Array, "*n p k"]:
    """Solutions of positive systems, in which columns may be the same but for rounding.

    They are solved in units of the diagonals.

    Args:
        matrices: One of each system.
        right: Right-hand sides of each, or one for all.
    """
    power = matrices.diagonal(axis1=-2, axis2=-1)
    size = np.sqrt(power)[..., None]
    scale = size * size.swapaxes(-1, -2)
    ridge = ROUNDING * np.eye(matrices.shape[-1])
    scaled = matrices / scale + ridge
    solution = np.linalg.solve(scaled, right / size)
    return np.asarray(solution / size)


def left_square(
    sums: Float[Array, "*R n c c"], coefficients: Float[Array, "*R n p"]
) -> Float[Array, "*R n"]:
    """Mean square of what coefficients leave of each joint's torque [(N m)²]."""
    weights = _weights(coefficients)
    across = (sums @ weights[..., None])[..., 0]
    square = (weights * across).sum(axis=-1)
    return np.asarray(np.maximum(square, LEAST_SQUARE))


def left_beside_losses(
    sums: Float[Array, "*R n c c"], coefficients: Float[Array, "*R n p"]
) -> Float[Array, "*R n"]:
    """Mean square of what coefficients leave of a run beside losses of its own [(N m)²]."""
    weights = _weights(coefficients)
    across = (sums @ weights[..., None])[..., 0]
    losses = slice(-1 - LOSSES, -1)
    along = across[..., losses]
    normal = sums[..., losses, losses] + LEAST_SQUARE * np.eye(LOSSES)
    follow = solve_positive(normal, along[..., None])[..., 0]
    square = (weights * across).sum(axis=-1)
    left = square - (along * follow).sum(axis=-1)
    return np.asarray(np.maximum(left, LEAST_SQUARE))


def _weights(coefficients: Float[Array, "*R n p"]) -> Float[Array, "*R n c"]:
    """Weights of a table's columns that leave of its last what coefficients do not explain."""
    of_torque = np.ones((*coefficients.shape[:-1], 1))
    return np.concatenate([-coefficients, of_torque], axis=-1)


def fits_among(sums: Float[Array, "R n c c"]) -> Fit:
    """For each run the fit to all other runs, in the runs' order."""
    count = len(sums) - 1
    return fit((sums.sum(axis=0) - sums) / count, count)


def mean_error(errors: Float[Array, "R n"]) -> Float[Array, " n"]:
    """Mean over the runs in which each joint moves, by joint; NaN where it moves in none.

    Args:
        errors: By run and joint; NaN where the joint does not move.
    """
    moves = np.isfinite(errors)
    total = np.where(moves, errors, 0.0).sum(axis=0)
    runs = np.maximum(moves.sum(axis=0), 1)
    mean = total / runs
    return np.where(moves.any(axis=0), mean, np.nan)
