"""The size of a torque: beyond its rating, at another scale than the model's, or due to joints not recorded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.checks.effort import TRANSITION_RAD_S, States, jackknife
from ident.checks.report import TelemetryReport, joints_at
from ident.recordings.recording import Session, Severity, TelemetryIssue
from ident.robot.arm import ArmModel
from ident.robot.traits import rated_torque

# Share of a torque that the recorded motion explains: below the first, others moved; above the second, none did.
OWN_MOTION = (0.85, 0.95)
# Torques beyond the rating are short; drives give two or three times it. Other units lie at a hundred times.
LARGE_SHARE, MOST_RATED = 0.99, 5.0


def check_rating(session: Session, arm: ArmModel) -> list[TelemetryIssue]:
    """Effort far beyond what a joint can give, or than its load asks for, is in another unit."""
    rated = np.maximum(
        rated_torque(arm), 3.0 * np.abs(arm.gravity(np.concatenate([r.position for r in session.runs]))).max(axis=0)
    )
    seen = np.quantile(np.abs(np.concatenate([run.effort for run in session.runs])), LARGE_SHARE, axis=0)
    factor = seen / np.maximum(rated, 1e-9)
    joints = np.flatnonzero(factor > MOST_RATED)
    if not len(joints):
        return []
    worst = int(np.argmax(factor))
    evidence = (
        f"{session.name}: the effort of {session.joints[worst]} reaches {seen[worst]:.3g} N m, {factor[worst]:.3g} "
        f"times the {rated[worst]:.3g} N m that it is rated for"
    )
    remedy = "give torque in N m, or current with [drive_gain_Nm_per_A] in session.toml; or mend the URDF's limit"
    return [TelemetryIssue("effort_not_torque", joints_at(session, joints), "fatal", evidence, remedy)]


def check_gains(session: Session) -> list[TelemetryIssue]:
    """Torques that are a current times a gain that nobody measured: every size that follows from them is as wrong."""
    if not session.guessed_gains:
        return []
    gains = ", ".join(f"{joint} {gain:.3g}" for joint, gain in session.guessed_gains.items())
    evidence = f"{session.name}: the drive gains are guesses [N m/A]: {gains}; all that follows is in their unit"
    remedy = (
        "measure the gains (`ident fit` with a known payload scales them), and take guessed = true out of session.toml"
    )
    return [TelemetryIssue("guessed_gains", tuple(session.guessed_gains), "warning", evidence, remedy)]


class Gains:
    """Sessions of one arm whose guessed gains differ: so do all their sizes, though the arm is the same."""

    def __init__(self) -> None:
        self._before: Session | None = None
        self._issues: list[TelemetryIssue] = []

    def take(self, session: Session, report: TelemetryReport) -> None:
        """One more session."""
        first = (self._before or session).guessed_gains
        differ = [name for name, gain in session.guessed_gains.items() if not np.isclose(gain, first.get(name, gain))]
        if differ and self._before is not None:
            evidence = f"{self._before.name} and {session.name} have different guesses for {', '.join(differ)}"
            remedy = "give both sessions the same drive gains"
            self._issues.append(TelemetryIssue("guessed_gains", tuple(differ), "warning", evidence, remedy))
        self._before = session.replace(runs=()) if session.guessed_gains else self._before

    def issues(self) -> list[TelemetryIssue]:
        """One a pair that differs."""
        return self._issues


def check_absent(session: Session, states: States, absent: Sequence[str]) -> list[TelemetryIssue]:
    """Whether joints that are not recorded moved: then a torque doesn't follow from the recorded joints' motion.

    Each torque is held against what the recorded angles, one by one, and the joint's own motion can make of it.

    Args:
        session: The recordings, mended.
        states: Their motion.
        absent: Joints of the robot that are not recorded.
    """
    swings = np.hstack([np.sin(states.q), np.cos(states.q), states.ddq])
    found = {}
    for j in np.flatnonzero(states.alive & states.moving):
        dq, tau = states.dq[:, j], states.tau[:, j]
        table = np.column_stack([swings, states.q[:, j], dq, np.tanh(dq / TRANSITION_RAD_S), np.ones(len(tau))])
        left = tau - table @ np.linalg.lstsq(table, tau, rcond=None)[0]
        found[int(j)] = 1.0 - float(left.var() / tau.var())
    worst = min(found, key=lambda j: found[j], default=None)
    if worst is None or found[worst] > OWN_MOTION[1]:
        return []
    severity: Severity = "fatal" if found[worst] < OWN_MOTION[0] else "warning"
    evidence = (
        f"{session.name}: the recorded motion explains {max(found[worst], 0.0):.0%} of the effort of "
        f"{session.joints[worst]}: {', '.join(absent)}, not recorded, seem to have moved"
    )
    remedy = "record every joint, or give a URDF in which they are fixed where they were"
    return [TelemetryIssue("joints_locked", (session.joints[worst],), severity, evidence, remedy)]


def fit_scale(states: States, joint: int) -> tuple[float, float]:
    """A joint's torque as a multiple of the model's, told by gravity, and its standard error.

    Least squares beside inertia (rotors add to it), friction, friction that grows with the load, an offset, with and
    without a spring; the error is
    the delete-one-piece jackknife's, and half of what the spring makes of it is added.
    """
    gravity, dq = states.gravity[:, joint], states.dq[:, joint]
    side = np.tanh(dq / TRANSITION_RAD_S)
    bare = [gravity, states.inertial[:, joint], side, dq, np.abs(gravity) * side, np.ones(len(dq))]
    (scale, error), (sprung, _) = (
        [float(one[0]) for one in jackknife(np.column_stack(columns), states.tau[:, joint], states.settings.pieces)]
        for columns in (bare, [*bare, states.q[:, joint]])
    )
    return scale, float(np.hypot(error, 0.5 * (scale - sprung)))


def check_scales(session: Session, states: States) -> list[TelemetryIssue]:
    """Moving joints whose whole torque is the model's at another size: a gain that is off, or masses that are."""
    held, found = states.settings, []
    for joint in map(int, np.flatnonzero(states.heavy & states.alive & states.moving)):
        scale, error = fit_scale(states, joint)
        if abs(scale - 1.0) > max(held.scale_off, 2.0 * error):
            found.append((joint, scale, error))
    if not found:
        return []
    found.sort(key=lambda one: -abs(np.log(max(one[1], 1e-9))))
    told = "; ".join(
        f"{session.joints[j]} reads {k:.2f} ± {2.0 * e:.2f} of the model's gravity torque" for j, k, e in found
    )
    remedy = "check its drive gain (torque / model) and the URDF's masses: one of them is off by this factor"
    joints = tuple(session.joints[j] for j, _, _ in found)
    return [TelemetryIssue("torque_scale", joints, "warning", f"{session.name}: {told}", remedy)]
