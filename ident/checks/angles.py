"""Positions: degrees for radians, wraps at half a turn, single wild samples, jumps.

Single wild cells of any channel: cut out before anything else looks at the numbers.

A cell is absurd if no unit makes it a figure of an arm. It is a spike if it leaves the samples
around it, which agree among themselves, much farther than nearly all samples do: the measure is a
high quantile of the same distance over all runs, so that fast motion, coarse channels and noise
each set their own level, and no few samples can raise it.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import median_filter

from ident.arrays import Array, Bool, Float, Int
from ident.checks.effort import collect_states, explained_by_model, fit_signed
from ident.checks.filtered_run import ANGLES as LIMIT
from ident.checks.filtered_run import CLOCK, compare_velocities, filter_run
from ident.checks.report import Findings, issue_of, joints_at
from ident.errors import plural
from ident.recordings.recording import Recording, Session, TelemetryIssue, cut_before
from ident.robot.arm import ArmModel
from ident.safe_read import toml_line

TURN = 2.0 * math.pi
# Channels in the unit of the angles, and their derivatives.
ANGULAR = ("position", "position_command")
DERIVATIVES = ("velocity", "acceleration", "velocity_command")
# Commands may leap: nobody but the checks of `ident.checks.channels` reads them.
WATCHED = ("effort", "position", "velocity", "current", "acceleration", "temperature")
# Nobody needs these: where they are broken they are left out, and the session is used without them.
OPTIONAL = ("velocity", "acceleration", "temperature")


def revolute(session: Session, arm: ArmModel | None) -> Bool[Array, " n"]:
    """Which joints turn; all where the robot is not known."""
    if arm is None:
        return np.ones(len(session.joints), dtype=bool)
    return ~arm.sliding_joints


def mend_degrees(session: Session, arm: ArmModel | None) -> tuple[Session, list[TelemetryIssue]]:
    """Finds angles in degrees, or radians read as degrees.

    The session is converted for other checks, a fit is refused.

    Suspected by motion that the arm's limits forbid, or where they are unknown, that no arm can
    make; told by how much better the robot's torques explain the measured ones when the numbers
    are read as degrees, else by the motion. Radians, where no joint goes farther than a turn's
    number of degrees, by torque that follows gravity as it should if the motion is so much wider.
    Only the suspected joints are in degrees where the torques are better explained so.
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
    converted = scale_angles(session, math.radians(1.0), turning, _in_one_unit(session))
    of_some = False
    if arm is not None and not suspects[turning].all():
        alone = scale_angles(session, math.radians(1.0), suspects, _in_one_unit(session))
        of_some = explained_by_model(alone, arm) > explained_by_model(converted, arm)
        converted = alone if of_some else converted
    reason = ""
    tells = False
    if arm is not None:
        as_radians = explained_by_model(session, arm)
        as_degrees = explained_by_model(converted, arm)
        tells = max(as_degrees, as_radians) > LIMIT.model_tells
        if tells and as_degrees > as_radians + 0.1:
            reason = (
                f"the robot's model explains {100.0 * as_degrees:.0f} % of the torque in degrees, "
                f"{100.0 * as_radians:.0f} % in radians"
            )
    if not tells:
        too_fast = fast > np.maximum(fastest, LIMIT.fastest_rad_s)
        # In degrees nearly any motion goes beyond what would be two turns; a fast joint alone may
        # be fast.
        is_far = far > LIMIT.farthest_rad
        if arm is not None:
            is_far |= is_limited(arm)
        if (suspects & too_fast & is_far).any():
            reason = "no arm moves so fast in radians"
    if not reason:
        return session, []
    worst = int(np.argmax(np.where(suspects, far, -1.0)))
    key = "degrees_of_some" if of_some else "degrees"
    joints = joints_at(session, suspects if of_some else turning)
    line = toml_line("unit", dict.fromkeys(joints, "deg"))
    issue = issue_of(key, session, joints, worst, line=line, far=far, fast=fast, reason=reason)
    return converted, [issue]


def _in_one_unit(session: Session) -> bool:
    """Whether the velocities are in the positions' unit; so where nothing moves or tells."""
    compared = compare_velocities(session)
    if compared is None:
        return True
    moving, slope, _ = compared
    return not moving.any() or float(np.median(slope[moving])) > 0.1


def is_limited(arm: ArmModel) -> Bool[Array, " n"]:
    """Joints of which the URDF says how fast they are."""
    return np.isfinite(arm.known_limits.speed)


