"""Time-optimal parameterisation of a given path by toppra: every time law on the path, not only splines' ones."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from toppra.algorithm import TOPPRA
from toppra.constraint import DiscretizationType, JointVelocityConstraint, SecondOrderConstraint
from toppra.interpolator import SplineInterpolator

from ident.arrays import Array, Float
from ident.model.loss import LossParameters
from plan.dynamics.power import ChainTorque
from plan.errors import MethodError
from plan.planners.base import Candidate, Ledger, Planner
from plan.problem.problem import SHARE, PlanningProblem
from plan.spline import Splines

logging.getLogger("toppra").setLevel(logging.ERROR)
GRID = 200
# Knots of the spline that carries the found motion.
KNOTS = 60
# The path is read at so many instants, and carried by so many knots over its length.
SAMPLES, PATH_KNOTS = 4000, 60


@dataclass(frozen=True)
class Toppra(Planner):
    """toppra on the path of every initial trajectory, iterated until its model is the whole model.

    toppra takes a torque that is linear in the path's acceleration and squared speed. Viscous friction, the sign of
    friction and the net are not of that form: they enter as torques along the path, taken from the motion of the round
    before. The time it gives is a bound for that path under that model; the returned motion is a spline through it,
    stretched until all limits hold.

    Attributes:
        rounds: Most rounds.
        tolerance: Change of the duration at which the rounds end, as a share.
    """

    rounds: int = 12
    tolerance: float = 1e-3
    name: ClassVar[str] = "toppra"

    def search(self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator) -> None:
        """Times every initial path; uses no randomness.

        Raises:
            MethodError: The task asks for energy, or the model is not a compiled one.
        """
        for problem in problems:
            if problem.objective != "time" or not isinstance(problem.model, ChainTorque):
                raise MethodError("--method toppra", "it finds the time of a path only", "use --objective time")
            model = problem.model
            linear = replace(LossParameters.zero(model.n), motor_inertia=model.losses.motor_inertia)
            motion = self._iterate(problem, ChainTorque(model.chain, linear), ledger)
            if motion is None:
                ledger.notes.append(f"toppra ({problem.label}): no time law keeps the limits on this path")
                continue
            times, points = motion
            ledger.notes.append(f"toppra ({problem.label}): {times[-1]:.4f} s, a bound for its model on this path")
            _stretch(problem, times, points, ledger)

    def _iterate(self, problem: PlanningProblem, linear: ChainTorque, ledger: Ledger) -> tuple[Array, Array] | None:
        """Times and positions of the motion; `linear` is as much of the model as is of toppra's form."""
        path = _path(problem)
        grid = np.linspace(0.0, path.duration, GRID + 1)
        rest, last, motion = np.zeros((GRID + 1, problem.n)), np.inf, None
        for turn in range(self.rounds):
            speed, push = _solve(problem, linear, path, grid, rest)
            if speed is None:
                return motion
            ledger.count(1)
            q, q1, q2 = path(grid), path(grid, 1), path(grid, 2)
            dq, ddq = q1 * speed[:, None], q1 * push[:, None] + q2 * speed[:, None] ** 2
            states = q[None], dq[None], ddq[None]
            new = (problem.model.torque(*states) - linear.torque(*states))[0]
            rest = new if turn == 0 else 0.5 * (rest + new)
            motion = _sample(path, grid, speed)
            if abs(motion[0][-1] - last) < self.tolerance * last:
                break
            last = motion[0][-1]
        return motion


def _path(problem: PlanningProblem) -> SplineInterpolator:
    """The initial trajectory as a path over its length in joint space.

    Its own time is no good parameter: it starts and ends at rest, and where the path's derivative vanishes toppra can't
    tell what pushes the arm.
    """
    splines = problem.decode(problem.initial)
    q = splines.at(np.linspace(0.0, float(splines.total[0]), SAMPLES))[0]
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])
    even = np.linspace(0.0, length[-1], PATH_KNOTS)
    return SplineInterpolator(even, np.stack([np.interp(even, length, column) for column in q.T], axis=1))


def _solve(
    problem: PlanningProblem, linear: ChainTorque, path: SplineInterpolator, grid: Array, rest: Array
) -> tuple[Array | None, Array]:
    """Speed and acceleration of the path's parameter on the grid, with given torques beyond toppra's model."""
    limit = SHARE * problem.limits.torque
    eye = np.vstack([np.eye(problem.n), -np.eye(problem.n)])

    def beyond(_: Any, s: float) -> Array:
        return np.array([np.interp(s, grid, rest[:, j]) for j in range(problem.n)])

    torque = SecondOrderConstraint(
        linear.torque,
        lambda _: eye,
        lambda _: np.concatenate([limit, limit]),
        problem.n,
        custom_term=beyond,
        discretization_scheme=DiscretizationType.Interpolation,
    )
    speed = SHARE * problem.limits.speed
    instance = TOPPRA(
        [JointVelocityConstraint(np.stack([-speed, speed], axis=1)), torque],
        path,
        gridpoints=grid,
        solver_wrapper="seidel",
    )
    push, pace, _ = instance.compute_parameterization(0.0, 0.0)
    if pace is None or not np.isfinite(pace).all():
        return None, grid
    return np.asarray(pace), np.append(push, push[-1])


def _sample(path: SplineInterpolator, grid: Float[Array, " G"], speed: Float[Array, " G"]) -> tuple[Array, Array]:
    """The motion as KNOTS positions at equal steps of time."""
    steps = 2.0 * np.diff(grid) / np.maximum(speed[1:] + speed[:-1], 1e-9)
    clock = np.concatenate([[0.0], np.cumsum(steps)])
    times = np.linspace(0.0, clock[-1], KNOTS)
    cell = np.clip(np.searchsorted(clock, times, side="right") - 1, 0, len(steps) - 1)
    # Between grid points the squared speed is linear in s, so the path's acceleration is constant.
    push = np.diff(speed**2) / (2.0 * np.diff(grid))
    since = times - clock[cell]
    return times, path(np.clip(grid[cell] + speed[cell] * since + 0.5 * push[cell] * since**2, 0.0, path.duration))


def _stretch(problem: PlanningProblem, times: Array, points: Array, ledger: Ledger) -> None:
    """Slows the spline through the motion down until every limit holds, and enters it."""
    found = Splines(points[None], np.diff(times)[None])
    carrier = problem.with_initial(found, free="times", label=f"{problem.label}, retimed")

    def slowed(factor: float) -> Candidate:
        x = carrier.encode(carrier.vias, carrier.durations * factor)
        trial = carrier.evaluate(x[None])
        return Candidate(carrier, x, float(trial.cost[0]), float(trial.violation[0]))

    low, high = 1.0, 1.0
    for _ in range(40):
        ledger.count(1)
        if slowed(high).feasible:
            break
        low, high = high, high * 1.02
    for _ in range(12):
        if high - low < 1e-4:
            break
        middle = 0.5 * (low + high)
        ledger.count(1)
        low, high = (low, middle) if slowed(middle).feasible else (middle, high)
    ledger.offer(slowed(high))
