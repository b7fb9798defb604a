"""How warm each joint is along runs: what a model whose friction follows warmth must know besides the motion.

A diagnosis tells how much friction changes between the coldest and the warmest moment of its recordings, and how fast a
joint warms, not how warm it was when. That follows from the motion itself: θ' = P − θ / τ with P the power that
friction turns into heat, over the clock of all runs, pauses included. Coldest and warmest are those of the runs that
the diagnosis saw; later ones go on from where those left the joint.

Source: the law of `thermal_friction` of the catalogue (Wolf and Iskandar 2018; Simoni 2017).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ident.arrays import Array, Float
from ident.effects.hysteresis_thermal import warm_up
from ident.export.law_model import LawModel, SimulatorModel
from ident.trajectories.reference import TICK_S, ReferenceMotion

CONSTANT = "time_constant_s"
# A joint of which nobody knows how warm it is.
HALF_WARM = 0.5
# Heat of less than this is none [J].
LEAST_HEAT = 1e-12


class TimedRun(Protocol):
    """A run on a clock."""

    @property
    def time(self) -> Float[Array, " T"]: ...

    @property
    def interval(self) -> float: ...

    @property
    def dq(self) -> Float[Array, "T n"]: ...


@dataclass(frozen=True, eq=False)
class PlannedRun:
    """A planned motion on a clock."""

    time: Float[Array, " T"]
    dq: Float[Array, "T n"]
    interval: float = TICK_S


def put_on_a_clock(motions: Sequence[ReferenceMotion], pause: float) -> tuple[PlannedRun, ...]:
    """Planned motions one after the other, each after the same pause [s]."""
    found, clock = [], 0.0
    for motion in motions:
        clock += pause
        found.append(PlannedRun(clock + TICK_S * np.arange(len(motion.dq)), motion.dq))
        clock += motion.duration
    return tuple(found)


@dataclass(frozen=True)
class WarmJoint:
    """One joint that warms.

    Attributes:
        joint: Its index.
        constant: How long it keeps its heat [s].
        coldest, span: Of the runs that the law was learnt from: least heat and how much more the largest was [J].
        heat: At the end of the last run that is known [J].
        clock: When that was [s]; None before the first run.
    """

    joint: int
    constant: float
    coldest: float = 0.0
    span: float = 1.0
    heat: float = 0.0
    clock: float | None = None


@dataclass(frozen=True)
class Warmth:
    """Joints that warm, and how warm they are by now; none where no law follows warmth or a sensor tells it."""

    joints: tuple[WarmJoint, ...] = ()

    @classmethod
    def learnt(cls, model: LawModel, runs: Sequence[TimedRun]) -> Warmth:
        """Of a model, from the runs that its laws were learnt from."""
        found = []
        for _, joint, figures in model.effects:
            if CONSTANT not in figures:
                continue
            courses, last = _courses(WarmJoint(joint, figures[CONSTANT]), model, runs)
            coldest, warmest = min(c.min() for c in courses), max(c.max() for c in courses)
            span = max(float(warmest - coldest), LEAST_HEAT)
            found.append(replace(last, coldest=float(coldest), span=span))
        return cls(tuple(found))

    def after(self, model: LawModel, runs: Sequence[TimedRun]) -> Warmth:
        """What it is after further runs."""
        return Warmth(tuple(_courses(joint, model, runs)[1] for joint in self.joints))

    def rested(self) -> Warmth:
        """The same joints, cold."""
        return Warmth(tuple(replace(joint, heat=0.0, clock=None) for joint in self.joints))

    def along(self, model: SimulatorModel, runs: Sequence[TimedRun]) -> tuple[SimulatorModel, ...]:
        """The model for each of further runs, in their order; one without such a law is the same for all."""
        if not self.joints or not isinstance(model, LawModel):
            return (model,) * len(runs)
        warmth = [np.full(run.dq.shape, HALF_WARM) for run in runs]
        for joint in self.joints:
            for values, course in zip(warmth, _courses(joint, model, runs)[0], strict=True):
                values[:, joint.joint] = (course - joint.coldest) / joint.span
        return tuple(replace(model, warmth=values) for values in warmth)


NO_WARMTH = Warmth()


def _courses(joint: WarmJoint, model: LawModel, runs: Sequence[TimedRun]) -> tuple[list[Float[Array, " T"]], WarmJoint]:
    """Heat over each run [J], and the joint as the last one leaves it."""
    found, heat, clock = [], joint.heat, joint.clock
    coulomb, viscous = model.losses.coulomb[joint.joint], model.losses.viscous[joint.joint]
    for run in runs:
        rest = 0.0 if clock is None else max(float(run.time[0]) - clock, 0.0)
        heat *= np.exp(-rest / joint.constant)
        speed = np.abs(run.dq[:, joint.joint])
        found.append(warm_up(speed * (coulomb + viscous * speed), run.interval, joint.constant, heat))
        heat, clock = float(found[-1][-1]), float(run.time[-1])
    return found, replace(joint, heat=heat, clock=clock)
