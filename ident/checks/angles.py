"""Positions' unit: degrees for radians, radians read as degrees, and millimetres for metres."""

from __future__ import annotations

import math

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.checks.effort import collect_states, explained_by_model, fit_signed
from ident.checks.filtered_run import compare_velocities
from ident.checks.report import issue_of, joints_at
from ident.checks.settings import ANGLES as LIMIT
from ident.checks.settings import CLOCK
from ident.recordings.recording import Recording, Session, TelemetryIssue
from ident.robot.arm import ArmModel
from ident.safe_read import toml_line

TURN = 2.0 * math.pi
PER_METRE = 1000.0  # millimetres

# Channels in the unit of the angles, and their derivatives.
ANGULAR = ("position", "position_command")

DERIVATIVES = ("velocity", "acceleration", "velocity_command")


def revolute(session: Session, arm: ArmModel | None) -> Bool[Array, " n"]:
    """Which joints turn (rather than slide); all where the robot is None."""
    if arm is None:
        return np.ones(len(session.joints), dtype=bool)
    return ~arm.sliding_joints


def mend_angle_units(
    session: Session, arm: ArmModel | None
) -> tuple[Session, list[TelemetryIssue]]:
    """Finds angles in degrees, radians read as degrees, and slides in millimetres.

    The session is converted for other checks, a fit is refused.

    Args:
        session: The recordings.
        arm: Their robot; None where it is not known.

    Returns:
        The session with its angles in radians and its slides in metres, and the issues.
    """
    session, of_turning = _mend_turning(session, arm)
    if arm is None:
        return session, of_turning
    session, of_slides = _mend_slides(session, arm)
    return session, of_turning + of_slides


def _mend_slides(session: Session, arm: ArmModel) -> tuple[Session, list[TelemetryIssue]]:
    """Finds slides in millimetres: farther or faster than the URDF's limits allow, by a factor that
    is nearer to a thousand than to one.
    """
    far = np.max([np.abs(run.position).max(axis=0) for run in session.runs], axis=0)
    fast = np.max([speed(run) for run in session.runs], axis=0)
    limits = arm.known_limits
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.fmax(far / limits.reach, fast / limits.speed)
    in_millimetres = arm.sliding_joints & (times > math.sqrt(PER_METRE))
    if not in_millimetres.any():
        return session, []
    worst = int(np.argmax(np.where(in_millimetres, times, 0.0)))
    joints = joints_at(session, in_millimetres)
    line = toml_line("slide_scale", dict.fromkeys(joints, 1.0 / PER_METRE))
    issue = issue_of(
        "millimetres", session, joints, worst, line=line, far=far, fast=fast, times=times
    )
    with_velocity = _in_one_unit(session)
    return scale_angles(session, 1.0 / PER_METRE, in_millimetres, with_velocity), [issue]


def _mend_turning(session: Session, arm: ArmModel | None) -> tuple[Session, list[TelemetryIssue]]:
    """Finds angles in degrees, or radians read as degrees.

    The session is converted for other checks, a fit is refused.

    Suspected by motion that the arm's limits forbid, or where they are unknown, that no arm can
    make; told by how much better the robot's torques explain the measured ones when the numbers
    are read as degrees, else by the motion. Radians, where no joint goes farther than a turn's
    number of degrees, by torque that follows gravity as it should if the motion is so much wider.
    Only the suspected joints are in degrees where the torques are better explained so.

    Args:
        session: The recordings.
        arm: Their robot; None where it is not known.

    Returns:
        The session with its angles in radians, and the issue; the session as it was and no issue
        where nothing is suspected.
    """
    turning = revolute(session, arm)
    far = np.max([np.abs(run.position).max(axis=0) for run in session.runs], axis=0)
    if arm is not None and turning.any() and far[turning].max() < math.radians(TURN):
        wider = scale_angles(session, math.degrees(1.0), turning)
        if follows_gravity(wider, arm):
            worst = int(np.argmax(np.where(turning, far, -1.0)))
            return wider, [issue_of("radians", session, turning, worst, far=far)]
    fast = np.max([speed(run) for run in session.runs], axis=0)
    farthest, fastest = farthest_motion(session, arm)
    suspects = turning & ((far > farthest) | (fast > fastest))
    if not suspects.any():
        return session, []
    converted, in_degrees = _in_radians(session, arm, turning, suspects)
    by_torque = None if arm is None else _told_by_torque(session, converted, arm)
    reason = by_torque or ""
    if by_torque is None:
        # In degrees nearly any motion goes beyond what would be two turns; a fast joint alone may
        # be fast.
        too_fast = fast > np.maximum(fastest, LIMIT.fastest_rad_s)
        is_far = far > LIMIT.farthest_rad
        if arm is not None:
            is_far |= is_limited(arm)
        if (suspects & too_fast & is_far).any():
            reason = "no arm moves so fast in radians"
    if not reason:
        return session, []
    worst = int(np.argmax(np.where(suspects, far, -1.0)))
    key = "degrees" if (in_degrees == turning).all() else "degrees_of_some"
    joints = joints_at(session, in_degrees)
    line = toml_line("unit", dict.fromkeys(joints, "deg"))
    issue = issue_of(key, session, joints, worst, line=line, far=far, fast=fast, reason=reason)
    return converted, [issue]


