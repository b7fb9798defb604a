"""PlanningProblem: what is to be found, its limits, and how good a batch of candidates is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from ident.arrays import Array, Bool, Float, freeze
from ident.model.training_range import TrainingRange
from plan.dynamics.power import ChainTorque, Metric, power_integral, section_nodes
from plan.geometry.clearance_proof import find_margins
from plan.geometry.scene import Scene
from plan.problem.cost import plan_cost
from plan.problem.rule_values import Rules
from plan.problem.rules import WayRules
from plan.spline import Splines

Objective = Literal["energy", "time"]
Free = Literal["vias", "times", "both"]
OBJECTIVES: tuple[Objective, ...] = get_args(Objective)
FREE: tuple[Free, ...] = get_args(Free)

# Limits are kept to this share during the search: torque is sampled there, and checked densely
# afterwards.
SHARE = 0.998
# A sum of broken limits up to this counts as none: a millionth of a limit, or 20 nm.
TOLERANCE = 1e-6
# The search stays this far inside the position limits [rad], so that what the tolerance lets pass
# is inside too.
INSIDE = 0.999 * TOLERANCE
# Section durations may shrink to this share of the initial ones, or grow to its inverse.
SQUEEZE = 0.05
# Local times at which torque is looked at where time is the objective, and torque the limit.
TIME_NODES = np.linspace(0.0, 1.0, 25)
# A motion with a jerk limit may start with the acceleration that the limit builds within this time,
# a controller's [s].
TICK = 1e-3
NO_RULES = WayRules()
# What limits of speed and acceleration may keep a motion inside of.
TRAINING = "the model's training"
ADVICE = "the maker's advice"
# Label of the paper's initial trajectory.
STRAIGHT = "straight"


@dataclass(frozen=True, eq=False)
class Limits:
    """What the motion has to keep."""

    lower: Float[Array, " n"]  # position limits [rad]
    upper: Float[Array, " n"]
    speed: Float[Array, " n"]  # speed limits [rad/s]
    torque: Float[Array, " n"]  # torque that may be used [N m]
    clearance: float  # smallest distance to keep [m]
    # Limits of acceleration [rad/s²] and jerk [rad/s³]; None where there is none. A motion with a
    # jerk limit starts and ends without acceleration.
    acceleration: Float[Array, " n"] | None = None
    jerk: Float[Array, " n"] | None = None
    # What was set aside of the torque limits because the model's torque is no better known [N m];
    # None for nothing.
    reserve: Float[Array, " n"] | None = None

    def __post_init__(self) -> None:
        for name in ("lower", "upper", "speed", "torque", "acceleration", "jerk", "reserve"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, freeze(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class BatchEvaluation:
    """What a batch of candidates costs and breaks."""

    cost: Float[Array, " B"]  # energy by the metric [J] or duration [s]
    # Shortfall of the clearance, in units of 2 cm (mean over time) and 5 cm (worst).
    collision: Float[Array, " B"]
    # Worst excess over the limit, as a share of it; speed's holds that of acceleration and jerk
    # too, and of the way's rules.
    speed: Float[Array, " B"]
    torque: Float[Array, " B"]
    position: Float[Array, " B"]  # worst excess over the position limits [rad]
    # Smallest separation seen; of a pair that may be nearer than others, counted as more by that
    # [m].
    gap: Float[Array, " B"]
    peak: Float[Array, "B n"]  # peak torque of each joint [N m]

    @property
    def violation(self) -> Float[Array, " B"]:
        """Sum of all that is broken; zero where nothing is."""
        return self.collision + self.speed + self.torque + self.position

    @property
    def feasible(self) -> Bool[Array, " B"]:
        """Whether nothing is broken."""
        return self.violation <= TOLERANCE


@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """One search: from one initial trajectory, over its via points, its section durations, or both.

    The decision vector holds the V·n via angles [rad], if free, then V + 1 numbers for the
    durations, if free: their logarithms for the time objective, and logarithms of shares of the
    fixed whole for the energy objective.
    """

    scene: Scene  # boxes and pairs
    model: ChainTorque
    limits: Limits
    start: Float[Array, " n"]  # ends of the motion [rad]
    goal: Float[Array, " n"]
    vias: Float[Array, "V n"]  # initial via points [rad]
    durations: Float[Array, " S"]  # initial section durations [s]
    objective: Objective = "energy"  # `energy` at fixed whole duration, or `time`
    metric: Metric = "absolute"  # how energy is counted
    free: Free = "vias"  # what is searched
    radius: float = np.pi / 2  # how far a via angle may go from the initial one [rad]
    label: str = STRAIGHT  # where the initial trajectory comes from
    # Whether a planner may insert via points and move stamps beyond what is named free.
    grows: bool = True
    trained: TrainingRange | None = None  # where the model was fitted; None where that is not known
    # What the arm carries, and the frame on which each of it hangs, for results.
    carried: tuple[dict[str, object], ...] = ()
    way: WayRules = NO_RULES  # what the motion has to keep on its way beside limits and clearance
    notes: tuple[str, ...] = ()  # what is to be said of the task in its result
    # Longest duration where it is free and energy is the objective [s]; None where it is fixed, or
    # time the objective.
    longest: float | None = None
    standby: float = 0.0  # power that the cell takes all the while [W]
    # What its limits keep it inside of, in words; nothing where they are the arm's own.
    known: str = ""
    # Joints that the robot itself locks, such as a gripper's: no controller of the arm has them.
    not_the_arms: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        for name in ("start", "goal", "vias", "durations"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.start)

    @property
    def via_count(self) -> int:
        """Number of via points V."""
        return len(self.vias)

    @property
    def dimension(self) -> int:
        """Length of the decision vector."""
        return len(self.initial)

    @property
    def searches_vias(self) -> bool:
        """Whether via angles are free."""
        return self.free in ("vias", "both")

    @property
    def searches_times(self) -> bool:
        """Whether section durations are free."""
        return self.free in ("times", "both")

    @cached_property
    def initial(self) -> Float[Array, " d"]:
        """Decision vector of the initial trajectory."""
        return freeze(self.encode(self.vias, self.durations))

    @cached_property
    def lower(self) -> Float[Array, " d"]:
        """Lower bounds of the decision vector."""
        vias = np.maximum(self.vias - self.radius, self.limits.lower)
        return freeze(self._join(vias, np.log(self.durations * SQUEEZE)))

    @cached_property
    def upper(self) -> Float[Array, " d"]:
        """Upper bounds of the decision vector."""
        vias = np.minimum(self.vias + self.radius, self.limits.upper)
        return freeze(self._join(vias, np.log(self.durations / SQUEEZE)))

    def encode(
        self, vias: Float[Array, "V n"], durations: Float[Array, " S"]
    ) -> Float[Array, " d"]:
        """Decision vector of a trajectory."""
        return self._join(np.asarray(vias), np.log(durations))

    def decode(self, x: Float[Array, "B d"]) -> Splines:
        """Trajectories of a batch of decision vectors, which are clipped to their bounds."""
        x = np.clip(np.atleast_2d(x), self.lower, self.upper)
        batch = len(x)
        split = self.via_count * self.n if self.searches_vias else 0
        vias = (
            x[:, :split].reshape(batch, -1, self.n)
            if self.searches_vias
            else np.repeat(self.vias[None], batch, 0)
        )
        ends = [np.broadcast_to(end, (batch, 1, self.n)) for end in (self.start, self.goal)]
        durations = (
            np.exp(x[:, split:])
            if self.searches_times
            else np.repeat(self.durations[None], batch, 0)
        )
        if self.objective == "energy":
            durations = durations * (self.durations.sum() / durations.sum(axis=1, keepdims=True))
        return Splines(np.concatenate([ends[0], vias, ends[1]], axis=1), durations)

    def evaluate(self, x: Float[Array, "B d"]) -> BatchEvaluation:
        """Cost and broken limits of a batch of decision vectors."""
        splines = self.decode(x)
        limits = self.limits
        s, w = (
            section_nodes()
            if self.objective == "energy"
            else (TIME_NODES, np.zeros(len(TIME_NODES)))
        )
        q, dq, ddq = splines.states(s)
        tau = self.model.torque(q, dq, ddq)
        weights = (splines.durations[:, :, None] * w).reshape(len(q), -1)
        cost = plan_cost(
            self.objective, splines.total, lambda: power_integral(tau, dq, weights, self.metric)
        )
        peak = np.abs(tau).max(axis=1)
        clearance, shortfall = self.scene.sweep(splines, self.margins)
        over = (
            np.maximum(splines.highest - limits.upper, limits.lower - splines.lowest).max(axis=1)
            + INSIDE
        )
        rates = _excess(splines.top_speed / (SHARE * limits.speed))
        if limits.acceleration is not None:  # exact: a cubic's acceleration is linear
            rates = np.maximum(
                rates, _excess(splines.top_acceleration / (SHARE * limits.acceleration))
            )
        if limits.jerk is not None:
            ends = splines.end_acceleration / (TICK * limits.jerk)
            rates = np.maximum(
                rates, _excess(np.maximum(splines.top_jerk / (SHARE * limits.jerk), ends))
            )
        if self.rules is not None:
            rates = rates + [
                self.rules.excess(*way, aimed=False) for way in zip(q, dq, strict=True)
            ]
        return BatchEvaluation(
            cost=cost,
            collision=shortfall / 0.02 + np.maximum(-clearance, 0.0) / 0.05,
            speed=rates,
            torque=_excess(peak / (SHARE * limits.torque)),
            position=np.maximum(over, 0.0),
            gap=clearance + limits.clearance,
            peak=peak,
        )

    @property
    def held(self) -> dict[str, float]:
        """Positions of the arm's joints that stand still [rad or m]."""
        return {k: q for k, q in self.scene.arm.locked_joints.items() if k not in self.not_the_arms}

    def with_ends(self, vias: Float[Array, "V n"]) -> Float[Array, "K n"]:
        """Start, via points and goal [rad]."""
        return np.concatenate([[self.start], vias, [self.goal]])

    @property
    def ends(self) -> Float[Array, "2 n"]:
        """Start and goal [rad]."""
        return np.stack([self.start, self.goal])

    @cached_property
    def rules(self) -> Rules | None:
        """What the way has to keep, for this start and goal; None where nothing is asked for."""
        if not self.way.given:
            return None
        return Rules(self.scene.arm, self.way, self.start, self.goal)

    @cached_property
    def margins(self) -> Float[Array, " P"]:
        """Gap that each pair has to keep in a search [m]."""
        return find_margins(self.scene, self.ends, self.limits.clearance)

    @cached_property
    def initial_evaluation(self) -> BatchEvaluation:
        """The initial trajectory's evaluation."""
        return self.evaluate(self.initial[None])

    @property
    def scale(self) -> float:
        """Cost of the initial trajectory, by which rewards and penalties are measured."""
        return max(float(np.abs(self.initial_evaluation.cost[0])), 1e-9)

    def penalised(self, evaluation: BatchEvaluation) -> Float[Array, " B"]:
        """One number to minimise.

        Cost as a share of the initial one, and a penalty for what is broken.
        """
        broken = evaluation.violation
        return (
            evaluation.cost / self.scale
            + np.minimum(3.0 * broken, 20.0)
            + 0.3 * (broken > TOLERANCE)
        )

    def with_initial(self, splines: Splines, **changes: object) -> PlanningProblem:
        """The problem started from another trajectory, the first of a batch.

        Args:
            splines: Its via points and durations are taken.
            changes: Other fields of the problem.
        """
        return replace(
            self,
            vias=splines.points[0, 1:-1],
            durations=splines.durations[0],
            **changes,  # type: ignore[arg-type]
        )

    def _join(self, vias: Array, logarithms: Array) -> Array:
        parts = [vias.reshape(-1)] if self.searches_vias else []
        return np.concatenate([*parts, logarithms] if self.searches_times else parts)


def _excess(ratio: Float[Array, "B n"]) -> Float[Array, " B"]:
    return np.maximum(ratio.max(axis=1) - 1.0, 0.0)
