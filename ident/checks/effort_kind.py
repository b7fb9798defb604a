"""What the effort channel holds: whether gravity is in it, and what each joint's effort is.

Drivers that compensate gravity log what is left of the torque: inertia and friction. In

    tau = a_g g(q) + a_i (rnea(q, dq, ddq) - g(q)) + b tanh(dq / eps) + c dq + k q + o

a_g is then about 0 where it should be about 1, while the other terms still explain the torque. A
spring k q of either sign stands beside them: one that carries the arm hides gravity too, and then
a_g is unsure and nothing is said.

The size of a torque: beyond its rating, at another scale than the model's, or due to joints not
recorded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.special import stdtrit

from ident.arrays import Array, Float, least_squares
from ident.checks.angles import speed
from ident.checks.effort import (
    TRANSITION_RAD_S,
    States,
    collect_states,
    fit_signed,
    jackknife,
    joint_terms,
)
from ident.checks.filtered_run import ARRANGEMENT
from ident.checks.filtered_run import EFFORT_KIND as LIMIT
from ident.checks.report import MISREAD, JointEffort, issue_of, joints_at
from ident.recordings.recording import Recording, Session, Severity, TelemetryIssue
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
    def tells_nothing(self) -> bool:
        """Whether no gravity and the model's are both within 95 % of the error."""
        reach = 2.0 * self.gravity_error
        return self.gravity - reach < 0.0 and self.gravity + reach > 1.0

    @property
    def lacks_gravity(self) -> bool:
        """Whether gravity is surely not in the torque, which is not just small in its unit."""
        size = abs(self.gravity)
        if not self.is_sure or size + self.gravity_error >= LIMIT.absent:
            return False
        if self.inertia_error < LIMIT.sure * max(self.inertia, 0.0):
            return self.inertia > max(LIMIT.least_inertia, LIMIT.over_gravity * size)
        return size < LIMIT.faint


def fit_gravity(states: States, joint: int) -> GravityFit:
    """Fits one joint's torque; errors by leaving out one piece of the recordings at a time."""
    tau = states.tau[:, joint]
    terms = np.column_stack([joint_terms(states, joint), states.q[:, joint]])
    centred = [column - column.mean() for column in terms.T]
    table = np.column_stack([*centred, np.ones(len(tau))])
    weights, errors = jackknife(table, tau, LIMIT.pieces)
    by_friction = table[:, 2:4] @ weights[2:4]
    share = float(by_friction.std() / max(float(tau.std()), 1e-300))
    gravity, inertia = map(float, weights[:2])
    gravity_error, inertia_error = map(float, errors[:2])
    return GravityFit(gravity, gravity_error, inertia, inertia_error, share)


def mend_effort_kind(
    session: Session, arm: ArmModel | None, is_compensated: bool = False, guessed: str = ""
) -> tuple[Session, list[TelemetryIssue]]:
    """Adds the model's gravity to gravity-compensated effort.

    Found so, or said to be so in session.toml.

    Args:
        session, arm: The recordings and their robot.
        is_compensated: Whether a search of all conventions found it so.
        guessed: What of the robot is a guess, in words.
    """
    if arm is None or session.effort_kind == "joint_torque":
        return session, []
    forced = session.effort_kind == "gravity_compensated"
    states = collect_states(session, arm)
    counted = f" with {guessed}" if guessed else ""
    sure = {} if states is None else _sure_fits(states)
    reported = {
        joint: f"{session.joints[joint]}: {tell_gravity(fit, counted)}"
        for joint, fit in sure.items()
    }
    if forced and sure and all(fit.gravity > LIMIT.present for fit in sure.values()):
        worst = max(sure, key=lambda joint: sure[joint].gravity)
        return session, [issue_of("gravity_is_there", session, sure, reported=reported[worst])]
    lacks = states is not None and _lacks_gravity(states, sure)
    if not forced and not lacks and not is_compensated:
        return session, []
    runs = [_with_gravity(run, arm) for run in session.runs]
    reason = "session.toml says gravity_compensated" if forced else "gravity is not in the effort"
    seen = f" ({'; '.join(reported.values())})" if reported else ""
    issue = issue_of(
        "gravity_lacks", session, session.joints, reason=reason, seen=seen, counted=counted
    )
    return session.replace(runs=runs, effort_kind="joint_torque"), [issue]


