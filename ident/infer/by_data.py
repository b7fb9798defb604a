"""Columns without names: what their numbers say.

Time rises evenly. Velocity is the derivative of position. Torque or current follows what the robot's model needs for
that motion. Columns that belong together stand side by side, one a joint.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from ident.arrays import Array
from ident.checks.effort import States, check_effort, collect_states, fit_signed
from ident.checks.settings import USUAL_EFFORT
from ident.errors import RecordingError
from ident.infer.guess import ForeignTable, Reason, Signals
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel

# Steps of a clock differ from their median by less than this many medians, for nearly all samples.
EVEN, NEARLY_ALL = 3.0, 0.99
# Derivative and velocity are the same signal from this correlation on.
SAME_MOTION = 0.9
# Steps over which a derivative is taken: noise of encoders weighs less over several samples.
STRIDE = 5
# Position, its derivative, and what follows the model: without names fewer can't be made out.
FEWEST_CHANNELS = 3
# Two torques of which the model explains nearly the same share are the same one, commanded and measured.
AS_GOOD = 0.05
HINT = "name its columns in [columns] of session.toml yourself"
ONE_TABLE = "put them side by side in one table, or in one .npz as arrays time, position, velocity and effort"


def guess_by_data(table: ForeignTable, arm: ArmModel) -> Signals:
    """Finds time, position, velocity and torque among columns without names.

    Raises:
        RecordingError: No columns move as this robot's joints do.
    """
    names, values = list(table.columns), np.column_stack(list(table.columns.values()))
    clock = None
    for i in range(len(names)) if len(values) > 1 else ():
        steps = np.diff(values[:, i])
        usual = float(np.median(steps))
        if usual > 0.0 and np.mean((steps > 0.0) & (np.abs(steps - usual) < EVEN * usual)) > NEARLY_ALL:
            clock = i
            break
    time = np.arange(len(values), dtype=float) if clock is None else values[:, clock]
    start = 0 if clock is None else clock + 1
    count = (len(names) - start) // arm.n
    blocks = [np.arange(start + k * arm.n, start + (k + 1) * arm.n) for k in range(count)]
    if count < FEWEST_CHANNELS:
        least = FEWEST_CHANNELS * arm.n
        what = f"columns of numbers: {len(names)}; position, velocity and torque of {arm.n} joints are {least}"
        raise RecordingError(table.source, what, ONE_TABLE)
    pair = _find_motion(values, blocks, time)
    if pair is None:
        what = f"no {arm.n} columns are the derivative of {arm.n} others"
        raise RecordingError(table.source, what, HINT)
    position, velocity, match = pair
    reasons = [] if clock is None else [Reason("time", f"column {names[clock]}", "the first column that rises evenly")]
    seen = f"columns {_span(names, blocks[velocity])} are their derivative (correlation {match:.3f})"
    reasons.append(Reason("position", f"columns {_span(names, blocks[position])}", seen))
    rest = [k for k in range(count) if k not in (position, velocity)]
    torque, channel, why = _find_torque(values, blocks, rest, (position, velocity), time, arm)
    if torque is None:
        raise RecordingError(table.source, "no columns follow the torque that this robot needs", HINT)
    reasons.append(Reason(channel, f"columns {_span(names, blocks[torque])}", why))
    chosen = {"position": position, "velocity": velocity, channel: torque}
    return Signals(
        arm.joint_names,
        {name: tuple(names[i] for i in blocks[k]) for name, k in chosen.items()},
        {name: values[:, blocks[k]] for name, k in chosen.items()},
        None if clock is None else names[clock],
        time,
        tuple(reasons),
    )


def _find_motion(values: Array, blocks: list[Array], time: Array) -> tuple[int, int, float] | None:
    """Blocks of position and velocity; of several pairs the one with more noise, for commands have none."""
    found = []
    for p, v in permutations(range(len(blocks)), 2):
        q, dq = values[:, blocks[p]], values[:, blocks[v]]
        derived = (q[STRIDE:] - q[:-STRIDE]) / np.maximum(time[STRIDE:] - time[:-STRIDE], 1e-12)[:, None]
        middle = dq[STRIDE // 2 : len(dq) - STRIDE + STRIDE // 2]
        moving = derived.std(axis=0) > 1e-9 * max(float(np.abs(derived).max()), 1e-300)
        if moving.any():
            one, other = (values[:, moving] - values[:, moving].mean(axis=0) for values in (derived, middle))
            scale = np.maximum(one.std(axis=0) * other.std(axis=0), 1e-300)
            match = float(np.median((one * other).mean(axis=0) / scale))
            found.append((match, _noise(dq), p, v))
    good = [one for one in found if one[0] > SAME_MOTION]
    if not good:
        return None
    match, _, p, v = max(good, key=lambda one: one[1])
    return p, v, match


def _find_torque(
    values: Array, blocks: list[Array], rest: list[int], motion: tuple[int, int], time: Array, arm: ArmModel
) -> tuple[int | None, str, str]:
    """The block that follows the model's torque but is no model itself, its channel, and why."""
    position, velocity = (values[:, blocks[k]] for k in motion)
    found: list[tuple[float, float, int, str, str]] = []
    for k in rest:
        run = Recording("guess", arm.joint_names, time, position, values[:, blocks[k]], velocity=velocity)
        session = Session("guess", (run,))
        states = collect_states(session, arm)
        if states is None or not states.alive.any():
            continue
        explained, scale = follow(states)
        computed = any(issue.issue == "effort_is_model" for issue in check_effort(session, arm, states))
        if computed or explained <= USUAL_EFFORT.follows:
            continue
        channel = "effort" if USUAL_EFFORT.scale_low < scale < USUAL_EFFORT.scale_high else "current"
        why = f"the robot's gravity, inertia and friction explain {explained:.0%} of them, gravity at {scale:.2g} times"
        found.append((explained, _noise(values[:, blocks[k]]), k, channel, f"{why} its size"))
    best = max(found, default=None)
    if best is None:
        return None, "", ""
    # What is commanded follows the model as well as what is measured: only the measured one is noisy.
    alike = [one for one in found if one[0] > best[0] - AS_GOOD]
    _, _, k, channel, why = max(alike, key=lambda one: one[1])
    others = ", ".join(f"{blocks[one[2]][0] + 1} to {blocks[one[2]][-1] + 1}" for one in alike if one[2] != k)
    return k, channel, f"{why}; {others} as well, but smoother: a command" if others else why


def _noise(table: Array) -> float:
    """Second differences against the spread, the median over columns."""
    rough = np.abs(np.diff(table, 2, axis=0)).mean(axis=0)
    return float(np.median(rough / np.maximum(table.std(axis=0), 1e-300)))


def follow(states: States) -> tuple[float, float]:
    """How much of the torque the model explains, whatever its sign, and at what scale; medians over heavy joints."""
    joints = np.flatnonzero(states.heavy & states.alive)
    if not len(joints):
        joints = np.flatnonzero(states.alive)
    fits = [max((fit_signed(states, int(j), s) for s in (1.0, -1.0)), key=lambda fit: fit.explained) for j in joints]
    return float(np.median([fit.explained for fit in fits])), float(np.median([fit.gravity for fit in fits]))


def _span(names: list[str], block: Array) -> str:
    return f"{names[block[0]]} to {names[block[-1]]}"
