"""The gradient reference: the task as a nonlinear programme in CasADi's symbols, solved by IPOPT.

It shares with the default planner the spline that is sought, a clamped cubic through via points,
and nothing else: not its coefficients, derivatives, sampling or steps; IPOPT gets the exact
Hessian. So what both end at is an optimum for two reasons. Newton-Euler, losses, named laws and
nets are written in symbols apart from the compiled torque, so that either checks the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.laws.carried import JointStates
from ident.model.joint_nets import DIRECTION_SCALES, LOAD_ROUNDING
from ident.robot.chain import Chain
from plan.dynamics.compiled_nets import CompiledJointNets
from plan.dynamics.power import ChainTorque, Metric, section_nodes
from plan.planners.base import Ledger, Planner
from plan.problem.problem import SHARE, SQUEEZE, TICK, TOLERANCE, PlanningProblem

Symbol = Any  # casadi.SX or DM

# Added to a squared speed that a root is drawn from [rad²/s²].
ROUNDING = 1e-12
# Rounding of the modulus of a load [N m].
BURDEN = 0.02
# Rounding of the sign of the speed [rad/s] and of the modulus of power [W], solve by solve: a joint
# that turns back is not kept from it by the corner.
WIDTHS = ((0.5, 5.0), (0.05, 0.5), (0.003, 0.05))
# Local times of a section at which a search for time keeps its limits.
TIMED = np.linspace(0.0, 1.0, 25)
# Share of a limit that is aimed at, for the solver's tolerance.
AIM = 0.9999
# Solves at most because a limit is passed between nodes.
TURNS = 4
# Where angles pass a limit between nodes, the next solve stays this many times that inside.
FARTHER = 1.1
# Other starts have their via points within this share of the reach.
AWAY = 0.5
IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "max_iter": 200,
    "mu_strategy": "adaptive",
    # Else IPOPT obeys the `ipopt.opt` of whatever folder it is started in, which names libraries to
    # load, files to empty.
    "option_file_name": "",
    "linear_solver": "mumps",
}


@dataclass(frozen=True, eq=False)
class SmoothStates(JointStates):
    """A joint's states as symbols, their moduli rounded over a width [rad/s]."""

    width: Symbol = 0.0

    @property
    def speed(self) -> Symbol:
        """|dq|, rounded at zero: √(dq² + w²) [rad/s]."""
        return ca.sqrt(self.dq * self.dq + self.width * self.width + ROUNDING)

    @property
    def burden(self) -> Symbol:
        """|load|, rounded at zero: √(load² + b²) [N m]."""
        return ca.sqrt(self.load * self.load + BURDEN**2)


class _MovedLink(NamedTuple):
    """What Newton-Euler's way out leaves of a link for the way back, in the link's frame."""

    turn: Symbol  # rotation from its frame to the one before
    lever: Symbol  # its origin in the frame before [m]
    force: Symbol  # what moves it [N]
    moment: Symbol  # about its origin [N m]
    axis: Symbol
    slides: bool


def rigid_torque(chain: Chain, q: Symbol, dq: Symbol, ddq: Symbol) -> list[Symbol]:
    """Torque of each joint of the rigid chain [N m], by recursive Newton-Euler. Source: eq. 2.

    Args:
        chain: The links.
        q, dq, ddq: Columns of n.
    """
    moved = _move_links(chain, q, dq, ddq)
    tau = []
    force = ca.SX.zeros(3)
    moment = ca.SX.zeros(3)
    for link in reversed(moved):
        force = link.force + force
        moment = link.moment + moment
        tau.append(ca.dot(link.axis, force if link.slides else moment))
        force = link.turn @ force
        moment = link.turn @ moment + ca.cross(link.lever, force)
    return tau[::-1]


def _move_links(chain: Chain, q: Symbol, dq: Symbol, ddq: Symbol) -> list[_MovedLink]:
    """Forces and moments that move the links, from the base outwards."""
    omega = ca.SX.zeros(3)
    alpha = ca.SX.zeros(3)
    acceleration: Symbol = -ca.DM(np.asarray(chain.gravity))
    moved = []
    for i in range(len(chain.axes)):
        axis = ca.DM(np.asarray(chain.axes[i]))
        offset = ca.DM(np.asarray(chain.offsets[i]))
        centre = ca.DM(np.asarray(chain.centres[i]))
        inertia = ca.DM(np.asarray(chain.inertias[i]))
        placed, sine, cosine = (ca.DM(matrix) for matrix in np.asarray(chain.rotations[i]))
        slides = bool(chain.sliding[i])
        turn: Symbol = placed
        lever: Symbol = offset
        if slides:
            lever = offset + placed @ axis * q[i]
        else:
            turn = placed + ca.sin(q[i]) * sine + (1.0 - ca.cos(q[i])) * cosine
        acceleration = turn.T @ (acceleration + _swung(omega, alpha, lever))
        omega = turn.T @ omega
        alpha = turn.T @ alpha
        if slides:
            acceleration += axis * ddq[i] + 2.0 * ca.cross(omega, axis) * dq[i]
        else:
            alpha += axis * ddq[i] + ca.cross(omega, axis) * dq[i]
            omega += axis * dq[i]
        force = chain.masses[i] * (acceleration + _swung(omega, alpha, centre))
        moment = inertia @ alpha + ca.cross(omega, inertia @ omega) + ca.cross(centre, force)
        moved.append(_MovedLink(turn, lever, force, moment, axis, slides))
    return moved


