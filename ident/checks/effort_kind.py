"""What the effort channel holds: whether gravity is in it, and what each joint's effort is.

Drivers that compensate gravity log what is left of the torque: inertia and friction. In

    tau = a_g g(q) + a_i (rnea(q, dq, ddq) - g(q)) + b tanh(dq / eps) + c dq + k q + o

a_g is then about 0 where it should be about 1, while the other terms still explain the torque. A spring k q of either
sign stands beside them: one that carries the arm hides gravity too, and then a_g is unsure and nothing is said.

The size of a torque: beyond its rating, at another scale than the model's, or due to joints not recorded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import stdtrit

from ident.arrays import Array, Float, least_squares
from ident.checks.angles import speed
from ident.checks.effort import TRANSITION_RAD_S, States, collect_states, fit_signed, jackknife
from ident.checks.filtered_run import ARRANGEMENT
from ident.checks.filtered_run import EFFORT_KIND as LIMIT
from ident.checks.report import JointEffort, issue_of, joints_at
from ident.recordings.recording import Session, Severity, TelemetryIssue
from ident.robot.arm import ArmModel
from ident.robot.limits import is_placeholder
from ident.robot.tolerance import PRIOR_SHARE, parameter_scale

# States by which a URDF's tolerance is weighed (chosen: limit of work).
TOLERANCE_STATES = 200


@dataclass(frozen=True)
class GravityFit:
    """How a joint's torque follows gravity and inertia, by least squares without bounds."""

    gravity: float  # a_g
    gravity_error: float  # its standard error over pieces of the recordings
    inertia: float  # a_i
    inertia_error: float  # its standard error
    friction: float  # friction's share of the torque's standard deviation

    @property
    def is_sure(self) -> bool:
        """Whether the recordings tell a_g."""
        return self.gravity_error < LIMIT.sure

    @property
    def lacks_gravity(self) -> bool:
        """Whether gravity is surely not in the torque, and the torque not just small in its unit."""
        small = self.is_sure and abs(self.gravity) + self.gravity_error < LIMIT.absent
        if self.inertia_error < LIMIT.sure * max(self.inertia, 0.0):
            return small and self.inertia > max(LIMIT.least_inertia, LIMIT.over_gravity * abs(self.gravity))
        return small and abs(self.gravity) < LIMIT.faint


def fit_gravity(states: States, joint: int) -> GravityFit:
    """Fits one joint's torque; errors by leaving out one piece of the recordings at a time."""
    dq, tau, gravity = states.dq[:, joint], states.tau[:, joint], states.gravity[:, joint]
    columns = [gravity, states.inertial[:, joint], np.tanh(dq / TRANSITION_RAD_S), dq, states.q[:, joint]]
    table = np.column_stack([*(column - column.mean() for column in columns), np.ones(len(tau))])
    weights, errors = jackknife(table, tau, LIMIT.pieces)
    friction = float((table[:, 2:4] @ weights[2:4]).std() / max(float(tau.std()), 1e-300))
    return GravityFit(float(weights[0]), float(errors[0]), float(weights[1]), float(errors[1]), friction)


def mend_effort_kind(
    session: Session, arm: ArmModel | None, is_compensated: bool = False
) -> tuple[Session, list[TelemetryIssue]]:
    """Adds the model's gravity to gravity-compensated effort, found so or said to be so in session.toml.

    Args:
        session, arm: The recordings and their robot.
        is_compensated: Whether a search of all conventions found it so.
    """
    if arm is None or session.effort_kind == "joint_torque":
        return session, []
    forced = session.effort_kind == "gravity_compensated"
    states, known = collect_states(session, arm), dict[int, GravityFit]()
    if states is not None:  # the joints on which gravity changes enough to be looked for
        fits = {int(joint): fit_gravity(states, int(joint)) for joint in np.flatnonzero(states.heavy & states.alive)}
        known = {joint: fit for joint, fit in fits.items() if fit.is_sure}
    reported = [f"{session.joints[j]}: {tell_gravity(fit)}" for j, fit in known.items()]
    if forced and known and all(fit.gravity > LIMIT.present for fit in known.values()):
        worst = [*known].index(max(known, key=lambda j: known[j].gravity))
        return session, [issue_of("gravity_is_there", session, known, reported=reported[worst])]
    # Gravity must lack on every joint that tells, and the rest explain what there is, with the right sign.
    lacks = states is not None and bool(known) and all(fit.lacks_gravity for fit in known.values())
    if lacks and states is not None:
        rest = [[fit_signed(states, joint, sign).explained for sign in (1.0, -1.0)] for joint in known]
        lacks = all(right > states.settings.sign_explains and right > wrong for right, wrong in rest)
    if not forced and not lacks and not is_compensated:
        return session, []
    whole = [run.replace(effort=run.effort + arm.gravity(run.position)) if len(run) else run for run in session.runs]
    reason = "session.toml says gravity_compensated" if forced else "gravity is not in the effort"
    seen = f" ({'; '.join(reported)})" if reported else ""
    issue = issue_of("gravity_lacks", session, session.joints, reason=reason, seen=seen)
    return session.replace(runs=whole, effort_kind="joint_torque"), [issue]


