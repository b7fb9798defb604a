"""What a motion is, computed afresh and densely, not as the search saw it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from plan.dynamics.power import METRICS, Metric, power_integrals, section_nodes
from plan.geometry.clearance_proof import SHORT, Clearance, Cut, find_cuts, prove_clearance
from plan.geometry.scene import Scene
from plan.problem.controllers import Controller
from plan.problem.extrapolation import Extrapolation, find_extrapolation
from plan.problem.problem import TICK, PlanningProblem
from plan.problem.ramps import STANDING, TimeLaw, find_time_law, measure
from plan.problem.rule_values import RuleCheck
from plan.spline import Splines

# A limit counts as kept up to this excess, as a share: rounding, not engineering.
ROUNDING = 1e-9
# Quadrature points a section: friction that turns round inside a section needs many.
FINE = 200
# Places a section at which peaks of torque are looked for; and, between two of them of which one
# passes a share of the limit, how many more: where a joint turns round, friction jumps within a
# millisecond.
DENSE = 400
NEAR_LIMIT = 0.96
CLOSER = 20
# Sections beyond which each has fewer of both, down to the least: those of a controller's ticks are
# as short as that.
MANY_SECTIONS = 48
LEAST_FINE = 4
LEAST_DENSE = 12


Shares = dict[str, Float[Array, " n"] | None]
"""Peak speed, acceleration, jerk and torque of each joint as a share of its limit; None without."""


@dataclass(frozen=True, eq=False)
class Certificate:
    """What a motion is, computed afresh and densely, not as the search saw it."""

    energy: dict[Metric, float]  # energy by every metric [J], and N² m² s for copper
    # Peak speed, acceleration, jerk and torque of each joint as a share of its limit; None without
    # a limit.
    shares: Shares
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
        broken = self._broken_limits()
        if self.position_margin < -ROUNDING:
            passed = np.degrees(-self.position_margin)
            broken.append(f"a joint passes its position limit by {passed:.2f} deg")
        broken += [str(rule) for rule in self.rules if not rule.kept]
        return broken + self.too_near

    def _broken_limits(self) -> list[str]:
        """Limits of speed, acceleration, jerk and torque that are passed, in words."""
        how = "" if self.controller is None else f" as {self.controller.name} executes it"
        broken = []
        for name, shares in self.shares.items():
            if shares is None:
                continue
            for joint in np.flatnonzero(shares > 1.0 + ROUNDING):
                percent = 100 * shares[joint]
                what = f"reaches {percent:.1f} % of its {name} limit{how}"
                broken.append(f"joint {joint + 1} {what}")
        worst = max(self.time_law.shares)
        if not broken and worst > 1.0 + ROUNDING:
            broken.append(f"started from rest it reaches {100 * worst:.1f} % of a limit{how}")
        return broken

    @property
    def too_near(self) -> list[str]:
        """Pairs that come nearer to each other than they may, in words."""
        asked = [(self.asked_clearance, self.clearance)]
        asked += [(cut.kept, clearance) for cut, clearance in self.cuts]
        near = []
        for least, clearance in asked:
            when = f"at {clearance.time:.3f} s"
            if not clearance.collision_free:
                near.append(f"{clearance.pair} collide {when}")
            elif clearance.proven < least - SHORT:
                distance = 1000 * clearance.proven
                near.append(f"{clearance.pair} come within {distance:.1f} mm {when}")
        return near

    @property
    def closest(self) -> Clearance:
        """The smallest proven clearance of any pair."""
        clearances = [self.clearance, *(clearance for _, clearance in self.cuts)]
        return min(clearances, key=lambda clearance: clearance.proven)


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
    limits = problem.limits
    scene = problem.scene
    law = _time_law(problem, splines, curve, controller)
    extrapolation = find_extrapolation(problem, curve)
    pairs = np.arange(len(scene.pairs))
    cuts = find_cuts(scene, problem.ends, limits.clearance)
    uncut = ~np.isin(pairs, [cut.pair for cut in cuts])
    proven_cuts = []
    for cut in cuts:
        proven = prove_clearance(scene, curve, pairs == cut.pair, asked=cut.kept - SHORT)
        proven_cuts.append((cut, proven))
    margins = np.minimum(curve.lowest - limits.lower, limits.upper - curve.highest)
    return Certificate(
        energy=_energy(problem, curve),
        shares=_shares(problem, curve, controller),
        position_margin=float(margins.min()),
        clearance=prove_clearance(scene, curve, uncut, asked=limits.clearance - SHORT),
        asked_clearance=limits.clearance,
        cuts=tuple(proven_cuts),
        scene=scene,
        time_law=law,
        extrapolation=extrapolation,
        curve=curve,
        controller=controller,
        reserve=limits.reserve,
        energy_half_width=None if extrapolation else _energy_half_width(problem, law),
        rules=() if problem.rules is None else problem.rules.check(curve),
    )


def _energy(problem: PlanningProblem, curve: Splines) -> dict[Metric, float]:
    """Energy of a curve by every metric, by quadrature [J]."""
    shares, weights = section_nodes(_places(curve, FINE, LEAST_FINE))
    q, dq, ddq = curve.states(shares)
    tau = problem.model.torque(q, dq, ddq)
    seconds = (curve.durations[:, :, None] * weights).reshape(len(q), -1)
    return power_integrals(tau, dq, seconds)


def _energy_half_width(problem: PlanningProblem, law: TimeLaw) -> float | None:
    """Half of the 95 % interval of an executed motion's energy [J]; None where none is known.

    A joint's estimates are off the same way all along a motion, those of different joints
    independently.
    """
    if problem.trained is None:
        return None
    half_widths = problem.trained.torque_half_width[: problem.n]
    return float(np.linalg.norm(half_widths * np.array(law.travel)))


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


def limit_shares(
    problem: PlanningProblem, splines: Splines, controller: Controller | None = None
) -> Shares:
    """Peaks of the first of a batch of motions as shares of each joint's limits.

    Args:
        problem, splines, controller: As for `certify`.
    """
    curve = splines if controller is None else controller.make_curve(splines)
    return _shares(problem, curve, controller)


def _time_law(
    problem: PlanningProblem, splines: Splines, curve: Splines, controller: Controller | None
) -> TimeLaw:
    """How a motion is executed: as the controller's curve of it, or started from rest."""
    if controller is None:
        return find_time_law(problem, splines)
    return measure(problem, curve, TimeLaw(float(curve.total[0])))


def _shares(problem: PlanningProblem, curve: Splines, controller: Controller | None) -> Shares:
    """Peak speed, acceleration, jerk and torque of each joint as a share of its limit.

    None without a limit.
    """
    limits = problem.limits
    tick = TICK if controller is None else controller.tick_s
    shares: Shares = {
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
    for_a_second = certify(problem, Splines(ends, np.ones((1, 1))))
    standing = replace(
        for_a_second,
        energy=dict.fromkeys(METRICS, 0.0),
        time_law=STANDING,
        energy_half_width=None,
        controller=controller,
    )
    return Splines(ends, np.zeros((1, 1))), standing


def _torque_share(problem: PlanningProblem, splines: Splines) -> Float[Array, " n"]:
    """Peak torque of each joint as a share of its limit.

    Densely everywhere, closer beside peaks near the limit.
    """
    dense = _places(splines, DENSE, LEAST_DENSE)
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
    times = begin[section, None] + durations[section, None] * inside / (dense - 1)
    states = [state[None] for state in splines.at(times.reshape(-1))]
    closer = np.abs(problem.model.torque(*states)[0])
    return np.maximum(share.max(axis=0), closer.max(axis=0) / problem.limits.torque)
