"""Time-optimal parameterisation of a given path by toppra.

Every time law on the path, not only splines' ones.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from toppra.algorithm import TOPPRA
from toppra.constraint import DiscretizationType, JointVelocityConstraint, SecondOrderConstraint
from toppra.interpolator import SplineInterpolator
from toppra.parametrizer import ParametrizeConstAccel

from ident.arrays import Array
from ident.model.loss import LossParameters
from plan.dynamics.power import ChainTorque
from plan.planners.base import Ledger, Planner
from plan.planners.evolution import shortest
from plan.problem.problem import SHARE, PlanningProblem
from plan.spline import Splines

logging.getLogger("toppra").setLevel(logging.ERROR)
GRID = 200
# Most rounds, and the change of the duration at which they end, as a share.
ROUNDS = 12
TOLERANCE = 1e-3
# Knots of the spline that carries the found motion.
KNOTS = 60
# The path is read at so many instants, and carried by so many knots over its length.
SAMPLES = 4000
PATH_KNOTS = 60
# Most by which the spline through the motion is slowed down.
SLOWEST = 2.0


@dataclass(frozen=True)
class Toppra(Planner):
    """toppra on the path of every initial trajectory, iterated until its model is the whole model.

    toppra takes a torque that is linear in the path's acceleration and squared speed. Viscous
    friction, the sign of friction and the net are not of that form: they enter as torques along the
    path, taken from the motion of the round before. The time it gives is a bound for that path
    under that model; the returned motion is a spline through it, stretched until all limits hold.
    """

    name: ClassVar[str] = "toppra"

    def search(
        self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator
    ) -> None:
        """Times every initial path; uses no randomness."""
        for problem in problems:
            model = problem.model
            linear = replace(LossParameters.zero(model.n), motor_inertia=model.losses.motor_inertia)
            motion = self._iterate(problem, ChainTorque(model.chain, linear), ledger)
            if motion is None:
                ledger.notes.append(
                    f"toppra ({problem.label}): no time law keeps the limits on this path"
                )
                continue
            bound = f"{motion.duration:.4f} s, a bound for its model on this path"
            ledger.notes.append(f"toppra ({problem.label}): {bound}")
            # The spline through the motion is slowed down until every limit holds.
            times = np.linspace(0.0, motion.duration, KNOTS)
            slowed = Splines(motion(times)[None], SLOWEST * np.diff(times)[None])
            carrier = problem.with_initial(slowed, free="times", label=f"{problem.label}, retimed")
            shortest(
                carrier,
                ledger,
                np.array(carrier.durations),
                np.arange(len(carrier.durations)),
                1.0 / SLOWEST,
            )

    def _iterate(
        self, problem: PlanningProblem, linear: ChainTorque, ledger: Ledger
    ) -> ParametrizeConstAccel | None:
        """The motion; `linear` is as much of the model as is of toppra's form."""
        # The initial trajectory over its length in joint space. Its own time is no good parameter:
        # it is at rest at its ends, and where the path's derivative vanishes toppra can't tell what
        # pushes the arm.
        splines = problem.decode(problem.initial)
        q = splines.at(np.linspace(0.0, float(splines.total[0]), SAMPLES))[0]
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])
        even = np.linspace(0.0, length[-1], PATH_KNOTS)
        path = SplineInterpolator(
            even, np.stack([np.interp(even, length, column) for column in q.T], axis=1)
        )
        grid = np.linspace(0.0, path.duration, GRID + 1)
        rest = np.zeros((GRID + 1, problem.n))
        last = np.inf
        motion = None
        for turn in range(ROUNDS):
            speed, push = self._solve(problem, linear, path, grid, rest)
            if speed is None:
                return motion
            ledger.count(1)
            q = path(grid)
            q1 = path(grid, 1)
            q2 = path(grid, 2)
            dq = q1 * speed[:, None]
            ddq = q1 * push[:, None] + q2 * speed[:, None] ** 2
            states = q[None], dq[None], ddq[None]
            new = (problem.model.torque(*states) - linear.torque(*states))[0]
            rest = new if turn == 0 else 0.5 * (rest + new)
            motion = ParametrizeConstAccel(path, grid, speed)
            if abs(motion.duration - last) < TOLERANCE * last:
                break
            last = motion.duration
        return motion

    def _solve(
        self,
        problem: PlanningProblem,
        linear: ChainTorque,
        path: SplineInterpolator,
        grid: Array,
        rest: Array,
    ) -> tuple[Array | None, Array]:
        """Speed and acceleration of the path's parameter on the grid, with given torques beyond
        toppra's model.
        """
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
