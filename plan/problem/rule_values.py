"""How far a motion is from what its way has to keep.

And how that changes with position and speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float, Int, freeze
from ident.records import Record
from ident.robot.arm import ArmModel
from plan.dynamics.rigid import frame_states
from plan.geometry.tool import find_frame
from plan.problem.rules import Cone, ViaPoint, WayRules
from plan.spline import Splines

# Units in which excesses count: a decimetre, a tenth of a radian; others are shares of their
# limits.
UNIT = 0.1
# Share of a limit at which a search aims: what happens between the places at which it looks has the
# rest.
AIM = 0.9
# The same of the square of the tool's speed, which changes little between two places.
AIM_OF_SPEED = 0.996
# A cone is aimed at within this much less than what is left of it.
AIM_OF_CONE = 0.01
# A line that is shorter has no direction [m].
SHORTEST = 1e-9
# Fewest joints that can turn a tool as they like.
TURNING = 6
# Places at which a certificate looks, and at which it looks closer about a via point.
DENSE = 4001
CLOSER = 401


@dataclass(frozen=True, eq=False)
class RuleRow:
    """One inequality along T states: value ≤ limit."""

    name: str  # of the rule
    value: Float[Array, " T"]  # in the rule's own measure
    limit: float
    unit: float  # what counts as one
    aim: float  # the limit that a search aims at
    # Derivatives of the value, shape (T, n); None where they are nought.
    by_position: Float[Array, "T n"]
    by_speed: Float[Array, "T n"] | None = None
    sparse: bool = False  # whether every other node is enough

    @property
    def excess(self) -> Float[Array, " T"]:
        """Value beyond the aim, in units."""
        return (self.value - self.aim) / self.unit


@dataclass(frozen=True)
class RuleCheck(Record):
    """What a finished motion makes of one rule."""

    rule: str  # in words
    worst: float  # largest value seen, or smallest where the rule keeps out, and what was asked for
    limit: float
    unit: str  # theirs
    time_s: float  # when [s]
    kept: bool  # whether it is kept

    def __str__(self) -> str:
        return (
            f"{self.rule}: {self.worst:.4g} of {self.limit:.4g} {self.unit} at {self.time_s:.3f} s"
        )


@dataclass(frozen=True, eq=False)
class _Measure:
    """What a rule measures along T states."""

    name: str  # the rule, in words
    values: Float[Array, " T"]
    limit: float
    unit: str  # of both
    sign: float = 1.0  # -1 where the limit is the least


class Rules:
    """The rules of one task: arm, start and goal are known."""

    def __init__(self, arm: ArmModel, rules: WayRules, start: Array, goal: Array) -> None:
        frame = find_frame(arm, rules.frame, "tool.frame")
        self.rules = rules
        self._chain = arm.chain
        self.frame = str(frame.name)
        turn = np.ascontiguousarray(frame.placement.rotation)
        place = np.ascontiguousarray(frame.placement.translation)
        self._tool = (int(frame.parentJoint), turn, place)
        places, axes, _, _ = self.tool(np.stack([start, goal]))
        self.first = (freeze(places[0]), freeze(axes[0]))
        self.last = (freeze(places[1]), freeze(axes[1]))
        way = self.last[0] - self.first[0]
        self.length = float(np.linalg.norm(way))
        along = np.array([1.0, 0.0, 0.0])
        if self.length > SHORTEST:
            along = way / self.length
        self._axes = np.linalg.svd(along[None])[2]  # along the line, or against it, and two across
        self._axes[0] = along
        self._turn = pin.log3(self.first[1].T @ self.last[1])

    def tool(self, q: Float[Array, "T n"]) -> tuple[Array, Array, Array, Array]:
        """Place and axes of the tool, and how they change with the joints.

        Args:
            q: Positions [rad or m].

        Returns:
            Place [m] and axes in the base frame, shapes (T, 3) and (T, 3, 3); change of place and
            turn for a unit of each joint, both of shape (T, n, 3).
        """
        return frame_states(self._chain, q, *self._tool)

    def rows(self, q: Float[Array, "T n"], dq: Float[Array, "T n"]) -> list[RuleRow]:
        """All rules that hold at every instant, along T states."""
        rules = self.rules
        if rules.speed is None and rules.straight is None and not rules.cones:
            return []
        states = self.tool(q)
        rows = []
        if rules.speed is not None:
            rows.append(self._speed_row(states, dq, rules.speed))
        if rules.straight is not None:
            rows += self._straight_rows(states, rules.straight)
        return rows + [self._cone_row(states, cone) for cone in rules.cones]

    def _cone_row(self, states: tuple[Array, Array, Array, Array], cone: Cone) -> RuleRow:
        """Cosine of the angle between a tool's axis and a cone's; less it where it stays inside."""
        _, axes, _, angular = states
        pointing = axes @ cone.axis
        sign = -1.0 if cone.allowed else 1.0
        cosine = np.cos(cone.angle)
        rest = 1.0 + sign * cosine  # from the limit to the farthest
        limit = sign * float(cosine)
        slope = np.cross(pointing, cone.towards)
        return RuleRow(
            name="cone",
            value=sign * (pointing @ cone.towards),
            limit=limit,
            unit=float(rest),
            aim=float(limit - AIM_OF_CONE * rest),
            by_position=sign * np.einsum("tnk,tk->tn", angular, slope),
        )

    def _speed_row(
        self, states: tuple[Array, Array, Array, Array], dq: Array, limit: float
    ) -> RuleRow:
        """Square of the tool's speed, as a share of its limit's."""
        linear, angular = states[2:]
        speed = np.einsum("tni,tn->ti", linear, dq)
        by_speed = 2.0 * np.einsum("tni,ti->tn", linear, speed) / limit**2
        # Joint j turns what the joints beyond it give, and is itself turned by those before it.
        beyond = np.cumsum((linear * dq[:, :, None])[:, ::-1], axis=1)[:, ::-1]
        turned = angular * dq[:, :, None]
        before = np.cumsum(turned, axis=1) - turned
        change = np.cross(angular, beyond) + np.cross(before, linear)
        by_position = 2.0 * np.einsum("tni,ti->tn", change, speed) / limit**2
        share = (speed * speed).sum(axis=1) / limit**2
        return RuleRow("speed", share, 1.0, 1.0, AIM_OF_SPEED, by_position, by_speed)

    def _straight_rows(
        self, states: tuple[Array, Array, Array, Array], within: float
    ) -> list[RuleRow]:
        """Off the line to either side and beyond its ends, and off the even turn."""
        place, _, linear, _ = states
        away = (place - self.first[0]) @ self._axes.T
        slopes = linear @ self._axes.T
        side = within / np.sqrt(2.0)
        rows = []
        for k in (1, 2):
            for sign in (1.0, -1.0):
                off = sign * away[:, k]
                slope = sign * slopes[:, :, k]
                rows.append(RuleRow("line", off, side, UNIT, AIM * side, slope, sparse=True))
        farthest = self.length + within
        aim = self.length + within / 2
        rows.append(RuleRow("line", away[:, 0], farthest, UNIT, aim, slopes[:, :, 0]))
        rows.append(RuleRow("line", -away[:, 0], within, UNIT, within / 2, -slopes[:, :, 0]))
        if linear.shape[1] >= TURNING:
            rows += self._turn_rows(states, away[:, 0], slopes[:, :, :1])
        return rows

    def _turn_rows(
        self,
        states: tuple[Array, Array, Array, Array],
        along: Float[Array, " T"],
        slope: Float[Array, "T n 1"],
    ) -> list[RuleRow]:
        """Off the even turn, about each axis either way.

        Args:
            states: Of the tool.
            along: How far along the line it is [m].
            slope: How that changes with the joints.
        """
        _, axes, _, angular = states
        error, reference = self._turned(axes, along)
        by_turn = np.einsum("tki,tnk->tni", reference, angular)
        by_turn -= slope * self._turn / max(self.length, SHORTEST)
        most = self.rules.turning / np.sqrt(3.0)
        rows = []
        for k in range(3):
            for sign in (1.0, -1.0):
                off = sign * error[:, k]
                by_position = sign * by_turn[:, :, k]
                rows.append(RuleRow("turn", off, most, UNIT, AIM * most, by_position, sparse=True))
        return rows

    def _turned(
        self, axes: Float[Array, "T 3 3"], along: Float[Array, " T"]
    ) -> tuple[Array, Array]:
        """How far the tool is turned from where it should be at its place on the line [rad], and
        that reference.
        """
        shares = np.clip(along / max(self.length, SHORTEST), 0.0, 1.0)
        begin = self.first[1]
        reference = np.array([begin @ pin.exp3(share * self._turn) for share in shares])
        turned = [pin.log3(even.T @ axis) for even, axis in zip(reference, axes, strict=True)]
        return np.array(turned), reference

    def missed(self, via: ViaPoint, q: Float[Array, "T n"]) -> Float[Array, "T k"]:
        """How far each joint, or the tool's place, is off a via point [rad or m]."""
        return (self.tool(q)[0] if via.of_tool else q) - via.target

    def when_passed(self, q: Float[Array, "T n"]) -> Int[Array, " K"]:
        """Which of T positions are nearest to the via points, in their order, the sum of what is
        missed least.

        Returns:
            One row of `q` a via point.
        """
        costs = []
        for via in self.rules.vias:
            missed = np.abs(self.missed(via, q)).max(axis=1)
            costs.append(missed / via.within)
        cost = np.array(costs)
        so_far = cost[0]
        for k in range(1, len(cost)):
            so_far = cost[k] + np.minimum.accumulate(so_far)
            cost[k] = so_far
        chosen = [int(np.argmin(cost[-1]))]
        for row in cost[-2::-1]:
            chosen.append(int(np.argmin(row[: chosen[-1] + 1])))
        return np.array(chosen[::-1])

    def via_rows(
        self, number: int, q: Float[Array, " n"], dq: Float[Array, " n"]
    ) -> tuple[Float[Array, " r"], Float[Array, "r n"]]:
        """What a position near a via point misses across the motion there, beyond what may be, in
        units; its slopes.

        Along the motion nothing is missed to first order: it passes a little sooner or later.
        """
        via = self.rules.vias[number]
        missed = self.missed(via, q[None])[0]
        slopes = self.tool(q[None])[2][0].T if via.of_tool else np.eye(len(q))
        along = slopes @ dq
        square = float(along @ along)
        across = np.eye(len(missed))
        if square > 1e-12:
            across -= np.outer(along, along) / square
        values = across @ missed
        slopes = across @ slopes
        excess = np.concatenate([values, -values]) - AIM * via.within
        return excess / UNIT, np.concatenate([slopes, -slopes]) / UNIT

    def excess(self, q: Float[Array, "T n"], dq: Float[Array, "T n"], aimed: bool = True) -> float:
        """Largest excess of any rule along a motion, in units.

        Args:
            q: Joint positions [rad].
            dq: Joint speeds [rad/s].
            aimed: Against what is aimed at, which is tighter; else against the limits themselves.

        Returns:
            Never below 0: 0 where all are kept.
        """
        largest = 0.0
        for row in self.rows(q, dq):
            allowed = row.aim if aimed else row.limit
            largest = max(largest, float((row.value - allowed).max()) / row.unit)
        if not self.rules.vias:
            return largest
        for number, t in enumerate(self.when_passed(q)):
            slack = 0.0 if aimed else (1.0 - AIM) * self.rules.vias[number].within / UNIT
            missed, _ = self.via_rows(number, q[t], dq[t])
            largest = max(largest, float(missed.max()) - slack)
        return largest

    def check(self, splines: Splines) -> tuple[RuleCheck, ...]:
        """Every rule along the first of a batch of motions, looked at densely, in the scene file's
        own units.
        """
        times = np.linspace(0.0, float(splines.total[0]), DENSE)
        checks = []
        for measure in self._measures(*splines.at(times)[:2]):
            worst = int(np.argmax(measure.sign * measure.values))
            value = measure.values[worst]
            checks.append(
                RuleCheck(
                    rule=measure.name,
                    worst=float(value),
                    limit=float(measure.limit),
                    unit=measure.unit,
                    time_s=float(times[worst]),
                    kept=bool(measure.sign * value <= measure.sign * measure.limit),
                )
            )
        return tuple(checks + self._check_vias(splines, times))

    def _measures(self, q: Float[Array, "T n"], dq: Float[Array, "T n"]) -> list[_Measure]:
        """What each rule measures along T states."""
        rules = self.rules
        place, axes, linear, _ = self.tool(q)
        measures = []
        if rules.speed is not None:
            speed = np.linalg.norm(np.einsum("tni,tn->ti", linear, dq), axis=1)
            measures.append(_Measure("speed of the tool", speed, rules.speed, "m/s"))
        if rules.straight is not None:
            away = (place - self.first[0]) @ self._axes.T
            beyond = np.maximum(np.maximum(away[:, 0] - self.length, -away[:, 0]), 0.0)
            off = np.linalg.norm(np.column_stack([beyond, away[:, 1:]]), axis=1)
            measures.append(_Measure("tool off its straight line", off, rules.straight, "m"))
            if q.shape[1] >= TURNING:
                error, _ = self._turned(axes, away[:, 0])
                turned = np.degrees(np.linalg.norm(error, axis=1))
                most = np.degrees(rules.turning)
                measures.append(_Measure("tool off its even turn", turned, most, "deg"))
        for number, cone in enumerate(rules.cones, start=1):
            cosine = np.clip(axes @ cone.axis @ cone.towards, -1.0, 1.0)
            angle = np.degrees(np.arccos(cosine))
            name = f"tool's axis {'inside' if cone.allowed else 'outside'} cone {number}"
            sign = 1.0 if cone.allowed else -1.0
            measures.append(_Measure(name, angle, np.degrees(cone.angle), "deg", sign))
        return measures

    def _check_vias(self, splines: Splines, times: Float[Array, " T"]) -> list[RuleCheck]:
        """How near each via point is passed, looked at closely about the nearest of T times."""
        if not self.rules.vias:
            return []
        step = times[1] - times[0]
        checks = []
        for number, t in enumerate(self.when_passed(splines.at(times)[0])):
            via = self.rules.vias[number]
            window = np.linspace(times[t] - step, times[t] + step, CLOSER)
            near = np.clip(window, 0.0, times[-1])
            missed = np.abs(self.missed(via, splines.at(near)[0])).max(axis=1)
            best = int(np.argmin(missed))
            scale, unit = (1.0, "m") if via.of_tool else (np.degrees(1.0), "deg")
            checks.append(
                RuleCheck(
                    rule=f"via point {number + 1} passed within",
                    worst=scale * float(missed[best]),
                    limit=scale * via.within,
                    unit=unit,
                    time_s=float(near[best]),
                    kept=bool(missed[best] <= via.within),
                )
            )
        return checks
