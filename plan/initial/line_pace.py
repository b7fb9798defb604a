"""A straight line of the tool: the arm's positions along it, and the quickest pace along these."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from ident.arrays import Array, Float
from plan.initial.inverse_kinematics import PoseSolver
from plan.problem.problem import PlanningProblem
from plan.problem.rule_values import TURNING, Rules
from plan.problem.rules import Pose

# Via points along a straight line of the tool.
ALONG = 12
# Steps of a line whose time law is looked for.
FINE_LINE = 240
# Least push that is taken where no limit leaves one [1/s²].
LEAST_PUSH = 1e-3
# Sections of the motion that begins with that law, and the share of them that stands where its pace
# changes.
TIMED = 24
RAMPS = 0.7


def positions_along(
    problem: PlanningProblem, rules: Rules, count: int = ALONG
) -> Float[Array, "V n"]:
    """Positions along the tool's straight line, drawn to the goal's own.

    Each is found from the one before.

    Args:
        problem: Its start and goal are the line's ends.
        rules: The tool's, with its place and axes at these.
        count: How many positions V between the ends.

    Returns:
        Joint positions [rad], without those of start and goal.
    """
    first_place, first_axes = rules.first
    last_place, last_axes = rules.last
    turn = pin.log3(first_axes.T @ last_axes)
    solver = PoseSolver(problem.scene.arm, rules.frame)
    shares = [float(share) for share in np.arange(1, count + 2) / (count + 1)]

    def position_at(share: float, guess: Array) -> Array:
        """The arm's position with the tool at a share of the line."""
        rotation = None
        if problem.n >= TURNING:
            rotation = first_axes @ pin.exp3(share * turn)
        place = first_place + share * (last_place - first_place)
        position, _ = solver.descend(Pose(None, place, rotation), guess)
        return position

    positions = [problem.start]
    for share in shares:
        positions.append(position_at(share, positions[-1]))
    rest = problem.goal - positions[-1]
    drawn = []
    for share, position in zip(shares, positions[1:], strict=True):
        drawn.append(position_at(share, position + share * rest))
    return np.clip(np.array(drawn[:-1]), problem.limits.lower, problem.limits.upper)


def timed_line(problem: PlanningProblem, rules: Rules) -> PlanningProblem:
    """The task from its tool's line, passed as quickly as speed, acceleration and torque let it.

    Most of the knots stand where the tool gets going or comes to rest, evenly by how much its speed
    changes there, the others evenly in time: a ramp takes a hundredth of the time, and a grid of
    equal sections holds none that is short.
    """
    fine = problem.with_ends(positions_along(problem, rules, FINE_LINE - 1))
    pace = quickest_pace(problem, fine, rules)
    steps = 2.0 / (pace[1:] + pace[:-1]) / FINE_LINE
    times = np.concatenate([[0.0], np.cumsum(steps)])
    change = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(pace)))])
    by_time = (1.0 - RAMPS) * times / times[-1]
    by_change = RAMPS * change / max(change[-1], 1e-12)
    progress = by_time + by_change
    knots = np.interp(np.arange(1, TIMED) / TIMED, progress, times)
    even = np.linspace(0.0, 1.0, FINE_LINE + 1)
    shares = CubicHermiteSpline(times, even, pace)(knots)
    vias = CubicSpline(even, fine)(shares)
    stamps = np.concatenate([[0.0], knots, times[-1:]])
    return replace(problem, vias=vias, durations=np.diff(stamps), label="straight line of the tool")


def quickest_pace(
    problem: PlanningProblem, q: Float[Array, "K n"], rules: Rules
) -> Float[Array, " K"]:
    """Pace along a path of equal steps, from rest to rest within all limits [1/s].

    It is the path's share a second. Along a path q(s), x = (ds/dt)² and u = d²s/dt², speed is q' √x
    and acceleration q' u + q'' x; torque is linear in u. A pass backwards and one forwards take the
    least and the largest u that all limits allow.

    Source: Bobrow, Dubowsky and Gibson, Time-optimal control of robotic manipulators along
    specified paths, 1985.
    """
    step = 1.0 / (len(q) - 1)
    slope = np.gradient(q, step, axis=0, edge_order=2)
    top = (problem.limits.speed / np.maximum(np.abs(slope), 1e-9)).min(axis=1)
    if problem.way.speed is not None:
        top = np.minimum(top, problem.way.speed / max(rules.length, 1e-9))
    push = _push_along(problem, q, slope, step)
    x = np.square(top)
    x[[0, -1]] = 0.0
    for k in range(len(q) - 2, -1, -1):
        x[k] = min(x[k], x[k + 1] + 2.0 * step * push(k + 1, x[k + 1], -1.0))
    for k in range(len(q) - 1):
        x[k + 1] = min(x[k + 1], x[k] + 2.0 * step * push(k, x[k], 1.0))
    return np.sqrt(x)


def _push_along(
    problem: PlanningProblem, q: Float[Array, "K n"], slope: Float[Array, "K n"], step: float
) -> Callable[[int, float, float], float]:
    """The largest u that the limits allow at a place of a path; see `quickest_pace`.

    Args:
        problem: The task.
        q: Positions along the path.
        slope: Their derivative q' by the path's share.
        step: Share from one position to the next.
    """
    bend = np.gradient(slope, step, axis=0, edge_order=2)
    limits = problem.limits
    most = np.full(problem.n, np.inf)
    if limits.acceleration is not None:
        most = limits.acceleration

    def push(k: int, x: float, sign: float) -> float:
        """Largest u times its sign at a place; at least a little, so that the pass goes on."""
        speed = slope[k] * np.sqrt(max(x, 1e-12))
        coasting = bend[k] * x
        spare = most - np.sign(sign * slope[k]) * coasting
        by_acceleration = spare / np.maximum(np.abs(slope[k]), 1e-9)
        pushing = coasting + sign * slope[k]
        positions = np.stack([q[k], q[k]])
        speeds = np.stack([speed, speed])
        accelerations = np.stack([coasting, pushing])
        torques = problem.model.torque(positions[None], speeds[None], accelerations[None])[0]
        coasting_torque, pushing_torque = torques
        rise = pushing_torque - coasting_torque
        spare = limits.torque - np.sign(rise) * coasting_torque
        by_torque = spare / np.maximum(np.abs(rise), 1e-9)
        return max(float(min(by_acceleration.min(), by_torque.min())), LEAST_PUSH)

    return push
