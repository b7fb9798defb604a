"""Where a search for the shortest time begins: at the limits, whatever duration the task guesses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plan.problem.problem import PlanningProblem
from plan.spline import Splines

# Local times of a section at which a motion is looked at, and how much longer than its rates alone ask for it may last.
LOOKS, SLOWER = np.linspace(0.0, 1.0, 25), np.geomspace(1.0, 100.0, 60)
# Digits of a duration that count: so that the same motion from two guesses is the same to the last bit.
DIGITS = 4
# Via points that hold a motion of each joint at its own limits.
HELD = 11


def at_its_limits(problem: PlanningProblem) -> PlanningProblem:
    """The same initial trajectory, lasting just as long as its limits of speed, acceleration, jerk and torque ask for.

    Speed goes with 1/T, acceleration with 1/T², jerk with 1/T³; torque, in which gravity and friction stay, is looked
    at for growing T. What breaks its torque limit at any T, as a motion through a pose that can't be held, lasts as
    long as the rates ask for.
    """
    shares = np.round(problem.durations / problem.durations.sum(), 12)
    points = np.concatenate([[problem.start], problem.vias, [problem.goal]])
    limits, unit = problem.limits, Splines(points[None], shares[None])
    needs = [unit.top_speed[0] / limits.speed]
    q, dq, ddq = unit.states(LOOKS)
    if limits.acceleration is not None:
        needs.append(np.sqrt(np.abs(ddq[0]).max(axis=0) / limits.acceleration))
    if limits.jerk is not None:
        needs.append(np.cbrt(unit.top_jerk[0] / limits.jerk))
    rows = [] if problem.rules is None else problem.rules.rows(q[0], dq[0])
    tool = max((float(np.sqrt(row.value.max() / row.aim)) for row in rows if row.by_speed is not None), default=0.0)
    least = max(tool, float(np.max(np.concatenate(needs))), 1e-3)
    times = least * SLOWER
    while times[-1] / times[0] > 1.001:
        stretch = times[:, None, None]
        states = (np.repeat(part, len(times), axis=0) for part in (q, dq, ddq))
        torque = problem.model.torque(*(part / stretch**order for order, part in enumerate(states)))
        kept = (np.abs(torque) <= limits.torque).all(axis=(1, 2))
        if not kept[-1]:
            times = np.array([least])
            break
        first = len(kept) - int(np.argmin(kept[::-1])) if not kept.all() else 0
        times = np.geomspace(times[max(first - 1, 0)], times[first], len(SLOWER)) if first else times[:1]
    total = float(f"{times[-1] * 1.0005:.{DIGITS - 1}e}")
    return replace(problem, durations=shares * total)


def quickest_of_each_joint(problem: PlanningProblem) -> PlanningProblem | None:
    """The motion that is quickest by the limits of speed, acceleration and jerk alone, all joints arriving together.

    Exact for a task without obstacles whose torque limits leave the room.

    Returns:
        None where acceleration has no limit.

    Source: Berscheid and Kröger, Jerk-limited real-time trajectory generation with arbitrary target states, 2021.
    """
    limits = problem.limits
    if limits.acceleration is None:
        return None
    from ruckig import InputParameter, Result, Ruckig, Trajectory

    asked, found = InputParameter(problem.n), Trajectory(problem.n)
    asked.current_position, asked.target_position = problem.start.tolist(), problem.goal.tolist()
    asked.max_velocity, asked.max_acceleration = limits.speed.tolist(), limits.acceleration.tolist()
    asked.max_jerk = [float("inf")] * problem.n if limits.jerk is None else limits.jerk.tolist()
    if Ruckig(problem.n).calculate(asked, found) not in (Result.Working, Result.Finished):
        return None
    times = found.duration * np.arange(1, HELD + 1) / (HELD + 1)
    vias = np.array([found.at_time(float(time))[0] for time in times])
    even = np.full(HELD + 1, found.duration / (HELD + 1))
    return replace(problem, vias=vias, durations=even, label="each joint at its limits")
