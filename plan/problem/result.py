"""PlanResult: a plan that certifies itself, and `plan.result/1`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from ident.arrays import Array, Float
from ident.model.training_range import QUANTITIES, UNITS
from ident.records import Record, as_record
from ident.results import Result
from plan.dynamics.power import METRICS, Metric, power_integrals, section_nodes
from plan.geometry.clearance_proof import SHORT, Clearance, Cut, find_cuts, prove_clearance
from plan.geometry.scene import Scene
from plan.problem.controllers import Controller
from plan.problem.cost import plan_cost
from plan.problem.problem import TICK, PlanningProblem
from plan.problem.ramps import STANDING, TimeLaw, find_time_law, measure
from plan.problem.rule_values import RuleCheck
from plan.spline import Splines

SCHEMA = "plan.result/1"
Status = Literal["solved", "infeasible", "budget_spent"]
# A limit counts as kept up to this excess, as a share: rounding, not engineering.
ROUNDING = 1e-9
# Quadrature points a section of the certificate: friction that turns round inside a section needs
# many.
FINE = 200
# Places a section at which the certificate looks for peaks of torque; and, between two of them of
# which one passes a share of the limit, how many more: where a joint turns round, friction jumps
# within a millisecond.
DENSE = 400
NEAR_LIMIT = 0.96
CLOSER = 20
# Sections beyond which each has fewer of both, down to the least: those of a controller's ticks are
# as short as that.
MANY_SECTIONS = 48
LEAST_PLACES = (4, 12)
# What of a result stands in its record as it is, before and behind what the motion is.
HEAD = ("status", "reason", "robot", "joints", "held", "carried", "method", "objective", "metric")
REST = (
    "evaluations",
    "seconds",
    "cpu_seconds",
    "seed",
    "bound",
    "reference_gap",
    "starts",
    "notes",
    "provenance",
)
# Places of a section at which speeds are looked at for what is beyond the model's training; less
# than this share of the range beyond it is rounding.
PLACES = 65
NOTHING = 1e-6


@dataclass(frozen=True)
class Extrapolation(Record):
    """One quantity of one joint that a plan takes beyond the model's training."""

    joint: str  # of what
    quantity: str
    unit: str
    low: float  # bounds of the training
    high: float
    reached: float  # the worse of the plan's own bounds
    share: float  # how far it lies outside, as a share of the range's width

    def __str__(self) -> str:
        bounds = f"trained from {self.low:.3g} to {self.high:.3g}"
        return f"{self.quantity} of {self.joint} reaches {self.reached:.3g} {self.unit}, {bounds}"


def find_extrapolation(
    problem: PlanningProblem, splines: Splines
) -> tuple[Extrapolation, ...] | None:
    """What the first of a batch of plans takes beyond the training, the worst first.

    None where no range is known.
    """
    known = problem.trained
    if known is None:
        return None
    if float(splines.total[0]) > 0.0:
        _, dq, ddq = (state[0] for state in splines.states(np.linspace(0.0, 1.0, PLACES)))
        low = np.stack([splines.lowest[0], dq.min(axis=0), ddq.min(axis=0)])
        high = np.stack([splines.highest[0], dq.max(axis=0), ddq.max(axis=0)])
    else:
        low = high = np.stack([splines.points[0, 0], *np.zeros((2, problem.n))])
    held = np.zeros((3, len(known.joints) - problem.n))
    held[0] = [problem.scene.arm.locked_joints.get(name, 0.0) for name in known.joints[problem.n :]]
    low, high = (np.concatenate([part, held], axis=1) for part in (low, high))
    beyond = known.beyond(low, high)
    found = []
    for k, j in zip(*np.nonzero(beyond > NOTHING), strict=True):
        below = known.low[k, j] - low[k, j]
        above = high[k, j] - known.high[k, j]
        reached = low[k, j] if below > above else high[k, j]
        bounds = float(known.low[k, j]), float(known.high[k, j])
        share = float(beyond[k, j])
        found.append(
            Extrapolation(known.joints[j], QUANTITIES[k], UNITS[k], *bounds, float(reached), share)
        )
    return tuple(sorted(found, key=lambda one: -one.share))


