"""Positions: degrees for radians, wraps at half a turn, single wild samples, jumps.

Single wild cells of any channel: cut out before anything else looks at the numbers.

A cell is absurd if no unit makes it a figure of an arm. It is a spike if it leaves the samples around it, which agree
among themselves, much farther than nearly all samples do: the measure is a high quantile of the same distance over all
runs, so that fast motion, coarse channels and noise each set their own level, and no few samples can raise it.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import median_filter

from ident.arrays import Array, Bool, Float
from ident.checks.effort import collect_states, explained_by_model, fit_signed
from ident.checks.filtered_run import ANGLES as LIMIT
from ident.checks.filtered_run import CLOCK, compare_velocities, filter_run
from ident.checks.report import Findings, issue_of
from ident.errors import plural
from ident.recordings.recording import Recording, Session, TelemetryIssue, cut_before
from ident.robot.arm import ArmModel

TURN = 2.0 * math.pi


def revolute(session: Session, arm: ArmModel | None) -> Bool[Array, " n"]:
    """Which joints turn; all where the robot is not known."""
    return np.ones(len(session.joints), dtype=bool) if arm is None else ~arm.sliding_joints


def mend_degrees(session: Session, arm: ArmModel | None) -> tuple[Session, list[TelemetryIssue]]:
    """Finds angles in degrees, or radians read as degrees: the session is converted for other checks, a fit is refused.

    Suspected by motion that the arm's limits forbid, or where they are unknown, that no arm can make; told by how much
    better the robot's torques explain the measured ones when the numbers are read as degrees, else by the motion.
    Radians, where no joint goes farther than a turn's number of degrees, by torque that follows gravity as it should if
    the motion is so much wider.
    """
    turning = revolute(session, arm)
    far = np.max([np.abs(run.position).max(axis=0) for run in session.runs], axis=0)
    fast = np.max([speed(run) for run in session.runs], axis=0)
    farthest, fastest = farthest_motion(session, arm)
    suspects = turning & ((far > farthest) | (fast > fastest))
    # In degrees nearly any motion goes beyond what would be two turns; a fast joint alone may be fast.
    is_far = far > LIMIT.farthest_rad
    if arm is not None:
        is_far |= is_limited(arm)
    if arm is not None and turning.any() and far[turning].max() < math.radians(TURN):
        wider = scale_angles(session, math.degrees(1.0), turning)
        if follows_gravity(wider, arm):
            worst = int(np.argmax(np.where(turning, far, -1.0)))
            return wider, [issue_of("radians", session, turning, worst, far=far)]
    if not suspects.any():
        return session, []
    found = compare_velocities(session)
    # Whether the velocities are in the positions' unit.
    alike = found is None or not found[0].any() or float(np.median(found[1][found[0]])) > 0.1
    converted = scale_angles(session, math.radians(1.0), turning, alike)
    as_radians, as_degrees = (0.0, 0.0) if arm is None else [explained_by_model(s, arm) for s in (session, converted)]
    tells = max(as_degrees, as_radians) > LIMIT.model_tells
    if tells and as_degrees > as_radians + 0.1:
        reason = (
            f"the robot's model explains {100.0 * as_degrees:.0f} % of the torque in degrees, "
            f"{100.0 * as_radians:.0f} % in radians"
        )
    elif tells or not (suspects & (fast > np.maximum(fastest, LIMIT.fastest_rad_s)) & is_far).any():
        return session, []
    else:
        reason = "no arm moves so fast in radians"
    worst = int(np.argmax(np.where(suspects, far, -1.0)))
    return converted, [issue_of("degrees", session, turning, worst, far=far, fast=fast, reason=reason)]


def is_limited(arm: ArmModel) -> Bool[Array, " n"]:
    """Joints of which the URDF says how fast they are."""
    return np.isfinite(arm.known_limits.speed)


def farthest_motion(session: Session, arm: ArmModel | None) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Position and speed that each joint surely does not exceed: by its URDF's limits, else by all arms' [rad, rad/s].

    Limits are nominal: some room is left.
    """
    count = len(session.joints)
    reach, top = np.full(count, np.inf), np.full(count, np.inf)
    if arm is not None:
        limits = arm.known_limits
        reach, top = limits.reach, CLOCK.over_limit * limits.speed
    farthest = np.where(np.isfinite(reach), np.maximum(CLOCK.over_limit * reach, TURN), LIMIT.farthest_rad)
    return farthest, np.where(np.isfinite(top), top, LIMIT.fastest_rad_s)


