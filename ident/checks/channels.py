"""Channels that hold still when they should not.

Stuck values, flat tops, commands that pose as measurements.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.checks.report import Findings, issue_of, joints_at
from ident.checks.settings import CHANNELS as LIMIT
from ident.recordings.blocks import FEWEST_BLOCKS, count_blocks
from ident.recordings.recording import Recording, Session, TelemetryIssue

# Share of a channel's range by which values that a limit cuts off may differ (chosen: below a
# converter's step).
ROUNDING = 1e-4
NOT_CUT = 0  # samples at the limit of a channel without one


def drop_stuck(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops the samples in which a position or torque is frozen.

    Refuses where too little is left to judge anything.

    Returns:
        The session without these samples, and the issues; empty runs and a fatal issue where too
        little is left.
    """
    findings = Findings(session)
    lost = 0
    # One value a run, another in the next, is a dead channel, not a coarse one.
    dead = np.all([np.ptp(run.effort, axis=0) == 0.0 for run in session.runs], axis=0)
    efforts = np.concatenate([run.effort for run in session.runs])
    coarse = is_coarse(efforts) & ~dead
    for run in session.runs:
        positions = stuck_positions(run)
        frozen = positions | (stuck_efforts(run) & ~coarse)
        rows = frozen.any(axis=1)
        if rows.any():
            count = rows.sum()
            lost += int(count)
            first = int(np.flatnonzero(rows)[0])
            channel = "position" if positions[first].any() else "effort"
            joint = run.joints[int(np.argmax(frozen[first]))]
            since = f"frozen from {run.time[first]:.3f} s, {count} samples in all"
            columns = np.flatnonzero(frozen.any(axis=0))
            findings.note(run, f"{channel} of {joint} is {since}", columns)
            run = run.at(~rows)
        if len(run):
            findings.runs.append(run)
    is_much = lost > LIMIT.most_lost * session.samples
    if is_much and _blocks(findings.runs) < FEWEST_BLOCKS:
        empty = [run.at(slice(0)) for run in session.runs]
        return session.replace(runs=empty), findings.issues("stuck_long")
    return findings.left(), findings.issues("stuck")


def _blocks(runs: list[Recording]) -> int:
    """How many blocks runs have together, of the shortest duration that is judged."""
    blocks = 0
    for run in runs:
        if len(run) > 1:
            blocks += count_blocks(len(run) * run.sample_interval)
    return blocks


def holds(values: Float[Array, " T"]) -> Int[Array, "h 2"]:
    """First and last row of every stretch in which a channel repeats one value, shape (h, 2).

    A value that is not repeated is a stretch of one row.
    """
    changes = np.flatnonzero(np.diff(values) != 0.0)
    first = np.append(0, changes + 1)
    last = np.append(changes, len(values) - 1)
    return np.column_stack([first, last])


def is_coarse(values: Float[Array, "T n"]) -> Bool[Array, " n"]:
    """Channels that take so few values that repetitions mean nothing.

    One value only is not coarse but dead.
    """
    coarse = np.zeros(values.shape[1], dtype=bool)
    for joint, column in enumerate(values.T):
        levels = np.unique(column)
        if len(levels) > 1:
            spacing = float(np.median(np.diff(levels)))
            coarse[joint] = spacing > LIMIT.coarse * np.ptp(column)
    return coarse


def _long_holds(values: Float[Array, " T"], time: Float[Array, " T"]) -> Int[Array, "h 2"]:
    """Stretches long enough to be a stuck channel, given how long it usually repeats a value.

    Args:
        values: The channel.
        time: Its stamps.

    Returns:
        First and last row of each.
    """
    stretches = holds(values)
    first = stretches[:, 0]
    last = stretches[:, 1]
    lengths = last - first + 1
    long = lengths >= LIMIT.stuck_samples
    duration = np.diff(time[stretches[long]], axis=1)[:, 0]
    long[long] = duration >= LIMIT.stuck_s
    # What is usual takes longer to find than that nothing is long.
    if len(stretches) > 2 and long.any():
        usual = float(np.median(lengths))
        long &= lengths >= LIMIT.stuck_repetitions * usual
    return stretches[long]


