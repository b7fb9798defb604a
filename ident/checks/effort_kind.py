"""What the effort channel holds: whether gravity is in it, and what each joint's effort is.

Drivers that compensate gravity log what is left of the torque: inertia and friction. In

    tau = a_g g(q) + a_i (rnea(q, dq, ddq) - g(q)) + b tanh(dq / eps) + c dq + k q + o

a_g is then about 0 where it should be about 1, while the other terms still explain the torque. A spring k q of either
sign stands beside them: one that carries the arm hides gravity too, and then a_g is unsure and nothing is said.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.checks.effort import TRANSITION_RAD_S, States, collect_states, fit_signed, jackknife
from ident.checks.report import JointEffort, joints_at
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel

# a_g counts as known if its standard error over pieces of the recordings is below this: 1 is then five errors off 0.
SURE = 0.2
PIECES = 10
# Without gravity a_g was within 0.05 of 0 on the shipped recordings; in whole torques of real logs it is 0.84 to 1.48.
# What the driver's own masses leave is allowed for.
ABSENT, PRESENT = 0.2, 0.75
# A current or a percentage follows gravity faintly too, but inertia as faintly: raw currents of a UR10e reach 0.09 to
# 0.13 and 0.07 to 0.2. Without gravity a_i is at least this large, and this many times |a_g|; where the motion is too
# slow to show a_i, a_g itself must be this small.
LEAST_INERTIA, OVER_GRAVITY, FAINT = 0.5, 4.0, 0.03
# Friction's share of the torque (standard deviations) from which the effort is that of a motor before its gear.
MOTOR_FRICTION = 0.05
# Effort is a current times a gain if their correlation is this close to one.
SAME = 1e-9


@dataclass(frozen=True)
class GravityFit:
    """How a joint's torque follows gravity and inertia, by least squares without bounds.

    Attributes:
        gravity: a_g.
        gravity_error: Its standard error over pieces of the recordings.
        inertia: a_i.
        inertia_error: Its standard error.
        friction: Friction's share of the torque's standard deviation.
    """

    gravity: float
    gravity_error: float
    inertia: float
    inertia_error: float
    friction: float

    @property
    def is_sure(self) -> bool:
        """Whether the recordings tell a_g."""
        return self.gravity_error < SURE

    @property
    def lacks_gravity(self) -> bool:
        """Whether gravity is surely not in the torque, and the torque not just small in its unit."""
        small = self.is_sure and abs(self.gravity) + self.gravity_error < ABSENT
        if self.inertia_error < SURE * max(self.inertia, 0.0):
            return small and self.inertia > max(LEAST_INERTIA, OVER_GRAVITY * abs(self.gravity))
        return small and abs(self.gravity) < FAINT


def fit_gravity(states: States, joint: int) -> GravityFit:
    """Fits one joint's torque; errors by leaving out one piece of the recordings at a time."""
    dq, tau, gravity = states.dq[:, joint], states.tau[:, joint], states.gravity[:, joint]
    columns = [gravity, states.inertial[:, joint], np.tanh(dq / TRANSITION_RAD_S), dq, states.q[:, joint]]
    table = np.column_stack([*(column - column.mean() for column in columns), np.ones(len(tau))])
    weights, errors = jackknife(table, tau, PIECES)
    friction = float((table[:, 2:4] @ weights[2:4]).std() / max(float(tau.std()), 1e-300))
    return GravityFit(float(weights[0]), float(errors[0]), float(weights[1]), float(errors[1]), friction)


def mend_effort_kind(session: Session, arm: ArmModel | None) -> tuple[Session, list[TelemetryIssue]]:
    """Adds the model's gravity to gravity-compensated effort, found so or said to be so in session.toml.

    Args:
        session: Positions in radians.
        arm: The robot with the session's payload; without it nothing is asked.
    """
    if arm is None or session.effort_kind == "joint_torque":
        return session, []
    forced = session.effort_kind == "gravity_compensated"
    states, known = collect_states(session, arm), dict[int, GravityFit]()
    if states is not None:  # the joints on which gravity changes enough to be looked for
        fits = {int(joint): fit_gravity(states, int(joint)) for joint in np.flatnonzero(states.heavy & states.alive)}
        known = {joint: fit for joint, fit in fits.items() if fit.is_sure}
    told = [f"{session.joints[j]} {tell_gravity(fit)}" for j, fit in known.items()]
    if forced and known and all(fit.gravity > PRESENT for fit in known.values()):
        worst = [*known].index(max(known, key=lambda j: known[j].gravity))
        evidence = f"{session.name}: session.toml says gravity_compensated, but {told[worst]}"
        remedy = 'remove effort_kind = "gravity_compensated" from session.toml'
        return session, [
            TelemetryIssue("effort_gravity_compensated", joints_at(session, known), "fatal", evidence, remedy)
        ]
    if not forced and not _is_compensated(states, known):
        return session, []
    whole = [run.replace(effort=run.effort + arm.gravity(run.position)) if len(run) else run for run in session.runs]
    reason = "session.toml says gravity_compensated" if forced else "gravity is not in the effort"
    seen = f" ({'; '.join(told)})" if told else ""
    evidence = f"{session.name}: {reason}{seen}; the model's gravity, payload included, is added"
    remedy = (
        "log the whole torque to see errors of masses: they hide where gravity is added; "
        'or write effort_kind = "joint_torque" in session.toml if gravity is in it'
    )
    issue = TelemetryIssue("effort_gravity_compensated", session.joints, "warning", evidence, remedy)
    return session.replace(runs=whole, effort_kind="joint_torque"), [issue]


