"""The gradient reference: the task as a nonlinear programme in CasADi's symbols, solved by IPOPT with exact Hessian.

It shares with the default planner the spline that is sought, a clamped cubic through via points, and nothing else: not
its coefficients, derivatives, sampling or steps. So what both end at is an optimum for two reasons.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from ident.arrays import Array
from plan.dynamics.power import ChainTorque, Metric, section_nodes
from plan.dynamics.symbolic import torque
from plan.errors import MethodError
from plan.planners.base import Ledger, Planner
from plan.problem.problem import SHARE, SQUEEZE, TICK, TOLERANCE, PlanningProblem

# Rounding of the sign of the speed [rad/s] and of the modulus of power [W], solve by solve: a joint that turns back is
# not kept from it by the corner.
WIDTHS = ((0.5, 5.0), (0.05, 0.5), (0.003, 0.05))
# Local times of a section at which a search for time keeps its limits.
TIMED = np.linspace(0.0, 1.0, 25)
# Share of a limit that is aimed at, for the solver's tolerance; solves at most because a limit is passed between nodes.
AIM, TURNS = 0.9999, 4
IPOPT: dict[str, Any] = {"print_level": 0, "sb": "yes", "max_iter": 200, "mu_strategy": "adaptive"}


@dataclass(frozen=True)
class Reference(Planner):
    """IPOPT from the initial trajectory and from others near it, for tasks without obstacles.

    Variables are position and speed at every knot and the sections' durations; that acceleration is the same on both
    sides of a knot is a constraint. Via points and time stamps that are not free are held. Limits are kept at nodes;
    where they are passed in between, they are aimed at lower. The arm's own links are not watched: a motion on which
    they touch is refused by the evaluation that every planner's motions pass.

    Attributes:
        starts: Initial trajectories: the given one, and others whose via points are drawn within half the reach.
    """

    starts: int = 4
    name: ClassVar[str] = "reference"
    explores: ClassVar[bool] = True

    def search(self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator) -> None:
        """Solves from every start.

        Raises:
            MethodError: The task or the model holds what has no symbols here.
        """
        problem = problems[0]
        for what in _without_symbols(problem):
            raise MethodError("--method reference", f"it plans without {what}", "use --method sqp")
        programme = _Programme(problem)
        for number in range(self.starts if problem.searches_vias else 1):
            away = rng.uniform(-0.5, 0.5, problem.vias.shape) * problem.radius * min(number, 1)
            vias = np.clip(problem.vias + away, problem.limits.lower, problem.limits.upper)
            programme.solve(vias, ledger)
            if ledger.remaining == 0:
                return


def _without_symbols(problem: PlanningProblem) -> list[str]:
    """What of a task can't be said in symbols here."""
    there = {
        "obstacles": bool(problem.scene.obstacles),
        "rules of the way": problem.way.given,
        "the penalty of singular poses": problem.avoid_singular,
    }
    return [what for what, is_there in there.items() if is_there]


