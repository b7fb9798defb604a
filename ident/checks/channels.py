"""Channels that hold still when they should not: stuck values, flat tops, commands that pose as measurements."""

from __future__ import annotations

from itertools import product

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.checks.filtered_run import CHANNELS as LIMIT
from ident.checks.report import Findings, issue_of
from ident.recordings.recording import FEWEST_BLOCKS, SHORTEST_BLOCK_S, Recording, Session, TelemetryIssue

# Share of a channel's range by which values that a limit cuts off may differ (chosen: below a converter's step).
ROUNDING = 1e-4


def drop_stuck(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops the samples in which a position or torque is frozen; refuses where too little is left to judge anything."""
    found, lost = Findings(session), 0
    # One value a run, another in the next, is a dead channel, not a coarse one.
    dead = np.all([np.ptp(run.effort, axis=0) == 0.0 for run in session.runs], axis=0)
    coarse = is_coarse(np.concatenate([run.effort for run in session.runs])) & ~dead
    for run in session.runs:
        positions = stuck_positions(run)
        frozen = positions | (stuck_efforts(run) & ~coarse)
        rows = frozen.any(axis=1)
        if rows.any():
            first = int(np.flatnonzero(rows)[0])
            lost += int(rows.sum())
            channel = "position" if positions[first].any() else "effort"
            where = f"{channel} of {run.joints[int(np.argmax(frozen[first]))]}"
            what = f"{where} is frozen from {run.time[first]:.3f} s, {rows.sum()} samples in all"
            found.note(run, what, np.flatnonzero(frozen.any(axis=0)))
        if not rows.all():
            found.runs.append(run.at(~rows) if rows.any() else run)
    usable = [run for run in found.runs if len(run) > 1]
    blocks = sum(int(len(run) * run.sample_interval / SHORTEST_BLOCK_S) for run in usable)
    if blocks < FEWEST_BLOCKS and lost > LIMIT.most_lost * session.samples:
        return session.replace(runs=[run.at(slice(0)) for run in session.runs]), found.issues("stuck_long")
    return found.left(), found.issues("stuck")


def holds(values: Float[Array, " T"]) -> Int[Array, "h 2"]:
    """First and last row of every stretch in which a channel repeats one value."""
    changes = np.flatnonzero(np.diff(values) != 0.0)
    return np.column_stack([np.append(0, changes + 1), np.append(changes, len(values) - 1)])


def is_coarse(values: Float[Array, "T n"]) -> Bool[Array, " n"]:
    """Channels that take so few values that repetitions mean nothing; one value only is not coarse but dead."""
    coarse = np.zeros(values.shape[1], dtype=bool)
    for joint, column in enumerate(values.T):
        levels = np.unique(column)
        spacing = float(np.median(np.diff(levels))) if len(levels) > 1 else 0.0
        coarse[joint] = spacing > LIMIT.coarse * np.ptp(column)
    return coarse


def _long_holds(values: Float[Array, " T"], time: Float[Array, " T"]) -> Int[Array, "h 2"]:
    """Stretches long enough to be a stuck channel, given how long the channel usually repeats a value."""
    found = holds(values)
    lengths = found[:, 1] - found[:, 0] + 1
    long = lengths >= LIMIT.stuck_samples
    long[long] = np.diff(time[found[long]], axis=1)[:, 0] >= LIMIT.stuck_s
    if len(found) > 2 and long.any():  # what is usual takes longer to find than that nothing is long
        long &= lengths >= LIMIT.stuck_repetitions * float(np.median(lengths))
    return found[long]


def stuck_positions(run: Recording) -> Bool[Array, "T n"]:
    """Samples in which a position is frozen although its joint moves."""
    frozen = np.zeros(run.position.shape, dtype=bool)
    for joint in range(len(run.joints)):
        q = run.position[:, joint]
        long = _long_holds(q, run.time)
        if not len(long):
            continue
        usual_step = float(np.percentile(np.abs(np.diff(q)), 99)) if len(q) > 2 else 0.0
        moves, usual_lag = np.ones(len(run), dtype=bool), 0.0
        for first, last in long:
            moves[first : last + 1] = False
        if run.position_command is not None and moves.any():
            # How far the joint stays behind its command in nearly all samples in which it does not stand.
            usual_lag = float(np.quantile(np.abs(run.position_command - run.position)[moves, joint], LIMIT.lag_share))
        others = np.delete(run.position, joint, axis=1)
        for first, last in long:
            stretch = slice(first, last + 1)
            jump = abs(q[last + 1] - q[last]) if last + 1 < len(q) else 0.0
            # While the whole arm stands, an encoder that stands is right: the arm starts again with a step.
            arm_stands = others.shape[1] > 0 and float(np.ptp(others[stretch], axis=0).max()) < LIMIT.hidden_travel
            jumps = jump > max(LIMIT.jump_steps * usual_step, LIMIT.jump_rad) and not arm_stands
            frozen[stretch, joint] = jumps or _hidden_travel(run, joint, stretch, usual_lag) > LIMIT.hidden_travel
    return frozen


def _hidden_travel(run: Recording, joint: int, stretch: slice, usual_lag: float) -> float:
    """How far the joint went by its velocity or command while its position stood still.

    A command is no measurement: one that the joint merely lags behind, as it does elsewhere, tells of no motion.
    """
    travel = 0.0
    if run.velocity is not None:
        steps = run.velocity[stretch, joint][1:] * np.diff(run.time[stretch])
        travel = float(np.ptp(np.concatenate([[0.0], np.cumsum(steps)])))
    if run.position_command is not None:
        command = run.position_command[stretch, joint]
        if float(np.abs(command - run.position[stretch, joint]).max()) > LIMIT.lag_times * usual_lag:
            travel = max(travel, float(np.ptp(command)))
    return travel


def stuck_efforts(run: Recording) -> Bool[Array, "T n"]:
    """Samples in which a torque is frozen, not at its extremes, although its joint moves."""
    frozen = np.zeros(run.effort.shape, dtype=bool)
    for joint, tau in enumerate(run.effort.T):
        for first, last in _long_holds(tau, run.time):
            stretch, whole = slice(first, last + 1), last - first + 1 > 0.9 * len(tau)
            extreme = tau[first] in (tau.min(), tau.max()) and not whole
            frozen[stretch, joint] = not extreme and np.ptp(run.position[stretch, joint]) > LIMIT.hidden_travel
    return frozen


def drop_stuck_velocity(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Velocities are not needed: where one is frozen, all are left out."""
    found = Findings(session)
    for run in session.runs:
        found.runs.append(run.replace(velocity=None))
        if run.velocity is None:
            continue
        for joint in range(len(run.joints)):
            for first, last in _long_holds(run.velocity[:, joint], run.time):
                travel = run.position[last, joint] - run.position[first, joint]
                claimed = run.velocity[first, joint] * (run.time[last] - run.time[first])
                if abs(travel - claimed) > max(LIMIT.hidden_travel, 0.5 * abs(travel)):
                    found.note(run, f"velocity of {run.joints[joint]} is frozen from {run.time[first]:.3f} s", [joint])
    return found.left(), found.issues("stuck_velocity")


def check_clipping(session: Session) -> list[TelemetryIssue]:
    """Finds torques that are cut off at a constant value while the joint moves."""
    found, clipped = Findings(session), 0
    for run in session.runs:
        if len(run) < LIMIT.stuck_samples:
            continue
        # At rest a torque may hold any value; only moving samples can show a flat top.
        moving = np.abs(np.gradient(run.position, run.time, axis=0)).max(axis=1) > LIMIT.hidden_travel
        for joint, sign in product(range(len(run.joints)), (1.0, -1.0)):
            count, level = flat_top(sign * run.effort[moving, joint])
            if count:
                clipped += count
                found.note(run, f"{run.joints[joint]} stays at {sign * level:.4g} N m for {count} samples", [joint])
    return found.issues("clipped", share=clipped / session.samples)


def flat_top(values: Float[Array, " T"]) -> tuple[int, float]:
    """Number of samples at a channel's cut-off maximum, and the maximum; zero if it is not cut off.

    A cut piles up at one value, up to rounding, what would lie above it: far more samples than in any slice just below.
    """
    if len(values) < LIMIT.top_samples or np.ptp(values) == 0.0:
        return 0, 0.0
    top, at = float(values.max()), values >= values.max() - ROUNDING * np.ptp(values)
    # A limit lies far out: a channel that only never changes its sign is not cut off at zero.
    if at.sum() < LIMIT.top_samples or top < LIMIT.top_level * np.abs(values).max() or is_coarse(values[:, None])[0]:
        return 0, top
    if max(int(last - first + 1) for first, last in holds(at.astype(float)) if at[first]) < LIMIT.top_stretch:
        return 0, top
    step = float(np.median(np.diff(np.unique(np.where(at, top, values)))))
    width = max(LIMIT.top_range * float(np.ptp(values)), 1.01 * step)
    below, _ = np.histogram(values[~at], bins=top - width * np.arange(LIMIT.top_slices, -1, -1))
    return (int(at.sum()), top) if at.sum() > LIMIT.top_pile * below.max() else (0, top)


def check_commands(session: Session) -> list[TelemetryIssue]:
    """Finds commands that are logged as measurements."""
    issues = []
    for measured in ("effort", "position"):
        command = f"{measured}_command"
        pairs = [run.channels() for run in session.runs if command in run.channels()]
        if not pairs:
            continue
        values = np.concatenate([pair[measured] for pair in pairs])
        commands = np.concatenate([pair[command] for pair in pairs])
        moving = np.abs(np.diff(commands, axis=0)) > 0.0
        same = (values == commands)[1:] & moving
        joints = np.flatnonzero((same.sum(axis=0) > LIMIT.command_share * moving.sum(axis=0)) & moving.any(axis=0))
        if len(joints):
            issues.append(issue_of(command, session, joints, int(joints[0]), measured=measured))
    return issues