def _swung(omega: Symbol, alpha: Symbol, place: Symbol) -> Symbol:
    """Acceleration of a place by its body's turning alone."""
    return ca.cross(alpha, place) + ca.cross(omega, ca.cross(omega, place))


def torque(
    model: ChainTorque, q: Symbol, dq: Symbol, ddq: Symbol, rounding: Symbol
) -> list[Symbol]:
    """Torque of each joint [N m], the sign of the speed rounded over a width. Source: eq. 1.

    Args:
        model: Of the arm's torque.
        q, dq, ddq: Columns of n.
        rounding: The width [rad/s].

    Raises:
        InputError: The net is of another kind than the default.
    """
    if not (model.net is None or isinstance(model.net, CompiledJointNets)):
        what = "this model's net has no symbols"
        raise InputError("--method reference", what, "use --method sqp")
    torques = []
    for j, load in enumerate(rigid_torque(model.chain, q, dq, ddq)):
        tau = load + _loss_torque(model, j, (q[j], dq[j], ddq[j]), load, rounding)
        if model.net is not None:
            tau += _net_torque(model.net, j, dq[j], ddq[j], load)
        torques.append(tau)
    return torques


def _loss_torque(
    model: ChainTorque, j: int, state: tuple[Symbol, Symbol, Symbol], load: Symbol, rounding: Symbol
) -> Symbol:
    """What a joint's motor inertia, friction and named laws take beside its load [N m]."""
    loss = model.losses
    q, dq, ddq = state
    width = ca.sqrt(rounding**2 + loss.transition_speed[j] ** 2)
    slip = ca.tanh(dq / width)
    tau = loss.motor_inertia[j] * ddq
    tau = tau + loss.viscous[j] * dq + loss.coulomb[j] * slip + loss.offset[j]
    states = SmoothStates(q, dq, load, slip, ca, width)
    for law in model.named:
        if law.joint != j:
            continue
        columns = law.kind.columns(states, law.shape)
        for (value, _, _), column in zip(law.figures, columns, strict=True):
            tau += value * column
    return tau


def _net_torque(net: CompiledJointNets, j: int, dq: Symbol, ddq: Symbol, load: Symbol) -> Symbol:
    """A joint's net, see `CompiledJointNets`."""
    low = net.bounds.low[:, j]
    high = net.bounds.high[:, j]
    inside = []
    for k, value in enumerate((dq, ddq, load)):
        inside.append(ca.fmin(ca.fmax(value, float(low[k])), float(high[k])))
    dq, ddq, load = inside
    near, far = (ca.tanh(dq / scale) for scale in DIRECTION_SCALES)
    burden = ca.sqrt(load * load + LOAD_ROUNDING**2)
    x = ca.vertcat(dq, ddq, near, far, load, burden * near)
    *layers, (last, offset) = net.joints[j]
    for weight, bias in layers:
        x = ca.sparsify(ca.DM(np.array(weight.T))) @ x + ca.DM(np.array(bias))
        x = 0.5 * x * (1.0 + ca.tanh(0.5 * x))
    said = ca.dot(ca.DM(np.array(last[:, 0])), x) + float(offset[0])
    least, most = net.bounds.torques
    return ca.fmin(ca.fmax(said, float(least[j])), float(most[j]))


