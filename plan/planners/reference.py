"""The gradient reference: the task as a nonlinear programme in CasADi's symbols, solved by IPOPT with exact Hessian.

It shares with the default planner the spline that is sought, a clamped cubic through via points, and nothing else: not
its coefficients, derivatives, sampling or steps. So what both end at is an optimum for two reasons. Newton-Euler,
losses, named laws and nets are written in symbols apart from the compiled torque, so that either checks the other.
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
from ident.errors import InputError
from ident.laws.carried import JointStates
from ident.model.joint_nets import DIRECTION_SCALES, LOAD_ROUNDING
from ident.robot.chain import Chain
from plan.dynamics.compiled_nets import CompiledJointNets
from plan.dynamics.power import ChainTorque, Metric, section_nodes
from plan.planners.base import Ledger, Planner
from plan.problem.problem import SHARE, SQUEEZE, TICK, TOLERANCE, PlanningProblem

Symbol = Any  # casadi.SX or DM
# Added to a squared speed that a root is drawn from [rad²/s²]; rounding of the modulus of a load [N m].
ROUNDING, BURDEN = 1e-12, 0.02


@dataclass(frozen=True, eq=False)
class SmoothStates(JointStates):
    """A joint's states as symbols, their moduli rounded over a width [rad/s]."""

    width: Symbol = 0.0

    @property
    def speed(self) -> Symbol:
        return ca.sqrt(self.dq * self.dq + self.width * self.width + ROUNDING)

    @property
    def burden(self) -> Symbol:
        return ca.sqrt(self.load * self.load + BURDEN**2)


def rigid_torque(chain: Chain, q: Symbol, dq: Symbol, ddq: Symbol) -> list[Symbol]:
    """Torque of each joint of the rigid chain [N m], by recursive Newton-Euler from columns of n. Source: eq. 2."""
    parts = np.asarray(chain.axes), np.asarray(chain.offsets), np.asarray(chain.centres), np.asarray(chain.inertias)
    axes, offsets, centres, inertias = ([ca.DM(one) for one in part] for part in parts)
    omega, alpha = ca.SX.zeros(3), ca.SX.zeros(3)
    acc: Symbol = -ca.DM(np.asarray(chain.gravity))
    moved = []
    for i, (axis, centre, inertia) in enumerate(zip(axes, centres, inertias, strict=True)):
        placed, sine, cosine = (ca.DM(part) for part in np.asarray(chain.rotations[i]))
        slides = bool(chain.sliding[i])
        turn: Symbol = placed if slides else placed + ca.sin(q[i]) * sine + (1.0 - ca.cos(q[i])) * cosine
        lever: Symbol = offsets[i] + placed @ axis * q[i] if slides else offsets[i]
        acc = turn.T @ (acc + ca.cross(alpha, lever) + ca.cross(omega, ca.cross(omega, lever)))
        omega, alpha = turn.T @ omega, turn.T @ alpha
        if slides:
            acc += axis * ddq[i] + 2.0 * ca.cross(omega, axis) * dq[i]
        else:
            alpha += axis * ddq[i] + ca.cross(omega, axis) * dq[i]
            omega += axis * dq[i]
        force = chain.masses[i] * (acc + ca.cross(alpha, centre) + ca.cross(omega, ca.cross(omega, centre)))
        moment = inertia @ alpha + ca.cross(omega, inertia @ omega) + ca.cross(centre, force)
        moved.append((turn, lever, force, moment, axis, slides))
    tau, force, moment = [], ca.SX.zeros(3), ca.SX.zeros(3)
    for turn, lever, own_force, own_moment, axis, slides in reversed(moved):
        force, moment = own_force + force, own_moment + moment
        tau.append(ca.dot(axis, force if slides else moment))
        force = turn @ force
        moment = turn @ moment + ca.cross(lever, force)
    return tau[::-1]