@dataclass(frozen=True, eq=False)
class Certificate:
    """What a motion is, computed afresh and densely, not as the search saw it."""

    energy: dict[Metric, float]  # energy by every metric [J], and N² m² s for copper
    # Peak speed, acceleration, jerk and torque of each joint as a share of its limit; None without
    # a limit.
    shares: dict[str, Float[Array, " n"] | None]
    position_margin: float  # smallest distance to a position limit [rad]
    clearance: Clearance  # proven clearance, of all pairs but those that were cut
    asked_clearance: float  # clearance that the task asks for [m]
    # Pairs of links that are nearer to each other than that at an end, and the proven clearance of
    # each.
    cuts: tuple[tuple[Cut, Clearance], ...]
    # The shapes that were looked at, and the pairs of links of whose clearance nothing is said.
    scene: Scene
    time_law: TimeLaw  # how the motion is executed from rest to rest, and the limits on that
    # What goes beyond the model's training, the worst first; None where no range is known.
    extrapolation: tuple[Extrapolation, ...] | None
    # The curve of which all this is said: the plan's own, or what its controller makes of it.
    curve: Splines
    controller: Controller | None  # that controller; None where the plan is looked at by itself
    # Torque that was set aside because the model's is no better known [N m]; None for none.
    reserve: Float[Array, " n"] | None
    # Half of the 95 % interval of the executed motion's energy, from that of the model's torque
    # [J]; None where the model tells none, and for a motion beyond its training, of which it says
    # nothing.
    energy_half_width: float | None
    rules: tuple[RuleCheck, ...]  # what the way had to keep, and did

    @property
    def torque_share(self) -> Float[Array, " n"]:
        """Peak torque of each joint as a share of its limit."""
        return np.asarray(self.shares["torque"])

    @property
    def speed_share(self) -> Float[Array, " n"]:
        """Top speed of each joint as a share of its limit."""
        return np.asarray(self.shares["speed"])

    @property
    def broken(self) -> list[str]:
        """What the motion breaks, in words; empty if nothing."""
        found = []
        how = "" if self.controller is None else f" as {self.controller.name} executes it"
        for name, share in self.shares.items():
            for joint, value in enumerate([] if share is None else share, start=1):
                if value > 1.0 + ROUNDING:
                    found.append(
                        f"joint {joint} reaches {100 * value:.1f} % of its {name} limit{how}"
                    )
        if not found and max(self.time_law.shares) > 1.0 + ROUNDING:
            percent = 100 * max(self.time_law.shares)
            found.append(f"started from rest it reaches {percent:.1f} % of a limit{how}")
        if self.position_margin < -ROUNDING:
            found.append(
                f"a joint passes its position limit by {np.degrees(-self.position_margin):.2f} deg"
            )
        return [*found, *(str(rule) for rule in self.rules if not rule.kept), *self.too_near]

    @property
    def too_near(self) -> list[str]:
        """Pairs that come nearer to each other than they may, in words."""
        found = []
        for asked, one in [
            (self.asked_clearance, self.clearance),
            *((cut.kept, one) for cut, one in self.cuts),
        ]:
            if not one.collision_free:
                found.append(f"{one.pair} collide at {one.time:.3f} s")
            elif one.proven < asked - SHORT:
                found.append(
                    f"{one.pair} come within {1000 * one.proven:.1f} mm at {one.time:.3f} s"
                )
        return found

    @property
    def closest(self) -> Clearance:
        """The smallest proven clearance of any pair."""
        return min(
            (self.clearance, *(clearance for _, clearance in self.cuts)), key=lambda one: one.proven
        )