@dataclass(frozen=True)
class Reference(Planner):
    """IPOPT from the initial trajectory and from others near it, for tasks without obstacles.

    Variables are position and speed at every knot and the sections' durations; that acceleration is
    the same on both sides of a knot is a constraint. Via points and time stamps that are not free
    are held. Limits are kept at nodes; where they are passed in between, they are aimed at lower.
    The arm's own links are not watched: a motion on which they touch is refused by the evaluation
    that every planner's motions pass.
    """

    # Initial trajectories: the given one, and others whose via points are drawn near its own.
    starts: int = 4
    name: ClassVar[str] = "reference"
    explores: ClassVar[bool] = True

    def search(
        self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator
    ) -> None:
        """Solves from every start.

        Raises:
            InputError: The task or the model holds what has no symbols here.
        """
        problem = problems[0]
        without_symbols = {
            "obstacles": bool(problem.scene.obstacles),
            "rules of the way": problem.way.given,
        }
        for what, is_there in without_symbols.items():
            if is_there:
                what = f"it plans without {what}"
                raise InputError("--method reference", what, "use --method sqp")
        programme = _Programme(problem)
        limits = problem.limits
        for number in range(self.starts if problem.searches_vias else 1):
            away = rng.uniform(-AWAY, AWAY, problem.vias.shape)
            away *= problem.radius * min(number, 1)
            vias = np.clip(problem.vias + away, limits.lower, limits.upper)
            programme.solve(vias, ledger)
            if ledger.remaining == 0:
                return


Guess = tuple[Float[Array, "n K"], Float[Array, "n K"], Float[Array, " S"]]
"""Points [rad] and speeds [rad/s] at the knots, and durations of the sections [s]."""


class _Programme:
    """The nonlinear programme of a task, its graph built once."""

    def __init__(self, problem: PlanningProblem) -> None:
        n = problem.n
        sections = problem.via_count + 1
        self.problem = problem
        self.timed = problem.objective == "time"
        self.opti = ca.Opti()
        self.points = self.opti.variable(n, sections + 1)
        self.speeds = self.opti.variable(n, sections + 1)
        self.durations = self.opti.variable(sections)
        self.widths = self.opti.parameter(2)
        # Shares of the limits of speed and torque that are aimed at, and how far inside the limits
        # of position the motion stays [rad].
        self.aims = self.opti.parameter(n, 2)
        self.inside = self.opti.parameter()
        self._bound_variables()
        self._write_nodes()
        options = {"print_time": False, "detect_simple_bounds": True}
        self.opti.solver("ipopt", options, IPOPT)

    def _bound_variables(self) -> None:
        """What is free, within its bounds; what is not is held, and the ends are at rest."""
        problem = self.problem
        limits = problem.limits
        reach = problem.radius * problem.searches_vias
        squeeze = SQUEEZE if problem.searches_times else 1.0
        lowest = ca.fmax(problem.vias.T - reach, limits.lower + self.inside)
        highest = ca.fmin(problem.vias.T + reach, limits.upper - self.inside)
        low = ca.horzcat(problem.start, lowest, problem.goal)
        high = ca.horzcat(problem.start, highest, problem.goal)
        self._keep(self.points, low, high)
        self.opti.subject_to(self.speeds[:, [0, problem.via_count + 1]] == 0.0)
        self._keep(self.durations, problem.durations * squeeze, problem.durations / squeeze)
        if not self.timed:
            self.opti.subject_to(ca.sum1(self.durations) == problem.durations.sum())

    def _write_nodes(self) -> None:
        """The cost, and the limits at all nodes of all sections."""
        problem = self.problem
        sections = problem.via_count + 1
        places, weights = (TIMED, np.zeros(len(TIMED))) if self.timed else section_nodes()
        count = len(places)
        each = np.repeat(np.arange(sections), count).tolist()
        after = [k + 1 for k in each]
        lengths = self.durations[each]
        node = _node(problem.model, problem.metric).map(len(each))
        q, dq, ddq, tau, power = node(
            self.points[:, each],
            self.points[:, after],
            self.speeds[:, each],
            self.speeds[:, after],
            lengths.T,
            np.tile(places, sections)[None],
            ca.repmat(self.widths, 1, len(each)),
        )
        cost = ca.sum1(self.durations)
        if not self.timed:
            cost = ca.dot(power.T, lengths * np.tile(weights, sections))
        self.opti.minimize(cost)
        limits = problem.limits
        self._keep(q, limits.lower + self.inside, limits.upper - self.inside)
        self._keep_share(dq / limits.speed, self.aims[:, 0])
        self._keep_share(tau / limits.torque, self.aims[:, 1])
        # A cubic's acceleration is largest at its ends.
        self._keep_accelerations(ddq[:, ::count], ddq[:, count - 1 :: count])

    def _keep_accelerations(self, first: Symbol, last: Symbol) -> None:
        """Acceleration steady across knots, and limits of it and of jerk where there are any.

        Args:
            first, last: Accelerations at both ends of every section.
        """
        limits = self.problem.limits
        lengths = ca.repmat(self.durations.T, self.problem.n, 1)
        jumps = (last[:, :-1] - first[:, 1:]) * lengths[:, :-1] * lengths[:, 1:]
        self.opti.subject_to(ca.vec(jumps) == 0.0)
        if limits.acceleration is not None:
            self._keep_share(ca.horzcat(first, last) / limits.acceleration, AIM)
        if limits.jerk is not None:
            self._keep_share((last - first) / lengths / limits.jerk, AIM)
            ends = ca.horzcat(first[:, 0], last[:, -1])
            self._keep(ends / limits.jerk, -0.5 * TICK, 0.5 * TICK)

    def _keep_share(self, share: Symbol, aim: Any) -> None:
        """Keeps shares of a limit, of either sign, within what is aimed at."""
        self._keep(share, -SHARE * aim, SHARE * aim)

    def _keep(self, matrix: Symbol, low: Any, high: Any) -> None:
        """Keeps each number of a matrix between bounds.

        A bound is a matrix like it, a column for all columns, or a number for all.
        """
        zeros = ca.DM.zeros(*matrix.shape)
        bounded = self.opti.bounded(ca.vec(zeros + low), ca.vec(matrix), ca.vec(zeros + high))
        self.opti.subject_to(bounded)

    def solve(self, vias: Float[Array, "V n"], ledger: Ledger) -> None:
        """From via points, with ever less rounding; again where limits are passed between nodes."""
        problem = self.problem
        limits = problem.limits
        inside = 0.0
        aims = np.full((2, problem.n), AIM)
        guess = self._guess(vias)
        for turn in range(TURNS):
            for widths in WIDTHS[self.timed :] if turn == 0 else WIDTHS[-1:]:
                if ledger.remaining == 0:
                    return
                guess = self._solve_once(guess, (widths, aims.T, inside))
                ledger.count(int(self.opti.stats()["n_call_nlp_f"]))
            points, _, durations = guess
            decision = problem.encode(points[:, 1:-1].T, durations)
            evaluation = ledger.evaluate(problem, decision[None])
            excess = (evaluation.speed[0], evaluation.torque[0], evaluation.position[0])
            if max(excess) <= TOLERANCE:
                return
            speed = problem.decode(decision).top_speed[0] / limits.speed
            shares = np.stack([speed, evaluation.peak[0] / limits.torque])
            aims = aims / np.maximum(shares / SHARE, 1.0)
            inside = inside + FARTHER * evaluation.position[0]

    def _guess(self, vias: Float[Array, "V n"]) -> Guess:
        """The clamped spline through via points at the task's own times."""
        problem = self.problem
        times = np.concatenate([[0.0], np.cumsum(problem.durations)])
        points = problem.with_ends(vias)
        speeds = CubicSpline(times, points, bc_type="clamped")(times, 1)
        return points.T, speeds.T, problem.durations

    def _solve_once(self, guess: Guess, given: Sequence[Any]) -> Guess:
        """Points, speeds and durations at which a run of IPOPT ends, converged or not."""
        for symbol, value in zip((self.widths, self.aims, self.inside), given, strict=True):
            self.opti.set_value(symbol, value)
        sought = (self.points, self.speeds, self.durations)
        for symbol, value in zip(sought, guess, strict=True):
            self.opti.set_initial(symbol, value)
        with suppress(RuntimeError):  # raised where it has not converged
            self.opti.solve()
        values = [np.array(self.opti.debug.value(symbol)) for symbol in sought]
        if not all(np.isfinite(value).all() for value in values):
            return guess
        points, speeds, durations = values
        return (
            points.reshape(guess[0].shape),
            speeds.reshape(guess[1].shape),
            durations.reshape(guess[2].shape),
        )


