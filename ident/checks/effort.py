"""Measured torque against the robot's model: sign, scale, and torques that are only a model of themselves.

Per joint, over all runs,

    tau = a_g g(q) + a_i (rnea(q, dq, ddq) - g(q)) + b tanh(dq / eps) + c dq + o,

all through the same filter, with a_g, a_i, b, c ≥ 0: gravity pulls, inertia resists and friction brakes, whatever the
URDF's masses, the rotor's inertia and the level of friction are. A flipped sign can't be fitted so; its negative can.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Bool, Float, least_squares
from ident.checks.channels import flat_top
from ident.checks.filtered_run import USUAL_EFFORT, EffortSettings, filter_run
from ident.checks.report import issue_of
from ident.optimum import non_negative_least_squares
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel
from ident.safe_read import toml_key

# Width of the sign's transition at zero speed [rad/s]: a few times the noise of a filtered velocity.
TRANSITION_RAD_S = 0.02
ORIGIN_STATES = 2000
# A torque that a limit cuts off says nothing of gravity, nor does its filtered value so near the limit, as a share of
# its range; where hardly a state is left beside the cut, all are taken (chosen: as a filter settles; one in thirty).
NEAR_CUT, LEAST_UNCUT = 0.03, 0.03


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

    @property
    def moving(self) -> Bool[Array, " n"]:
        """Joints that move."""
        return np.sqrt(np.mean(self.dq**2, axis=0)) > self.settings.moving_rad_s

    @property
    def alive(self) -> Bool[Array, " n"]:
        """Joints whose torque changes at all."""
        spread = self.tau.std(axis=0)
        return spread > 1e-6 * max(float(np.abs(self.tau).max()), 1e-300)

    @property
    def heavy(self) -> Bool[Array, " n"]:
        """Joints on which gravity changes much."""
        change = self.gravity.std(axis=0)
        return (change > self.settings.heavy_share * change.max()) & (change > self.settings.heavy_Nm)


class SignedFit(NamedTuple):
    """The fit of one joint's torque, all physical coefficients non-negative."""

    explained: float  # share of the torque's variance that is explained
    gravity: float  # a_g
    inertia: float  # a_i


def collect_states(session: Session, arm: ArmModel, settings: EffortSettings = USUAL_EFFORT) -> States | None:
    """The filtered motion of all runs; None where every run is too short."""
    motions = [motion for run in session.runs if (motion := filter_run(run)) is not None]
    if not motions:
        return None
    q, dq, ddq, tau = (np.concatenate([getattr(one, name) for one in motions]) for name in ("q", "dq", "ddq", "tau"))
    gravity = arm.gravity(q)
    return States(q, dq, ddq, tau, gravity, arm.inverse_dynamics(q, dq, ddq) - gravity, settings)


def joint_terms(states: States, joint: int, rows: Array | slice = slice(None)) -> Float[Array, "T 4"]:
    """What a joint's torque is made of: gravity, inertia, dry and viscous friction."""
    gravity, inertial, dq = (one[rows, joint] for one in (states.gravity, states.inertial, states.dq))
    return np.column_stack([gravity, inertial, np.tanh(dq / TRANSITION_RAD_S), dq])


def fit_signed(
    states: States, joint: int, sign: float, rows: Array | slice = slice(None), spring: bool = False
) -> SignedFit:
    """One joint's torque, times a sign, with coefficients that are not negative; beside a spring of either sign."""
    tau, table = sign * states.tau[rows, joint], joint_terms(states, joint, rows)
    table[:, 0] -= table[:, 0].mean()
    size = np.linalg.norm(table, axis=0)
    # Columns that are zero but for rounding would get coefficients without meaning.
    live = size > 1e-6 * max(float(size.max()), 1e-12)
    scaled = np.where(live, table / np.where(live, size, 1.0), 0.0)
    free, _ = np.linalg.qr(np.column_stack([np.ones(len(tau)), states.q[rows, joint]][: 1 + spring]))
    whole = np.column_stack([scaled, tau])
    triangle = np.asarray(np.linalg.qr(whole - free @ (free.T @ whole), mode="r"))
    weights, left = non_negative_least_squares(triangle[:, :-1], triangle[:, -1])
    variance = float(tau.var())
    coefficients = np.where(live, weights / np.where(live, size, 1.0), 0.0)
    explained = 1.0 - left**2 / len(tau) / variance if variance > 0.0 else 0.0
    return SignedFit(float(explained), float(coefficients[0]), float(coefficients[1]))


