"""Checks of the measured torque against the robot's model: sign, scale, and torques that a model
made.

Each asks the fits of `effort`: a flipped sign fits only as its negative, a wrong unit only at
another size, and what a computer made of the model alone shows no friction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Bool, Float, least_squares
from ident.checks.channels import flat_top
from ident.checks.effort import (
    TRANSITION_RAD_S,
    SignedFit,
    States,
    fit_signed,
    jackknife,
    joint_terms,
)
from ident.checks.report import issue_of
from ident.checks.settings import EffortSettings
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel
from ident.safe_read import toml_line

ORIGIN_STATES = 2000
# A torque that a limit cuts off says nothing of gravity, nor does its filtered value so near the
# limit, as a share of its range (chosen: as a filter settles).
NEAR_CUT = 0.03
# Where hardly a state is left beside the cut, all are taken (chosen: one in thirty).
LEAST_UNCUT = 0.03


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