def _is_compensated(states: States | None, known: dict[int, GravityFit]) -> bool:
    """Whether gravity lacks on every joint that tells, and the rest explains what there is, with the right sign."""
    if states is None or not known or not all(fit.lacks_gravity for fit in known.values()):
        return False
    rest = [[fit_signed(states, joint, sign).explained for sign in (1.0, -1.0)] for joint in known]
    return all(right > states.settings.sign_explains and right > wrong for right, wrong in rest)


def tell_gravity(fit: GravityFit) -> str:
    """The figures of a fit in words."""
    return f"follows gravity at {fit.gravity:.2f} ± {fit.gravity_error:.2f} and inertia at {fit.inertia:.2f}"


def _contradicted(session: Session, known: dict[int, GravityFit]) -> TelemetryIssue:
    joint = max(known, key=lambda j: known[j].gravity)
    told = f"{session.joints[joint]} {tell_gravity(known[joint])}"
    evidence = f"{session.name}: session.toml says gravity_compensated, but {told}"
    remedy = 'remove effort_kind = "gravity_compensated" from session.toml'
    return TelemetryIssue("effort_gravity_compensated", joints_at(session, known), "fatal", evidence, remedy)


def judge_effort(session: Session, states: States | None, issues: list[TelemetryIssue]) -> tuple[JointEffort, ...]:
    """What each joint's effort is, with the evidence.

    Args:
        session: Mended.
        states: Its motion; None where every run is too short.
        issues: What was found of it.
    """
    return tuple(_judge_joint(session, joint, states, issues) for joint in range(len(session.joints)))


def _judge_joint(session: Session, joint: int, states: States | None, issues: list[TelemetryIssue]) -> JointEffort:
    name = session.joints[joint]
    if states is None or not states.alive[joint]:
        return JointEffort(name, "unknown", "no run is long enough, or the effort doesn't change")
    fit = fit_gravity(states, joint)
    told = tell_gravity(fit) if states.heavy[joint] else "gravity hardly changes here"
    told += f"; friction is {fit.friction:.0%} of the effort's spread"
    for issue in issues:
        if name in issue.joints and issue.issue == "effort_gravity_compensated" and issue.severity != "fatal":
            return JointEffort(name, "gravity_compensated", f"{told}, gravity added")
        if name in issue.joints and issue.issue == "effort_is_model":
            commanded = "equals its command" in issue.evidence
            return JointEffort(name, "commanded" if commanded else "model_output", issue.evidence)
        if name in issue.joints and issue.issue == "effort_not_torque":
            faint = states.heavy[joint] and fit.is_sure and fit.gravity > 0.0 and not fit.lacks_gravity
            return JointEffort(name, "motor_current" if faint else "external_torque", issue.evidence)
    if _is_current(session, joint):
        return JointEffort(name, "motor_current", f"the current times a constant gain; {told}")
    if not states.moving[joint]:
        return JointEffort(name, "unknown", "it hardly moves")
    return JointEffort(name, "motor_torque" if fit.friction > MOTOR_FRICTION else "joint_torque", told)


def _is_current(session: Session, joint: int) -> bool:
    """Whether the effort was made of the current, or is it in another unit."""
    pairs = [(run.effort[:, joint], run.current[:, joint]) for run in session.runs if run.current is not None]
    if not pairs or len(pairs) < len(session.runs):
        return False
    effort, current = (np.concatenate(values) for values in zip(*pairs, strict=True))
    size = float(np.linalg.norm(effort) * np.linalg.norm(current))
    return size > 0.0 and abs(float(effort @ current)) > (1.0 - SAME) * size