def tell_gravity(fit: GravityFit) -> str:
    """The parameters of a fit in words, with 95 % of the error."""
    return (
        f"its gravity is {fit.gravity:.2f} ± {2.0 * fit.gravity_error:.2f} times the model's, "
        f"its inertia {fit.inertia:.2f} times"
    )


def judge_effort(session: Session, states: States | None, issues: list[TelemetryIssue]) -> tuple[JointEffort, ...]:
    """What each joint's effort is, with the evidence."""

    def judge(joint: int, name: str) -> tuple[str, str]:
        if states is None or not states.alive[joint]:
            return "unknown", "no run is long enough, or the effort doesn't change"
        fit = fit_gravity(states, joint)
        scale, error, _ = fit_scale(states, joint)  # what `check_scales` reports
        shown = replace(fit, gravity=scale, gravity_error=error)
        reported = tell_gravity(shown) if states.heavy[joint] else "gravity hardly changes here"
        reported += f"; friction is {100.0 * fit.friction:.0f} % of the effort's spread"
        for issue in (one for one in issues if name in one.joints):
            if issue.issue == "effort_gravity_compensated" and issue.severity != "fatal":
                return "gravity_compensated", f"{reported}, gravity added"
            if issue.issue == "effort_is_model":
                return "commanded" if "equals its command" in issue.evidence else "model_output", issue.evidence
            if issue.issue == "effort_not_torque":
                faint = states.heavy[joint] and fit.is_sure and fit.gravity > 0.0 and not fit.lacks_gravity
                return "motor_current" if faint else "external_torque", issue.evidence
        pairs = [(run.effort[:, joint], run.current[:, joint]) for run in session.runs if run.current is not None]
        if pairs and len(pairs) == len(session.runs):
            effort, current = (np.concatenate(values) for values in zip(*pairs, strict=True))
            lengths = float(np.linalg.norm(effort) * np.linalg.norm(current))
            if abs(float(effort @ current)) > (1.0 - LIMIT.same) * lengths:  # made of the current, or in another unit
                return "motor_current", f"the current times a constant gain; {reported}"
        if not states.moving[joint]:
            return "unknown", "it hardly moves"
        return "motor_torque" if fit.friction > LIMIT.motor_friction else "joint_torque", reported

    return tuple(JointEffort(name, *judge(joint, name)) for joint, name in enumerate(session.joints))


def check_rating(session: Session, arm: ArmModel, states: States) -> list[TelemetryIssue]:
    """Effort far beyond what a joint can give, or than its load asks for, is in another unit, or the limit is wrong.

    Effort that follows the model at its own size is in its unit.
    """
    load = arm.gravity(np.concatenate([run.position for run in session.runs]))
    rated = np.maximum(arm.rated_torque, 3.0 * np.abs(load).max(axis=0))
    seen = np.quantile(np.abs(np.concatenate([run.effort for run in session.runs])), LIMIT.large_share, axis=0)
    factor = seen / np.maximum(rated, 1e-9)
    beyond = factor > LIMIT.most_rated
    in_unit = np.array([has_own_size(states, j) if beyond[j] else False for j in range(arm.n)])
    issues = []
    for key, mask in (("rating", beyond & ~in_unit), ("effort_limits", beyond & in_unit)):
        if mask.any():
            worst = int(np.argmax(np.where(mask, factor, 0.0)))
            whole = is_whole(session) if key == "rating" else np.zeros(arm.n, dtype=bool)
            counts = f"; whole numbers at {', '.join(joints_at(session, whole))}: counts?" if whole.any() else ""
            seen_there: dict[str, Any] = {"seen": seen, "factor": factor, "rated": rated, "counts": counts}
            issues.append(issue_of(key, session, mask | whole, worst, **seen_there))
    return issues