class _Programme:
    """The nonlinear programme of a task, its graph built once."""

    def __init__(self, problem: PlanningProblem) -> None:
        self.problem, n, sections = problem, problem.n, problem.via_count + 1
        self.timed, self.opti = problem.objective == "time", ca.Opti()
        opti, limits = self.opti, problem.limits
        self.points, self.speeds = points, speeds = opti.variable(n, sections + 1), opti.variable(n, sections + 1)
        self.h, self.widths = h, widths = opti.variable(sections), opti.parameter(2)
        self.aims, self.inside = aims, inside = opti.parameter(n, 2), opti.parameter()
        s, weights = (TIMED, np.zeros(len(TIMED))) if self.timed else section_nodes()
        each = np.repeat(np.arange(sections), len(s)).tolist()
        ends = [part[:, [k + last for k in each]] for part in (points, speeds) for last in (0, 1)]
        node = _node(problem.model, problem.metric).map(len(each))
        q, dq, ddq, tau, power = node(*ends, h[each].T, np.tile(s, sections)[None], ca.repmat(widths, 1, len(each)))
        opti.minimize(ca.sum1(h) if self.timed else ca.dot(power.T, h[each] * np.tile(weights, sections)))
        # What is free, within its bounds; what is not is held, and the ends are at rest.
        reach, squeeze = problem.radius * problem.searches_vias, SQUEEZE if problem.searches_times else 1.0
        low, high = (problem.vias.T - reach, problem.vias.T + reach)
        vias = ca.fmax(low, limits.lower + inside), ca.fmin(high, limits.upper - inside)
        self._keep(points, *(ca.horzcat(problem.start, via, problem.goal) for via in vias))
        opti.subject_to(speeds[:, [0, sections]] == 0.0)
        self._keep(h, problem.durations * squeeze, problem.durations / squeeze)
        if not self.timed:
            opti.subject_to(ca.sum1(h) == problem.durations.sum())
        # Limits at the nodes, in shares; a cubic's acceleration is largest at its ends, and steady across a knot.
        self._keep(q, limits.lower + inside, limits.upper - inside)
        for rate, limit, aim in ((dq, limits.speed, aims[:, 0]), (tau, limits.torque, aims[:, 1])):
            self._keep(rate / limit, -SHARE * aim, SHARE * aim)
        first, last, lengths = ddq[:, :: len(s)], ddq[:, len(s) - 1 :: len(s)], ca.repmat(h.T, n, 1)
        opti.subject_to(ca.vec((last[:, :-1] - first[:, 1:]) * lengths[:, :-1] * lengths[:, 1:]) == 0.0)
        if limits.acceleration is not None:
            self._keep(ca.horzcat(first, last) / limits.acceleration, -SHARE * AIM, SHARE * AIM)
        if limits.jerk is not None:
            self._keep((last - first) / lengths / limits.jerk, -SHARE * AIM, SHARE * AIM)
            self._keep(ca.horzcat(first[:, 0], last[:, -1]) / limits.jerk, -0.5 * TICK, 0.5 * TICK)
        opti.solver("ipopt", {"print_time": False, "detect_simple_bounds": True}, IPOPT)

    def _keep(self, part: Any, low: Any, high: Any) -> None:
        """Keeps each number of a matrix between bounds: a matrix like it, a column for all columns, or one number."""
        size = ca.DM.zeros(*part.shape)
        self.opti.subject_to(self.opti.bounded(ca.vec(size + low), ca.vec(part), ca.vec(size + high)))

    def solve(self, vias: Array, ledger: Ledger) -> None:
        """From via points, with ever less rounding, and again where a limit was passed between the nodes."""
        problem, inside, aims = self.problem, 0.0, np.full((2, self.problem.n), AIM)
        limits, times = problem.limits, np.concatenate([[0.0], np.cumsum(problem.durations)])
        points = np.concatenate([problem.start[None], vias, problem.goal[None]])
        speeds = CubicSpline(times, points, bc_type="clamped")(times, 1)
        guess: tuple[Array, ...] = points.T, speeds.T, problem.durations
        for turn in range(TURNS):
            for widths in WIDTHS[self.timed :] if turn == 0 else WIDTHS[-1:]:
                if ledger.remaining == 0:
                    return
                guess = self._solve_once(guess, (widths, aims.T, inside))
                ledger.count(int(self.opti.stats()["n_call_nlp_f"]))
            decision = problem.encode(guess[0][:, 1:-1].T, guess[2])
            found = ledger.evaluate(problem, decision[None])
            if max(found.speed[0], found.torque[0], found.position[0]) <= TOLERANCE:
                return
            shares = np.stack([problem.decode(decision).top_speed[0] / limits.speed, found.peak[0] / limits.torque])
            aims, inside = aims / np.maximum(shares / SHARE, 1.0), inside + 1.1 * found.position[0]

    def _solve_once(self, guess: Sequence[Array], given: Sequence[Any]) -> tuple[Array, ...]:
        """Points, speeds and durations at which one run of IPOPT ends, converged or not."""
        for symbol, value in zip((self.widths, self.aims, self.inside), given, strict=True):
            self.opti.set_value(symbol, value)
        sought = self.points, self.speeds, self.h
        for symbol, value in zip(sought, guess, strict=True):
            self.opti.set_initial(symbol, value)
        with suppress(RuntimeError):  # raised where it has not converged
            self.opti.solve()
        found = [np.array(self.opti.debug.value(symbol)) for symbol in sought]
        finite = all(np.isfinite(part).all() for part in found)
        return tuple(part.reshape(old.shape) if finite else old for part, old in zip(found, guess, strict=True))


def _node(model: ChainTorque, metric: Metric) -> Any:
    """CasADi function: both ends of a cubic section, its duration, a local time and widths to state, torque, power."""
    n, names = model.n, ("q0", "q1", "v0", "v1")
    q0, q1, v0, v1 = parts = [ca.SX.sym(name, n) for name in names]
    h, s, widths = ca.SX.sym("h"), ca.SX.sym("s"), ca.SX.sym("widths", 2)
    a, b, d = v0 * h, v1 * h, q1 - q0
    square, cube = 3 * d - 2 * a - b, a + b - 2 * d
    q, dq = q0 + s * (a + s * (square + s * cube)), (a + s * (2 * square + 3 * s * cube)) / h
    ddq = (2 * square + 6 * s * cube) / h**2
    tau = ca.vertcat(*torque(model, q, dq, ddq, widths[0]))
    power = tau * tau if metric == "copper" else tau * dq
    if metric in ("absolute", "positive"):
        rounded = ca.sqrt(power * power + widths[1] ** 2) - widths[1]
        power = rounded if metric == "absolute" else 0.5 * (power + rounded)
    return ca.Function("node", [*parts, h, s, widths], [q, dq, ddq, tau, ca.sum1(power)])