def follows_gravity(session: Session, arm: ArmModel) -> bool:
    """Whether the heavy joints' torque is mostly explained, gravity in it of about its own size (medians)."""
    states = collect_states(session, arm)
    if states is None or not states.heavy.any():
        return False
    fits = [fit_signed(states, int(j), 1.0) for j in np.flatnonzero(states.heavy)]
    explained, size, _ = np.median(fits, axis=0)
    return bool(explained > LIMIT.model_tells and states.settings.scale_low < size < states.settings.scale_high)


def speed(run: Recording) -> Float[Array, " n"]:
    """A speed that each joint holds for more than single samples: the 99th percentile of its steps.

    A sample that leaves its neighbours and comes back is no motion: the step over three samples is asked as well.
    """
    if len(run) < 4:
        return np.zeros(len(run.joints))
    elapsed = np.maximum(np.diff(run.time), 1e-9)[:, None]
    short = np.abs(np.diff(run.position, axis=0)) / elapsed
    wide = np.abs(run.position[3:] - run.position[:-3]) / (elapsed[2:] + elapsed[1:-1] + elapsed[:-2])
    return np.percentile(np.minimum(short[1:-1], wide), 99, axis=0)


def scale_angles(session: Session, factor: float, columns: Bool[Array, " n"], derivatives: bool = True) -> Session:
    """Multiplies positions of some joints, and their derivatives or not."""
    further = ("velocity", "acceleration", "velocity_command") if derivatives else ()
    scale, names = np.where(columns, factor, 1.0), ("position", "position_command", *further)
    scaled = [{name: v * scale for name, v in run.channels().items() if name in names} for run in session.runs]
    return session.replace(runs=[run.replace(**own) for run, own in zip(session.runs, scaled, strict=True)])


