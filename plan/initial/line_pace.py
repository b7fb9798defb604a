"""A straight line of the tool: the arm's positions along it, and the quickest pace along these."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
# Most passes backwards and forwards: nearly always the second changes nothing.
PASSES = 8
# Squared paces that differ by less than this share are the same.
SAME_PACE = 1e-4
# Squared paces at which the limits are looked at, as shares of the largest: evenly in pace.
LEVELS = np.square(np.linspace(0.0, 1.0, 41))
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
    and acceleration q' u + q'' x; torque is linear in u. Where the path bends a joint may use all
    its acceleration at a steady pace, and x has a bound of its own. A pass backwards takes the
    largest x from which the next place's can still be reached, one forwards the largest that can be
    reached; each u is allowed at both places between which it lasts, so what the one takes away the
    other has to be told.

    Source: Pham and Pham, A new approach to time-optimal path parameterization based on
    reachability analysis, 2018.
    """
    path = _Path.of(q)
    top = (problem.limits.speed / np.maximum(np.abs(path.slope), 1e-9)).min(axis=1)
    if problem.way.speed is not None:
        top = np.minimum(top, problem.way.speed / max(rules.length, 1e-9))
    levels = np.square(top)[:, None] * LEVELS
    least, most = _pushes(problem, path, levels)
    allowed = _largest(levels, most - least)
    levels = allowed[:, None] * LEVELS
    least, most = _pushes(problem, path, levels)
    step = 2.0 / (len(q) - 1)
    slowest = step * LEAST_PUSH
    last = len(q) - 1
    x = levels[:, -1].copy()
    x[[0, last]] = 0.0
    for _ in range(PASSES):
        before = x.copy()
        for k in range(last - 1, 0, -1):
            there = x[k + 1] - step * np.interp(x[k + 1], levels[k + 1], least[k + 1])
            spare = x[k + 1] - levels[k] - step * least[k]
            here = _largest(levels[k : k + 1], spare[None])[0]
            x[k] = max(min(x[k], there, here), slowest)
        for k in range(1, last):
            there = x[k - 1] + step * np.interp(x[k - 1], levels[k - 1], most[k - 1])
            spare = x[k - 1] - levels[k] + step * most[k]
            here = _largest(levels[k : k + 1], spare[None])[0]
            x[k] = max(min(x[k], there, here), slowest)
        if np.all(before - x <= SAME_PACE * before):
            break
    return np.sqrt(x)


@dataclass(frozen=True, eq=False)
class _Path:
    """A path of equal steps, with its derivatives by its share."""

    q: Float[Array, "K n"]
    slope: Float[Array, "K n"]
    bend: Float[Array, "K n"]

    @classmethod
    def of(cls, q: Float[Array, "K n"]) -> _Path:
        """Of its positions."""
        step = 1.0 / (len(q) - 1)
        before = q[:-2]
        behind = q[2:]
        slope = np.gradient(q, step, axis=0, edge_order=2)
        inner = (before - 2.0 * q[1:-1] + behind) / step**2
        bend = np.concatenate([inner[:1], inner, inner[-1:]])
        return cls(q, slope, bend)


def _largest(x: Float[Array, "K L"], spare: Float[Array, "K L"]) -> Float[Array, " K"]:
    """The largest x up to which something is spare, between levels by the chord.

    What is spare is concave in x, so the chord never promises too much.

    Args:
        x: Levels, rising from nought.
        spare: What is spare at each; nought or less where nothing is.
    """
    short = spare < 0.0
    first = np.where(short.any(axis=1), np.argmax(short, axis=1), x.shape[1])
    above = np.clip(first, 1, x.shape[1] - 1)
    rows = np.arange(len(x))
    below = above - 1
    fall = spare[rows, below] - spare[rows, above]
    share = np.clip(spare[rows, below] / np.where(fall > 0.0, fall, 1.0), 0.0, 1.0)
    between = x[rows, below] + share * (x[rows, above] - x[rows, below])
    between = np.where(first == 0, 0.0, between)
    return np.asarray(np.where(first == x.shape[1], x[:, -1], between))


def _pushes(problem: PlanningProblem, path: _Path, x: Float[Array, "K L"]) -> Float[Array, "2 K L"]:
    """The least and the largest u that the limits allow at a path's places; see `quickest_pace`.

    The least is above the largest where no u is allowed.

    Args:
        problem: The task.
        path: Its places.
        x: Squared paces of each.
    """
    least = np.full(x.shape, -np.inf)
    most = np.full(x.shape, np.inf)
    q = np.broadcast_to(path.q[:, None], (*x.shape, problem.n))
    gain = path.slope[:, None]
    coasting = path.bend[:, None] * x[:, :, None]
    bounds = []
    if problem.limits.acceleration is not None:
        bounds.append((coasting, gain, problem.limits.acceleration))
    # At rest there is no friction yet that helps, and all of it as soon as the arm moves.
    for square in (x, np.maximum(x, x[:, 1:2])):
        speed = gain * np.sqrt(square)[:, :, None]
        coasting_torque = problem.model.torque(q, speed, coasting)
        pushing_torque = problem.model.torque(q, speed, coasting + gain)
        rise = pushing_torque - coasting_torque
        bounds.append((coasting_torque, rise, problem.limits.torque))
    for value, by_push, limit in bounds:
        size = np.maximum(np.abs(by_push), 1e-12)
        onwards = np.sign(by_push) * value
        most = np.minimum(most, ((limit - onwards) / size).min(axis=2))
        least = np.maximum(least, ((-limit - onwards) / size).max(axis=2))
    return np.stack([least, most])
