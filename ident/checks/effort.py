"""Measured torque against the robot's model: sign, scale, and torques that a model made.

Per joint, over all runs,

    tau = a_g g(q) + a_i (rnea(q, dq, ddq) - g(q)) + b tanh(dq / eps) + c dq + o,

all through the same filter, with a_g, a_i, b, c ≥ 0: gravity pulls, inertia resists and friction
brakes, whatever the URDF's masses, the rotor's inertia and the level of friction are. A flipped
sign can't be fitted so; its negative can.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from ident.arrays import Array, Bool, Float, least_squares
from ident.checks.channels import flat_top
from ident.checks.filtered_run import filter_run
from ident.checks.report import issue_of
from ident.checks.settings import USUAL_EFFORT, EffortSettings
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel
from ident.safe_read import toml_line

EVERY_ROW = slice(None)
# Width of the sign's transition at zero speed [rad/s]: a few times a filtered velocity's noise.
TRANSITION_RAD_S = 0.02
ORIGIN_STATES = 2000
# Change of a gravity torque beside its size that is rounding.
ROUNDING = 1e-9
# A torque that a limit cuts off says nothing of gravity, nor does its filtered value so near the
# limit, as a share of its range (chosen: as a filter settles).
NEAR_CUT = 0.03
# Where hardly a state is left beside the cut, all are taken (chosen: one in thirty).
LEAST_UNCUT = 0.03


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


def _surely_off(states: States, joint: int, rows: Bool[Array, " T"]) -> bool:
    """Whether gravity's coefficient is out of range however it is drawn.

    Strong friction that varies can hide it: the delete-one-piece jackknife of free coefficients is
    asked, of either sign, with and without a spring.
    """
    settings = states.settings
    tau = states.tau[rows, joint]
    terms = joint_terms(states, joint, rows)
    bare = [terms, np.ones(len(terms))]
    for columns in (bare, [*bare, states.q[rows, joint]]):
        coefficients, errors = jackknife(np.column_stack(columns), tau, settings.pieces)
        size = abs(float(coefficients[0]))
        doubt = settings.sure * float(errors[0])
        if size + doubt > settings.scale_low and size - doubt < settings.scale_high:
            return False
    return True


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


def check_effort(session: Session, arm: ArmModel, states: States) -> list[TelemetryIssue]:
    """Checks sign, scale and origin of the measured torque.

    Returns:
        Issues; empty where nothing is wrong, or nothing can be told.
    """
    changes = states.gravity.std(axis=0) > states.settings.static_Nm
    telling = states.moving | changes
    tested = np.flatnonzero(telling & states.alive).tolist()
    fits = {joint: TwoSigns.of(session, states, joint) for joint in tested}
    flipped = [joint for joint, fit in fits.items() if fit.is_flipped(states)]
    issues: list[TelemetryIssue] = []
    if flipped:
        worst = max(flipped, key=lambda joint: fits[joint].minus.explained)
        line = toml_line("effort_sign", {session.joints[joint]: -1 for joint in flipped})
        right = max(fits[worst].plus.explained, 0.0)
        wrong = fits[worst].minus.explained
        issue = issue_of("sign_alone", session, flipped, worst, line=line, wrong=wrong, right=right)
        issues.append(issue)
    issues += _check_scale(session, states, fits, flipped)
    return issues + _check_origin(session, arm, states)


@dataclass(frozen=True, eq=False)
class TwoSigns:
    """The fits of one joint's torque as it is, and of its negative."""

    joint: int  # its column
    rows: Bool[Array, " T"]  # states that count
    plus: SignedFit
    minus: SignedFit

    @classmethod
    def of(cls, session: Session, states: States, joint: int) -> TwoSigns:
        """Fits a joint's torque with either sign, of the states in which no limit cuts it off."""
        rows = _uncut(session, states, joint)
        plus = fit_signed(states, joint, 1.0, rows)
        minus = fit_signed(states, joint, -1.0, rows)
        return cls(joint, rows, plus, minus)

    def is_flipped(self, states: States) -> bool:
        """Whether minus the torque follows the model, and better than the torque as it is.

        Beside a spring, too: one that more than carries the joint is no sign.
        """
        settings = states.settings
        least = max(settings.sign_explains, self.plus.explained + settings.sign_better)
        if self.minus.explained <= least:
            return False
        minus = self.beside_spring(states, -1.0)
        return minus.explained > self.beside_spring(states, 1.0).explained

    def beside_spring(self, states: States, sign: float) -> SignedFit:
        """The fit of the torque times a sign (1 or -1), beside a spring of either sign."""
        return fit_signed(states, self.joint, sign, self.rows, spring=True)


def _uncut(session: Session, states: States, joint: int) -> Bool[Array, " T"]:
    """States whose torque a limit does not cut off.

    All, where no limit does, or hardly one is left.
    """
    measured = np.concatenate([run.effort[:, joint] for run in session.runs])
    filtered = states.tau[:, joint]
    margin = NEAR_CUT * np.ptp(measured)
    uncut = np.ones(len(states.tau), dtype=bool)
    for sign in (1.0, -1.0):
        count, level = flat_top(sign * measured)
        if count:
            uncut &= sign * filtered < level - margin
    return uncut if uncut.mean() > LEAST_UNCUT else np.ones_like(uncut)