def mend_spikes(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops rows in which a position leaves its neighbours for one sample."""
    found = Findings(session)
    for run in session.runs:
        wild = find_spikes(run.position)
        rows: Bool[Array, " T"] = np.asarray(wild.any(axis=1))
        # Many such rows are no hiccup but a channel that can't be trusted; the velocity check will tell.
        if rows.any() and rows.mean() <= 0.01:
            what = f"position leaves its neighbours for one sample {rows.sum()} times"
            found.note(run, f"{what}, first at {run.time[rows][0]:.3f} s", np.flatnonzero(wild.any(axis=0)))
            run = run.at(~rows)
        found.runs.append(run)
    return found.left(), found.issues("garbage_cells")


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
    turning, found = revolute(session, arm), Findings(session)
    for run in session.runs:
        unwrapped, wraps = unwrap(run.position, turning)
        if wraps.any():
            columns = np.flatnonzero(wraps)
            lower, upper = (-np.inf, np.inf) if arm is None else arm.known_limits[:2]
            for turn in (-TURN, TURN):  # whole runs move by turns where only so they lie within the limits
                low, high = unwrapped.min(axis=0), unwrapped.max(axis=0)
                outside = (low < lower) | (high > upper)
                unwrapped = unwrapped + turn * (outside & (low + turn >= lower) & (high + turn <= upper))
            changes = {"position": unwrapped}
            if run.position_command is not None:
                command, _ = unwrap(run.position_command, turning)
                # The command follows the position: it starts in the same turn.
                changes["position_command"] = command + TURN * np.round((changes["position"][0] - command[0]) / TURN)
            found.note(run, f"{run.joints[columns[0]]} jumps by a turn {wraps[columns[0]]} times", columns)
            run = run.replace(**changes)
        found.runs.append(run)
    return found.left(), found.issues("wraps")


def unwrap(q: Float[Array, "T n"], turning: Bool[Array, " n"]) -> tuple[Float[Array, "T n"], Array]:
    """Takes out steps of one turn; returns the positions and the number of steps a joint."""
    steps = np.diff(q, axis=0)
    turns = np.round(steps / TURN)
    wraps = (np.abs(turns) == 1.0) & (np.abs(steps - TURN * turns) < LIMIT.wrap_rest) & turning
    shift = np.zeros(q.shape)
    shift[1:] = -TURN * np.cumsum(np.where(wraps, turns, 0.0), axis=0)
    return q + shift, wraps.sum(axis=0)


def split_at_jumps(session: Session, arm: ArmModel | None) -> tuple[Session, list[TelemetryIssue]]:
    """Parts runs where a position jumps farther than its joint moves: samples are missing, whatever the stamps say.

    A jump is far beyond the joint's limit of speed and beyond the speeds that it has in the run, to which motion would
    have come through those between. A filter smears one over steps in a row, and as far again to either side. A few
    jumps part a run; many make its positions none.
    """
    parted, broken = Findings(session), Findings(session)
    _, top = farthest_motion(session, arm)
    for run in session.runs:
        moved = np.diff(run.position, axis=0)
        fastest = np.maximum(top, LIMIT.jump_speeds * speed(run))
        fast = np.abs(moved) > fastest * np.maximum(np.diff(run.time), 0.0)[:, None]
        row = np.cumsum(~fast, axis=0) + len(run) * np.arange(fast.shape[1])
        steps = np.abs(np.bincount(row.ravel(), (moved * fast).ravel())[row]) * fast
        rows, columns = (np.flatnonzero((steps > LIMIT.spike_rad).any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            parted.runs.append(run)
            continue
        column = int(np.argmax(steps[rows[0]]))
        words = f"{run.joints[column]} jumps by {steps[rows[0], column]:.2f} rad at {run.time[rows[0]]:.3f} s"
        if len(rows) > max(LIMIT.most_jumps * len(run), 1):
            broken.note(run, f"{words} and {len(rows) - 1} times more, farther than it can move", columns)
            parted.runs.append(run)
        else:
            parted.note(run, words, columns)
            jumps = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
            spread = np.concatenate([np.arange(one[0] - len(one) + 2, one[-1] + len(one) + 1) for one in jumps])
            pieces = cut_before(run, np.unique(np.clip(spread, 1, len(run) - 1)))
            parted.runs += [piece for piece in pieces if filter_run(piece) is not None]
    broken.columns |= parted.columns
    return (parted.left() if parted.runs else session), broken.issues("broken_position") or parted.issues("jump")


# Commands may leap: nobody but the checks of `ident.checks.channels` reads them.
WATCHED = ("effort", "position", "velocity", "current", "acceleration", "temperature")
# Nobody needs these: where they are broken they are left out, and the session is used without them.
OPTIONAL = ("velocity", "acceleration", "temperature")


def mend_absurd(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops the rows with a cell that no arm can have had, time included."""
    wild = []
    for run in session.runs:
        far = [np.abs(values) > LIMIT.absurd for values in run.channels().values()]
        wild.append(np.any(far, axis=0) | (np.abs(run.time) > LIMIT.absurd_time)[:, None])
    return _drop(session, wild, "garbage_cells", "cells beyond any figure of an arm", "")


def mend_channel_spikes(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops the rows in which a channel leaves the samples around it for a moment."""
    issues: list[TelemetryIssue] = []
    slow = float(np.median([run.sample_interval for run in session.runs if len(run) > 1] or [0.0])) > LIMIT.slow_s
    for channel in WATCHED:
        if not all(channel in run.channels() for run in session.runs):
            continue
        values = [np.asarray(run.channels()[channel]) for run in session.runs]
        gap = LIMIT.wide_gap if slow or channel in ("position", "temperature") else LIMIT.gap
        wild = find_wild(values, LIMIT.spike_rad if channel == "position" else 0.0, slow, gap)
        issue = "effort_spike" if channel in ("effort", "current") else "garbage_cells"
        session, found = _drop(session, wild, issue, f"{channel} leaves the samples around it", channel)
        issues += found
    return session, issues


def find_far(runs: list[Float[Array, "T n"]], gap: float = LIMIT.gap, floor: float = 0.0) -> list[Bool[Array, "T n"]]:
    """Which cells of a channel lie far from all else, by run, however many they are.

    A motion, a torque or a temperature comes to a value through those on the way. Walking outwards from a channel's
    median, sample by sample in order of distance, the first stretch without any sample that is several times as wide as
    all that lies within parts the channel from what is not its own. Half of the samples may be bad.

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
    limit, half = np.full(len(middle), np.inf), len(whole) // 2
    for joint in range(len(middle)):
        least = max(float((np.delete(usual, joint) if len(usual) > 1 else usual).max()), floor)
        ranked = np.sort(reach[:, joint])
        # Where the channel ends: before the first empty stretch beyond half of the samples.
        empty = ranked[half + 1 :] > gap * np.maximum(ranked[half:-1], least)
        if least > 0.0 and empty.any():
            limit[joint] = ranked[half + int(np.argmax(empty))]
    return [np.abs(values - middle) > limit for values in runs]


def find_wild(
    runs: list[Float[Array, "T n"]], floor: float = 0.0, slow: bool = False, gap: float = LIMIT.gap
) -> list[Bool[Array, "T n"]]:
    """Which cells of a channel are spikes, by run.

    Args:
        runs: The channel.
        slow: Whether a single sample may be true where it stands out by the channel's range.
        gap: How far beyond an empty stretch a cell must lie, see `find_far`.
        floor: Of positions: less than this is no spike [rad], and a turn is a wrap; an encoder may have been set anew.
    """
    masks = find_far(runs, gap, TURN if floor else 0.0)
    for width, least in LIMIT.widths:
        off = {k: distance(values, width) for k, values in enumerate(runs) if len(values) > 4 * width}
        if not off:
            continue
        size = np.concatenate([np.abs(one) for one in off.values()])
        level = np.quantile(size, LIMIT.share, axis=0)
        low, high = np.percentile(np.concatenate([runs[k] for k in off]), [2, 98], axis=0)
        least = LIMIT.widths[-1][1] if slow else least
        limit = np.maximum(np.maximum(LIMIT.times * level, least * (high - low)), floor)
        # A joint at rest has next to no range of its own: what is a tremble beside the arm's motion is no fault.
        limit = np.maximum(limit, LIMIT.tremble * float(np.max(high - low)))
        # A channel that never changes has neither: any change of it would be a spike.
        for k in off:
            wraps = np.abs(np.abs(off[k]) - TURN) < LIMIT.wrap_rest if floor else np.zeros_like(masks[k])
            masks[k] |= (np.abs(off[k]) > limit) & (limit > 0.0) & ~wraps
    return masks


def distance(values: Float[Array, "T n"], width: int) -> Float[Array, "T n"]:
    """How far each sample lies from the median of those around it, itself and so many on each side counted.

    The first and last ones have the window at the run's end: a mirrored neighbour would count twice.
    """
    medians = median_filter(values, (2 * width + 1, 1))[width : len(values) - width]
    rows = np.clip(np.arange(len(values)) - width, 0, len(medians) - 1)
    return np.asarray(values - medians[rows])


def _drop(
    session: Session, wild: list[Bool[Array, "T n"]], issue: str, words: str, channel: str
) -> tuple[Session, list[TelemetryIssue]]:
    """Drops rows with wild cells, and tells; where there are too many, refuses."""
    found, lost = Findings(session), 0
    for run, mask in zip(session.runs, wild, strict=True):
        rows = np.asarray(mask.any(axis=1))
        if rows.any():
            first = int(np.flatnonzero(rows)[0])
            joint = int(np.argmax(mask[first]))
            lost += int(rows.sum())
            seen = f", {run.channels()[channel][first, joint]:.4g}" if channel else ""
            count = plural(int(rows.sum()), "row")
            what = f"{words} in {count}, first of {run.joints[joint]} in row {first + 1}{seen}"
            found.note(run, what, np.flatnonzero(mask.any(axis=0)))
            run = run.at(~rows)
        found.runs.append(run)
    if lost <= max(LIMIT.most_rows * session.samples, 1):
        return found.left(), found.issues(issue, "note" if lost < 0.001 * session.samples else "warning")
    if channel in OPTIONAL:
        found.runs = [run.replace(**{channel: None}) for run in session.runs]
        return found.left(), found.issues("broken_channel", channel=channel)
    return found.left(), found.issues("wild_cells" if issue == "garbage_cells" else "wild_effort")
