"""Positions: degrees for radians, wraps at half a turn, single wild samples, jumps."""

from __future__ import annotations

import math

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.checks.effort import explained_by_model
from ident.checks.filtered_run import compare_velocities, filter_run
from ident.checks.report import Findings, joints_at
from ident.recordings.recording import Recording, Session, TelemetryIssue, cut_before
from ident.robot.arm import ArmModel

TURN = 2.0 * math.pi
# No arm turns faster: the fastest small industrial ones reach 8 rad/s at the wrist.
FASTEST_RAD_S = 12.0
# Beyond two turns from zero no joint with a cable goes.
FARTHEST_RAD = 2.0 * TURN
# The model is asked only where it explains the torque in one of both units.
MODEL_TELLS = 0.5
# After a wrap is taken out, what is left of the step is motion within one sample.
WRAP_REST = 0.5
# A sample that leaves its neighbours this far and comes back at once is no motion at any rate of sampling [rad].
SPIKE_RAD = 0.2
SPIKE_NOISES = 30.0
# A run whose positions jump farther than any arm moves in a larger share of its samples is no recording of an arm.
MOST_JUMPS = 0.01


def revolute(session: Session, arm: ArmModel | None) -> Bool[Array, " n"]:
    """Which joints turn; all where the robot is not known."""
    return np.ones(len(session.joints), dtype=bool) if arm is None else ~arm.sliding_joints


def mend_degrees(session: Session, arm: ArmModel | None) -> tuple[Session, list[TelemetryIssue]]:
    """Finds angles in degrees. The session is converted for the checks that follow; a fit is refused.

    Told by motion that no arm can make; where the robot is known, by how much better its torques explain the
    measured ones when the numbers are read as degrees.
    """
    turning = revolute(session, arm)
    far = np.max([np.abs(run.position).max(axis=0) for run in session.runs], axis=0)
    fast = np.max([_speed(run) for run in session.runs], axis=0)
    suspects = turning & ((far > FARTHEST_RAD) | (fast > FASTEST_RAD_S))
    if not suspects.any():
        return session, []
    found = compare_velocities(session)
    # Whether the velocities are in the positions' unit.
    alike = found is None or not found.moving.any() or float(np.median(found.slope[found.moving])) > 0.1
    converted = scale_angles(session, math.radians(1.0), turning, alike)
    as_radians, as_degrees = (0.0, 0.0) if arm is None else [explained_by_model(s, arm) for s in (session, converted)]
    tells = max(as_degrees, as_radians) > MODEL_TELLS
    if tells and as_degrees > as_radians + 0.1:
        reason = f"the robot's model explains {as_degrees:.0%} of the torque in degrees, {as_radians:.0%} in radians"
    elif tells or fast.max() < FASTEST_RAD_S:
        return session, []
    else:
        reason = "no arm moves so fast in radians"
    joint = int(np.argmax(np.where(suspects, far, -1.0)))
    evidence = f"{session.name}: {session.joints[joint]} goes to {far[joint]:.1f} at {fast[joint]:.1f} /s; {reason}"
    remedy = 'write angle_unit = "deg" in session.toml'
    issue = TelemetryIssue("units_degrees", joints_at(session, np.flatnonzero(turning)), "fatal", evidence, remedy)
    return converted, [issue]


def _speed(run: Recording) -> Float[Array, " n"]:
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
    scale = np.where(columns, factor, 1.0)
    names: tuple[str, ...] = ("position", "position_command")
    if derivatives:
        names += ("velocity", "acceleration", "velocity_command")
    return session.replace(
        runs=[run.replace(**{k: v * scale for k, v in run.channels().items() if k in names}) for run in session.runs]
    )


