"""Controllers: what each is sent, and the curve that it makes of that, which is not the plan's own.

A controller gets points and joins them in its own way. So a plan is first put on the controller's
step: a clamped cubic spline again, with its knots where the controller takes points. What the
controller then does with the rounded numbers is a curve of cubic sections, too, and it is that
curve of which the certificate speaks.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.robot.arm import ArmModel
from plan.problem.ramps import TimeLaw
from plan.spline import Splines

TABLE = Path(__file__).with_suffix(".toml")
# Points of a motion that has ramps lie so far apart, whatever the controller would take [s].
RAMPED_S = 0.01
# Formats that hold samples of a motion, for any controller or none.
SAMPLED = (".csv", ".parquet")
# ROS 2's message is written as YAML under either name.
SAME = {".yml": ".yaml"}
# Rounding of a count of steps.
NEARLY = 1e-9


@dataclass(frozen=True)
class Controller:
    """What is known of a controller; `controllers.toml` says what each number means."""

    name: str
    arms: str  # regular expression for names of robots
    suffix: str  # of the file that it is sent
    points: Literal["even", "knots"]
    curve: Literal["cubic", "speed", "servo"]
    step_s: float  # least distance of two points
    tick_s: float  # period in which it works
    stamp_s: float  # resolution of times
    digits: int  # decimals of angles and speeds
    source: str
    degrees: bool = False  # whether it is sent degrees
    joints: int | None = None  # how many joints it has; None for any number
    # Whether it holds numbers in single precision: 24 bits, however many decimals it is sent.
    single: bool = False
    before_end_s: tuple[float, ...] = ()  # where points are sent in any case, before the end
    lookahead_s: float = 0.0  # parameters of servoj
    gain: int = 0

    def fits(self, arm: ArmModel) -> bool:
        """Whether an arm may have this controller."""
        return _is_named(self.arms, arm)

    @property
    def keeps_curve(self) -> bool:
        """Whether it makes the plan's own curve of a plan, but for rounding."""
        return self.points == "knots" and self.curve == "cubic"

    def put_on_step(self, splines: Splines, law: TimeLaw) -> Splines:
        """The first of a batch of plans as it is executed, its knots where the controller takes
        points.

        Args:
            splines: The plan.
            law: Its ramps, and by how much it is slowed down for them.

        Returns:
            A clamped spline through the same positions; longer by less than a step, so that it ends
            on one.
        """
        total = law.duration
        whole = self.whole(total)
        if self.points == "even":
            count = self.sections(whole)
            times = whole * np.arange(count + 1) / count
        elif law.ramp > 0.0:
            count = max(int(whole / max(RAMPED_S, self.step_s)), 1)
            times = whole * np.arange(count + 1) / count
        else:
            times = (
                np.concatenate([[0.0], np.cumsum(splines.durations[0])])
                * law.stretch
                * (whole / total)
            )
        more = whole - np.array(self.before_end_s)
        times = np.append(times, more[more > 0.0])
        times = np.unique(np.round(times / self.stamp_s)) * self.stamp_s
        points = law.states(splines, np.minimum(times * (total / whole), total))[0]
        points[0] = splines.points[0, 0]
        points[-1] = splines.points[0, -1]
        return Splines(points[None], np.diff(times)[None])

    def whole(self, total: float) -> float:
        """The shortest duration that is not below one and that the controller can be told [s]."""
        return float(np.ceil(total / self.stamp_s - NEARLY)) * self.stamp_s

    def sections(self, whole: float) -> int:
        """How many steps a duration holds."""
        return max(int(whole / self.step_s + NEARLY), 1)

    def parts(self, total: float) -> int | None:
        """Equal parts of a duration at whose ends a plan's knots lie so that the step keeps it as
        it is; None where that keeps them anywhere.

        Args:
            total: The duration [s].
        """
        if self.keeps_curve:
            return None
        whole = self.whole(total)
        return self.sections(whole) if self.points == "even" else round(whole / self.stamp_s)

    def knots_on_step(self, knots: Float[Array, " K"], total: float) -> Float[Array, " k"]:
        """The nearest shares of a duration at which a spline may have its knots, so that the step
        keeps it as it is.

        Args:
            knots: Shares, from 0 to 1.
            total: The duration, one that the controller can be told [s].
        """
        count = self.sections(total) if self.points == "even" else round(total / self.stamp_s)
        return np.asarray(np.unique(np.round(knots * count)) / count)

    def sent(
        self, splines: Splines
    ) -> tuple[Float[Array, " K"], Float[Array, "K n"], Float[Array, "K n"]]:
        """Times, positions and velocities of a plan on this step, as rounded as they are written
        [s, rad, rad/s].
        """
        knots = np.concatenate([[0.0], np.cumsum(splines.durations[0])])
        if self.curve == "servo":
            count = round(knots[-1] / self.tick_s)
            times = self.tick_s * np.arange(count + 1)
            q, dq, _ = splines.at(times)
        else:
            times = np.round(knots / self.stamp_s) * self.stamp_s
            q = splines.points[0]
            dq = splines.slopes[0]
        if self.curve == "speed":
            speeds = self.rounded(dq)
            return times, self._aimed(times, q, speeds), speeds
        return times, self.rounded(q), self.rounded(dq)

    def _aimed(
        self,
        times: Float[Array, " K"],
        q: Float[Array, "K n"],
        dq: Float[Array, "K n"],
    ) -> Float[Array, "K n"]:
        """Positions to be sent so that velocities that are linear from tick to tick pass by q.

        The trapezia under a section's cubic of N ticks miss, of the way d that it is sent, d / N²,
        and of each end's velocity v they hold v T / (2 N²) too much. A section of one tick goes by
        its velocities alone, wherever it is sent: the one before it ends where it must begin.

        Args:
            times: Times of the points [s].
            q: Where the arm is to be then [rad].
            dq: Velocities, as rounded as they are written [rad/s].

        Returns:
            Positions, as rounded as they are written [rad].
        """
        lengths = np.diff(times)
        ticks = np.round(lengths / self.tick_s)
        wanted = q.copy()
        for k in range(len(lengths) - 1, -1, -1):
            if ticks[k] == 1.0:
                wanted[k] = wanted[k + 1] - 0.5 * self.tick_s * (dq[k] + dq[k + 1])
        wanted[0] = q[0]
        sent = self.rounded(wanted)
        place = sent[0]
        for k, length in enumerate(lengths):
            if ticks[k] > 1.0:
                share = 1.0 / ticks[k] ** 2
                by_ends = 0.5 * share * length * (dq[k] + dq[k + 1])
                way = (wanted[k + 1] - place - by_ends) / (1.0 - share)
                sent[k + 1] = self.rounded(place + way)
            place = _stepped_way(place, sent[k + 1], dq[k : k + 2], length, self.tick_s)[0][-1]
        return sent

    def rounded(self, values: Float[Array, "K n"]) -> Float[Array, "K n"]:
        """Angles [rad] or speeds [rad/s] as they are after having been written and read.

        They are rounded to so many decimals in the unit of the file, then to what the controller
        holds, and come back in the unit of the input.
        """
        unit = np.degrees(1.0) if self.degrees else 1.0
        numbers = np.round(values * unit, self.digits)
        if self.single:
            numbers = numbers.astype(np.float32).astype(float)
        return np.asarray(numbers / unit)

    def make_curve(self, splines: Splines) -> Splines:
        """What the controller makes of a plan on its step, as cubic sections with velocities of
        their own.
        """
        times, q, dq = self.sent(splines)
        if self.curve == "servo":
            return _smoothed(q, self.tick_s)
        if self.curve == "speed":
            return _stepped_speeds(times, q, dq, self.tick_s)
        return Splines(q[None], np.diff(times)[None], dq[None])


