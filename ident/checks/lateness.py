"""Whether the torque is late, or early, by more than a diagnosis looks for.

Then channels have clocks of their own.

Of each run and joint, the torque moved by whole steps of the filtered states is held against
gravity, inertia, the rotor, friction and an offset. Evidence is the sum over runs and joints of the
logarithm by which what they leave shrinks against the best step that a diagnosis looks for; it must
exceed that of the number of steps over the chance of a false alarm.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float, least_squares
from ident.checks.effort import TRANSITION_RAD_S
from ident.checks.filtered_run import FilteredRun, filter_run
from ident.checks.report import issue_of
from ident.checks.settings import BETWEEN_RUNS, LATENESS
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel

FEWEST_STATES = 20  # of a run beside the steps, several a coefficient


def check_lateness(session: Session, arm: ArmModel) -> list[TelemetryIssue]:
    """Finds torques that are late, or early, by more than a diagnosis looks for.

    Returns:
        One issue with the delay, or none.
    """
    steps = np.arange(-LATENESS.steps, LATENESS.steps + 1)
    intervals = []
    costs = []
    for run in session.runs:
        motion = filter_run(run)
        if motion is not None and len(motion.q) > FEWEST_STATES + 2 * LATENESS.steps:
            intervals.append(motion.interval)
            costs.append(errors_of(motion, arm, steps))
    if not costs:
        return []
    cost = np.sum(costs, axis=0)
    delays = float(np.median(intervals)) * steps
    usual = np.abs(delays) <= LATENESS.longest_s
    best = int(np.argmin(cost))
    gain = float(cost[usual].min() - cost[best])
    if usual[best] or gain < np.log(len(steps) / BETWEEN_RUNS.chance):
        return []
    side = "later" if delays[best] > 0.0 else "earlier"
    share = float(1.0 - np.exp(-gain / len(costs) / arm.n))
    return [
        issue_of(
            "effort_late", session, (), delay=1000.0 * abs(delays[best]), side=side, share=share
        )
    ]


def errors_of(motion: FilteredRun, arm: ArmModel, steps: Float[Array, " s"]) -> Float[Array, " s"]:
    """Logarithms of a run's errors, summed over the joints, by how late its torque is taken to be.

    Args:
        motion: The run.
        arm: Whose model it is held against.
        steps: By how many states the torque is late.
    """
    margin = int(np.abs(steps).max())
    inside = slice(margin, len(motion.q) - margin)
    q = motion.q[inside]
    dq = motion.dq[inside]
    ddq = motion.ddq[inside]
    gravity = arm.gravity(q)
    inertial = arm.inverse_dynamics(q, dq, ddq) - gravity
    costs = np.zeros(len(steps))
    for joint in range(arm.n):
        speed = dq[:, joint]
        columns = [
            gravity[:, joint],
            inertial[:, joint],
            ddq[:, joint],
            np.tanh(speed / TRANSITION_RAD_S),
            speed,
        ]
        table = np.column_stack([*columns, np.ones(len(speed))])
        torques = [
            motion.tau[margin + step : len(motion.q) - margin + step, joint]
            for step in steps.tolist()
        ]
        moved = np.column_stack(torques)
        left = moved - table @ least_squares(table, moved)
        costs += 0.5 * np.log(np.mean(left**2, axis=0) + 1e-24)
    return costs