def _check_scale(
    session: Session, states: States, fits: Mapping[int, TwoSigns], flipped: Sequence[int]
) -> list[TelemetryIssue]:
    """Torques that follow the model not at all, or at another size.

    A spring that carries the arm can hide gravity: what it could explain is no fault of the
    channel.

    Args:
        session: The recordings.
        states: Their states.
        fits: Of the joints that tell something.
        flipped: Those whose torque has the other sign.
    """
    settings = states.settings
    upright: dict[int, SignedFit] = {}
    deaf = []
    off = []
    for joint, fit in fits.items():
        is_flipped = joint in flipped
        upright[joint] = fit.minus if is_flipped else fit.plus
        if not states.heavy[joint]:
            continue
        sprung = fit.beside_spring(states, -1.0 if is_flipped else 1.0)
        if sprung.explained < settings.follows:
            deaf.append(joint)
            continue
        sizes = (upright[joint].gravity, sprung.gravity)
        outside = [not settings.scale_low < size < settings.scale_high for size in sizes]
        if all(outside) and _surely_off(states, joint, fit.rows):
            off.append(joint)
    issues = []
    if deaf:
        worst = min(deaf, key=lambda joint: upright[joint].explained)
        explained = max(upright[worst].explained, 0.0)
        change = states.gravity.std(axis=0)
        issue = issue_of("deaf", session, deaf, worst, explained=explained, change=change)
        issues.append(issue)
    if off:
        worst = max(off, key=lambda joint: abs(np.log(max(upright[joint].gravity, 1e-9))))
        scale = upright[worst].gravity
        counted = states.counted
        issues.append(issue_of("unit", session, off, worst, scale=scale, counted=counted))
    return issues


class RigidFit(NamedTuple):
    """How a rigid model explains one joint's torque without any friction."""

    left: float  # share of the torque's spread that it leaves
    friction: float  # friction beside it [N m]
    joint: int


def _check_origin(session: Session, arm: ArmModel, states: States) -> list[TelemetryIssue]:
    """Finds torques that a rigid model explains without any friction."""
    moving = np.flatnonzero(states.moving & states.alive)
    if len(states.q) < 20 * arm.n or not len(moving):
        return []
    rows = slice(None, None, max(1, len(states.q) // ORIGIN_STATES))
    ddq = states.ddq[rows]
    regressor = arm.regressor(states.q[rows], states.dq[rows], ddq)
    models = []
    for joint in moving:
        columns = regressor[:, joint]
        felt = np.any(columns != 0.0, axis=0)  # no joint feels the links before it
        rigid = np.column_stack([columns[:, felt], ddq[:, joint]])
        dq = states.dq[rows, joint]
        tau = states.tau[rows, joint]
        left, friction, computed = _without_friction(rigid, dq, tau, states.settings)
        if computed:
            models.append(RigidFit(left, friction, int(joint)))
    # One joint without friction may be a fine gear; most joints without are a computer.
    if len(models) < max(1.0, 0.5 * len(moving)):
        return []
    worst = min(models)
    joints = [model.joint for model in models]
    issue = issue_of(
        "computed", session, joints, worst.joint, left=worst.left, friction=worst.friction
    )
    return [issue]


def _without_friction(
    rigid: Float[Array, "T k"],
    dq: Float[Array, " T"],
    tau: Float[Array, " T"],
    settings: EffortSettings,
) -> tuple[float, float, bool]:
    """Whether a torque shows no friction beside a rigid model.

    Args:
        rigid: Columns of the model.
        dq: The joint's velocity [rad/s].
        tau: Its torque [N m].
        settings: What counts as none.

    Returns:
        Share of the torque's spread that the rigid columns leave, friction beside them [N m], and
        whether that is none.
    """
    friction = np.column_stack([np.tanh(dq / TRANSITION_RAD_S), dq])
    constant = np.ones(len(tau))
    table = np.column_stack([rigid, constant, friction])
    size = np.linalg.norm(table, axis=0)
    is_live = size > 1e-9 * size.max()
    table = table / np.where(is_live, size, np.inf)
    # All that least squares needs of the table is its triangle.
    whole = np.column_stack([table, tau])
    triangle = np.asarray(np.linalg.qr(whole, mode="r"))
    columns = triangle[:, :-1]
    target = triangle[:, -1]
    left_rigid, _ = _left_of(columns[:, :-2], target, len(tau))
    left_whole, weights = _left_of(columns, target, len(tau))
    spread = float(tau.std())
    gain = 0.0
    if left_rigid > 0.0:
        gain = 1.0 - (left_whole / left_rigid) ** 2
    of_friction = table[:, -2:] @ weights[-2:]
    level = float(np.sqrt(np.mean(of_friction**2)))
    share = left_rigid / spread
    explained = share**2 < 1.0 - settings.rigid_explains
    has_little = level < settings.friction_share * spread
    is_frictionless = has_little and gain < settings.friction_gain
    return share, level, share < 1e-6 or (explained and is_frictionless)


def _left_of(
    columns: Float[Array, "c k"], target: Float[Array, " c"], rows: int
) -> tuple[float, Float[Array, " k"]]:
    """Root mean square over so many rows of what columns leave of a target, and their weights."""
    weights = least_squares(columns, target, 1e-8)
    left = float(np.linalg.norm(target - columns @ weights))
    return left / np.sqrt(rows), weights
