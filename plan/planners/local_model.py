"""Cost, limits and clearance of one trajectory, and their derivatives by its coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float, Int
from plan.dynamics.power import ChainTorque, Slopes, differentiate_torque, find_kinks, rounded
from plan.planners.subproblem import Bounds, ConstraintRows
from plan.planners.transcription import ACTING, DEGREE, Grid, States, sections_of
from plan.planners.velocity_reversals import FULLY, Reversals, find_dips, find_turns
from plan.problem.problem import SHARE, PlanningProblem
from plan.problem.rule_values import RuleRow, Rules
from plan.spline import Splines

# Only what has come this near to its limit is watched while a step is looked for [-].
WATCHED_SHARE = 0.6
# Jerk, which is steady in a section and jumps between two, is watched from this share of that on.
SOONER = 0.5
# Angles within this much of their limits are watched [rad].
WATCHED_ANGLE = 0.5
# Rules of the way that are broken by less than minus so many units are not watched.
WATCHED_RULE = 0.5
# Pairs closer than this are watched [m].
NEAR = 0.06
# At most so many of their places are watched at a time, the nearest ones.
MOST_NEAR = 90
# Places along a motion at which all pairs are looked at.
PLACES = 64
# Where a gap dips to within so much of the margin [m], it is looked at more closely, and once more
# in the same way: past an edge a gap falls and rises by half a millimetre within a five-hundredth
# of a motion.
CLOSE = (0.03, 0.005)
# Places to either side of a dip at which it is looked at more closely.
CLOSER = 8
# Unit of the clearance's shortfall [m].
CLEARANCE_UNIT = 0.1
# Clearance asked for beyond the margin, for what happens between the watched places [m].
EXTRA = 5e-4
# Order of the derivative that jerk is.
JERK = 3
# Shortest and longest duration, as multiples of the task's own.
SHORTEST_SHARE = 0.02
LONGEST_SHARE = 50.0

Dips = tuple[Float[Array, " m"], Int[Array, " m"], Float[Array, " m"]]
"""Places as shares of the duration, pairs, and their gaps beyond the margin there [m]."""


@dataclass(frozen=True, eq=False)
class TrajectoryValues:
    """What a trajectory costs and breaks, as a local search sees it."""

    cost: float  # energy [J] or duration [s], rounded as the search rounds it
    limits: float  # largest excess over a limit, as a share of it
    clearance: float  # shortfall of the clearance, in units of 10 cm
    # Largest excess of a rule of the way, in units of 10 cm, a tenth of a radian, or a limit.
    rules: float = 0.0

    @property
    def broken(self) -> float:
        """Sum of what is broken."""
        return self.limits + self.clearance + self.rules

    def merit(self, weights: Float[Array, " 3"], scale: float) -> float:
        """A number to bring down."""
        priced = weights @ [self.limits, self.clearance, self.rules]
        return float(self.cost / scale + priced)


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A trajectory at the nodes, and how its torque changes there."""

    coefficients: Float[Array, "C n"]  # all of the B-spline [rad]
    duration: float  # [s]
    states: States  # at the nodes
    torque: tuple[Array, Slopes]  # [N m], and its derivatives by the states


def _passed(
    share: Float[Array, "T n"], change: Float[Array, "T n"]
) -> tuple[Int[Array, " r"], Int[Array, " r"], Float[Array, " r"]]:
    """Where a limit that is not watched would be passed: nodes, joints, signs."""
    after = share + change
    nodes, joints = np.nonzero((np.abs(after) > 1.0) & (np.sign(after) * share <= WATCHED_SHARE))
    return nodes, joints, np.sign(after[nodes, joints])