def stuck_positions(run: Recording) -> Bool[Array, "T n"]:
    """Samples in which a position is frozen although its joint moves."""
    frozen = np.zeros(run.position.shape, dtype=bool)
    for joint in range(len(run.joints)):
        q = run.position[:, joint]
        long = _long_holds(q, run.time)
        if not len(long):
            continue
        usual_lag = _usual_lag(run, joint, long)
        least_jump = LIMIT.jump_rad
        if len(q) > 2:
            usual_step = float(np.percentile(np.abs(np.diff(q)), 99))
            least_jump = max(LIMIT.jump_steps * usual_step, LIMIT.jump_rad)
        for first, last in long:
            stretch = slice(first, last + 1)
            jump = 0.0
            if last + 1 < len(q):
                jump = abs(q[last + 1] - q[last])
            # While the whole arm stands, an encoder that stands is right: the arm starts again
            # with a step.
            jumps = jump > least_jump and not _others_stand(run, joint, stretch)
            hidden = _hidden_travel(run, joint, stretch, usual_lag)
            frozen[stretch, joint] = jumps or hidden > LIMIT.hidden_travel
    return frozen


def _others_stand(run: Recording, joint: int, stretch: slice) -> bool:
    """Whether all other joints stand in a stretch; not so where there is no other."""
    others = np.delete(run.position[stretch], joint, axis=1)
    if not others.shape[1]:
        return False
    return float(np.ptp(others, axis=0).max()) < LIMIT.hidden_travel


def _usual_lag(run: Recording, joint: int, standing: Int[Array, "h 2"]) -> float:
    """How far a joint stays behind its command in nearly all samples in which it moves [rad].

    Args:
        run: The run; 0 comes back where it has no commands.
        joint: The joint's column.
        standing: First and last row of each stretch in which it stands.
    """
    moves = np.ones(len(run), dtype=bool)
    for first, last in standing:
        moves[first : last + 1] = False
    if run.position_command is None or not moves.any():
        return 0.0
    lag = np.abs(run.position_command - run.position)[moves, joint]
    return float(np.quantile(lag, LIMIT.lag_share))


def _hidden_travel(run: Recording, joint: int, stretch: slice, usual_lag: float) -> float:
    """How far the joint went by its velocity or command while its position stood still [rad].

    A command is no measurement: one that the joint merely lags behind, as it does elsewhere, tells
    of no motion.
    """
    travel = 0.0
    if run.velocity is not None:
        velocity = run.velocity[stretch, joint][1:]
        steps = velocity * np.diff(run.time[stretch])
        way = np.concatenate([[0.0], np.cumsum(steps)])
        travel = float(np.ptp(way))
    if run.position_command is not None:
        command = run.position_command[stretch, joint]
        lag = float(np.abs(command - run.position[stretch, joint]).max())
        if lag > LIMIT.lag_times * usual_lag:
            travel = max(travel, float(np.ptp(command)))
    return travel


def stuck_efforts(run: Recording) -> Bool[Array, "T n"]:
    """Samples in which a torque is frozen, not at its extremes, although its joint moves."""
    frozen = np.zeros(run.effort.shape, dtype=bool)
    for joint, tau in enumerate(run.effort.T):
        for first, last in _long_holds(tau, run.time):
            stretch = slice(first, last + 1)
            is_whole = last - first + 1 > 0.9 * len(tau)
            is_extreme = tau[first] in (tau.min(), tau.max()) and not is_whole
            moves = np.ptp(run.position[stretch, joint]) > LIMIT.hidden_travel
            frozen[stretch, joint] = not is_extreme and moves
    return frozen