def torque(model: ChainTorque, q: Symbol, dq: Symbol, ddq: Symbol, rounding: Symbol) -> list[Symbol]:
    """Torque of each joint [N m], the sign of the speed rounded over a width [rad/s]. Source: eq. 1.

    Raises:
        InputError: The net is of another kind than the default.
    """
    if not (model.net is None or isinstance(model.net, CompiledJointNets)):
        raise InputError("--method reference", "this model's net has no symbols", "use --method sqp")
    rigid, loss, found = rigid_torque(model.chain, q, dq, ddq), model.losses, []
    for j, load in enumerate(rigid):
        width = ca.sqrt(rounding**2 + loss.transition_speed[j] ** 2)
        slip = ca.tanh(dq[j] / width)
        tau = load + loss.motor_inertia[j] * ddq[j] + loss.viscous[j] * dq[j] + loss.coulomb[j] * slip + loss.offset[j]
        at = SmoothStates(q[j], dq[j], load, slip, ca, width)
        for law in (law for law in model.named if law.joint == j):
            columns = law.kind.columns(at, law.shape)
            tau += sum(value * column for (value, _, _), column in zip(law.figures, columns, strict=True))
        found.append(tau if model.net is None else tau + _net_torque(model.net, j, dq[j], ddq[j], load))
    return found


def _net_torque(net: CompiledJointNets, j: int, dq: Symbol, ddq: Symbol, load: Symbol) -> Symbol:
    """A joint's net, see `CompiledJointNets`."""
    edges = zip((dq, ddq, load), net.bounds.low[:, j], net.bounds.high[:, j], strict=True)
    dq, ddq, load = (ca.fmin(ca.fmax(part, float(low)), float(high)) for part, low, high in edges)
    near, far = (ca.tanh(dq / scale) for scale in DIRECTION_SCALES)
    x = ca.vertcat(dq, ddq, near, far, load, ca.sqrt(load * load + LOAD_ROUNDING**2) * near)
    *layers, (last, offset) = net.joints[j]
    for weight, bias in layers:
        x = ca.sparsify(ca.DM(np.array(weight.T))) @ x + ca.DM(np.array(bias))
        x = 0.5 * x * (1.0 + ca.tanh(0.5 * x))
    said = ca.dot(ca.DM(np.array(last[:, 0])), x) + float(offset[0])
    least, most = net.bounds.torques
    return ca.fmin(ca.fmax(said, float(least[j])), float(most[j]))


# Rounding of the sign of the speed [rad/s] and of the modulus of power [W], solve by solve: a joint that turns back is
# not kept from it by the corner.
WIDTHS = ((0.5, 5.0), (0.05, 0.5), (0.003, 0.05))
# Local times of a section at which a search for time keeps its limits.
TIMED = np.linspace(0.0, 1.0, 25)
# Share of a limit that is aimed at, for the solver's tolerance; solves at most because a limit is passed between nodes.
AIM, TURNS = 0.9999, 4
IPOPT: dict[str, Any] = {"print_level": 0, "sb": "yes", "max_iter": 200, "mu_strategy": "adaptive"}
# Else IPOPT obeys the `ipopt.opt` of whatever folder it is started in, which names libraries to load, files to empty.
IPOPT |= {"option_file_name": "", "linear_solver": "mumps"}


@dataclass(frozen=True)
class Reference(Planner):
    """IPOPT from the initial trajectory and from others near it, for tasks without obstacles.

    Variables are position and speed at every knot and the sections' durations; that acceleration is the same on both
    sides of a knot is a constraint. Via points and time stamps that are not free are held. Limits are kept at nodes;
    where they are passed in between, they are aimed at lower. The arm's own links are not watched: a motion on which
    they touch is refused by the evaluation that every planner's motions pass.
    """

    starts: int = 4  # initial trajectories: the given one, and others whose via points are drawn within half the reach
    name: ClassVar[str] = "reference"
    explores: ClassVar[bool] = True

    def search(self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator) -> None:
        """Solves from every start.

        Raises:
            InputError: The task or the model holds what has no symbols here.
        """
        problem = problems[0]
        without_symbols = {"obstacles": bool(problem.scene.obstacles), "rules of the way": problem.way.given}
        for what, is_there in without_symbols.items():
            if is_there:
                raise InputError("--method reference", f"it plans without {what}", "use --method sqp")
        programme = _Programme(problem)
        for number in range(self.starts if problem.searches_vias else 1):
            away = rng.uniform(-0.5, 0.5, problem.vias.shape) * problem.radius * min(number, 1)
            vias = np.clip(problem.vias + away, problem.limits.lower, problem.limits.upper)
            programme.solve(vias, ledger)
            if ledger.remaining == 0:
                return


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
        points = problem.with_ends(vias)
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