def mend_spikes(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Drops rows in which a position leaves its neighbours for one sample."""
    found = Findings(session)
    for run in session.runs:
        wild = find_spikes(run.position)
        rows: Bool[Array, " T"] = np.asarray(wild.any(axis=1))
        # Many such rows are no hiccup but a channel that can't be trusted; the velocity check will tell.
        if rows.any() and rows.mean() <= 0.01:
            first = run.time[int(np.flatnonzero(rows)[0])]
            what = f"position leaves its neighbours for one sample {rows.sum()} times, first at {first:.3f} s"
            found.note(run, what, np.flatnonzero(wild.any(axis=0)))
            run = run.at(~rows)
        found.runs.append(run)
    ending = "; these rows are dropped"
    return found.left(), found.issues("garbage_cells", "note", ending, "none needed; look at the logger")


def find_spikes(q: Float[Array, "T n"]) -> Bool[Array, "T n"]:
    """Samples far from both neighbours while these are close to each other; wraps are none."""
    wild = np.zeros(q.shape, dtype=bool)
    if len(q) < 5:
        return wild
    off = q[1:-1] - 0.5 * (q[:-2] + q[2:])
    noise = np.median(np.abs(off), axis=0)
    beyond = np.abs(off) > np.maximum(SPIKE_RAD, SPIKE_NOISES * noise)
    returns = np.abs(q[2:] - q[:-2]) < 0.2 * np.abs(off)
    turns = np.abs(np.abs(off) - TURN) < WRAP_REST
    wild[1:-1] = beyond & returns & ~turns
    return wild


def mend_wraps(session: Session, arm: ArmModel | None) -> tuple[Session, list[TelemetryIssue]]:
    """Unwraps joints whose position jumps by a turn."""
    turning, found = revolute(session, arm), Findings(session)
    for run in session.runs:
        unwrapped, wraps = unwrap(run.position, turning)
        if wraps.any():
            columns = np.flatnonzero(wraps)
            changes = {"position": _within_limits(unwrapped, arm)}
            if run.position_command is not None:
                command, _ = unwrap(run.position_command, turning)
                # The command follows the position: it starts in the same turn.
                changes["position_command"] = command + TURN * np.round((changes["position"][0] - command[0]) / TURN)
            found.note(run, f"{run.joints[columns[0]]} jumps by a turn {wraps[columns[0]]} times", columns)
            run = run.replace(**changes)
        found.runs.append(run)
    return found.left(), found.issues("position_wraps", "note", "; unwrapped", "none needed")


def unwrap(q: Float[Array, "T n"], turning: Bool[Array, " n"]) -> tuple[Float[Array, "T n"], Array]:
    """Takes out steps of one turn; returns the positions and the number of steps a joint."""
    steps = np.diff(q, axis=0)
    turns = np.round(steps / TURN)
    wraps = (np.abs(turns) == 1.0) & (np.abs(steps - TURN * turns) < WRAP_REST) & turning
    shift = np.zeros(q.shape)
    shift[1:] = -TURN * np.cumsum(np.where(wraps, turns, 0.0), axis=0)
    return q + shift, wraps.sum(axis=0)


def _within_limits(q: Float[Array, "T n"], arm: ArmModel | None) -> Float[Array, "T n"]:
    """Moves whole runs by turns where only so they lie within the joint's limits."""
    if arm is None:
        return q
    low, high = q.min(axis=0), q.max(axis=0)
    for turns in (-1.0, 1.0):
        outside = (low < arm.lower) | (high > arm.upper)
        fits = (low + TURN * turns >= arm.lower) & (high + TURN * turns <= arm.upper)
        q = q + TURN * turns * (outside & fits)
        low, high = q.min(axis=0), q.max(axis=0)
    return q


def split_at_jumps(session: Session) -> tuple[Session, list[TelemetryIssue]]:
    """Parts runs where a position jumps farther than any arm moves: samples are missing, whatever the stamps say.

    A few jumps part a run; many make its positions none.
    """
    parted, broken = Findings(session), Findings(session)
    for run in session.runs:
        steps = np.abs(np.diff(run.position, axis=0))
        jumps = (steps > FASTEST_RAD_S * np.maximum(np.diff(run.time), 0.0)[:, None]) & (steps > SPIKE_RAD)
        rows, columns = np.flatnonzero(jumps.any(axis=1)), np.flatnonzero(jumps.any(axis=0))
        if not len(rows):
            parted.runs.append(run)
            continue
        column = int(np.argmax(steps[rows[0]]))
        words = f"{run.joints[column]} jumps by {steps[rows[0], column]:.2f} rad at {run.time[rows[0]]:.3f} s"
        if len(rows) > max(MOST_JUMPS * len(run), 1):
            broken.note(run, f"{words} and {len(rows) - 1} times more, farther than any arm moves", columns)
            parted.runs.append(run)
        else:
            parted.note(run, words, columns)
            parted.runs += [piece for piece in cut_before(run, rows + 1) if filter_run(piece) is not None]
    broken.columns |= parted.columns
    remedy = "repair the channel and record again, or leave the run out"
    lost = "look for lost samples, or for an encoder that was set anew during the run"
    issues = broken.issues("garbage_cells", "fatal", "", remedy)
    return (parted.left() if parted.runs else session), issues or parted.issues(
        "time_gap", "warning", "; parted there", lost
    )