def _sure_fits(states: States) -> dict[int, GravityFit]:
    """Fits of the joints on which gravity changes enough to be told."""
    fits = {}
    for joint in map(int, np.flatnonzero(states.heavy & states.alive)):
        fit = fit_gravity(states, joint)
        if fit.is_sure:
            fits[joint] = fit
    return fits


def _lacks_gravity(states: States, fits: Mapping[int, GravityFit]) -> bool:
    """Whether gravity lacks on every joint that tells, and the rest explain what there is.

    With the right sign, too.
    """
    if not fits or not all(fit.lacks_gravity for fit in fits.values()):
        return False
    for joint in fits:
        right = fit_signed(states, joint, 1.0).explained
        wrong = fit_signed(states, joint, -1.0).explained
        if right <= max(states.settings.sign_explains, wrong):
            return False
    return True


def _with_gravity(run: Recording, arm: ArmModel) -> Recording:
    """A run whose effort lacked gravity."""
    if not len(run):
        return run
    return run.replace(effort=run.effort + arm.gravity(run.position))


def tell_gravity(fit: GravityFit, counted: str = "") -> str:
    """The parameters of a fit in words, with 95 % of the error.

    Args:
        fit: Of a joint's torque.
        counted: What of the model is a guess, to be said behind it.
    """
    gravity = f"{fit.gravity:.2f} ± {2.0 * fit.gravity_error:.2f}"
    inertia = f"{fit.inertia:.2f} ± {2.0 * fit.inertia_error:.2f}"
    share = f"its gravity is {gravity} times the model's{counted}"
    if fit.tells_nothing:
        share = f"whether gravity{counted} is in it can't be told ({gravity} times the model's)"
    return f"{share}, its inertia {inertia} times"


def judge_effort(
    session: Session, states: States | None, issues: list[TelemetryIssue]
) -> tuple[JointEffort, ...]:
    """What each joint's effort is, with the evidence.

    Args:
        session: The recordings.
        states: Their states; None where every run is too short.
        issues: What the checks found.
    """
    efforts = []
    for joint, name in enumerate(session.joints):
        if states is None or not states.alive[joint]:
            reason = "no run is long enough, or the effort doesn't change"
            efforts.append(JointEffort(name, "unknown", reason))
        else:
            kind, evidence = _judge(session, states, joint, issues)
            efforts.append(JointEffort(name, kind, evidence))
    return tuple(efforts)


def _judge(
    session: Session, states: States, joint: int, issues: list[TelemetryIssue]
) -> tuple[str, str]:
    """What one joint's effort is, and the evidence."""
    fit = fit_gravity(states, joint)
    by_issues = _judge_by_issues(session, states, joint, issues)
    reads_factor = any(
        issue.issue == MISREAD and session.joints[joint] in issue.joints for issue in issues
    )
    reported = _tell_effort(states, joint, fit, reads_factor)
    if by_issues is not None:
        kind, evidence = by_issues
        return kind, evidence or f"{reported}, gravity added"
    if _follows_current(session, joint):
        return "motor_current", f"the current times a constant gain; {reported}"
    if not states.moving[joint]:
        return "unknown", "it hardly moves"
    return "motor_torque" if fit.friction > LIMIT.motor_friction else "joint_torque", reported


def _tell_effort(states: States, joint: int, fit: GravityFit, reads_factor: bool) -> str:
    """How an effort follows gravity, and how much of it is friction, in words.

    Args:
        states: The states of the recordings.
        joint: Column of the joint.
        fit: Of its torque.
        reads_factor: Whether `check_scales` reports its factor.
    """
    friction = f"friction is {100.0 * fit.friction:.0f} % of the effort's spread"
    if not states.heavy[joint] and not reads_factor:
        change = states.gravity[:, joint].std() / states.tau[:, joint].std()
        gravity = f"gravity by the model{states.counted} is {100.0 * change:.0f} %"
        return f"{friction}, {gravity}"
    scale, error, _ = fit_scale(states, joint)  # what `check_scales` reports
    shown = replace(fit, gravity=scale, gravity_error=error)
    return f"{tell_gravity(shown, states.counted)}; {friction}"


