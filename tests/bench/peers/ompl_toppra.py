"""A peer to compare with: OMPL's RRTConnect for the path, TOPP-RA for its time. OMPL is installed by who wants it."""

import importlib
import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from ident.arrays import Array, Float
from plan.geometry.clearance_proof import find_margins
from plan.initial.trees import Trees
from plan.initial.vias import from_vias
from plan.paper.toppra import Toppra
from plan.planners.base import Ledger, Planner
from plan.problem.problem import PlanningProblem
from plan.spline import Splines

# OMPL's log level above which nothing is said: standard output is the plan's.
QUIET = "LOG_ERROR"
# A path is pruned, and then bent a little by its spline: the tree keeps this much more than the margin [m].
SPARE = 0.005


def is_installed() -> bool:
    """Whether OMPL's Python wheel is there."""
    return importlib.util.find_spec("ompl") is not None


@dataclass(frozen=True)
class OmplToppra(Planner):
    """RRTConnect in joint space, corners cut, timed under the full model; for energy, drawn out to the task's duration.

    OMPL draws by its own clock-seeded generator unless it is told a seed before its first use in a process: two runs of
    one seed may differ.
    """

    seconds: float = 5.0  # longest search for a path [s]
    resolution: float = 0.04  # distance at which edges are checked [rad]
    reach: float = 0.35  # longest edge of the trees [rad]
    name: ClassVar[str] = "ompl"
    explores: ClassVar[bool] = True

    def search(self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator) -> None:
        """Finds one path and times it."""
        task = problems[0]
        path = self.find_path(task, rng)
        ledger.count(1)
        if path is None:
            ledger.notes.append("ompl: no path was found")
            ledger.evaluate(task, task.initial[None])
            return
        timed = from_vias(replace(task, objective="time", free="times"), path[1:-1], "ompl", 2)
        own = Ledger(ledger.most, max(ledger.most_seconds - ledger.cpu_seconds, 0.0))
        Toppra().search([timed], own, rng)
        ledger.count(own.evaluations)
        ledger.notes.extend(own.notes)
        if own.best is None:
            ledger.evaluate(timed, timed.initial[None])
        elif task.objective == "time":
            ledger.offer(own.best)
        else:
            motion = own.best.splines
            longer = float(task.durations.sum() / motion.total[0])
            carrier = task.with_initial(Splines(motion.points, motion.durations * longer), free="vias", label="ompl")
            ledger.evaluate(carrier, carrier.initial[None])

    def find_path(self, task: PlanningProblem, rng: np.random.Generator) -> Float[Array, "k n"] | None:
        """Positions of OMPL's path, corners cut; None where it finds none in time."""
        base, geometric = importlib.import_module("ompl.base"), importlib.import_module("ompl.geometric")
        util = importlib.import_module("ompl.util")
        util.setLogLevel(getattr(util, QUIET, None) or util.LogLevel.LOG_ERROR)
        ends = task.ends
        low = np.maximum(task.limits.lower, ends.min(axis=0) - np.pi)
        high = np.minimum(task.limits.upper, ends.max(axis=0) + np.pi)
        space, bounds = base.RealVectorStateSpace(task.n), base.RealVectorBounds(task.n)
        for j in range(task.n):
            bounds.setLow(j, float(low[j]))
            bounds.setHigh(j, float(high[j]))
        space.setBounds(bounds)
        setup = geometric.SimpleSetup(space)
        free = find_margins(task.scene, ends, task.limits.clearance + SPARE)

        def is_free(state: Any) -> bool:
            at = np.array([[state[j] for j in range(task.n)]])
            return bool(task.scene.separation(at, free)[0] > 0.0)

        setup.setStateValidityChecker(is_free)
        setup.getSpaceInformation().setStateValidityCheckingResolution(self.resolution / space.getMaximumExtent())
        states = []
        for end in ends:
            state = space.allocState()
            for j in range(task.n):
                state[j] = float(end[j])
            states.append(state)
        setup.setStartAndGoalStates(*states)
        planner = geometric.RRTConnect(setup.getSpaceInformation())
        planner.setRange(self.reach)
        setup.setPlanner(planner)
        setup.solve(self.seconds)
        if not setup.haveExactSolutionPath():
            return None
        found = [[state[j] for j in range(task.n)] for state in setup.getSolutionPath().getStates()]
        found[0], found[-1] = list(task.start), list(task.goal)
        return replace(Trees.of(task, np.random.default_rng(0)), margins=free).prune(np.array(found))