@dataclass(frozen=True, eq=False)
class LocalModel:
    """A task on one grid of coefficients.

    The variables are the free coefficients, coefficient by coefficient, and for the time objective
    the duration as a share of the task's own.
    """

    problem: PlanningProblem
    grid: Grid  # knots and nodes
    weights: Float[Array, " m"]  # quadrature weights of one section's nodes
    width: float  # rounding of the friction's sign [rad/s]
    power: float  # rounding of the modulus of power [W]
    torque_aim: Float[Array, "K n"]  # shares of the limits that are aimed at, by section and joint
    speed_aim: Float[Array, " n"]

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.problem.n

    @property
    def timed(self) -> bool:
        """Whether the duration is a variable."""
        return self.problem.objective == "time"

    @property
    def size(self) -> int:
        """Number of variables."""
        return self.grid.free * self.n + self.timed

    @cached_property
    def reference(self) -> float:
        """Duration by which durations are measured [s]."""
        return float(self.problem.durations.sum())

    @property
    def bounds(self) -> Bounds:
        """Position limits, and no farther from the ends and the via points than the reach."""
        problem = self.problem
        points = problem.with_ends(problem.vias)
        lowest = np.maximum(points.min(axis=0) - problem.radius, problem.limits.lower)
        highest = np.minimum(points.max(axis=0) + problem.radius, problem.limits.upper)
        low = np.tile(lowest, self.grid.free)
        high = np.tile(highest, self.grid.free)
        if self.timed:
            low = np.append(low, SHORTEST_SHARE)
            high = np.append(high, LONGEST_SHARE)
        return low, high

    def join(self, free: Float[Array, "F n"], duration: float) -> Float[Array, " d"]:
        """Variables of coefficients and a duration."""
        flat = free.reshape(-1)
        return np.append(flat, duration / self.reference) if self.timed else flat.copy()

    def split(self, x: Float[Array, " d"]) -> tuple[Float[Array, "C n"], float]:
        """All coefficients and the duration [s]."""
        count = self.grid.free * self.n
        duration = float(x[count]) * self.reference if self.timed else self.reference
        free = x[:count].reshape(-1, self.n)
        return self.grid.coefficients(free, self.problem.start, self.problem.goal), duration

    def splines(self, x: Float[Array, " d"]) -> Splines:
        """The trajectory."""
        return self.grid.splines(*self.split(x))

    def look(self, x: Float[Array, " d"]) -> TrajectoryValues:
        """What a trajectory costs and breaks."""
        coefficients, duration = self.split(x)
        states = self.grid.states(coefficients, duration)
        q, dq, ddq = states
        tau = self._model.torque(q[None], dq[None], ddq[None])[0]
        cost = duration
        if not self.timed:
            cost = float(self._quadrature * duration @ self._rate(tau, dq)[0])
        excess = self._excess(coefficients, states, tau, duration)
        rules = self.problem.rules
        rule_excess = 0.0 if rules is None else rules.excess(q, dq)
        return TrajectoryValues(cost, excess, self._shortfall(coefficients, duration), rule_excess)

    def _excess(
        self, coefficients: Float[Array, "C n"], states: States, tau: Array, duration: float
    ) -> float:
        """Largest excess over a limit, as a share of it, or in radians of an angle."""
        limits = self.problem.limits
        q, dq, ddq = states
        turns, at_turns, first = self._turns(coefficients, dq, ddq, duration)
        at_turn = np.abs(turns.torque(self.problem.model, at_turns))
        largest = [float((q - limits.upper).max()), float((limits.lower - q).max()), 0.0]
        shares = [np.abs(tau) / self._torque_limit, at_turn / self._turn_limit(turns, first)]
        rates = (*states, self.grid.jerk(coefficients, duration))
        shares.extend(np.abs(rates[order]) / limit for order, limit in self._rate_limits)
        largest.extend(float(share.max()) - 1.0 for share in shares)
        return max(largest)

    def _shortfall(self, coefficients: Float[Array, "C n"], duration: float) -> float:
        """Shortfall of the clearance, in its unit."""
        scene = self.problem.scene
        if len(scene.pairs) == 0:
            return 0.0
        splines = self.grid.splines(coefficients, duration)
        left = float(scene.sweep(splines, self.problem.margins)[0][0])
        return max(0.5 * self._extra - left, 0.0) / CLEARANCE_UNIT

    def linearise(self, x: Float[Array, " d"]) -> Linearisation:
        """States and torque of a trajectory at the nodes, with the torque's derivatives."""
        coefficients, duration = self.split(x)
        states = self.grid.states(coefficients, duration)
        torque = differentiate_torque(self._model, *states)
        return Linearisation(coefficients, duration, states, torque)

    def gradient(
        self, about: Linearisation
    ) -> tuple[Float[Array, " d"], Float[Array, "d d"], ConstraintRows]:
        """Slope of the cost, how its kinks bend it, and the limits that are near."""
        coefficients, duration = about.coefficients, about.duration
        states, torque = about.states, about.torque
        if self.timed:
            slope = np.zeros(self.size)
            slope[-1] = self.reference
            bent = np.zeros((0, self.size))
        else:
            slope = self._energy_slope(states, torque, duration)
            bent = self._energy_kinks(states, torque, duration)
        limits = [
            self._near_torque_rows(about),
            self._turn_rows(coefficients, states, duration),
            *self._kinematic_rows(coefficients, states, duration),
        ]
        return slope, bent.T @ bent, ConstraintRows.join(limits)

    def passed_limits(self, about: Linearisation, step: Float[Array, " d"]) -> ConstraintRows:
        """Limits of torque, speed and acceleration that are not watched, and that a step passes.

        To first order. In a short section a short step takes acceleration from one limit to the
        other, so that any node may come to matter.

        Args:
            about: Where the step begins.
            step: Change of the variables.
        """
        changes = self._changes(about, step)
        tau, slopes = about.torque
        change = np.zeros_like(tau)
        for slope, by in zip(slopes, changes, strict=True):
            change += np.einsum("tij,tj->ti", slope, by)
        sets = [ConstraintRows.none(self.size)]
        share = tau / self._torque_limit
        passed = _passed(share, change / self._torque_limit)
        if len(passed[0]) > 0:
            sets.append(self._torque_rows(about, *passed))
        for order, limit in self._rate_limits:
            if order == JERK:
                continue
            share = about.states[order] / limit
            nodes, joints, signs = _passed(share, changes[order] / limit)
            if len(nodes) > 0:
                by_rate = np.eye(self.n)[joints] * (signs / limit[joints])[:, None]
                local = [np.zeros_like(by_rate)] * order + [by_rate]
                matrix = self._node_rows(nodes, local, about.states, about.duration)
                sets.append(ConstraintRows(matrix, 1.0 - signs * share[nodes, joints]))
        return ConstraintRows.join(sets)

    def _changes(self, about: Linearisation, step: Float[Array, " d"]) -> States:
        """How a step changes position, speed and acceleration at the nodes, to first order."""
        count = self.grid.free * self.n
        free = step[:count].reshape(-1, self.n)
        still = np.zeros(self.n)
        duration = about.duration
        coefficients = self.grid.coefficients(free, still, still)
        changes = self.grid.states(coefficients, duration)
        if not self.timed:
            return changes
        longer = float(step[count]) * self.reference / duration
        _, dq, ddq = about.states
        return changes[0], changes[1] - longer * dq, changes[2] - 2.0 * longer * ddq

    def _energy_slope(
        self, states: States, torque: tuple[Array, Slopes], duration: float
    ) -> Float[Array, " d"]:
        """Derivative of the energy by the variables."""
        tau, slopes = torque
        _, by_torque, by_speed = self._rate(tau, states[1])
        weights = (self._quadrature * duration)[:, None]
        by_states = [np.einsum("ti,tij->tj", by_torque, slope) for slope in slopes]
        by_states[1] += by_speed
        return self._scatter([weights * slope for slope in by_states], duration)

    def _energy_kinks(
        self, states: States, torque: tuple[Array, Slopes], duration: float
    ) -> Float[Array, "r d"]:
        """Rows whose squares bend the energy where power or speed changes its sign."""
        weights = (self._quadrature * duration)[:, None]
        kinks = find_kinks(self._model, states[1], torque, self.problem.metric, self.power)
        rows = [np.zeros((0, self.size))]
        for nodes, by_states in kinks:
            roots = np.sqrt(weights[nodes])
            local = [roots * slope for slope in by_states]
            rows.append(self._node_rows(nodes, local, states, duration))
        return np.concatenate(rows)

    def clearance_rows(self, x: Float[Array, " d"]) -> ConstraintRows:
        """Clearance of the nearest pairs at the watched places, to first order."""
        scene = self.problem.scene
        if len(scene.pairs) == 0:
            return ConstraintRows.none(self.size)
        coefficients = self.split(x)[0]
        even = (np.arange(PLACES) + 0.5) / PLACES
        dips = find_dips(even, self._gaps(coefficients, even), NEAR)
        if len(dips[0]) == 0:
            return ConstraintRows.none(self.size)
        shares, pairs, gaps = self._nearest(coefficients, dips)
        q = self.grid.positions(coefficients, shares)
        slopes = scene.gradients(q, pairs)
        still = np.zeros_like(slopes)
        bases, first = self.grid.at(shares)
        matrix = self._rows(bases, first, [-slopes / CLEARANCE_UNIT, still, still])
        # Half of what is asked for beyond the margin is let pass by `look`: were it wanted back
        # here, a step would promise what it can't bring.
        room = np.maximum(gaps - self._extra, np.minimum(gaps - 0.5 * self._extra, 0.0))
        return ConstraintRows(matrix, room / CLEARANCE_UNIT)

    def _gaps(
        self,
        coefficients: Float[Array, "C n"],
        shares: Float[Array, " m"],
        wanted: Array | None = None,
    ) -> Float[Array, "m P"]:
        """What pairs keep beyond their margins at some places, all of them or those wanted [m]."""
        far = self.problem.limits.clearance + NEAR
        q = self.grid.positions(coefficients, shares)
        return self.problem.scene.gaps(q, far, wanted) - self.problem.margins

    def _nearest(self, coefficients: Float[Array, "C n"], dips: Dips) -> Dips:
        """Dips looked at ever more closely, and of all of these the nearest, in order of place."""
        # Between two places the arm moves by centimetres: a dip's bottom has to be watched.
        pair_count = len(self.problem.scene.pairs)
        watched = [dips]
        spacing = 1.0 / PLACES
        for close in CLOSE:
            shares, pairs, gaps = watched[-1]
            deep = np.flatnonzero(gaps < close)
            if len(deep) == 0:
                break
            nearby = spacing * np.arange(-CLOSER, CLOSER + 1) / CLOSER
            windows = np.clip(shares[deep][:, None] + nearby, 0.0, 1.0)
            windows = np.round(windows, 12)
            closer, place = np.unique(windows, return_inverse=True)
            wanted = np.zeros((len(closer), pair_count), dtype=bool)
            wanted[place.reshape(windows.shape), pairs[deep][:, None]] = True
            watched.append(find_dips(closer, self._gaps(coefficients, closer, wanted), NEAR))
            spacing /= CLOSER
        shares, pairs, gaps = (np.concatenate(each) for each in zip(*watched, strict=True))
        order = np.argsort(gaps)[:MOST_NEAR]
        order = order[np.argsort(shares[order])]  # pairs at one place share the arm's position
        return shares[order], pairs[order], gaps[order]

    def rule_rows(self, x: Float[Array, " d"]) -> ConstraintRows:
        """What the way has to keep, to first order: all along, and where via points are passed."""
        none = ConstraintRows.none(self.size)
        rules = self.problem.rules
        if rules is None:
            return none
        coefficients, duration = self.split(x)
        states = self.grid.states(coefficients, duration)
        along = [self._rule_row(row, states, duration) for row in rules.rows(*states[:2])]
        return ConstraintRows.join([none, *along, *self._via_rows(rules, states, duration)])

    def _rule_row(self, row: RuleRow, states: States, duration: float) -> ConstraintRows:
        """A rule that holds at every instant, where it is nearly broken."""
        nodes = np.flatnonzero(row.excess > -WATCHED_RULE)
        if row.sparse:
            nodes = nodes[nodes % 2 == 0]
        by_position = row.by_position[nodes] / row.unit
        still = np.zeros_like(by_position)
        by_speed = still if row.by_speed is None else row.by_speed[nodes] / row.unit
        matrix = self._node_rows(nodes, [by_position, by_speed, still], states, duration)
        return ConstraintRows(matrix, -row.excess[nodes])

    def _via_rows(self, rules: Rules, states: States, duration: float) -> list[ConstraintRows]:
        """Via points, each at the node that is to pass it."""
        if not rules.rules.vias:
            return []
        q, dq, _ = states
        rows = []
        for number, node in enumerate(rules.when_passed(q)):
            excess, slopes = rules.via_rows(number, q[node], dq[node])
            nodes = np.full(len(excess), node)
            still = np.zeros_like(slopes)
            matrix = self._node_rows(nodes, [slopes, still, still], states, duration)
            rows.append(ConstraintRows(matrix, -excess))
        return rows

    @cached_property
    def _model(self) -> ChainTorque:
        """The torque with the sign of the speed rounded."""
        return rounded(self.problem.model, self.width)

    @cached_property
    def _extra(self) -> float:
        """Clearance asked for beyond the margin [m]."""
        return EXTRA if self.problem.limits.clearance > 0 else 0.0

    @cached_property
    def _quadrature(self) -> Float[Array, " T"]:
        """Weights of all nodes, as shares of the duration."""
        return (np.diff(self.grid.knots)[:, None] * self.weights).reshape(-1)

    @cached_property
    def _torque_limit(self) -> Float[Array, "T n"]:
        """Torque that is aimed at, at every node [N m]."""
        aims = SHARE * self.torque_aim * self.problem.limits.torque
        return np.repeat(aims, len(self.grid.nodes), axis=0)

    @cached_property
    def _rate_limits(self) -> list[tuple[int, Float[Array, " n"]]]:
        """Limits of speed, acceleration and jerk where there are any, by order of derivative."""
        limits = self.problem.limits
        ordered = [(1, SHARE * self.speed_aim * limits.speed)]
        for order, limit in ((2, limits.acceleration), (JERK, limits.jerk)):
            if limit is not None:
                ordered.append((order, SHARE * limit))
        return ordered

    def _rate(self, tau: Array, dq: Array) -> tuple[Array, Array, Array]:
        """What is integrated, summed over the joints, and its derivatives by torque and speed."""
        metric = self.problem.metric
        if metric == "copper":
            return (tau * tau).sum(axis=1), 2.0 * tau, np.zeros_like(dq)
        power = tau * dq
        if metric == "signed":
            return power.sum(axis=1), dq, tau
        root = np.sqrt(power * power + self.power**2)
        slope = power / root
        value = root - self.power
        if metric == "positive":
            value = 0.5 * (power + value)
            slope = 0.5 * (1.0 + slope)
        return value.sum(axis=1), slope * dq, slope * tau

    def _scatter(self, by_states: Sequence[Array], duration: float) -> Float[Array, " d"]:
        """Sums derivatives by the nodes' states into derivatives by the coefficients."""
        slopes = np.zeros((self.grid.sections + DEGREE, self.n))
        for order, slope in enumerate(by_states):
            slopes += self._designs[order].T @ slope / duration**order
        return slopes[self.grid.held : -self.grid.held].reshape(-1)

    @cached_property
    def _designs(self) -> Float[Array, "3 T C"]:
        """What each coefficient gives at each node: position and two derivatives by the share."""
        designs = np.zeros((3, len(self.grid.shares), self.grid.sections + DEGREE))
        rows = np.arange(len(self.grid.shares))[:, None]
        designs[:, rows, self.grid.first[:, None] + ACTING] = self.grid.bases[:3]
        return designs

    def _near_torque_rows(self, about: Linearisation) -> ConstraintRows:
        """Torque at the nodes where it is near its limit."""
        share = about.torque[0] / self._torque_limit
        nodes, joints = np.nonzero(np.abs(share) > WATCHED_SHARE)
        return self._torque_rows(about, nodes, joints, np.sign(share[nodes, joints]))

    def _torque_rows(
        self,
        about: Linearisation,
        nodes: Int[Array, " r"],
        joints: Int[Array, " r"],
        signs: Float[Array, " r"],
    ) -> ConstraintRows:
        """Torque of some joints at some nodes, against the limit of the given sign."""
        tau, slopes = about.torque
        limit = signs * self._torque_limit[nodes, joints]
        local = [slope[nodes, joints] / limit[:, None] for slope in slopes]
        matrix = self._node_rows(nodes, local, about.states, about.duration)
        return ConstraintRows(matrix, 1.0 - tau[nodes, joints] / limit)

    def _turn_rows(
        self, coefficients: Float[Array, "C n"], states: States, duration: float
    ) -> ConstraintRows:
        """Torque where joints turn round, friction fully there on either side."""
        model = self.problem.model
        turns, at_turns, first = self._turns(coefficients, *states[1:], duration)
        tau = np.abs(turns.torque(model, at_turns))
        near = tau > WATCHED_SHARE * self._turn_limit(turns, first)
        if not near.any():
            return ConstraintRows.none(self.size)
        turns = turns.only(near)
        first = first[near]
        q, dq, ddq = (state[near] for state in at_turns)
        jerk = self.grid.jerk(coefficients, duration)[first]
        tau, slopes = turns.gradient(model, (q, dq, ddq), jerk)
        limit = self._turn_limit(turns, first)
        signs = (np.sign(tau) / limit)[:, None]
        bases, first = self.grid.at(turns.shares)
        matrix = self._rows(
            bases, first, [slope * signs for slope in slopes], (q, dq, ddq), duration
        )
        return ConstraintRows(matrix, 1.0 - np.abs(tau) / limit)

    def _turns(
        self, coefficients: Float[Array, "C n"], dq: Array, ddq: Array, duration: float
    ) -> tuple[Reversals, States, Int[Array, " m"]]:
        """Reversals, the states there, and their sections.

        None that are so slow that the nodes see friction come and go. A joint that waits may creep
        either way: were each crossing of zero a turn with friction fully there, a step that changes
        next to nothing would pass a limit by all of it, and no step would be allowed.
        """
        turns = find_turns(self.grid.shares, dq, ddq).settled(self.grid, coefficients, duration)
        first = sections_of(turns.shares, self.grid.knots)
        q, dq, ddq = self.grid.states(coefficients, duration, turns.shares)
        acceleration = np.abs(ddq[turns.rows, turns.joints])
        gained = acceleration * duration / len(self.grid.shares)  # between two nodes
        width = self.problem.model.losses.transition_speed[turns.joints]
        fast = ~turns.inside | (gained >= FULLY * width)
        return turns.only(fast), (q[fast], dq[fast], ddq[fast]), first[fast]

    def _turn_limit(self, turns: Reversals, first: Int[Array, " m"]) -> Float[Array, " m"]:
        """Torque that is aimed at where joints turn round [N m]."""
        aims = self.torque_aim * self.problem.limits.torque
        limit: Array = SHARE * aims[first, turns.joints]
        return limit

    def _kinematic_rows(
        self, coefficients: Float[Array, "C n"], states: States, duration: float
    ) -> list[ConstraintRows]:
        """Position, speed and acceleration at the nodes, and jerk section by section."""
        limits = self.problem.limits
        q = states[0]
        ones = np.ones_like(q)
        each = len(self.grid.nodes)
        jerk = np.repeat(self.grid.jerk(coefficients, duration), each, axis=0)
        rates = (*states, jerk)
        sets = []
        for room, slope in ((limits.upper - q, ones), (q - limits.lower, -ones)):
            sets.append(self._rate_rows(0, room, slope, WATCHED_ANGLE, rates, duration))
        for order, limit in self._rate_limits:
            share = rates[order] / limit
            room = 1.0 - np.abs(share)
            slope = np.sign(share) / limit
            watched = WATCHED_SHARE * (SOONER if order == JERK else 1.0)
            sets.append(self._rate_rows(order, room, slope, 1.0 - watched, rates, duration))
        return sets

    def _rate_rows(
        self,
        order: int,
        room: Float[Array, "T n"],
        slope: Float[Array, "T n"],
        near: float,
        rates: Sequence[Array],
        duration: float,
    ) -> ConstraintRows:
        """A limit of a derivative of the position, where less room is left than what is near."""
        is_near = room < near
        if order == JERK:  # the same all along a section
            is_first = np.arange(len(room)) % len(self.grid.nodes) == 0
            is_near &= is_first[:, None]
        nodes, joints = np.nonzero(is_near)
        by_rate = np.eye(self.n)[joints] * slope[nodes, joints][:, None]
        local = [np.zeros_like(by_rate)] * order + [by_rate]
        matrix = self._node_rows(nodes, local, rates, duration)
        return ConstraintRows(matrix, room[nodes, joints])

    def _node_rows(
        self,
        nodes: Int[Array, " r"],
        local: Sequence[Array],
        states: Sequence[Array],
        duration: float,
    ) -> Float[Array, "r d"]:
        """Rows from derivatives by the states at some nodes."""
        bases = self.grid.bases[:, nodes]
        first = self.grid.first[nodes]
        return self._rows(bases, first, local, [state[nodes] for state in states], duration)

    def _rows(
        self,
        bases: Float[Array, "4 r 4"],
        first: Int[Array, " r"],
        local: Sequence[Array],
        states: Sequence[Array] | None = None,
        duration: float = 1.0,
    ) -> Float[Array, "r d"]:
        """Rows from derivatives by the states at some places.

        By the four coefficients that act there, and by the time.
        """
        count = self.grid.free * self.n
        wide = (DEGREE + 1) * self.n
        values = np.zeros((len(first), DEGREE + 1, self.n))
        for order, slope in enumerate(local):
            values += bases[order][:, :, None] * slope[:, None, :] / duration**order
        which = first[:, None] + ACTING - self.grid.held
        columns = which[:, :, None] * self.n + np.arange(self.n)
        columns = columns.reshape(-1, wide)
        # Columns of held coefficients fall away; no column stands twice in a row.
        inside = (columns >= 0) & (columns < count)
        padded = np.zeros((len(columns), count + 1))
        rows = np.arange(len(columns))[:, None]
        padded[rows, np.where(inside, columns, count)] = values.reshape(-1, wide)
        matrix = padded[:, :count]
        if not self.timed:
            return matrix
        by_time = np.zeros(len(first))
        if states is not None:
            for order in range(1, len(local)):
                change = order * (local[order] * states[order]).sum(axis=1)
                by_time -= change * self.reference / duration
        return np.concatenate([matrix, by_time[:, None]], axis=1)