def is_whole(session: Session) -> Array:
    """Which joints' efforts are whole numbers that change: counts, or per mille of a rating."""
    effort = np.concatenate([run.effort for run in session.runs])
    return np.asarray((effort == np.round(effort)).all(axis=0) & (np.ptp(effort, axis=0) > 0.0))


def has_own_size(states: States, joint: int) -> bool:
    """Whether a joint's effort follows gravity, or where that is faint inertia, at about the model's size."""
    held, fit = states.settings, max(fit_signed(states, joint, sign) for sign in (1.0, -1.0))
    size = fit.gravity if states.heavy[joint] else fit.inertia
    return bool(states.alive[joint] and fit.explained > held.sign_explains and held.scale_low < size < held.scale_high)


def check_placeholders(session: Session, arm: ArmModel) -> list[TelemetryIssue]:
    """Names limits that are an exporter's and that the recordings exceed; a limit of zero plainly says nothing."""
    effort = np.quantile(np.abs(np.concatenate([run.effort for run in session.runs])), LIMIT.large_share, axis=0)
    moved = np.max([speed(run) for run in session.runs], axis=0)
    kinds, factors, joints = [], [], np.zeros(arm.n, dtype=bool)
    for kind, seen, limit in (("effort", effort, arm.effort_limit), ("velocity", moved, arm.velocity_limit)):
        exceeded = is_placeholder(limit) & (limit > 0.0) & (seen > limit)
        if exceeded.any():
            kinds.append(kind)
            factors.append(float((seen / np.maximum(limit, 1e-9))[exceeded].max()))
            joints |= exceeded
    if not kinds:
        return []
    names = ", ".join(joints_at(session, joints))
    told: dict[str, Any] = {"kinds": " and ".join(kinds), "names": names, "value": 1.0, "factor": max(factors)}
    return [issue_of("placeholder_limits", session, joints, **told)]


def check_gains(session: Session) -> list[TelemetryIssue]:
    """Torques that are a current times a gain that nobody measured: every size that follows from them is as wrong."""
    if not session.guessed_gains:
        return []
    gains = ", ".join(f"{joint} {gain:.3g}" for joint, gain in session.guessed_gains.items())
    return [issue_of("guessed", session, session.guessed_gains, gains=gains)]


class Gains:
    """Reads sessions of one arm with the first one's guesses of its drive gains: another guess is no other arm."""

    def __init__(self, first: Session | None = None) -> None:
        self._first = first
        self._issues: list[TelemetryIssue] = []

    def in_first_unit(self, session: Session) -> Session:
        """The session, its torques those of the first one's guesses."""
        if not session.guessed_gains:
            return session
        first = self._first = self._first or session.replace(runs=())
        gains = {name: first.guessed_gains.get(name, gain) for name, gain in session.guessed_gains.items()}
        differ = [name for name, gain in session.guessed_gains.items() if not np.isclose(gain, gains[name])]
        if not differ:
            return session
        evidence = (
            f"{first.name} and {session.name} have different guesses for {', '.join(differ)}: read with the first"
        )
        remedy = "give both sessions the same drive gains"
        self._issues.append(TelemetryIssue("guessed_gains", tuple(differ), "warning", evidence, remedy))
        factor = [gains[name] / session.guessed_gains[name] if name in differ else 1.0 for name in session.joints]
        runs = [run if run.current is None else run.replace(effort=factor * run.effort) for run in session.runs]
        return session.replace(runs=runs, guessed_gains=gains)

    def issues(self) -> list[TelemetryIssue]:
        """One for each session that differs."""
        return self._issues


def check_absent(session: Session, states: States, absent: Sequence[str]) -> list[TelemetryIssue]:
    """Whether joints that are not recorded moved: then a torque doesn't follow from the recorded joints' motion.

    Each torque is held against the model's with those joints still, and what the recorded angles, one by one, and the
    joint's own motion can make of it.
    """
    swings = np.hstack([np.sin(states.q), np.cos(states.q), states.ddq])
    found = {}
    for j in np.flatnonzero(states.alive & states.moving):
        dq, tau = states.dq[:, j], states.tau[:, j]
        model = [states.gravity[:, j], states.inertial[:, j]]
        table = np.column_stack([swings, *model, states.q[:, j], dq, np.tanh(dq / TRANSITION_RAD_S), np.ones(len(tau))])
        left = tau - table @ least_squares(table, tau)
        found[int(j)] = max(1.0 - float(left.var() / tau.var()), 0.0)
    worst = min(found, key=lambda j: found[j], default=None)
    if worst is None or found[worst] > LIMIT.own_motion[1]:
        return []
    severity: Severity = "fatal" if found[worst] < LIMIT.own_motion[0] else "warning"
    return [issue_of("absent", session, [worst], worst, severity, explained=found[worst], absent=", ".join(absent))]