def _judge_by_issues(
    session: Session, states: States, joint: int, issues: list[TelemetryIssue]
) -> tuple[str, str] | None:
    """What issues say of a joint's effort, and their evidence; "" where gravity was added.

    None where they say nothing.
    """
    for issue in issues:
        if session.joints[joint] not in issue.joints:
            continue
        if issue.issue == "effort_gravity_compensated" and issue.severity != "fatal":
            return "gravity_compensated", ""
        if issue.issue == "effort_is_model":
            is_command = "equals its command" in issue.evidence
            return "commanded" if is_command else "model_output", issue.evidence
        if issue.issue == "effort_not_torque":
            fit = fit_gravity(states, joint)
            shows_gravity = fit.is_sure and fit.gravity > 0.0 and not fit.lacks_gravity
            is_faint = states.heavy[joint] and shows_gravity
            return "motor_current" if is_faint else "external_torque", issue.evidence
    return None


def _follows_current(session: Session, joint: int) -> bool:
    """Whether a joint's effort was made of its current, or is the current in another unit."""
    efforts = []
    currents = []
    for run in session.runs:
        if run.current is None:
            return False
        efforts.append(run.effort[:, joint])
        currents.append(run.current[:, joint])
    if not efforts:
        return False
    effort = np.concatenate(efforts)
    current = np.concatenate(currents)
    lengths = float(np.linalg.norm(effort) * np.linalg.norm(current))
    return abs(float(effort @ current)) > (1.0 - LIMIT.same) * lengths


def check_rating(session: Session, arm: ArmModel, states: States) -> list[TelemetryIssue]:
    """Effort far beyond what a joint can give, or than its load asks for.

    It is in another unit, or the limit is wrong. Effort that follows the model at its own size is
    in its unit.
    """
    load = arm.gravity(np.concatenate([run.position for run in session.runs]))
    rated = np.maximum(arm.rated_torque, 3.0 * np.abs(load).max(axis=0))
    seen = _large_effort(session)
    factor = seen / np.maximum(rated, 1e-9)
    beyond = factor > LIMIT.most_rated
    in_unit = np.zeros(arm.n, dtype=bool)
    for joint in np.flatnonzero(beyond):
        in_unit[joint] = has_own_size(states, int(joint))
    figures: dict[str, Any] = {"seen": seen, "factor": factor, "rated": rated}
    issues = []
    in_another = beyond & ~in_unit
    if in_another.any():
        worst = int(np.argmax(np.where(in_another, factor, 0.0)))
        whole = is_whole(session)
        counts = ""
        if whole.any():
            counts = f"; whole numbers at {', '.join(joints_at(session, whole))}: counts?"
        joints = in_another | whole
        issues.append(issue_of("rating", session, joints, worst, counts=counts, **figures))
    wrong_limits = beyond & in_unit
    if wrong_limits.any():
        worst = int(np.argmax(np.where(wrong_limits, factor, 0.0)))
        issues.append(issue_of("effort_limits", session, wrong_limits, worst, counts="", **figures))
    return issues


def _large_effort(session: Session) -> Float[Array, " n"]:
    """An effort that each joint exceeds in few samples only [its unit]."""
    effort = np.concatenate([run.effort for run in session.runs])
    return np.quantile(np.abs(effort), LIMIT.large_share, axis=0)


def is_whole(session: Session) -> Array:
    """Which joints' efforts are whole numbers that change: counts, or per mille of a rating."""
    effort = np.concatenate([run.effort for run in session.runs])
    return np.asarray((effort == np.round(effort)).all(axis=0) & (np.ptp(effort, axis=0) > 0.0))


def has_own_size(states: States, joint: int) -> bool:
    """Whether a joint's effort follows gravity at about the model's size.

    Where gravity is faint, inertia.
    """
    settings = states.settings
    fit = max(fit_signed(states, joint, sign) for sign in (1.0, -1.0))
    size = fit.gravity if states.heavy[joint] else fit.inertia
    is_own = settings.scale_low < size < settings.scale_high
    return bool(states.alive[joint] and fit.explained > settings.sign_explains and is_own)


