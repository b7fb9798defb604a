"""How long a motion takes that its limits alone decide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.arrays import Array, Bool, Float
from plan.problem.problem import PlanningProblem
from plan.spline import Splines

# Local times of a section at which a motion is looked at.
LOOKS = np.linspace(0.0, 1.0, 25)
# How much longer a motion may last than its rates alone ask for.
LONGER = np.geomspace(1.0, 100.0, 60)
# Durations that differ by less than this factor are the same.
ALIKE = 1.001
# Factor by which a duration is longer than the shortest that was found to be allowed.
SPARE = 1.0005
# Digits of a duration that count: so that the same motion from two guesses is the same to the last
# bit.
DIGITS = 4
# Via points that hold a motion of each joint at its own limits.
HELD = 11


def at_its_limits(problem: PlanningProblem) -> PlanningProblem:
    """The problem with its initial path lasting just as long as its limits ask for.

    Speed goes with 1/T, acceleration with 1/T², jerk with 1/T³; torque, in which gravity and
    friction stay, is looked at for growing T. What breaks its torque limit at any T, as a motion
    through a pose that can't be held, lasts as long as the rates ask for.
    """
    shares = np.round(problem.durations / problem.durations.sum(), 12)
    points = problem.with_ends(problem.vias)
    unit = Splines(points[None], shares[None])
    states = unit.states(LOOKS)
    least = _least_by_rates(problem, unit, states)
    shortest = _least_by_torque(problem, states, least)
    total = float(f"{shortest * SPARE:.{DIGITS - 1}e}")
    return replace(problem, durations=shares * total)


def _least_by_rates(problem: PlanningProblem, unit: Splines, states: tuple[Array, ...]) -> float:
    """Duration that speed, acceleration and jerk ask for, of the joints and of the tool [s].

    Args:
        problem: The task.
        unit: The motion, lasting a second.
        states: Its positions, speeds and accelerations, each shape (1, T, n).
    """
    limits = problem.limits
    q, dq, ddq = states
    needs = [unit.top_speed[0] / limits.speed]
    if limits.acceleration is not None:
        top_acceleration = np.abs(ddq[0]).max(axis=0)
        needs.append(np.sqrt(top_acceleration / limits.acceleration))
    if limits.jerk is not None:
        needs.append(np.cbrt(unit.top_jerk[0] / limits.jerk))
    tool = 0.0
    if problem.rules is not None:
        for row in problem.rules.rows(q[0], dq[0]):
            if row.by_speed is not None:
                tool = max(tool, float(np.sqrt(row.value.max() / row.aim)))
    return max(tool, float(np.max(np.concatenate(needs))), 1e-3)


def _least_by_torque(problem: PlanningProblem, states: tuple[Array, ...], least: float) -> float:
    """Duration from which on the torque limits hold [s]; `least` where they hold at none.

    Args:
        problem: The task.
        states: Of the motion that lasts a second, see `_least_by_rates`.
        least: Duration that its rates ask for [s].
    """
    times = least * LONGER
    while times[-1] / times[0] > ALIKE:
        holds = _torque_holds(problem, states, times)
        if not holds[-1]:
            return least
        if holds.all():
            return float(times[0])
        first = len(holds) - int(np.argmin(holds[::-1]))
        times = np.geomspace(times[first - 1], times[first], len(LONGER))
    return float(times[-1])


def _torque_holds(
    problem: PlanningProblem, states: tuple[Array, ...], times: Float[Array, " k"]
) -> Bool[Array, " k"]:
    """Whether a motion keeps its torque limits, for each duration that it may have."""
    stretch = times[:, None, None]
    stretched = []
    for order, values in enumerate(states):
        repeated = np.repeat(values, len(times), axis=0)
        stretched.append(repeated / stretch**order)
    torque = problem.model.torque(*stretched)
    return np.asarray((np.abs(torque) <= problem.limits.torque).all(axis=(1, 2)))


def quickest_of_each_joint(problem: PlanningProblem) -> PlanningProblem | None:
    """The motion that is quickest by the limits of speed, acceleration and jerk alone.

    All joints arrive together. Exact for a task without obstacles whose torque limits leave the
    room.

    Returns:
        None where acceleration has no limit.

    Source: Berscheid and Kröger, Jerk-limited real-time trajectory generation with arbitrary target
    states, 2021.
    """
    limits = problem.limits
    if limits.acceleration is None:
        return None
    from ruckig import InputParameter, Result, Ruckig, Trajectory

    asked = InputParameter(problem.n)
    asked.current_position = problem.start.tolist()
    asked.target_position = problem.goal.tolist()
    asked.max_velocity = limits.speed.tolist()
    asked.max_acceleration = limits.acceleration.tolist()
    asked.max_jerk = [float("inf")] * problem.n
    if limits.jerk is not None:
        asked.max_jerk = limits.jerk.tolist()
    motion = Trajectory(problem.n)
    status = Ruckig(problem.n).calculate(asked, motion)
    if status not in (Result.Working, Result.Finished):
        return None
    times = motion.duration * np.arange(1, HELD + 1) / (HELD + 1)
    vias = np.array([motion.at_time(float(time))[0] for time in times])
    durations = np.full(HELD + 1, motion.duration / (HELD + 1))
    return replace(problem, vias=vias, durations=durations, label="each joint at its limits")