def fit_scale(states: States, joint: int) -> tuple[float, float, float]:
    """A joint's torque as a multiple of the model's, told by gravity, its standard error, and it beside a spring.

    Least squares beside inertia, the rotor's (no part of the model, which could bend gravity's), friction, friction
    that grows with the load, an offset; the error is the delete-one-piece jackknife's, and half of what the spring
    makes of it is added.
    """
    gravity, dq = states.gravity[:, joint], states.dq[:, joint]
    side = np.tanh(dq / TRANSITION_RAD_S)
    inertia = [states.inertial[:, joint], states.ddq[:, joint]]
    bare = [gravity, *inertia, side, dq, np.abs(gravity) * side, np.ones(len(dq))]
    (scale, error), (sprung, _) = (
        [float(one[0]) for one in jackknife(np.column_stack(columns), states.tau[:, joint], states.settings.pieces)]
        for columns in (bare, [*bare, states.q[:, joint]])
    )
    return scale, float(np.hypot(error, 0.5 * (scale - sprung))), sprung


def check_scales(session: Session, states: States, arm: ArmModel) -> list[TelemetryIssue]:
    """Moving joints whose whole torque is the model's at another size: a gain that is off, or masses that are.

    Where gravity changes much, a size is told that the recordings tell; elsewhere one that its URDF's tolerance, too,
    leaves no room for.
    """
    held, found = states.settings, []
    tested = np.flatnonzero(states.alive & states.moving)
    # Student's t for the errors of so few pieces, one chance in twenty for all joints together.
    heavy_sure, sure = (
        float(stdtrit(held.pieces - 1, 1.0 - 0.025 / max(count, 1)))
        for count in (int(states.heavy[tested].sum()), len(tested))
    )
    change = states.gravity.std(axis=0)
    tolerance = gravity_tolerance(states, arm)
    for joint in map(int, tested):
        scale, error, sprung = fit_scale(states, joint)
        # What a spring explains for the most part is no scale.
        is_spring = abs(sprung - 1.0) <= 0.5 * abs(scale - 1.0)
        if states.heavy[joint]:
            is_off = abs(scale - 1.0) > max(held.scale_off, heavy_sure * error)
        else:
            doubt = float(np.hypot(error * change[joint], tolerance[joint]))
            is_off = abs(scale - 1.0) * change[joint] > sure * doubt
        if is_off and not is_spring:
            found.append((joint, scale, error))
    if not found:
        return []
    found.sort(key=lambda one: -abs(np.log(max(one[1], 1e-9))))
    words = "{} reads {:.2f} ± {:.2f} times the model's gravity torque"
    reported = "; ".join(words.format(session.joints[j], scale, 2.0 * error) for j, scale, error in found)
    return [issue_of("scale", session, [j for j, _, _ in found], reported=reported)]


def gravity_tolerance(states: States, arm: ArmModel) -> Float[Array, " n"]:
    """Standard deviation of what a URDF within its tolerance has otherwise of each joint's change of gravity [N m].

    Its links are off by their tolerance, and its base by any tilt up to the one that a diagnosis finds.
    """
    q = states.q[:: max(1, len(states.q) // TOLERANCE_STATES)]
    still = np.zeros_like(q)
    spread = arm.regressor(q, still, still).var(axis=0)
    deviation = PRIOR_SHARE["consistent"] * parameter_scale(arm)
    square = (spread * deviation**2).sum(axis=-1)
    tilt = np.radians(ARRANGEMENT.least_turn_deg) / np.sqrt(3.0)  # of a uniform distribution
    size = float(np.linalg.norm(arm.model.gravity.linear))
    for axis in np.eye(3):
        square += (tilt * arm.with_gravity(size * axis).gravity(q)).var(axis=0)
    return np.asarray(np.sqrt(square))