def drop_stuck_velocity(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Leaves out the velocities of all joints where one is frozen: they are not needed.

    Returns:
        The session, and the issues; as it was, and none, where no velocity is frozen.
    """
    findings = Findings(session)
    for run in session.runs:
        findings.runs.append(run.replace(velocity=None))
        if run.velocity is None:
            continue
        for joint, velocity in enumerate(run.velocity.T):
            for first, last in _long_holds(velocity, run.time):
                travel = run.position[last, joint] - run.position[first, joint]
                claimed = velocity[first] * (run.time[last] - run.time[first])
                if abs(travel - claimed) > max(LIMIT.hidden_travel, 0.5 * abs(travel)):
                    name = run.joints[joint]
                    words = f"velocity of {name} is frozen from {run.time[first]:.3f} s"
                    findings.note(run, words, [joint])
    return findings.left(), findings.issues("stuck_velocity")


def check_clipping(session: Session) -> list[TelemetryIssue]:
    """Finds torques that are cut off at a constant value while the joint moves.

    Returns:
        One issue with the share of the samples that are cut off, or none.
    """
    findings = Findings(session)
    clipped = 0
    for run in session.runs:
        if len(run) < LIMIT.stuck_samples:
            continue
        # At rest a torque may hold any value; only moving samples can show a flat top.
        velocity = np.gradient(run.position, run.time, axis=0)
        speed = np.abs(velocity).max(axis=1)
        effort = run.effort[speed > LIMIT.hidden_travel]
        for joint, sign in product(range(len(run.joints)), (1.0, -1.0)):
            count, level = flat_top(sign * effort[:, joint])
            if count:
                clipped += count
                stays = f"stays at {sign * level:.4g} N m for {count} samples"
                findings.note(run, f"{run.joints[joint]} {stays}", [joint])
    return findings.issues("clipped", share=clipped / session.samples)


def flat_top(values: Float[Array, " T"]) -> tuple[int, float]:
    """Number of samples at a channel's cut-off maximum, and the maximum; 0 if it is not cut off.

    A cut piles up at one value, up to rounding, what would lie above it: far more samples than in
    any slice just below.
    """
    if len(values) < LIMIT.top_samples:
        return NOT_CUT, 0.0
    spread = float(np.ptp(values))
    if spread == 0.0:
        return NOT_CUT, 0.0
    top = float(values.max())
    is_top = values >= top - ROUNDING * spread
    count = int(is_top.sum())
    # A limit lies far out: a channel that only never changes its sign is not cut off at zero.
    largest = np.abs(values).max()
    is_far_out = top >= LIMIT.top_level * largest
    if count < LIMIT.top_samples or not is_far_out or is_coarse(values[:, None])[0]:
        return NOT_CUT, top
    if _longest(is_top) < LIMIT.top_stretch:
        return NOT_CUT, top
    levels = np.unique(np.where(is_top, top, values))
    step = float(np.median(np.diff(levels)))
    width = max(LIMIT.top_range * spread, 1.01 * step)
    slices = np.arange(LIMIT.top_slices, -1, -1)
    edges = top - width * slices
    below, _ = np.histogram(values[~is_top], bins=edges)
    is_pile = count > LIMIT.top_pile * below.max()
    return (count if is_pile else NOT_CUT), top


def _longest(marked: Bool[Array, " T"]) -> int:
    """Rows of the longest stretch that is marked; at least one row is."""
    stretches = holds(marked.astype(float))
    first = stretches[:, 0]
    last = stretches[:, 1]
    lengths = last - first + 1
    return int(lengths[marked[first]].max())


def check_commands(session: Session) -> list[TelemetryIssue]:
    """Finds commands that are logged as measurements, of positions, velocities or efforts.

    Returns:
        An issue for each channel that mostly equals its command while the joint moves.
    """
    issues = []
    channels = [run.channels() for run in session.runs]
    for measured in ("effort", "position"):
        command = f"{measured}_command"
        pairs = [channel for channel in channels if command in channel]
        if not pairs:
            continue
        values = np.concatenate([pair[measured] for pair in pairs])
        commands = np.concatenate([pair[command] for pair in pairs])
        moving = np.abs(np.diff(commands, axis=0)) > 0.0
        is_command = (values == commands)[1:]
        same = (is_command & moving).sum(axis=0)
        mostly_same = same > LIMIT.command_share * moving.sum(axis=0)
        joints = np.flatnonzero(mostly_same & moving.any(axis=0))
        if len(joints):
            places = ", ".join(joints_at(session, joints))
            if len(joints) == len(session.joints) > 1:
                places = "every joint"
            share = float((same[joints] / moving.sum(axis=0)[joints]).min())
            issue = issue_of(
                command, session, joints, measured=measured, places=places, share=share
            )
            issues.append(issue)
    return issues