def _smoothed(q: Float[Array, "K n"], tick: float) -> Splines:
    """Positions joined by straight lines, and that averaged over one tick.

    Sections of steady acceleration.

    Its knots lie in the middle between two positions, where it goes as fast as the line between
    them.
    """
    middles = (q[1:] + q[:-1]) / 2.0
    slopes = np.diff(q, axis=0) / tick
    still = np.zeros((1, q.shape[1]))
    points = np.concatenate([q[:1], middles, q[-1:]])
    velocities = np.concatenate([still, slopes, still])
    return Splines(points[None], np.full((1, len(q)), tick), velocities[None])


def _stepped_speeds(
    times: Float[Array, " K"], q: Float[Array, "K n"], dq: Float[Array, "K n"], tick: float
) -> Splines:
    """Velocity on the cubic of each section at its ticks, and a straight line between them.

    A section's cubic begins where the arm has come to, so what the lines miss does not add up.
    """
    place = q[0]
    points = [q[:1]]
    velocities = [dq[:1]]
    for k in range(len(times) - 1):
        length = times[k + 1] - times[k]
        way, speed = _stepped_way(place, q[k + 1], dq[k : k + 2], length, tick)
        place = way[-1]
        points.append(way)
        velocities.append(speed)
    every = np.concatenate(points)
    durations = np.full((1, len(every) - 1), tick)
    return Splines(every[None], durations, np.concatenate(velocities)[None])


