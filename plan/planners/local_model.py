"""Cost and limits of one trajectory, and their derivatives by its coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float, Int
from plan.dynamics.power import ChainTorque, Slopes, differentiate_torque, find_kinks, rounded
from plan.planners.near_pairs import clearance_shortfall
from plan.planners.subproblem import ConstraintRows
from plan.planners.task_on_grid import TaskOnGrid
from plan.planners.transcription import States, sections_of
from plan.planners.velocity_reversals import FULLY, Reversals, find_turns
from plan.problem.problem import SHARE
from plan.problem.rule_values import RuleRow, Rules

# Only what has come this near to its limit is watched while a step is looked for [-].
WATCHED_SHARE = 0.6
# Jerk, which is steady in a section and jumps between two, is watched from this share of that on.
SOONER = 0.5
# Angles within this much of their limits are watched [rad].
WATCHED_ANGLE = 0.5
# Rules of the way that are broken by less than minus so many units are not watched.
WATCHED_RULE = 0.5
# Order of the derivative that jerk is.
JERK = 3


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
class LocalModel(TaskOnGrid):
    """Cost and limits of a task on one grid, and their derivatives by its variables."""

    weights: Float[Array, " m"]  # quadrature weights of one section's nodes
    width: float  # rounding of the friction's sign [rad/s]
    power: float  # rounding of the modulus of power [W]
    torque_aim: Float[Array, "K n"]  # shares of the limits that are aimed at, by section and joint
    speed_aim: Float[Array, " n"]

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
        return TrajectoryValues(
            cost, excess, clearance_shortfall(self, coefficients, duration), rule_excess
        )

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
        coefficients = about.coefficients
        duration = about.duration
        states = about.states
        torque = about.torque
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
        changes = self.changes(about.states, about.duration, step)
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
                matrix = self.node_rows(nodes, local, about.states, about.duration)
                sets.append(ConstraintRows(matrix, 1.0 - signs * share[nodes, joints]))
        return ConstraintRows.join(sets)

    def _energy_slope(
        self, states: States, torque: tuple[Array, Slopes], duration: float
    ) -> Float[Array, " d"]:
        """Derivative of the energy by the variables."""
        tau, slopes = torque
        _, by_torque, by_speed = self._rate(tau, states[1])
        weights = (self._quadrature * duration)[:, None]
        by_states = [np.einsum("ti,tij->tj", by_torque, slope) for slope in slopes]
        by_states[1] += by_speed
        return self.sum_over_nodes([weights * slope for slope in by_states], duration)

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
            rows.append(self.node_rows(nodes, local, states, duration))
        return np.concatenate(rows)

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
        matrix = self.node_rows(nodes, [by_position, by_speed, still], states, duration)
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
            matrix = self.node_rows(nodes, [slopes, still, still], states, duration)
            rows.append(ConstraintRows(matrix, -excess))
        return rows

    @cached_property
    def _model(self) -> ChainTorque:
        """The torque with the sign of the speed rounded."""
        return rounded(self.problem.model, self.width)

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
        matrix = self.node_rows(nodes, local, about.states, about.duration)
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
        matrix = self.rows_at(
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
        matrix = self.node_rows(nodes, local, rates, duration)
        return ConstraintRows(matrix, room[nodes, joints])