def jackknife(
    table: Float[Array, "T k"], target: Float[Array, " T"], pieces: int
) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Coefficients of a least-squares fit, and their errors by leaving out one piece of the rows at a time."""
    steps = np.arange(len(table)) * pieces // len(table)
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-12)
    whole = np.column_stack([table / size, target])
    each = np.stack([whole[steps == k].T @ whole[steps == k] for k in range(pieces)])
    found, *parts = (
        least_squares(sums[:-1, :-1], sums[:-1, -1], 1e-10) / size
        for sums in [each.sum(axis=0), *(each.sum(axis=0) - one for one in each)]
    )
    return found, np.sqrt((pieces - 1) * np.var(parts, axis=0))


def _surely_off(states: States, joint: int, rows: Bool[Array, " T"]) -> bool:
    """Whether gravity's coefficient is out of range however it is drawn: strong friction that varies can hide it.

    Delete-one-piece jackknife of free coefficients, of either sign, with and without a spring.
    """
    held = states.settings
    terms = joint_terms(states, joint, rows)
    bare = [terms, np.ones(len(terms))]
    for columns in (bare, [*bare, states.q[rows, joint]]):
        whole, error = jackknife(np.column_stack(columns), states.tau[rows, joint], held.pieces)
        size, doubt = abs(float(whole[0])), held.sure * float(error[0])
        if size + doubt > held.scale_low and size - doubt < held.scale_high:
            return False
    return True


def explained_by_model(session: Session, arm: ArmModel) -> float:
    """Median over the heavy joints of the share of torque that is explained with either sign."""
    states = collect_states(session, arm)
    if states is None or not states.heavy.any():
        return 0.0
    heavy = map(int, np.flatnonzero(states.heavy))
    return float(np.median([max(fit_signed(states, j, sign).explained for sign in (1.0, -1.0)) for j in heavy]))


def check_effort(session: Session, arm: ArmModel, states: States) -> list[TelemetryIssue]:
    """Sign, scale and origin of the measured torque."""
    held = states.settings
    telling = states.moving | (states.gravity.std(axis=0) > held.static_Nm)
    tested = [int(joint) for joint in np.flatnonzero(telling & states.alive)]
    rows = {}
    for j in tested:  # states whose torque a limit does not cut off; all where no limit does, or hardly one is left
        every, kept = np.concatenate([run.effort[:, j] for run in session.runs]), np.ones(len(states.tau), dtype=bool)
        for sign in (1.0, -1.0):
            count, level = flat_top(sign * every)
            if count:
                kept &= sign * states.tau[:, j] < level - NEAR_CUT * np.ptp(every)
        rows[j] = kept if kept.mean() > LEAST_UNCUT else np.ones_like(kept)
    right, wrong = ({j: fit_signed(states, j, sign, rows[j]) for j in tested} for sign in (1.0, -1.0))
    explained = {j: max(held.sign_explains, right[j].explained + held.sign_better) for j in tested}
    flipped = [j for j in tested if wrong[j].explained > explained[j]]
    # Minus the torque must follow the model better beside a spring, too: one that more than carries is no sign.
    beside = {j: [fit_signed(states, j, sign, rows[j], spring=True).explained for sign in (1.0, -1.0)] for j in flipped}
    flipped = [j for j in flipped if beside[j][1] > beside[j][0]]
    issues: list[TelemetryIssue] = []
    if flipped:
        worst = max(flipped, key=lambda j: wrong[j].explained)
        lines = ", ".join(f"{toml_key(session.joints[j])} = -1" for j in flipped)
        shares = (wrong[worst].explained, max(right[worst].explained, 0.0))
        issues.append(issue_of("sign_alone", session, flipped, worst, lines=lines, wrong=shares[0], right=shares[1]))
    upright = right | {j: wrong[j] for j in flipped}
    return issues + _check_scale(session, states, upright, flipped, rows) + _check_origin(session, arm, states)


def _check_scale(
    session: Session,
    states: States,
    fits: Mapping[int, SignedFit],
    flipped: Sequence[int],
    rows: Mapping[int, Bool[Array, " T"]],
) -> list[TelemetryIssue]:
    """Torques that follow the model not at all, or at another size.

    A spring that carries the arm can hide gravity: what it could explain is no fault of the channel.
    """
    held, deaf, off = states.settings, [], []
    for j in (joint for joint in fits if states.heavy[joint]):
        sprung = fit_signed(states, j, -1.0 if j in flipped else 1.0, rows[j], spring=True)
        if sprung.explained < held.follows:
            deaf.append(j)
        elif all(not held.scale_low < fit.gravity < held.scale_high for fit in (fits[j], sprung)):
            off += [j] if _surely_off(states, j, rows[j]) else []
    issues = []
    if deaf:
        worst = min(deaf, key=lambda j: fits[j].explained)
        explained, change = max(fits[worst].explained, 0.0), states.gravity.std(axis=0)
        issues.append(issue_of("deaf", session, deaf, worst, explained=explained, change=change))
    if off:
        worst = max(off, key=lambda j: abs(np.log(max(fits[j].gravity, 1e-9))))
        issues.append(issue_of("unit", session, off, worst, scale=fits[worst].gravity))
    return issues


def _check_origin(session: Session, arm: ArmModel, states: States) -> list[TelemetryIssue]:
    """Finds torques that a rigid model explains without any friction."""
    held, moving = states.settings, np.flatnonzero(states.moving & states.alive)
    if len(states.q) < 20 * arm.n or not len(moving):
        return []
    rows = slice(None, None, max(1, len(states.q) // ORIGIN_STATES))
    regressor = arm.regressor(states.q[rows], states.dq[rows], states.ddq[rows])
    models = []
    for joint in moving:
        felt = regressor[:, joint, np.any(regressor[:, joint] != 0.0, axis=0)]  # no joint feels the links before it
        rigid = np.column_stack([felt, states.ddq[rows, joint]])
        left, friction, computed = _without_friction(rigid, states.dq[rows, joint], states.tau[rows, joint], held)
        if computed:
            models.append((left, friction, int(joint)))
    # One joint without friction may be a fine gear; most joints without are a computer.
    if len(models) < max(1.0, 0.5 * len(moving)):
        return []
    left, friction, worst = min(models)
    return [issue_of("computed", session, [joint for *_, joint in models], worst, left=left, friction=friction)]


def _without_friction(
    rigid: Float[Array, "T k"], dq: Float[Array, " T"], tau: Float[Array, " T"], settings: EffortSettings
) -> tuple[float, float, bool]:
    """Share of a torque's spread that rigid columns leave, friction beside them [N m], and whether it shows none."""
    friction = np.column_stack([np.tanh(dq / TRANSITION_RAD_S), dq])
    table = np.column_stack([rigid, np.ones(len(tau)), friction])
    size = np.linalg.norm(table, axis=0)
    table = table / np.where(size > 1e-9 * size.max(), size, np.inf)
    # All that least squares needs of the table is its triangle.
    triangle = np.asarray(np.linalg.qr(np.column_stack([table, tau]), mode="r"))
    columns, target = triangle[:, :-1], triangle[:, -1]
    left = []
    for count in (columns.shape[1] - 2, columns.shape[1]):
        weights = least_squares(columns[:, :count], target, 1e-8)
        left.append(float(np.linalg.norm(target - columns[:, :count] @ weights)) / np.sqrt(len(tau)))
    spread = float(tau.std())
    gain = 1.0 - (left[1] / left[0]) ** 2 if left[0] > 0.0 else 0.0
    share, level = left[0] / spread, float(np.sqrt(np.mean((table[:, -2:] @ weights[-2:]) ** 2)))
    explained = share**2 < 1.0 - settings.rigid_explains
    none = level < settings.friction_share * spread and gain < settings.friction_gain
    return share, level, share < 1e-6 or (explained and none)