def _stepped_way(
    start: Float[Array, " n"],
    goal: Float[Array, " n"],
    dq: Float[Array, "2 n"],
    length: float,
    tick: float,
) -> tuple[Float[Array, "N n"], Float[Array, "N n"]]:
    """Positions and velocities of a section at the ends of its ticks [rad, rad/s].

    Args:
        start: Where the arm is [rad].
        goal: Where the section is sent [rad].
        dq: Velocities at its ends [rad/s].
        length: Its duration [s].
        tick: Period of the controller [s].
    """
    steps = round(length / tick)
    cubic = Splines(np.stack([start, goal])[None], np.array([[length]]), dq[None])
    speed = cubic.at(length * np.arange(1, steps + 1) / steps)[1]
    speed[-1] = dq[1]
    before = np.concatenate([dq[:1], speed[:-1]])
    return start + np.cumsum((before + speed) * (0.5 * tick), axis=0), speed


def load_controllers() -> tuple[Controller, ...]:
    """All rows of the table, those of one kind of arm before those of any."""
    rows = tomllib.loads(TABLE.read_text(encoding="utf-8"))["controller"]
    for row in rows:
        row["before_end_s"] = tuple(row.get("before_end_s", ()))
    return tuple(Controller(**row) for row in rows)


def choose_controller(name: str | None, out: Path | None, arm: ArmModel) -> Controller | None:
    """The controller that is named, or the first of the arm whose file ends as the one that is
    asked for.

    Args:
        name: Its name; None where it is not given.
        out: The file to be written; None for none.
        arm: The arm.

    Returns:
        None where no name is given and the file holds samples, or there is none.

    Raises:
        InputError: No such controller, or not this arm's, or its file ends in another way.
    """
    known = load_controllers()
    suffix = None if out is None else SAME.get(out.suffix, out.suffix)
    if name is None:
        if suffix is None or suffix in SAMPLED:
            return None
        ours = [
            controller
            for controller in known
            if controller.suffix == suffix and controller.fits(arm)
        ]
        if ours:
            return ours[0]
        named = sorted({controller.name for controller in known if controller.suffix == suffix})
        what = (
            f"{out.name!r} is a file of {' or '.join(named)}, the robot is {arm.name!r}"
            if out
            else ""
        )
        raise InputError("--out", what, f"end it in one of: {', '.join(_suffixes(arm))}")
    chosen = next((controller for controller in known if controller.name == name), None)
    if chosen is None:
        names = ", ".join(controller.name for controller in known)
        raise InputError("--controller", f"{name!r} is unknown", f"use one of: {names}")
    if not chosen.fits(arm):
        ours = [controller for controller in known if controller.fits(arm)]
        names = ", ".join(controller.name for controller in ours)
        raise InputError("--controller", f"{name} is none of {arm.name!r}", f"use one of: {names}")
    if suffix is not None and suffix not in (*SAMPLED, chosen.suffix):
        ends = ", ".join((chosen.suffix, *SAMPLED))
        raise InputError("--out", f"{name} is sent no {suffix} file", f"end it in one of: {ends}")
    return chosen


def require_joints(controller: Controller, joints: int) -> None:
    """Raises InputError where a controller has another number of joints than the arm."""
    if controller.joints is not None and controller.joints != joints:
        what = f"{controller.name} has {controller.joints} joints, the arm has {joints}"
        raise InputError("--controller", what, "write a .csv or .yaml file")


def _suffixes(arm: ArmModel) -> list[str]:
    """Endings of files that can be written for an arm."""
    ours = [controller.suffix for controller in load_controllers() if controller.fits(arm)]
    return sorted({*ours, *SAMPLED})


def _is_named(pattern: str, arm: ArmModel) -> bool:
    names = (arm.name, "" if arm.source is None else arm.source.stem)
    return any(re.fullmatch(pattern, name.lower()) is not None for name in names)