def _node(model: ChainTorque, metric: Metric) -> Any:
    """CasADi function of a place in a cubic section.

    From positions and speeds of both its ends, its duration, a local time and widths to position,
    speed, acceleration, torque and power.
    """
    q0, q1, v0, v1 = ends = [ca.SX.sym(name, model.n) for name in ("q0", "q1", "v0", "v1")]
    h = ca.SX.sym("h")
    s = ca.SX.sym("s")
    widths = ca.SX.sym("widths", 2)
    # The cubic q0 + a s + square s² + cube s³ of the local time s.
    a = v0 * h
    b = v1 * h
    d = q1 - q0
    square = 3 * d - 2 * a - b
    cube = a + b - 2 * d
    q = q0 + s * (a + s * (square + s * cube))
    dq = (a + s * (2 * square + 3 * s * cube)) / h
    ddq = (2 * square + 6 * s * cube) / h**2
    tau = ca.vertcat(*torque(model, q, dq, ddq, widths[0]))
    power = tau * tau if metric == "copper" else tau * dq
    if metric in ("absolute", "positive"):
        rounded = ca.sqrt(power * power + widths[1] ** 2) - widths[1]
        power = rounded if metric == "absolute" else 0.5 * (power + rounded)
    return ca.Function("node", [*ends, h, s, widths], [q, dq, ddq, tau, ca.sum1(power)])