def certify(
    problem: PlanningProblem, splines: Splines, controller: Controller | None = None
) -> Certificate:
    """Checks the first of a batch of motions.

    Energy, limits on a dense grid, clearance at every instant.

    Args:
        problem: The task.
        splines: The motions; on a controller's step, where one is given.
        controller: Who executes it: then it is its curve that is looked at.
    """
    curve = splines if controller is None else controller.make_curve(splines)
    s, w = section_nodes(_places(curve, FINE, LEAST_PLACES[0]))
    q, dq, ddq = curve.states(s)
    tau = problem.model.torque(q, dq, ddq)
    weights = (curve.durations[:, :, None] * w).reshape(len(q), -1)
    limits = problem.limits
    scene = problem.scene
    trained = problem.trained
    law = _time_law(problem, splines, curve, controller)
    beyond = find_extrapolation(problem, curve)
    cuts = find_cuts(scene, problem.ends, limits.clearance)
    half_width = None
    uncut = ~np.isin(np.arange(len(scene.pairs)), [cut.pair for cut in cuts])
    if trained is not None and not beyond:
        # A joint's estimates are off the same way all along a motion, those of different joints
        # independently.
        half_width = float(
            np.linalg.norm(trained.torque_half_width[: problem.n] * np.array(law.travel))
        )
    return Certificate(
        energy=power_integrals(tau, dq, weights),
        shares=_shares(problem, curve, controller),
        position_margin=float(
            np.minimum(curve.lowest - limits.lower, limits.upper - curve.highest).min()
        ),
        clearance=prove_clearance(scene, curve, uncut, asked=limits.clearance - SHORT),
        asked_clearance=limits.clearance,
        cuts=tuple(
            (
                cut,
                prove_clearance(
                    scene, curve, np.arange(len(scene.pairs)) == cut.pair, asked=cut.kept - SHORT
                ),
            )
            for cut in cuts
        ),
        scene=scene,
        time_law=law,
        extrapolation=beyond,
        curve=curve,
        controller=controller,
        reserve=limits.reserve,
        energy_half_width=half_width,
        rules=() if problem.rules is None else problem.rules.check(curve),
    )


def keeps_limits(
    problem: PlanningProblem, splines: Splines, controller: Controller | None = None
) -> bool:
    """Whether the first of a batch of motions keeps the limits of each joint.

    That is a certificate's first look, without its proof of clearance, which is most of its work.

    Args:
        problem, splines, controller: As for `certify`.
    """
    curve = splines if controller is None else controller.make_curve(splines)
    shares = _shares(problem, curve, controller).values()
    largest = [float(share.max()) for share in shares if share is not None]
    law = _time_law(problem, splines, curve, controller)
    return not max(*largest, *law.shares) > 1.0 + ROUNDING


def _time_law(
    problem: PlanningProblem, splines: Splines, curve: Splines, controller: Controller | None
) -> TimeLaw:
    """How a motion is executed: as the controller's curve of it, or started from rest."""
    if controller is None:
        return find_time_law(problem, splines)
    return measure(problem, curve, TimeLaw(float(curve.total[0])))


def _shares(
    problem: PlanningProblem, curve: Splines, controller: Controller | None
) -> dict[str, Float[Array, " n"] | None]:
    """Peak speed, acceleration, jerk and torque of each joint as a share of its limit.

    None without a limit.
    """
    limits = problem.limits
    tick = TICK if controller is None else controller.tick_s
    shares: dict[str, Float[Array, " n"] | None] = {
        "speed": curve.top_speed[0] / limits.speed,
        "acceleration": None,
        "jerk": None,
        "torque": _torque_share(problem, curve),
    }
    if limits.acceleration is not None:
        shares["acceleration"] = curve.top_acceleration[0] / limits.acceleration
    if limits.jerk is not None:
        # That of getting going within a controller's tick, and of a step of the acceleration at a
        # knot, too.
        steps = np.maximum(curve.end_acceleration[0], curve.acceleration_jumps[0]) / tick
        shares["jerk"] = np.maximum(curve.top_jerk[0], steps) / limits.jerk
    return shares