def _in_radians(
    session: Session,
    arm: ArmModel | None,
    turning: Bool[Array, " n"],
    suspects: Bool[Array, " n"],
) -> tuple[Session, Bool[Array, " n"]]:
    """The session with all turning joints read as degrees, and which these are; or the suspected
    ones alone where the torques are better explained so.
    """
    with_velocity = _in_one_unit(session)
    converted = scale_angles(session, math.radians(1.0), turning, with_velocity)
    if arm is None or suspects[turning].all():
        return converted, turning
    alone = scale_angles(session, math.radians(1.0), suspects, with_velocity)
    if explained_by_model(alone, arm) > explained_by_model(converted, arm):
        return alone, suspects
    return converted, turning


def _told_by_torque(session: Session, converted: Session, arm: ArmModel) -> str | None:
    """Why the torques say that angles are in degrees; empty where they say that they are not.

    None where they say nothing.
    """
    as_radians = explained_by_model(session, arm)
    as_degrees = explained_by_model(converted, arm)
    if max(as_degrees, as_radians) <= LIMIT.model_tells:
        return None
    if as_degrees <= as_radians + 0.1:
        return ""
    return (
        f"the robot's model explains {100.0 * as_degrees:.0f} % of the torque in degrees, "
        f"{100.0 * as_radians:.0f} % in radians"
    )


def _in_one_unit(session: Session) -> bool:
    """Whether the velocities are in the positions' unit; so where nothing moves or tells."""
    compared = compare_velocities(session)
    if compared is None:
        return True
    moving, slope, _ = compared
    return not moving.any() or float(np.median(slope[moving])) > 0.1


def is_limited(arm: ArmModel) -> Bool[Array, " n"]:
    """Which joints have a limit of speed in the URDF."""
    return np.isfinite(arm.known_limits.speed)


def farthest_motion(
    session: Session, arm: ArmModel | None
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Position and speed that each joint surely does not exceed [rad, rad/s].

    By its URDF's limits, which are nominal, so that some room is left; else by all arms'.

    Args:
        session: The recordings, for the number of joints.
        arm: Their robot; None where it is not known.
    """
    count = len(session.joints)
    farthest = np.full(count, LIMIT.farthest_rad)
    fastest = np.full(count, LIMIT.fastest_rad_s)
    if arm is None:
        return farthest, fastest
    reach = arm.known_limits.reach
    top = CLOCK.over_limit * arm.known_limits.speed
    beyond_reach = np.maximum(CLOCK.over_limit * reach, TURN)
    farthest = np.where(np.isfinite(reach), beyond_reach, farthest)
    return farthest, np.where(np.isfinite(top), top, fastest)


def follows_gravity(session: Session, arm: ArmModel) -> bool:
    """Whether the heavy joints' torque is mostly explained, gravity in it of about its own size.

    Of both, the median over the joints counts.
    """
    states = collect_states(session, arm)
    if states is None or not states.heavy.any():
        return False
    fits = [fit_signed(states, int(joint), 1.0) for joint in np.flatnonzero(states.heavy)]
    explained, size, _ = np.median(fits, axis=0)
    own_size = states.settings.scale_low < size < states.settings.scale_high
    return bool(explained > LIMIT.model_tells and own_size)


def speed(run: Recording) -> Float[Array, " n"]:
    """A speed that each joint holds for more than single samples [rad/s].

    The 99th percentile of its steps. A sample that leaves its neighbours and comes back is no
    motion: the step over three samples is asked as well.

    Zeros for a run of fewer than four samples.
    """
    if len(run) < 4:
        return np.zeros(len(run.joints))
    elapsed = np.maximum(np.diff(run.time), 1e-9)[:, None]
    short = np.abs(np.diff(run.position, axis=0)) / elapsed
    over_three = elapsed[2:] + elapsed[1:-1] + elapsed[:-2]
    wide = np.abs(run.position[3:] - run.position[:-3]) / over_three
    return np.percentile(np.minimum(short[1:-1], wide), 99, axis=0)


def scale_angles(
    session: Session, factor: float, columns: Bool[Array, " n"], derivatives: bool = True
) -> Session:
    """Multiplies positions of some joints.

    Args:
        session: The recordings.
        factor: What the positions are multiplied by.
        columns: Which joints' positions.
        derivatives: Whether velocities and accelerations are multiplied, too.
    """
    scale = np.where(columns, factor, 1.0)
    scaled = (*ANGULAR, *DERIVATIVES) if derivatives else ANGULAR
    runs = []
    for run in session.runs:
        channels = run.channels()
        changed = {name: channels[name] * scale for name in scaled if name in channels}
        runs.append(run.replace(**changed))
    return session.replace(runs=runs)
