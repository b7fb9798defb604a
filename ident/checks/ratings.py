"""Effort against what the joints are rated for: another unit, or limits that are none."""

from __future__ import annotations

from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.checks.angles import speed
from ident.checks.effort import States, fit_signed
from ident.checks.report import issue_of, joints_at
from ident.checks.settings import EFFORT_KIND as LIMIT
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel
from ident.robot.limits import is_placeholder


def check_rating(session: Session, arm: ArmModel, states: States) -> list[TelemetryIssue]:
    """Effort far beyond what a joint can give, or than its load asks for.

    It is in another unit, or the limit is wrong. Effort that follows the model at its own size is
    in its unit.

    Returns:
        Issues about the unit, or about the URDF's limits; empty where neither is off, and efforts
            of some joints alone are not whole numbers.
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
    whole = is_whole(session)
    in_another = beyond & ~in_unit
    if in_another.any():
        worst = int(np.argmax(np.where(in_another, factor, 0.0)))
        counts = tell_whole(session)
        joints = in_another | whole
        issues.append(issue_of("rating", session, joints, worst, counts=counts, **figures))
    elif whole.any() and not whole.all():
        names = ", ".join(joints_at(session, whole))
        issues.append(issue_of("whole_numbers", session, whole, names=names))
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
    is_whole = (effort == np.round(effort)).all(axis=0)
    changes = np.ptp(effort, axis=0) > 0.0
    return np.asarray(is_whole & changes)


def tell_whole(session: Session) -> str:
    """That efforts are whole numbers, and at which joints, to follow what else is off.

    "" where none are.
    """
    whole = is_whole(session)
    if not whole.any():
        return ""
    names = "every joint" if whole.all() else ", ".join(joints_at(session, whole))
    return f"; whole numbers at {names}: counts?"


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
