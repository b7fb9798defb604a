"""The gradient optimum: exact derivatives of model, spline and clearance, solved by IPOPT."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ident.arrays import Array, Float
from plan.errors import MethodError
from plan.planners.base import Candidate, Ledger, Planner
from plan.planners.planes import NEAR, WATCHED, make_slots
from plan.planners.reference_graph import SLOTS, Programme, build
from plan.power import ChainTorque
from plan.problem import SHARE, SQUEEZE, TOLERANCE, Evaluation, PlanningProblem
from plan.spline import Splines


@dataclass(frozen=True)
class Reference(Planner):
    """IPOPT from every initial trajectory.

    The sign of the speed and the modulus of power are rounded, first widely and then finely; the result is evaluated
    with the exact ones. Limits enter the programme only where the optimum without them breaks one. Clearance is
    kept by separating planes that are chosen anew after each solve.

    Attributes:
        widths: Rounding of sign [rad/s] and power [W], solve by solve.
        rounds: Most times that the planes are chosen anew.
        tolerance: Relative gain under which the planes are left as they are.
        extra: Clearance added to the margin, for what happens between the watched places [m].
    """

    widths: tuple[tuple[float, float], ...] = ((0.05, 2.0), (0.01, 0.05))
    rounds: int = 12
    tolerance: float = 1e-4
    extra: float = 5e-4
    name: ClassVar[str] = "reference"

    def search(self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator) -> None:
        """Solves from each initial trajectory; uses no randomness.

        Raises:
            MethodError: The model can't be written as symbols.
        """
        for problem in problems:
            if not isinstance(problem.model, ChainTorque):
                raise MethodError(
                    "--method reference", "this model has effects without derivatives", "use --method cma"
                )
            self._solve(problem, ledger)
            if ledger.remaining == 0:
                return

    def _solve(self, problem: PlanningProblem, ledger: Ledger) -> None:
        limited = problem.objective == "time"
        z = np.concatenate([problem.vias.reshape(-1), problem.durations])
        z = self._rounds(problem, ledger, z, limited)
        if not limited and _breaks_limits(problem.evaluate(_decision(problem, z)[None])):
            self._rounds(problem, ledger, z, True)

    def _rounds(self, problem: PlanningProblem, ledger: Ledger, z: Array, limited: bool) -> Float[Array, " d"]:
        """Solves, chooses planes anew, and again until nothing is gained; the best is left in the ledger.

        Speed and torque are held at nodes; where they pass their limit in between, the limit is tightened by that.
        """
        best, shares = np.inf, np.full(2, SHARE)
        for turn in range(self.rounds):
            near = _is_near(problem, _splines(problem, z))
            z = self._one_round(problem, ledger, z, limited, near, shares, turn == 0)
            found = ledger.evaluate(problem, _decision(problem, z)[None])
            shares /= 1.0 + 1.1 * np.array([found.speed[0], found.torque[0]])
            clear = found.collision[0] <= TOLERANCE
            kept = clear and not (limited and _breaks_limits(found))
            settled = found.cost[0] > best * (1.0 - self.tolerance) or not (near or _is_near(problem, _splines(problem, z)))
            if (kept and settled) or (clear and not limited and _breaks_limits(found)) or ledger.remaining == 0:
                break
            if kept:
                best = min(best, float(found.cost[0]))
        return z

    def _one_round(
        self,
        problem: PlanningProblem,
        ledger: Ledger,
        z: Array,
        limited: bool,
        near: bool,
        shares: Array,
        first: bool,
    ) -> Float[Array, " d"]:
        model, slots = problem.model, SLOTS if near else 0
        assert isinstance(model, ChainTorque)
        programme = build(model, problem.via_count, problem.objective, problem.metric, limited, slots)
        margin = problem.margin + (self.extra if problem.margin > 0 else 0.0)
        places = make_slots(problem, _splines(problem, z), slots, margin)
        for width in self.widths if first else self.widths[-1:]:
            z = _call(programme, problem, z, np.array(width), places, shares, ledger)
        return z


def _breaks_limits(found: Evaluation) -> bool:
    return bool((found.speed + found.torque + found.position > TOLERANCE)[0])


def _is_near(problem: PlanningProblem, splines: Splines) -> bool:
    q = splines.states(WATCHED)[0][0]
    return bool(problem.scene.separation(q[:-1]).min() < NEAR)


def _splines(problem: PlanningProblem, z: Array) -> Splines:
    vias = z[: problem.via_count * problem.n].reshape(-1, problem.n)
    return Splines(np.concatenate([[problem.start], vias, [problem.goal]])[None], z[vias.size :][None])


def _decision(problem: PlanningProblem, z: Array) -> Float[Array, " d"]:
    split = problem.via_count * problem.n
    return problem.encode(z[:split].reshape(-1, problem.n), z[split:])


def _call(
    programme: Programme, problem: PlanningProblem, z: Array, widths: Array, slots: Array, shares: Array, ledger: Ledger
) -> Float[Array, " d"]:
    """One run of IPOPT."""
    low, high = _variable_bounds(problem)
    parameters = np.concatenate([problem.start, problem.goal, widths, slots.T.reshape(-1)])
    g_low, g_high = _constraint_bounds(problem, programme, shares)
    if problem.objective == "energy" and problem.searches_times:
        raise MethodError("--variables", "the reference can't free times at a fixed duration yet", "free the vias")
    arguments: dict[str, Any] = {"x0": np.clip(z, low, high), "p": parameters, "lbx": low, "ubx": high}
    found = programme.solver(**arguments, lbg=g_low, ubg=g_high)
    ledger.count(int(programme.solver.stats()["n_call_nlp_f"]))
    return np.clip(np.array(ca.DM(found["x"])).reshape(-1), low, high)


def _variable_bounds(problem: PlanningProblem) -> tuple[Array, Array]:
    vias, spread = problem.vias.reshape(-1), problem.radius if problem.searches_vias else 0.0
    limits = [np.tile(limit, problem.via_count) for limit in (problem.limits.lower, problem.limits.upper)]
    low, high = np.maximum(vias - spread, limits[0]), np.minimum(vias + spread, limits[1])
    squeeze = SQUEEZE if problem.searches_times else 1.0
    return np.concatenate([low, problem.durations * squeeze]), np.concatenate([high, problem.durations / squeeze])


def _constraint_bounds(problem: PlanningProblem, programme: Programme, shares: Array) -> tuple[Array, Array]:
    limits, slots = problem.limits, programme.slots
    speed, torque = shares[0] * limits.speed, shares[1] * limits.torque
    low = [np.tile(part, programme.nodes) for part in (limits.lower, -speed, -torque)]
    high = [np.tile(part, programme.nodes) for part in (limits.upper, speed, torque)]
    return np.concatenate([*low, np.zeros(slots)]), np.concatenate([*high, np.full(slots, np.inf)])