def check_placeholders(session: Session, arm: ArmModel) -> list[TelemetryIssue]:
    """Names limits that are an exporter's and that the recordings exceed.

    A limit of zero plainly says nothing.
    """
    fastest = np.max([speed(run) for run in session.runs], axis=0)
    limits = {
        "effort": (_large_effort(session), arm.effort_limit),
        "velocity": (fastest, arm.velocity_limit),
    }
    factors = {}
    joints = np.zeros(arm.n, dtype=bool)
    for kind, (seen, limit) in limits.items():
        exceeded = is_placeholder(limit) & (limit > 0.0) & (seen > limit)
        if exceeded.any():
            factors[kind] = float((seen / np.maximum(limit, 1e-9))[exceeded].max())
            joints |= exceeded
    if not factors:
        return []
    issue = issue_of(
        "placeholder_limits",
        session,
        joints,
        kinds=" and ".join(factors),
        names=", ".join(joints_at(session, joints)),
        value=1.0,
        factor=max(factors.values()),
    )
    return [issue]


def check_gains(session: Session) -> list[TelemetryIssue]:
    """Torques that are a current times a gain that nobody measured.

    Every size that follows from them is as wrong.
    """
    if not session.guessed_gains:
        return []
    gains = ", ".join(f"{joint} {gain:.3g}" for joint, gain in session.guessed_gains.items())
    return [issue_of("guessed", session, session.guessed_gains, gains=gains)]


class Gains:
    """Reads sessions of one arm with the first one's guesses of its drive gains.

    Another guess is no other arm.
    """

    def __init__(self, first: Session | None = None) -> None:
        self._first = first
        self._issues: list[TelemetryIssue] = []

    def in_first_unit(self, session: Session) -> Session:
        """The session, its torques those of the first one's guesses."""
        guessed = session.guessed_gains
        if not guessed:
            return session
        if self._first is None:
            self._first = session.replace(runs=())
        first = self._first
        gains = {name: first.guessed_gains.get(name, gain) for name, gain in guessed.items()}
        differ = [name for name, gain in guessed.items() if not np.isclose(gain, gains[name])]
        if not differ:
            return session
        evidence = (
            f"{first.name} and {session.name} have different guesses for {', '.join(differ)}: "
            "read with the first"
        )
        remedy = "give both sessions the same drive gains"
        issue = TelemetryIssue("guessed_gains", tuple(differ), "warning", evidence, remedy)
        self._issues.append(issue)
        factor = np.ones(len(session.joints))
        for joint, name in enumerate(session.joints):
            if name in differ:
                factor[joint] = gains[name] / guessed[name]
        runs = []
        for run in session.runs:
            is_made_of_current = run.current is not None
            runs.append(run.replace(effort=factor * run.effort) if is_made_of_current else run)
        return session.replace(runs=runs, guessed_gains=gains)

    def issues(self) -> list[TelemetryIssue]:
        """One for each session that differs."""
        return self._issues


def check_absent(session: Session, states: States, absent: Sequence[str]) -> list[TelemetryIssue]:
    """Whether joints that are not recorded moved.

    Then a torque doesn't follow from the recorded joints' motion. Each torque is held against the
    model's with those joints still, and what the recorded angles, one by one, and the joint's own
    motion can make of it.

    Args:
        session: The recordings.
        states: Their states.
        absent: Names of the joints that are not recorded.
    """
    swings = np.hstack([np.sin(states.q), np.cos(states.q), states.ddq])
    explained = {}
    for joint in map(int, np.flatnonzero(states.alive & states.moving)):
        dq = states.dq[:, joint]
        tau = states.tau[:, joint]
        model = [states.gravity[:, joint], states.inertial[:, joint]]
        losses = [dq, np.tanh(dq / TRANSITION_RAD_S), np.ones(len(tau))]
        table = np.column_stack([swings, *model, states.q[:, joint], *losses])
        left = tau - table @ least_squares(table, tau)
        explained[joint] = max(1.0 - float(left.var() / tau.var()), 0.0)
    least, enough = LIMIT.own_motion
    worst = min(explained, key=lambda joint: explained[joint], default=None)
    if worst is None or explained[worst] > enough:
        return []
    severity: Severity = "fatal" if explained[worst] < least else "warning"
    names = ", ".join(absent)
    share = explained[worst]
    return [issue_of("absent", session, [worst], worst, severity, explained=share, absent=names)]