def _places(curve: Splines, most: int, least: int) -> int:
    """Places of each section: fewer where there are very many sections."""
    sections = curve.durations.shape[1]
    return max(most * MANY_SECTIONS // max(sections, MANY_SECTIONS), least)


def certify_standing(
    problem: PlanningProblem, controller: Controller | None = None
) -> tuple[Splines, Certificate]:
    """The plan of zero length for a start that is the goal.

    What standing there for a second is, but for its time.
    """
    ends = np.stack([problem.start, problem.start])[None]
    found = certify(problem, Splines(ends, np.ones((1, 1))))
    still = dict.fromkeys(METRICS, 0.0)
    splines = Splines(ends, np.zeros((1, 1)))
    standing = {"time_law": STANDING, "energy_half_width": None, "controller": controller}
    return splines, replace(found, energy=still, **standing)  # type: ignore[arg-type]


def _torque_share(problem: PlanningProblem, splines: Splines) -> Float[Array, " n"]:
    """Peak torque of each joint as a share of its limit.

    Densely everywhere, closer beside peaks near the limit.
    """
    dense = _places(splines, DENSE, LEAST_PLACES[1])
    s = np.linspace(0.0, 1.0, dense)
    share = np.abs(problem.model.torque(*splines.states(s))[0]) / problem.limits.torque
    padded = np.pad(share.reshape(-1, dense, problem.n), ((0, 0), (1, 1), (0, 0)))
    peak = padded[:, 1:-1] >= np.maximum(padded[:, :-2], padded[:, 2:])
    near = (peak & (padded[:, 1:-1] > NEAR_LIMIT)).any(axis=2)
    section, cell = np.nonzero(near[:, :-1] | near[:, 1:])
    if len(section) == 0:
        return share.max(axis=0)
    durations = splines.durations[0]
    begin = np.concatenate([[0.0], np.cumsum(durations)[:-1]])
    inside = cell[:, None] + np.arange(1, CLOSER) / CLOSER
    times = (begin[section, None] + durations[section, None] * inside / (dense - 1)).reshape(-1)
    closer = problem.model.torque(*(part[None] for part in splines.at(times)))[0]
    return np.maximum(share.max(axis=0), np.abs(closer).max(axis=0) / problem.limits.torque)


@dataclass(frozen=True, eq=False)
class PlanResult(Result):
    """Outcome of one planning task."""

    SHOWN_BY = "plan.show.results"

    status: Status  # `solved`, `infeasible` or `budget_spent`
    method: str  # what was asked for
    objective: str
    metric: Metric
    seed: int
    reason: str = ""  # why there is no plan; empty where there is one
    splines: Splines | None = None  # the motion, a batch of one; None without
    certificate: Certificate | None = None  # what the motion was found to be
    evaluations: int = 0  # what was spent; processor time is that of the process alone
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    # What no motion's cost can undercut, whatever its path; None where none is known.
    bound: float | None = None
    # Cost above the default method's, as a share; None if that was not computed.
    reference_gap: float | None = None
    # One record an initial trajectory: label, via points, cost reached, reason where it failed.
    starts: tuple[dict[str, Any], ...] = ()
    # Evaluations, processor seconds and best cost, each time it fell.
    history: tuple[tuple[int, float, float], ...] = ()
    notes: tuple[str, ...] = ()  # remarks of the planner
    robot: str = ""  # name of the arm and of the joints that move
    joints: tuple[str, ...] = ()
    # Positions of the joints that stand still [rad or m].
    held: Mapping[str, float] = field(default_factory=dict)
    # What the arm carries, and the frame on which each of it hangs.
    carried: tuple[dict[str, object], ...] = ()
    standby: float = 0.0  # power that the cell takes all the while [W]
    # Where the duration was free: durations that were looked at [s], and the least energy found for
    # each [J].
    energy_curve: tuple[tuple[float, float], ...] = ()

    @property
    def stands(self) -> bool:
        """Whether the plan is one of zero length."""
        return self.splines is not None and float(self.splines.total[0]) <= 0.0

    @property
    def execution(self) -> TimeLaw:
        """How the motion is executed from rest to rest."""
        return STANDING if self.certificate is None else self.certificate.time_law

    @property
    def solved(self) -> bool:
        """Whether there is a certified plan."""
        return self.status == "solved"

    @property
    def cost(self) -> float:
        """Energy by the metric, and of the cell's standby [J], or duration [s].

        Infinite without a plan.
        """
        if self.certificate is None or self.splines is None or not self.solved:
            return float("inf")
        energies = self.certificate.energy
        duration = float(self.splines.total[0])
        return plan_cost(self.objective, duration, lambda: energies[self.metric], self.standby)

    @property
    def executed_cost(self) -> float:
        """As `cost`, of the motion as a controller executes it, from rest to rest.

        Infinite without a plan.
        """
        if not self.solved:
            return float("inf")
        duration = self.execution.duration
        energies = dict(self.execution.energy)
        if self.objective != "time" and self.metric not in energies:
            return self.cost
        return plan_cost(self.objective, duration, lambda: energies[self.metric], self.standby)

    def to_dict(self) -> dict[str, Any]:
        """The record of `plan.result/1`; lengths in m, angles in rad."""
        head, tail = (
            {name: as_record(getattr(self, name)) for name in names} for names in (HEAD, REST)
        )
        history = [list(row) for row in self.history if np.isfinite(row[2])]
        names = ("duration_s", "energy_J")
        curve = [dict(zip(names, row, strict=True)) for row in self.energy_curve]
        more = {"standby_W": self.standby, "energy_curve": curve}
        return {"schema": SCHEMA, **head, **self._motion(), **more, **tail, "history": history}

    def _motion(self) -> dict[str, Any]:
        certificate = self.certificate
        splines = self.splines
        if splines is None or certificate is None:
            return {}
        energy = certificate.energy
        closest = certificate.closest
        points = splines.points[0]
        rest = [0.0] * points.shape[1]
        reserve = certificate.reserve
        beyond = certificate.extrapolation
        return {
            "energy_J": {metric: energy[metric] for metric in METRICS if metric != "copper"},
            "copper_N2m2s": energy["copper"],
            "duration_s": float(splines.total[0]),
            "peak_torque_share": certificate.torque_share.tolist(),
            "peak_speed_share": certificate.speed_share.tolist(),
            "limits": {
                name: None if share is None else float(share.max())
                for name, share in certificate.shares.items()
            },
            "peak_acceleration_rad_s2": rest
            if self.stands
            else splines.top_acceleration[0].tolist(),
            "peak_jerk_rad_s3": rest if self.stands else splines.top_jerk[0].tolist(),
            "execution": certificate.time_law.to_dict(),
            "controller": None if certificate.controller is None else certificate.controller.name,
            "extrapolation": None
            if beyond is None
            else max((one.share for one in beyond), default=0.0),
            "beyond_training": as_record(beyond or ()),
            "torque_reserve_Nm": None if reserve is None else reserve.tolist(),
            "energy_half_width_J": certificate.energy_half_width,
            "collision_free": closest.collision_free,
            "clearance_m": closest.proven if closest.checks else None,
            "closest": {"pair": closest.pair, "time_s": closest.time},
            "asked_clearance_m": certificate.asked_clearance,
            "clearance_cuts": [
                {**cut.to_dict(), "proven_m": one.proven} for cut, one in certificate.cuts
            ],
            "rules": as_record(certificate.rules),
            "coarser_obstacles": list(certificate.scene.coarser),
            **certificate.scene.to_dict(),
            "start_rad": points[0].tolist(),
            "goal_rad": points[-1].tolist(),
            "via_points_rad": points[1:-1].tolist(),
            "times_s": np.cumsum(splines.durations[0])[:-1].tolist(),
        }
