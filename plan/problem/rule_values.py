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
from plan.problem.rules import ViaPoint, WayRules
from plan.spline import Splines

# Units in which excesses count: a decimetre, a tenth of a radian; others are shares of their
# limits.
UNIT = 0.1
# Share of a limit at which a search aims: what happens between the places at which it looks has the
# rest.
AIM = 0.9
# The same of the square of the tool's speed, which changes little between two places.
AIM_OF_SPEED = 0.996
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


class Rules:
    """The rules of one task: arm, start and goal are known."""

    def __init__(self, arm: ArmModel, rules: WayRules, start: Array, goal: Array) -> None:
        frame = find_frame(arm, rules.frame, "tool.frame")
        self.rules = rules
        self._chain = arm.chain
        self.frame = str(frame.name)
        turn, place = (
            np.ascontiguousarray(part)
            for part in (frame.placement.rotation, frame.placement.translation)
        )
        self._tool = int(frame.parentJoint), turn, place
        ends = self.tool(np.stack([start, goal]))
        self.first, self.last = ((freeze(ends[0][k]), freeze(ends[1][k])) for k in (0, 1))
        way = self.last[0] - self.first[0]
        self.length = float(np.linalg.norm(way))
        along = way / self.length if self.length > 1e-9 else np.array([1.0, 0.0, 0.0])
        self._axes = np.linalg.svd(along[None])[2]  # along the line, or against it, and two across
        self._axes[0] = along
        self._turn = pin.log3(self.first[1].T @ self.last[1])

    def tool(self, q: Float[Array, "T n"]) -> tuple[Array, Array, Array, Array]:
        """Place and axes of the tool, and how they change with the joints, as `frame_states`."""
        at, axes, linear, angular = frame_states(self._chain, np.ascontiguousarray(q), *self._tool)
        return at, axes, linear, angular

    def rows(self, q: Float[Array, "T n"], dq: Float[Array, "T n"]) -> list[RuleRow]:
        """All rules that hold at every instant, along T states."""
        rules = self.rules
        if rules.speed is None and rules.straight is None and not rules.cones:
            return []
        states = self.tool(q)
        found = [] if rules.speed is None else [self._speed_row(states, dq, rules.speed)]
        found += [] if rules.straight is None else self._straight_rows(states, rules.straight)
        for cone in rules.cones:
            pointing = states[1] @ cone.axis
            sign, rest = (
                (-1.0, 1.0 - np.cos(cone.angle))
                if cone.allowed
                else (1.0, 1.0 + np.cos(cone.angle))
            )
            limit = sign * float(np.cos(cone.angle))
            slope = np.cross(pointing, cone.towards)
            by_position = sign * np.einsum("tnk,tk->tn", states[3], slope)
            value = sign * (pointing @ cone.towards)
            aim = limit - 0.01 * rest
            found.append(RuleRow("cone", value, limit, float(rest), float(aim), by_position))
        return found

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
        place, axes, linear, angular = states
        away = (place - self.first[0]) @ self._axes.T
        slopes = linear @ self._axes.T
        side = within / np.sqrt(2.0)
        found = []
        for k in (1, 2):
            for sign in (1.0, -1.0):
                row = sign * away[:, k], side, UNIT, AIM * side, sign * slopes[:, :, k]
                found.append(RuleRow("line", *row, sparse=True))
        found.append(
            RuleRow(
                "line",
                away[:, 0],
                self.length + within,
                UNIT,
                self.length + within / 2,
                slopes[:, :, 0],
            )
        )
        found.append(RuleRow("line", -away[:, 0], within, UNIT, within / 2, -slopes[:, :, 0]))
        if linear.shape[1] < TURNING:
            return found
        error, reference = self._turned(axes, away[:, 0])
        by_turn = np.einsum("tki,tnk->tni", reference, angular)
        by_turn -= slopes[:, :, :1] * self._turn / max(self.length, 1e-9)
        most = self.rules.turning / np.sqrt(3.0)
        for k in range(3):
            for sign in (1.0, -1.0):
                row = sign * error[:, k], most, UNIT, AIM * most, sign * by_turn[:, :, k]
                found.append(RuleRow("turn", *row, sparse=True))
        return found

    def _turned(
        self, axes: Float[Array, "T 3 3"], along: Float[Array, " T"]
    ) -> tuple[Array, Array]:
        """How far the tool is turned from where it should be at its place on the line [rad], and
        that reference.
        """
        shares = np.clip(along / max(self.length, 1e-9), 0.0, 1.0)
        reference = np.array([self.first[1] @ pin.exp3(share * self._turn) for share in shares])
        return np.array(
            [pin.log3(a.T @ b) for a, b in zip(reference, axes, strict=True)]
        ), reference

    def missed(self, via: ViaPoint, q: Float[Array, "T n"]) -> Float[Array, "T k"]:
        """How far each joint, or the tool's place, is off a via point [rad or m]."""
        return (self.tool(q)[0] if via.of_tool else q) - via.target

    def when_passed(self, q: Float[Array, "T n"]) -> Int[Array, " K"]:
        """Which of T positions are nearest to the via points, in their order, the sum of what is
        missed least.
        """
        cost = np.array(
            [np.abs(self.missed(via, q)).max(axis=1) / via.within for via in self.rules.vias]
        )
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
        across = np.eye(len(missed)) - (np.outer(along, along) / square if square > 1e-12 else 0.0)
        values = across @ missed
        slopes = across @ slopes
        excess = np.concatenate([values, -values]) - AIM * via.within
        return excess / UNIT, np.concatenate([slopes, -slopes]) / UNIT

    def excess(self, q: Float[Array, "T n"], dq: Float[Array, "T n"], aimed: bool = True) -> float:
        """Largest excess of any rule along a motion, in units.

        Against the limits themselves if not aimed.
        """
        found = [
            float((row.value - (row.aim if aimed else row.limit)).max()) / row.unit
            for row in self.rows(q, dq)
        ]
        if self.rules.vias:
            for number, t in enumerate(self.when_passed(q)):
                slack = 0.0 if aimed else (1.0 - AIM) * self.rules.vias[number].within / UNIT
                found.append(float(self.via_rows(number, q[t], dq[t])[0].max()) - slack)
        return max(0.0, *found) if found else 0.0

    def check(self, splines: Splines) -> tuple[RuleCheck, ...]:
        """Every rule along the first of a batch of motions, looked at densely, in the scene file's
        own units.
        """
        times = np.linspace(0.0, float(splines.total[0]), DENSE)
        rules = self.rules
        q, dq, _ = splines.at(times)
        place, axes, linear, _ = self.tool(q)
        # Name, values, limit, unit, and -1 where it is the least.
        seen: list[tuple[str, Array, float, str, float]] = []
        if rules.speed is not None:
            speed = np.linalg.norm(np.einsum("tni,tn->ti", linear, dq), axis=1)
            seen.append(("speed of the tool", speed, rules.speed, "m/s", 1.0))
        if rules.straight is not None:
            away = (place - self.first[0]) @ self._axes.T
            beyond = np.maximum(np.maximum(away[:, 0] - self.length, -away[:, 0]), 0.0)
            off = np.linalg.norm(np.column_stack([beyond, away[:, 1:]]), axis=1)
            seen.append(("tool off its straight line", off, rules.straight, "m", 1.0))
            if q.shape[1] >= TURNING:
                turned = np.degrees(np.linalg.norm(self._turned(axes, away[:, 0])[0], axis=1))
                seen.append(
                    ("tool off its even turn", turned, np.degrees(rules.turning), "deg", 1.0)
                )
        for number, cone in enumerate(rules.cones, start=1):
            angle = np.degrees(np.arccos(np.clip(axes @ cone.axis @ cone.towards, -1.0, 1.0)))
            name = f"tool's axis {'inside' if cone.allowed else 'outside'} cone {number}"
            seen.append((name, angle, np.degrees(cone.angle), "deg", 1.0 if cone.allowed else -1.0))
        found = []
        for name, values, limit, unit, sign in seen:
            worst = int(np.argmax(sign * values))
            kept = bool(sign * values[worst] <= sign * limit)
            found.append(
                RuleCheck(name, float(values[worst]), float(limit), unit, float(times[worst]), kept)
            )
        step = times[1] - times[0]
        for number, t in enumerate(self.when_passed(q) if rules.vias else ()):
            via = rules.vias[number]
            near = np.clip(np.linspace(times[t] - step, times[t] + step, CLOSER), 0.0, times[-1])
            missed = np.abs(self.missed(via, splines.at(near)[0])).max(axis=1)
            best = int(np.argmin(missed))
            scale, unit = (1.0, "m") if via.of_tool else (np.degrees(1.0), "deg")
            reached = scale * float(missed[best])
            kept = bool(missed[best] <= via.within)
            name = f"via point {number + 1} passed within"
            found.append(
                RuleCheck(name, reached, scale * via.within, unit, float(near[best]), kept)
            )
        return tuple(found)