def fit_scale(states: States, joint: int) -> tuple[float, float, float]:
    """A joint's torque as a multiple of the model's, told by gravity.

    Least squares beside inertia, the rotor's (no part of the model, which could bend gravity's),
    friction, friction that grows with the load, an offset; the error is the delete-one-piece
    jackknife's, and half of what a spring makes of the scale is added.

    Returns:
        The scale, its standard error, and the scale beside a spring.
    """
    tau = states.tau[:, joint]
    gravity = states.gravity[:, joint]
    dq = states.dq[:, joint]
    side = np.tanh(dq / TRANSITION_RAD_S)
    inertia = [states.inertial[:, joint], states.ddq[:, joint]]
    friction = [side, dq, np.abs(gravity) * side]
    bare = np.column_stack([gravity, *inertia, *friction, np.ones(len(dq))])
    sprung = np.column_stack([bare, states.q[:, joint]])
    weights, errors = jackknife(bare, tau, states.settings.pieces)
    beside_spring, _ = jackknife(sprung, tau, states.settings.pieces)
    scale = float(weights[0])
    scale_beside_spring = float(beside_spring[0])
    error = float(np.hypot(float(errors[0]), 0.5 * (scale - scale_beside_spring)))
    return scale, error, scale_beside_spring


class ScaleOff(NamedTuple):
    """A joint whose torque is the model's at another size."""

    joint: int
    scale: float
    error: float  # standard


def check_scales(session: Session, states: States, arm: ArmModel) -> list[TelemetryIssue]:
    """Moving joints whose whole torque is the model's at another size.

    A gain is off, or masses are. Where gravity changes much, a size is told that the recordings
    tell; elsewhere one that its URDF's tolerance, too, leaves no room for.
    """
    settings = states.settings
    tested = np.flatnonzero(states.alive & states.moving)
    heavy_sure = _chance_for_all(int(states.heavy[tested].sum()), settings.pieces)
    sure = _chance_for_all(len(tested), settings.pieces)
    change = states.gravity.std(axis=0)
    tolerance = gravity_tolerance(states, arm)
    scales = []
    for joint in map(int, tested):
        scale, error, sprung = fit_scale(states, joint)
        off = abs(scale - 1.0)
        # What a spring explains for the most part is no scale.
        if abs(sprung - 1.0) <= 0.5 * off:
            continue
        if states.heavy[joint]:
            is_off = off > max(settings.scale_off, heavy_sure * error)
        else:
            doubt = float(np.hypot(error * change[joint], tolerance[joint]))
            is_off = off * change[joint] > sure * doubt
        if is_off:
            scales.append(ScaleOff(joint, scale, error))
    if not scales:
        return []
    scales.sort(key=lambda off: -abs(np.log(max(off.scale, 1e-9))))
    words = []
    for joint, scale, error in scales:
        interval = f"{scale:.2f} ± {2.0 * error:.2f}"
        times = f"{interval} times the model's gravity torque{states.counted}"
        words.append(f"{session.joints[joint]} reads {times}")
    joints = [off.joint for off in scales]
    return [issue_of("scale", session, joints, reported="; ".join(words))]


def _chance_for_all(count: int, pieces: int) -> float:
    """Standard errors beyond which one in twenty sound arms has any of so many joints.

    Student's t, for errors of so few pieces.
    """
    return float(stdtrit(pieces - 1, 1.0 - 0.025 / max(count, 1)))


def gravity_tolerance(states: States, arm: ArmModel) -> Float[Array, " n"]:
    """What a URDF within its tolerance has otherwise of each joint's change of gravity [N m].

    A standard deviation. Its links are off by their tolerance, and its base by any tilt up to the
    one that a diagnosis finds.
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
