"""Fits of the measured torque to the robot's model, joint by joint, with either sign.

Per joint, over all runs,

    tau = a_g g(q) + a_i (rnea(q, dq, ddq) - g(q)) + b tanh(dq / eps) + c dq + o,

all through the same filter, with a_g, a_i, b, c ≥ 0: gravity pulls, inertia resists and friction
brakes, whatever the URDF's masses, the rotor's inertia and the level of friction are. A flipped
sign can't be fitted so; its negative can.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from ident.arrays import Array, Bool, Float, least_squares
from ident.checks.filtered_run import filter_run
from ident.checks.settings import USUAL_EFFORT, EffortSettings
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel

EVERY_ROW = slice(None)
# Width of the sign's transition at zero speed [rad/s]: a few times a filtered velocity's noise.
TRANSITION_RAD_S = 0.02
# Change of a gravity torque beside its size that is rounding.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class States:
    """Filtered states of all runs, and the model's torque in two parts, shapes (T, n)."""

    q: Float[Array, "T n"]
    dq: Float[Array, "T n"]
    ddq: Float[Array, "T n"]
    tau: Float[Array, "T n"]
    gravity: Float[Array, "T n"]
    inertial: Float[Array, "T n"]
    settings: EffortSettings = USUAL_EFFORT
    # What the model has beside the URDF because the torques ask for it, in words.
    guessed: str = ""

    @property
    def counted(self) -> str:
        """Words about what of the model is a guess, to be put behind it; "" where nothing is."""
        return f" with {self.guessed}" if self.guessed else ""

    @property
    def moving(self) -> Bool[Array, " n"]:
        """Which joints move: the root mean square of their speed exceeds a threshold."""
        mean_square = np.mean(self.dq**2, axis=0)
        return np.sqrt(mean_square) > self.settings.moving_rad_s

    @property
    def alive(self) -> Bool[Array, " n"]:
        """Which joints have a torque that changes at all."""
        spread = self.tau.std(axis=0)
        largest = max(float(np.abs(self.tau).max()), 1e-300)
        return spread > 1e-6 * largest

    @property
    def heavy(self) -> Bool[Array, " n"]:
        """Which joints have a gravity torque that changes much: in N m, and beside that of the
        others.
        """
        change = self.gravity.std(axis=0)
        much = change > self.settings.heavy_share * change.max()
        return much & (change > self.settings.heavy_Nm)

    @property
    def varies(self) -> Bool[Array, " n"]:
        """Which joints have a gravity torque that changes at all: that of a vertical slide is
        constant, and so no other than an offset.
        """
        return self.gravity.std(axis=0) > ROUNDING * np.abs(self.gravity).max(axis=0)


class SignedFit(NamedTuple):
    """The fit of one joint's torque, all physical coefficients non-negative."""

    explained: float  # share of the torque's variance that is explained
    gravity: float  # a_g
    inertia: float  # a_i


def collect_states(
    session: Session, arm: ArmModel, settings: EffortSettings = USUAL_EFFORT, guessed: str = ""
) -> States | None:
    """The filtered motion of all runs; None where every run is too short.

    Args:
        session: The recordings.
        arm: Their robot.
        settings: Thresholds.
        guessed: What of the arm is a guess, in words.
    """
    filtered = [filter_run(run) for run in session.runs]
    motions = [motion for motion in filtered if motion is not None]
    if not motions:
        return None
    q = np.concatenate([motion.q for motion in motions])
    dq = np.concatenate([motion.dq for motion in motions])
    ddq = np.concatenate([motion.ddq for motion in motions])
    tau = np.concatenate([motion.tau for motion in motions])
    gravity = arm.gravity(q)
    inertial = arm.inverse_dynamics(q, dq, ddq) - gravity
    return States(q, dq, ddq, tau, gravity, inertial, settings, guessed)


