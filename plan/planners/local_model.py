"""Cost, limits and clearance of one trajectory, and their derivatives by its coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float, Int
from plan.dynamics.power import ChainTorque, Slopes, differentiate_torque, find_kinks, rounded
from plan.planners.subproblem import ConstraintRows
from plan.planners.transcription import DEGREE, Grid, sections_of
from plan.planners.velocity_reversals import FULLY, Turns, find_dips, find_turns
from plan.problem.problem import SHARE, PlanningProblem
from plan.spline import Splines

# Only what has come this near to its limit is watched while a step is looked for [-].
WATCHED_SHARE = 0.6
# Pairs closer than this are watched [m]; at most so many of their places at a time, the nearest ones.
NEAR, MOST_NEAR = 0.06, 90
# Places along a motion at which all pairs are looked at; where a gap dips to within so much of the margin [m], it is
# looked at more closely, at so many places to either side of it, and once more in the same way: past an edge a gap
# falls and rises by half a millimetre within a five-hundredth of a motion.
PLACES, CLOSE, CLOSER = 64, (0.03, 0.005), 8
# Rules of the way that are broken by less than minus so many units are not watched.
WATCHED_RULE = 0.5
# Unit of the clearance's shortfall [m].
CLEARANCE_UNIT = 0.1
# Clearance asked for beyond the margin, for what happens between the watched places [m].
EXTRA = 5e-4


@dataclass(frozen=True, eq=False)
class Look:
    """What a trajectory costs and breaks, as a local search sees it."""

    cost: float  # energy [J] or duration [s], rounded as the search rounds it
    limits: float  # largest excess over a limit, as a share of it
    clearance: float  # shortfall of the clearance, in units of 10 cm
    rules: float = 0.0  # largest excess of a rule of the way, in units of 10 cm, a tenth of a radian, or a limit

    @property
    def broken(self) -> float:
        """Sum of what is broken."""
        return self.limits + self.clearance + self.rules

    def merit(self, weights: Float[Array, " 3"], scale: float) -> float:
        """One number to bring down."""
        return float(self.cost / scale + weights @ [self.limits, self.clearance, self.rules])


@dataclass(frozen=True, eq=False)
class LocalModel:
    """A task on one grid of coefficients.

    The variables are the free coefficients, coefficient by coefficient, and for the time objective the duration as a
    share of the task's own.
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
    def bounds(self) -> tuple[Float[Array, " d"], Float[Array, " d"]]:
        """Bounds of the variables: position limits, and no farther from the ends and the via points than the reach."""
        problem, count = self.problem, self.grid.free
        points = problem.with_ends(problem.vias)
        low = np.tile(np.maximum(points.min(axis=0) - problem.radius, problem.limits.lower), count)
        high = np.tile(np.minimum(points.max(axis=0) + problem.radius, problem.limits.upper), count)
        return (np.append(low, 0.02), np.append(high, 50.0)) if self.timed else (low, high)

    def join(self, free: Float[Array, "F n"], duration: float) -> Float[Array, " d"]:
        """Variables of coefficients and a duration."""
        return np.append(free.reshape(-1), duration / self.reference) if self.timed else free.reshape(-1).copy()

    def split(self, x: Float[Array, " d"]) -> tuple[Float[Array, "C n"], float]:
        """All coefficients and the duration [s]."""
        count = self.grid.free * self.n
        duration = float(x[count]) * self.reference if self.timed else self.reference
        return self.grid.coefficients(x[:count].reshape(-1, self.n), self.problem.start, self.problem.goal), duration

    def splines(self, x: Float[Array, " d"]) -> Splines:
        """The trajectory."""
        return self.grid.splines(*self.split(x))

    def look(self, x: Float[Array, " d"]) -> Look:
        """What a trajectory costs and breaks."""
        coefficients, duration = self.split(x)
        q, dq, ddq = self.grid.states(coefficients, duration)
        tau = self._model.torque(q[None], dq[None], ddq[None])[0]
        cost = duration if self.timed else float(self._quadrature * duration @ self._rate(tau, dq)[0])
        turns, at_turns, first = self._turns(coefficients, dq, ddq, duration)
        at_turn = np.abs(turns.torque(self.problem.model, at_turns)) / self._turn_limit(turns, first)
        rates, limits = (q, dq, ddq, self.grid.jerk(coefficients, duration)), self.problem.limits
        shares = [np.abs(tau) / self._torque_limit, at_turn]
        shares += [np.abs(rates[order]) / limit for order, limit in self._rate_limits]
        outside = max(float((q - limits.upper).max()), float((limits.lower - q).max()))
        excess = max(outside, *(float(share.max()) - 1.0 for share in shares), 0.0)
        rules = 0.0 if self.problem.rules is None else self.problem.rules.excess(q, dq)
        shortfall = 0.0
        if len(self.problem.scene.pairs):
            splines = self.grid.splines(coefficients, duration)
            left = float(self.problem.scene.sweep(splines, self.problem.margins)[0][0])
            shortfall = max(0.5 * self._extra - left, 0.0) / CLEARANCE_UNIT
        return Look(cost, excess, shortfall, rules)

    def gradient(self, x: Float[Array, " d"]) -> tuple[Float[Array, " d"], Float[Array, "d d"], ConstraintRows]:
        """Derivative of the cost, how its kinks bend it there, and the limits that are near, to first order."""
        coefficients, duration = self.split(x)
        states = self.grid.states(coefficients, duration)
        found = differentiate_torque(self._model, *states)
        slope, bent = np.zeros(self.size), np.zeros((0, self.size))
        if self.timed:
            slope[-1] = self.reference
        else:
            _, by_tau, by_speed = self._rate(found[0], states[1])
            w = (self._quadrature * duration)[:, None]
            kinks = find_kinks(self._model, states[1], found, self.problem.metric, self.power)
            rows = [self._node_rows(at, [np.sqrt(w[at]) * p for p in by], states, duration) for at, by in kinks]
            bent = np.concatenate([bent, *rows])
            parts = [np.einsum("ti,tij->tj", by_tau, part) for part in found[1]]
            parts[1] += by_speed
            slope = self._scatter([w * part for part in parts], duration)
        torque = [self._torque_rows(states, found, duration), self._turn_rows(coefficients, states, duration)]
        return (
            slope,
            bent.T @ bent,
            ConstraintRows.join([*torque, *self._kinematic_rows(coefficients, states, duration)]),
        )

    def clearance_rows(self, x: Float[Array, " d"]) -> ConstraintRows:
        """Clearance of the nearest pairs at the watched places, to first order."""
        scene = self.problem.scene
        if len(scene.pairs) == 0:
            return ConstraintRows.none(self.size)
        coefficients = self.split(x)[0]
        even = (np.arange(PLACES) + 0.5) / PLACES
        margins, far = self.problem.margins, self.problem.limits.clearance + NEAR
        gaps = scene.gaps(self.grid.positions(coefficients, even), far) - margins
        shares, pairs, found = find_dips(even, gaps, NEAR)
        if len(shares) == 0:
            return ConstraintRows.none(self.size)
        watched, spacing = [(shares, pairs, found)], 1.0 / PLACES
        for close in CLOSE:
            # Between two places the arm moves by centimetres: each dip is looked at more closely, its bottom watched.
            dips = np.flatnonzero(watched[-1][2] < close)
            if len(dips) == 0:
                break
            shares, pairs, _ = (each[dips] for each in watched[-1])
            nearby = spacing * np.arange(-CLOSER, CLOSER + 1) / CLOSER
            windows = np.round(np.clip(shares[:, None] + nearby, 0.0, 1.0), 12)
            closer, place = np.unique(windows, return_inverse=True)
            wanted = np.zeros((len(closer), gaps.shape[1]), dtype=bool)
            wanted[place.reshape(windows.shape), pairs[:, None]] = True
            looked = scene.gaps(self.grid.positions(coefficients, closer), far, wanted) - margins
            watched.append(find_dips(closer, looked, NEAR))
            spacing /= CLOSER
        shares, pairs, found = (np.concatenate(each) for each in zip(*watched, strict=True))
        order = np.argsort(found)[:MOST_NEAR]
        order = order[np.argsort(shares[order])]  # pairs at one place share the arm's position
        shares, pairs, found = shares[order], pairs[order], found[order]
        q = self.grid.positions(coefficients, shares)
        slopes = scene.gradients(q, pairs)
        local = [-slopes / CLEARANCE_UNIT, np.zeros_like(slopes), np.zeros_like(slopes)]
        room = (found - self._extra) / CLEARANCE_UNIT
        return ConstraintRows(self._rows(*self.grid.at(shares), local), room)

    def rule_rows(self, x: Float[Array, " d"]) -> ConstraintRows:
        """What the way has to keep, to first order: all along, and where via points are passed."""
        rules, none = self.problem.rules, ConstraintRows.none(self.size)
        if rules is None:
            return none
        coefficients, duration = self.split(x)
        states, found = self.grid.states(coefficients, duration), [none]
        for row in rules.rows(*states[:2]):
            nodes = np.flatnonzero(row.excess > -WATCHED_RULE)
            nodes = nodes[nodes % 2 == 0] if row.sparse else nodes
            by_speed = np.zeros_like(row.by_position) if row.by_speed is None else row.by_speed
            local = [part[nodes] / row.unit for part in (row.by_position, by_speed)]
            local.append(np.zeros_like(local[0]))
            found.append(ConstraintRows(self._node_rows(nodes, local, states, duration), -row.excess[nodes]))
        for number, node in enumerate(rules.when_passed(states[0]) if rules.rules.vias else ()):
            excess, slopes = rules.via_rows(number, states[0][node], states[1][node])
            at, still = np.full(len(excess), node), np.zeros_like(slopes)
            found.append(ConstraintRows(self._node_rows(at, [slopes, still, still], states, duration), -excess))
        return ConstraintRows.join(found)

    # Parts of the above.

    @cached_property
    def _model(self) -> ChainTorque:
        return rounded(self.problem.model, self.width)

    @cached_property
    def _extra(self) -> float:
        return EXTRA if self.problem.limits.clearance > 0 else 0.0

    @cached_property
    def _quadrature(self) -> Float[Array, " T"]:
        return (np.diff(self.grid.knots)[:, None] * self.weights).reshape(-1)

    @cached_property
    def _torque_limit(self) -> Float[Array, "T n"]:
        return np.repeat(SHARE * self.torque_aim * self.problem.limits.torque, len(self.grid.nodes), axis=0)

    @cached_property
    def _rate_limits(self) -> list[tuple[int, Float[Array, " n"]]]:
        """Limits of speed, acceleration and jerk where there are any, each with the order of its derivative."""
        limits = self.problem.limits
        found = [(1, SHARE * self.speed_aim * limits.speed)]
        for order, limit in ((2, limits.acceleration), (3, limits.jerk)):
            found += [] if limit is None else [(order, SHARE * limit)]
        return found

    def _rate(self, tau: Array, dq: Array) -> tuple[Array, Array, Array]:
        """What is integrated, summed over the joints, and its derivatives by torque and speed."""
        metric, power = self.problem.metric, tau * dq
        if metric == "copper":
            return (tau * tau).sum(axis=1), 2.0 * tau, np.zeros_like(dq)
        if metric == "signed":
            return power.sum(axis=1), dq, tau
        root = np.sqrt(power * power + self.power**2)
        slope = power / root
        value = root - self.power
        if metric == "positive":
            value, slope = 0.5 * (power + value), 0.5 * (1.0 + slope)
        return value.sum(axis=1), slope * dq, slope * tau

    def _scatter(self, parts: list[Array], duration: float) -> Float[Array, " d"]:
        """Sums derivatives by the nodes' states into derivatives by the coefficients."""
        out = sum(
            design.T @ part / duration**order
            for order, (design, part) in enumerate(zip(self._designs, parts, strict=True))
        )
        return np.asarray(out)[self.grid.held : -self.grid.held].reshape(-1)

    @cached_property
    def _designs(self) -> Float[Array, "3 T C"]:
        """What each coefficient gives at each node: position, and its first and second derivative by the share."""
        out = np.zeros((3, len(self.grid.shares), self.grid.sections + DEGREE))
        rows = np.arange(len(self.grid.shares))[:, None]
        out[:, rows, self.grid.first[:, None] + np.arange(DEGREE + 1)] = self.grid.bases[:3]
        return out

    def _torque_rows(
        self, states: tuple[Array, Array, Array], found: tuple[Array, Slopes], duration: float
    ) -> ConstraintRows:
        share = found[0] / self._torque_limit
        nodes, joints = np.nonzero(np.abs(share) > WATCHED_SHARE)
        signs = np.sign(share[nodes, joints]) / self._torque_limit[nodes, joints]
        local = [part[nodes, joints] * signs[:, None] for part in found[1]]
        matrix = self._node_rows(nodes, local, states, duration)
        return ConstraintRows(matrix, 1.0 - np.abs(share[nodes, joints]))

    def _turn_rows(self, coefficients: Array, states: tuple[Array, Array, Array], duration: float) -> ConstraintRows:
        """Torque where joints turn round, friction fully there on either side."""
        turns, at, first = self._turns(coefficients, *states[1:], duration)
        near = np.abs(turns.torque(self.problem.model, at)) > WATCHED_SHARE * self._turn_limit(turns, first)
        if not near.any():
            return ConstraintRows.none(self.size)
        turns, at, first = turns.only(near), tuple(part[near] for part in at), first[near]
        tau, parts = turns.gradient(self.problem.model, at, self.grid.jerk(coefficients, duration)[first])
        limit = self._turn_limit(turns, first)
        local = [part * (np.sign(tau) / limit)[:, None] for part in parts]
        bases, first = self.grid.at(turns.shares)
        return ConstraintRows(self._rows(bases, first, local, list(at), duration), 1.0 - np.abs(tau) / limit)

    def _turns(
        self, coefficients: Array, dq: Array, ddq: Array, duration: float
    ) -> tuple[Turns, tuple[Array, Array, Array], Int[Array, " m"]]:
        """Turns, the states there, and their sections; none that are so slow that the nodes see friction come and go.

        A joint that waits may creep either way: were each crossing of zero a turn with friction fully there, a step
        that changes next to nothing would pass a limit by all of it, and no step would be allowed.
        """
        turns = find_turns(self.grid.shares, dq, ddq).settled(self.grid, coefficients, duration)
        at, first = self.grid.states(coefficients, duration, turns.shares), sections_of(turns.shares, self.grid.knots)
        gained = np.abs(at[2][turns.rows, turns.joints]) * duration / len(self.grid.shares)
        fast = ~turns.inside | (gained >= FULLY * self.problem.model.losses.transition_speed[turns.joints])
        return turns.only(fast), (at[0][fast], at[1][fast], at[2][fast]), first[fast]

    def _turn_limit(self, turns: Turns, first: Int[Array, " m"]) -> Float[Array, " m"]:
        limit: Array = SHARE * (self.torque_aim * self.problem.limits.torque)[first, turns.joints]
        return limit

    def _kinematic_rows(
        self, coefficients: Array, states: tuple[Array, Array, Array], duration: float
    ) -> list[ConstraintRows]:
        """Position, speed and acceleration at the nodes, and jerk section by section."""
        limits, q, found, each = self.problem.limits, states[0], [], len(self.grid.nodes)
        ones = np.ones_like(q)
        wanted = [(0, limits.upper - q, ones, 0.5), (0, q - limits.lower, -ones, 0.5)]
        everything = [*states, np.repeat(self.grid.jerk(coefficients, duration), each, axis=0)]
        for order, limit in self._rate_limits:
            share, watched = everything[order] / limit, WATCHED_SHARE * (0.5 if order == 3 else 1.0)
            wanted.append((order, 1.0 - np.abs(share), np.sign(share) / limit, 1.0 - watched))
        for order, room, slope, near in wanted:
            one = np.arange(len(room)) % each == 0 if order == 3 else True  # jerk is the same all along a section
            nodes, joints = np.nonzero((room < near) & np.reshape(one, (-1, 1)))
            rows = np.eye(self.n)[joints] * slope[nodes, joints][:, None]
            local = [rows if k == order else np.zeros_like(rows) for k in range(order + 1)]
            found.append(ConstraintRows(self._node_rows(nodes, local, everything, duration), room[nodes, joints]))
        return found

    def _node_rows(
        self, nodes: Array, local: list[Array], states: Sequence[Array], duration: float
    ) -> Float[Array, "r d"]:
        """Rows from derivatives by the states at some nodes."""
        bases, first = self.grid.bases[:, nodes], self.grid.first[nodes]
        return self._rows(bases, first, local, [part[nodes] for part in states], duration)

    def _rows(
        self,
        bases: Float[Array, "4 r 4"],
        first: Int[Array, " r"],
        local: list[Array],
        states: list[Array] | None = None,
        duration: float = 1.0,
    ) -> Float[Array, "r d"]:
        """Rows from derivatives by the states at some places: by the four coefficients that act there, and the time."""
        at = np.zeros((len(first), DEGREE + 1, self.n))
        for order, part in enumerate(local):
            at += bases[order][:, :, None] * part[:, None, :] / duration**order
        which = first[:, None] + np.arange(DEGREE + 1) - self.grid.held
        columns = which[:, :, None] * self.n + np.arange(self.n)
        wide = (DEGREE + 1) * self.n
        # Columns of held coefficients fall away; no column stands twice in a row.
        count, columns = self.grid.free * self.n, columns.reshape(-1, wide)
        out = np.zeros((len(columns), count + 1))
        inside = (columns >= 0) & (columns < count)
        out[np.arange(len(columns))[:, None], np.where(inside, columns, count)] = at.reshape(-1, wide)
        matrix = out[:, :count]
        if not self.timed:
            return matrix
        by_time = np.zeros(len(first))
        if states is not None:
            for order in range(1, len(local)):
                by_time -= order * (local[order] * states[order]).sum(axis=1) * self.reference / duration
        return np.concatenate([matrix, by_time[:, None]], axis=1)