def farthest_motion(
    session: Session, arm: ArmModel | None
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Position and speed that each joint surely does not exceed [rad, rad/s].

    By its URDF's limits, which are nominal, so that some room is left; else by all arms'.
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


def mend_spikes(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops rows in which a position leaves its neighbours for one sample."""
    findings = Findings(session)
    for run in session.runs:
        wild = find_spikes(run.position)
        rows: Bool[Array, " T"] = np.asarray(wild.any(axis=1))
        # Many such rows are no hiccup but a channel that can't be trusted; the velocity check will
        # tell.
        if rows.any() and rows.mean() <= 0.01:
            first = run.time[rows][0]
            words = f"position leaves its neighbours for one sample {rows.sum()} times"
            columns = np.flatnonzero(wild.any(axis=0))
            findings.note(run, f"{words}, first at {first:.3f} s", columns)
            findings.runs.append(run.at(~rows))
        else:
            findings.runs.append(run)
    return findings.left(), findings.issues("garbage_cells")


def find_spikes(q: Float[Array, "T n"]) -> Bool[Array, "T n"]:
    """Samples far from both neighbours while these are close to each other; wraps are none."""
    wild = np.zeros(q.shape, dtype=bool)
    if len(q) < 5:
        return wild
    off = q[1:-1] - 0.5 * (q[:-2] + q[2:])
    noise = np.median(np.abs(off), axis=0)
    beyond = np.abs(off) > np.maximum(LIMIT.spike_rad, LIMIT.spike_noises * noise)
    returns = np.abs(q[2:] - q[:-2]) < 0.2 * np.abs(off)
    turns = np.abs(np.abs(off) - TURN) < LIMIT.wrap_rest
    wild[1:-1] = beyond & returns & ~turns
    return wild


def mend_wraps(session: Session, arm: ArmModel | None) -> tuple[Session, list[TelemetryIssue]]:
    """Unwraps joints whose position jumps by a turn."""
    turning = revolute(session, arm)
    findings = Findings(session)
    for run in session.runs:
        unwrapped, wraps = unwrap(run.position, turning)
        if not wraps.any():
            findings.runs.append(run)
            continue
        if arm is not None:
            unwrapped = _within_limits(unwrapped, arm)
        changes = {"position": unwrapped}
        if run.position_command is not None:
            command, _ = unwrap(run.position_command, turning)
            # The command follows the position: it starts in the same turn.
            turns = np.round((unwrapped[0] - command[0]) / TURN)
            changes["position_command"] = command + TURN * turns
        columns = np.flatnonzero(wraps)
        first = columns[0]
        findings.note(run, f"{run.joints[first]} jumps by a turn {wraps[first]} times", columns)
        findings.runs.append(run.replace(**changes))
    return findings.left(), findings.issues("wraps")


def _within_limits(q: Float[Array, "T n"], arm: ArmModel) -> Float[Array, "T n"]:
    """Positions moved by whole turns where only so they lie within the limits [rad]."""
    lower, upper = arm.known_limits[:2]
    for turn in (-TURN, TURN):
        low = q.min(axis=0)
        high = q.max(axis=0)
        outside = (low < lower) | (high > upper)
        is_inside_then = (low + turn >= lower) & (high + turn <= upper)
        q = q + turn * (outside & is_inside_then)
    return q


def unwrap(
    q: Float[Array, "T n"], turning: Bool[Array, " n"]
) -> tuple[Float[Array, "T n"], Int[Array, " n"]]:
    """Takes out steps of one turn.

    Returns:
        The positions [rad], and the number of such steps of each joint.
    """
    steps = np.diff(q, axis=0)
    turns = np.round(steps / TURN)
    is_near = np.abs(steps - TURN * turns) < LIMIT.wrap_rest
    wraps = (np.abs(turns) == 1.0) & is_near & turning
    shift = np.zeros(q.shape)
    shift[1:] = -TURN * np.cumsum(np.where(wraps, turns, 0.0), axis=0)
    return q + shift, wraps.sum(axis=0)


def split_at_jumps(session: Session, arm: ArmModel | None) -> tuple[Session, list[TelemetryIssue]]:
    """Parts runs where a position jumps farther than its joint moves.

    Samples are missing there, whatever the stamps say. A jump is far beyond the joint's limit of
    speed and beyond the speeds that it has in the run, to which motion would have come through
    those between. A few jumps part a run; many make its positions none.
    """
    parted = Findings(session)
    broken = Findings(session)
    _, top = farthest_motion(session, arm)
    for run in session.runs:
        steps = _jumps(run, top)
        jumps = steps > LIMIT.spike_rad
        rows = np.flatnonzero(jumps.any(axis=1))
        columns = np.flatnonzero(jumps.any(axis=0))
        if not len(rows):
            parted.runs.append(run)
            continue
        first = rows[0]
        column = int(np.argmax(steps[first]))
        jump = f"jumps by {steps[first, column]:.2f} rad at {run.time[first]:.3f} s"
        words = f"{run.joints[column]} {jump}"
        if len(rows) > max(LIMIT.most_jumps * len(run), 1):
            more = f"{len(rows) - 1} times more, farther than it can move"
            broken.note(run, f"{words} and {more}", columns)
            parted.runs.append(run)
        else:
            parted.note(run, words, columns)
            pieces = cut_before(run, _rows_of_cuts(rows, len(run)))
            parted.runs += [piece for piece in pieces if filter_run(piece) is not None]
    broken.columns |= parted.columns
    issues = broken.issues("broken_position") or parted.issues("jump")
    return (parted.left() if parted.runs else session), issues


def _jumps(run: Recording, top: Float[Array, " n"]) -> Float[Array, "T n"]:
    """Size of the jump that each step of a position belongs to [rad]; 0 where it moves as it may.

    Args:
        run: The run, of one row more than there are steps.
        top: Speed that each joint does not exceed [rad/s].
    """
    moved = np.diff(run.position, axis=0)
    fastest = np.maximum(top, LIMIT.jump_speeds * speed(run))
    elapsed = np.maximum(np.diff(run.time), 0.0)
    fast = np.abs(moved) > fastest * elapsed[:, None]
    # Fast steps in a row are one jump: they share the number of the last slow step before.
    jump = np.cumsum(~fast, axis=0) + len(run) * np.arange(fast.shape[1])
    total = np.bincount(jump.ravel(), (moved * fast).ravel())
    return np.abs(total[jump]) * fast


def _rows_of_cuts(rows: Int[Array, " k"], count: int) -> Int[Array, " c"]:
    """Rows before which a run is cut, by the rows of its jumps.

    A filter smears a jump over steps in a row, and as far again to either side.

    Args:
        rows: Of the steps that jump, in order.
        count: Rows of the run.
    """
    around = []
    for jump in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
        width = len(jump)
        around.append(np.arange(jump[0] - width + 2, jump[-1] + width + 1))
    return np.unique(np.clip(np.concatenate(around), 1, count - 1))


def mend_absurd(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops the rows with a cell that no arm can have had, time included."""
    wild = []
    for run in session.runs:
        far = [np.abs(values) > LIMIT.absurd for values in run.channels().values()]
        far_in_time = np.abs(run.time) > LIMIT.absurd_time
        wild.append(np.any(far, axis=0) | far_in_time[:, None])
    return _drop(session, wild, "garbage_cells", "cells beyond any figure of an arm", "")


def mend_channel_spikes(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops the rows in which a channel leaves the samples around it for a moment."""
    issues: list[TelemetryIssue] = []
    intervals = [run.sample_interval for run in session.runs if len(run) > 1]
    slow = float(np.median(intervals or [0.0])) > LIMIT.slow_s
    for channel in WATCHED:
        if not all(channel in run.channels() for run in session.runs):
            continue
        values = [np.asarray(run.channels()[channel]) for run in session.runs]
        wide = slow or channel in ("position", "temperature")
        gap = LIMIT.wide_gap if wide else LIMIT.gap
        floor = LIMIT.spike_rad if channel == "position" else 0.0
        wild = find_wild(values, floor, slow, gap)
        issue = "effort_spike" if channel in ("effort", "current") else "garbage_cells"
        words = f"{channel} leaves the samples around it"
        session, issues_of_channel = _drop(session, wild, issue, words, channel)
        issues += issues_of_channel
    return session, issues


def find_far(
    runs: list[Float[Array, "T n"]], gap: float = LIMIT.gap, floor: float = 0.0
) -> list[Bool[Array, "T n"]]:
    """Which cells of a channel lie far from all else, by run, however many they are.

    A motion, a torque or a temperature comes to a value through those on the way. Walking outwards
    from a channel's median, sample by sample in order of distance, the first stretch without any
    sample that is several times as wide as all that lies within parts the channel from what is not
    its own. Half of the samples may be bad.

    Args:
        runs: The channel.
        gap: How many times the reach of all that lies within the stretch must span.
        floor: Reach below which nothing is far, in the channel's unit.
    """
    whole = np.concatenate(runs)
    if len(whole) < 3:
        return [np.zeros(values.shape, dtype=bool) for values in runs]
    middle = np.median(whole, axis=0)
    reach = np.abs(whole - middle)
    usual = np.quantile(reach, LIMIT.reach_share, axis=0)
    limit = np.full(len(middle), np.inf)
    for joint in range(len(middle)):
        of_others = np.delete(usual, joint) if len(usual) > 1 else usual
        least = max(float(of_others.max()), floor)
        limit[joint] = _end_of(reach[:, joint], gap, least)
    return [np.abs(values - middle) > limit for values in runs]


def _end_of(reach: Float[Array, " T"], gap: float, least: float) -> float:
    """Where a channel ends: before the first empty stretch beyond half of its samples.

    Args:
        reach: Distance of the samples from the median.
        gap: How many times the reach of all within, or `least`, such a stretch spans.
        least: Reach of the other joints.
    """
    if least <= 0.0:
        return np.inf
    half = len(reach) // 2
    outer = np.sort(reach)[half:]
    empty = outer[1:] > gap * np.maximum(outer[:-1], least)
    return float(outer[np.argmax(empty)]) if empty.any() else np.inf


def find_wild(
    runs: list[Float[Array, "T n"]],
    floor: float = 0.0,
    slow: bool = False,
    gap: float = LIMIT.gap,
) -> list[Bool[Array, "T n"]]:
    """Which cells of a channel are spikes, by run.

    Args:
        runs: The channel.
        floor: Of positions: less than this is no spike [rad], and a turn is a wrap; an encoder may
            have been set anew.
        slow: Whether a single sample may be true where it stands out by the channel's range.
        gap: How far beyond an empty stretch a cell must lie, see `find_far`.
    """
    masks = find_far(runs, gap, TURN if floor else 0.0)
    for width, share_of_range in LIMIT.widths:
        long = [number for number, values in enumerate(runs) if len(values) > 4 * width]
        if not long:
            continue
        off = {number: distance(runs[number], width) for number in long}
        sizes = {number: np.abs(far) for number, far in off.items()}
        level = np.quantile(np.concatenate(list(sizes.values())), LIMIT.share, axis=0)
        whole = np.concatenate([runs[number] for number in long])
        low, high = np.percentile(whole, [2, 98], axis=0)
        least = LIMIT.widths[-1][1] if slow else share_of_range
        limit = np.maximum(LIMIT.times * level, least * (high - low))
        limit = np.maximum(limit, floor)
        # A joint at rest has next to no range of its own: what is a tremble beside the arm's motion
        # is no fault.
        limit = np.maximum(limit, LIMIT.tremble * float(np.max(high - low)))
        for number, size in sizes.items():
            # A channel that never changes has no limit either: any change would be a spike.
            spikes = (size > limit) & (limit > 0.0)
            if floor:
                spikes &= np.abs(size - TURN) >= LIMIT.wrap_rest
            masks[number] |= spikes
    return masks


def distance(values: Float[Array, "T n"], width: int) -> Float[Array, "T n"]:
    """How far each sample lies from the median of those around it.

    The first and last ones have the window at the run's end: a mirrored neighbour would count
    twice.

    Args:
        values: A channel of one run.
        width: Samples on each side that are counted, beside the sample itself.
    """
    medians = median_filter(values, (2 * width + 1, 1))[width : len(values) - width]
    rows = np.clip(np.arange(len(values)) - width, 0, len(medians) - 1)
    return np.asarray(values - medians[rows])


def _drop(
    session: Session, wild: list[Bool[Array, "T n"]], issue: str, words: str, channel: str
) -> tuple[Session, list[TelemetryIssue]]:
    """Drops rows with wild cells, and tells; where there are too many, refuses.

    Args:
        session: The recordings.
        wild: Which cells, by run.
        issue: Wording of the issue.
        words: What was seen.
        channel: Where; "" if in several.
    """
    findings = Findings(session)
    lost = 0
    for run, mask in zip(session.runs, wild, strict=True):
        rows = np.asarray(mask.any(axis=1))
        if not rows.any():
            findings.runs.append(run)
            continue
        count = int(rows.sum())
        lost += count
        first = int(np.flatnonzero(rows)[0])
        joint = int(np.argmax(mask[first]))
        place = f"{run.joints[joint]} in row {first + 1}"
        if channel:
            place += f", {run.channels()[channel][first, joint]:.4g}"
        columns = np.flatnonzero(mask.any(axis=0))
        findings.note(run, f"{words} in {plural(count, 'row')}, first of {place}", columns)
        findings.runs.append(run.at(~rows))
    if lost <= max(LIMIT.most_rows * session.samples, 1):
        is_little = lost < 0.001 * session.samples
        return findings.left(), findings.issues(issue, "note" if is_little else "warning")
    if channel in OPTIONAL:
        findings.runs = [run.replace(**{channel: None}) for run in session.runs]
        return findings.left(), findings.issues("broken_channel", channel=channel)
    refusal = "wild_cells" if issue == "garbage_cells" else "wild_effort"
    return findings.left(), findings.issues(refusal)
