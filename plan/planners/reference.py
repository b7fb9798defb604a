"""The gradient reference: exact derivatives of model, spline and clearance by CasADi, solved by IPOPT."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ident.arrays import Array, Float
from plan.dynamics.power import ChainTorque
from plan.errors import MethodError
from plan.planners.base import Ledger, Planner
from plan.planners.evolution import Evolution
from plan.planners.planes import count_near, make_slots
from plan.planners.reference_graph import SLOTS, Transcription, build
from plan.planners.sequential import require_soft_vias
from plan.problem.problem import SHARE, SQUEEZE, TICK, TOLERANCE, BatchEvaluation, PlanningProblem
from plan.spline import Splines

# Initial trajectories that break more than this are not solved from as they are.
WORTH_TRYING = 0.5
# A step shorter than this is not worth another solve [rad].
SHORTEST_REACH = 0.005
# Share of acceleration and jerk limits that is aimed at, for the solver's own tolerance; of a tick's at the ends.
AIM, END_AIM = 0.9999, 0.5


@dataclass(frozen=True)
class Reference(Planner):
    """IPOPT, from the initial trajectory or from the best of a short CMA-ES run over all of them.

    The sign of the speed and the modulus of power are rounded, first widely, so that no joint is kept from turning
    back, and then finely; the result is evaluated with the exact ones. Limits enter the programme only where the
    optimum without them breaks one. Clearance is kept by separating planes that are chosen anew after each solve.

    Attributes:
        widths: Rounding of sign [rad/s] and power [W], solve by solve.
        rounds, rough: Most times that the planes and limits are set anew, from the screening's best and from others.
        screening: Evaluations of the CMA-ES run that chooses the starts, for each of them; a lone initial
            trajectory without obstacles is taken as it is. Time has many local optima: there
            CMA-ES runs until it has converged.
        finalists: Initial trajectories that are solved from as they are, beside the screening's best.
        reach: Farthest that a via angle goes in the first solve where there is something to hit [rad]; durations
            change by as large a share.
        tolerance: Relative gain under which the planes are left as they are.
        extra: Clearance added to the margin, for what happens between the watched places [m].
    """

    widths: tuple[tuple[float, float], ...] = ((0.5, 5.0), (0.05, 0.5), (0.005, 0.05))
    rounds: int = 6
    rough: int = 3
    screening: int = 3000
    finalists: int = 1
    reach: float = 0.4
    tolerance: float = 1e-4
    extra: float = 5e-4
    name: ClassVar[str] = "reference"

    def search(self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator) -> None:
        """Solves from the chosen starts.

        Raises:
            MethodError: The model can't be written as symbols, or a jerk limit leaves no via point free.
        """
        first = problems[0]
        require_soft_vias(first)
        alone = len(problems) == 1 and not first.scene.obstacles
        if alone and first.objective == "energy" and first.initial_evaluation.feasible[0]:
            _Run(first, self, ledger, first.initial).solve(self.rounds)
            return
        raw = [(p, p.initial) for p in problems if p.initial_evaluation.violation[0] < WORTH_TRYING]
        if first.objective == "time":
            raw = []  # they are energy optima, far from the limits: the screening has left them behind
        raw.sort(key=lambda start: float(start[0].initial_evaluation.cost[0]))
        most = self.screening * len(problems) if first.objective == "energy" else 0
        Evolution(most=most).search(problems, ledger, rng)
        best = sorted(ledger.best_of.values(), key=lambda found: (not found.feasible, found.violation, found.cost))
        screened = [(found.problem, found.x) for found in best]
        for number, (problem, x) in enumerate([*screened[:1], *raw[: self.finalists]]):
            _Run(problem, self, ledger, x).solve(self.rounds if number == 0 else self.rough)


class _Run:
    """The solves from one trajectory."""

    def __init__(self, problem: PlanningProblem, options: Reference, ledger: Ledger, x: Array) -> None:
        if not isinstance(problem.model, ChainTorque):
            raise MethodError("--method reference", "this model has effects without derivatives", "use --method cma")
        self.problem, self.options, self.ledger = problem, options, ledger
        start = problem.decode(x)
        self.z = np.concatenate([start.points[0, 1:-1].reshape(-1), start.durations[0]])
        self.limited = problem.objective == "time"
        self.shares = np.full((2, problem.n), SHARE)
        self.reach = options.reach if len(problem.scene.pairs) else np.inf

    def solve(self, rounds: int) -> None:
        """Solves without limits, and with them if that breaks one and is not already worse than what is known."""
        if self.ledger.remaining == 0:
            return
        before, wide = self.z.copy(), self.reach
        self.refine(rounds)
        last = self._evaluate()
        known = self.ledger.best
        worse = known is not None and known.feasible and last.cost[0] > known.cost
        if not self.limited and _breaks_limits(last) and not worse:
            self.limited, self.z, self.reach = True, before, wide
            self.refine(rounds)

    def refine(self, rounds: int) -> None:
        """Solves and chooses planes anew, by turns, until nothing is gained.

        Planes hold at the watched places only, so a step is taken back, and the next one kept shorter, when it leads
        into a collision elsewhere. Speed and torque are held at nodes; where they pass their limit in between, the
        limit is tightened by that.
        """
        merit = self._merit(self._evaluate())
        for turn in range(rounds):
            kept = self.z.copy()
            slots = self._slots()
            self._solve_once(slots, self.options.widths if turn == 0 else self.options.widths[-1:])
            found = self._evaluate()
            tightened = self._tighten(found) if self.limited else False
            now, gained = self._merit(found), merit
            if now < merit:
                gained, merit = merit - now, now
                self.reach *= 1.5
            else:
                self.z = kept
                self.reach *= 0.3 if found.collision[0] > TOLERANCE else 1.0
                gained = 0.0 if self.reach < SHORTEST_REACH else gained
            alone = slots == 0 and self._slots() == 0 and not tightened
            if self.ledger.remaining == 0 or alone or (gained < self.options.tolerance and not tightened):
                return

    def _merit(self, found: BatchEvaluation) -> float:
        """Cost and broken limits in one number; limits count only once they are constraints."""
        if self.limited:
            return float(self.problem.penalised(found)[0])
        return float(found.cost[0] / self.problem.scale + min(3.0 * found.collision[0], 20.0))

    def _tighten(self, found: BatchEvaluation) -> bool:
        """Aims each limit so that the true peak, between the nodes, meets it; whether any had to move."""
        splines, limits = self._splines(), self.problem.limits
        worst = np.array([splines.top_speed[0] / limits.speed, found.peak[0] / limits.torque]) / SHARE
        over = worst > 1.0 + TOLERANCE / 4
        self.shares = np.where(over, self.shares / worst * (1.0 - 1e-7), self.shares)
        return bool(over.any())

    def _slots(self) -> int:
        near = count_near(self.problem, self._splines())
        return next((size for size in SLOTS if size >= near), SLOTS[-1]) if near else 0

    def _solve_once(self, slots: int, widths: Sequence[tuple[float, float]]) -> str:
        problem, status = self.problem, ""
        assert isinstance(problem.model, ChainTorque)
        sought = (problem.objective, problem.metric, problem.free)
        programme = build(problem.model, problem.via_count, sought, self.limited, slots)
        extra = self.options.extra if problem.limits.clearance > 0 else 0.0
        places = make_slots(problem, self._splines(), slots, extra)
        for width in widths:
            status = self._call(programme, np.array(width), places)
        return status

    def _call(self, programme: Transcription, widths: Array, places: Array) -> str:
        """One run of IPOPT from z, which takes on its result."""
        problem = self.problem
        free = _free_mask(problem)
        low, high = self._bounds()
        parts = (self.z[~free], problem.start, problem.goal, widths, places.T.reshape(-1))
        g_low, g_high = _constraint_bounds(problem, programme, self.shares)
        arguments: dict[str, Any] = {"x0": np.clip(self.z, low, high)[free], "p": np.concatenate(parts)}
        found = programme.solver(**arguments, lbx=low[free], ubx=high[free], lbg=g_low, ubg=g_high)
        stats = programme.solver.stats()
        self.ledger.count(int(stats["n_call_nlp_f"]))
        result = np.array(ca.DM(found["x"])).reshape(-1)
        if np.isfinite(result).all():
            self.z[free] = np.clip(result, low[free], high[free])
        return str(stats["return_status"])

    def _bounds(self) -> tuple[Array, Array]:
        """Bounds of the variables, and not farther than the reach from where they are."""
        low, high = _variable_bounds(self.problem)
        if not np.isfinite(self.reach):
            return low, high
        split = self.problem.via_count * self.problem.n
        step = np.concatenate([np.full(split, self.reach), self.reach * self.z[split:]])
        return np.maximum(low, self.z - step), np.minimum(high, self.z + step)

    def _evaluate(self) -> BatchEvaluation:
        return self.ledger.evaluate(self.problem, self._decision()[None])

    def _decision(self) -> Float[Array, " d"]:
        split = self.problem.via_count * self.problem.n
        return self.problem.encode(self.z[:split].reshape(-1, self.problem.n), self.z[split:])

    def _splines(self) -> Splines:
        return self.problem.decode(self._decision())


def _breaks_limits(found: BatchEvaluation) -> bool:
    return bool((found.speed + found.torque + found.position > TOLERANCE)[0])


def _free_mask(problem: PlanningProblem) -> Array:
    vias, sections = problem.via_count * problem.n, problem.via_count + 1
    return np.concatenate([np.full(vias, problem.searches_vias), np.full(sections, problem.searches_times)])


def _variable_bounds(problem: PlanningProblem) -> tuple[Array, Array]:
    vias = problem.vias.reshape(-1)
    limits = [np.tile(limit, problem.via_count) for limit in (problem.limits.lower, problem.limits.upper)]
    low, high = np.maximum(vias - problem.radius, limits[0]), np.minimum(vias + problem.radius, limits[1])
    return (
        np.concatenate([low, problem.durations * SQUEEZE]),
        np.concatenate([high, problem.durations / SQUEEZE]),
    )


def _constraint_bounds(problem: PlanningProblem, programme: Transcription, shares: Array) -> tuple[Array, Array]:
    limits, slots, high, low = problem.limits, programme.slots, [], []
    if programme.nodes:
        accelerations, jerks = _rate_bounds(problem)
        speed, torque = (np.tile(part, programme.nodes) for part in shares * [limits.speed, limits.torque])
        high = [np.tile(limits.upper, programme.nodes), speed, torque, accelerations, jerks]
        low = [np.tile(limits.lower, programme.nodes), *(-part for part in high[1:])]
    whole = [float(problem.durations.sum())] if problem.objective == "energy" and problem.searches_times else []
    return np.concatenate([*low, np.zeros(slots), whole]), np.concatenate([*high, np.full(slots, np.inf), whole])


def _rate_bounds(problem: PlanningProblem) -> tuple[Array, Array]:
    """Bounds of acceleration at both ends of every section, and of jerk; with a jerk limit none at start and goal."""
    limits, free = problem.limits, np.full(problem.n, np.inf)
    jerk = free if limits.jerk is None else limits.jerk
    acceleration = free if limits.acceleration is None else SHARE * AIM * limits.acceleration
    edges = np.tile(acceleration, (2 * (problem.via_count + 1), 1))
    edges[[0, -1]] = np.minimum(edges[[0, -1]], END_AIM * TICK * jerk)
    return edges.reshape(-1), np.tile(SHARE * AIM * jerk, problem.via_count + 1)
