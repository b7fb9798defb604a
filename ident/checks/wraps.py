"""Positions that step: wraps by a turn, which are taken out, and jumps, where runs are parted."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.checks.angles import TURN, farthest_motion, revolute, speed
from ident.checks.filtered_run import filter_run
from ident.checks.report import Findings
from ident.checks.settings import ANGLES as LIMIT
from ident.recordings.recording import Recording, Session, TelemetryIssue, cut_before
from ident.robot.arm import ArmModel


def mend_wraps(session: Session, arm: ArmModel | None) -> tuple[Session, list[TelemetryIssue]]:
    """Unwraps joints whose position jumps by a turn.

    Args:
        session: The recordings.
        arm: Their robot; if None, all joints count as turning.

    Returns:
        The session, and the issue; as it was, and none, where nothing jumps.
    """
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

    Args:
        session: The recordings.
        arm: Their robot; None where it is not known.

    Returns:
        The session of the pieces that are long enough, and the issue; as it was where there is no
        jump, no piece is left or there are too many.
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