def joint_terms(states: States, joint: int, rows: Array | slice = EVERY_ROW) -> Float[Array, "T 4"]:
    """Terms of a joint's torque, side by side: gravity [N m], inertial torque [N m], direction of
    dry friction in [-1, 1], speed [rad/s].

    Args:
        states: Of all joints.
        joint: Which of them.
        rows: States that count.
    """
    dq = states.dq[rows, joint]
    dry = np.tanh(dq / TRANSITION_RAD_S)
    gravity = states.gravity[rows, joint]
    inertial = states.inertial[rows, joint]
    return np.column_stack([gravity, inertial, dry, dq])


def fit_signed(
    states: States,
    joint: int,
    sign: float,
    rows: Array | slice = EVERY_ROW,
    spring: bool = False,
) -> SignedFit:
    """One joint's torque, times a sign, with coefficients that are not negative.

    Args:
        states: Of all joints.
        joint: Which of them.
        sign: What the torque is multiplied by.
        rows: States that count.
        spring: Whether a spring of either sign stands beside them.

    Returns:
        Share of the variance that is explained (below 0 where it is worse than the mean), and the
        coefficients of the model's gravity and inertia.
    """
    tau = sign * states.tau[rows, joint]
    table = joint_terms(states, joint, rows)
    table[:, 0] -= table[:, 0].mean()
    size = np.linalg.norm(table, axis=0)
    # Columns that are zero but for rounding would get coefficients without meaning.
    live = size > 1e-6 * max(float(size.max()), 1e-12)
    divisor = np.where(live, size, 1.0)
    scaled = np.where(live, table / divisor, 0.0)
    either_sign = [np.ones(len(tau))]
    if spring:
        either_sign.append(states.q[rows, joint])
    free, _ = np.linalg.qr(np.column_stack(either_sign))
    whole = np.column_stack([scaled, tau])
    beside = whole - free @ (free.T @ whole)
    triangle = np.asarray(np.linalg.qr(beside, mode="r"))
    weights, left = nnls(triangle[:, :-1], triangle[:, -1])
    gravity, inertia, *_ = np.where(live, weights / divisor, 0.0)
    with np.errstate(over="ignore", invalid="ignore"):  # cells may hold any number
        variance = float(tau.var())
    is_known = 0.0 < variance < np.inf
    explained = 1.0 - left**2 / len(tau) / variance if is_known else 0.0
    return SignedFit(float(explained), float(gravity), float(inertia))


def jackknife(
    table: Float[Array, "T k"], target: Float[Array, " T"], pieces: int
) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """A least-squares fit, and its errors by leaving out one piece of the rows at a time.

    Args:
        table: Columns.
        target: What they are fitted to.
        pieces: Into how many pieces the rows are parted, in their order.

    Returns:
        Coefficients, and their standard errors.
    """
    rows_in_all = len(table)
    piece = np.arange(rows_in_all) * pieces // rows_in_all
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-12)
    whole = np.column_stack([table / size, target])
    by_piece = []
    for number in range(pieces):
        rows = whole[piece == number]
        by_piece.append(rows.T @ rows)
    sums = np.stack(by_piece)
    total = sums.sum(axis=0)

    def solve(products: Float[Array, "c c"]) -> Float[Array, " k"]:
        normal = products[:-1, :-1]
        right = products[:-1, -1]
        return least_squares(normal, right, 1e-10) / size

    left_out = [solve(total - products) for products in sums]
    variance = np.var(left_out, axis=0)
    return solve(total), np.sqrt((pieces - 1) * variance)


def explained_by_model(session: Session, arm: ArmModel) -> float:
    """Median over the heavy joints of the share of torque that is explained with either sign.

    0 where no run is long enough or no joint is heavy.
    """
    states = collect_states(session, arm)
    if states is None or not states.heavy.any():
        return 0.0
    shares = []
    for joint in np.flatnonzero(states.heavy):
        fits = [fit_signed(states, int(joint), sign) for sign in (1.0, -1.0)]
        shares.append(max(fit.explained for fit in fits))
    return float(np.median(shares))
