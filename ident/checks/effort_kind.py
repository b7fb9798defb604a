"""What the effort channel holds: whether gravity is in it, and what each joint's effort is.

Drivers that compensate gravity log what is left of the torque: inertia and friction. In

    tau = a_g g(q) + a_i (rnea(q, dq, ddq) - g(q)) + b tanh(dq / eps) + c dq + k q + o

a_g is then about 0 where it should be about 1, while the other terms still explain the torque. A
spring k q of either sign stands beside them: one that carries the arm hides gravity too, and then
a_g is unsure and nothing is said.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ident.checks.effort import States, collect_states, fit_signed, jackknife, joint_terms
from ident.checks.report import MISREAD, JointEffort, issue_of, with_reach
from ident.checks.scales import fit_scale
from ident.checks.settings import EFFORT_KIND as LIMIT
from ident.recordings.recording import Recording, Session, TelemetryIssue
from ident.robot.arm import ArmModel


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
        """Whether the error of the gravity coefficient is small enough to judge by."""
        return self.gravity_error < LIMIT.sure

    @property
    def tells_nothing(self) -> bool:
        """Whether the gravity coefficient's 95 % interval holds both 0 and 1."""
        reach = 2.0 * self.gravity_error
        return self.gravity - reach < 0.0 and self.gravity + reach > 1.0

    @property
    def lacks_gravity(self) -> bool:
        """Whether gravity is surely not in the torque, and the torque is not just small in its
        unit.
        """
        size = abs(self.gravity)
        if not self.is_sure or size + self.gravity_error >= LIMIT.absent:
            return False
        if self.inertia_error < LIMIT.sure * max(self.inertia, 0.0):
            return self.inertia > max(LIMIT.least_inertia, LIMIT.over_gravity * size)
        return size < LIMIT.faint


def fit_gravity(states: States, joint: int) -> GravityFit:
    """Fits one joint's torque without bounds, beside friction, a spring and an offset.

    Errors come from leaving out one piece of the recordings at a time.
    """
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

    Returns:
        The session with gravity in its effort, and the issue that tells it; as it was where gravity
        is there or can't be told.
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
    gravity = with_reach(fit.gravity, 2.0 * fit.gravity_error)
    inertia = with_reach(fit.inertia, 2.0 * fit.inertia_error)
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
        spread = states.tau[:, joint].std()
        change = states.gravity[:, joint].std() / spread
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
            return _kind_of_no_torque(states, joint), issue.evidence
    return None


def _kind_of_no_torque(states: States, joint: int) -> str:
    """What an effort is that is no torque in N m: unknown where it follows the motion."""
    fit = fit_gravity(states, joint)
    shows_gravity = fit.is_sure and fit.gravity > 0.0 and not fit.lacks_gravity
    if states.heavy[joint] and shows_gravity:
        return "motor_current"
    explained = max(fit_signed(states, joint, sign).explained for sign in (1.0, -1.0))
    return "unknown" if explained > states.settings.sign_explains else "external_torque"


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
