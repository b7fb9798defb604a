"""Sets of runs made to fit an arm, of families of motions that an experimenter knows, and random
ones.

Each family has a few figures, for one joint of an arm in some pose.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RobotError
from ident.robot.arm import ArmModel
from ident.trajectories.kinds import plan_motions
from ident.trajectories.motion_limits import MotionLimits
from ident.trajectories.reference import (
    TICK_S,
    ReferenceMotion,
    sampled,
    ticks,
)
from plan.experiment.feasible import Feasibility
from plan.experiment.stage import Stage

SPREAD = "pose_spread"
"""The figure of all families that says how far a run's pose lies from home.

As a share of the usual span.
"""
Figures = dict[str, tuple[float, float]]
"""The ends of each figure's range, by its name."""

FAMILIES: dict[str, Figures] = tomllib.loads(
    Path(__file__).with_name("families.toml").read_text(encoding="utf-8")
)
"""Each family, as in `ident.effects.effect_info`, with ranges of the numbers that are searched."""
# Ends of the names of figures that are searched on a logarithmic scale.
LOGARITHMIC = ("_rad", "_rad_s", "_hz", "leg_s", "period_s", "speed_share")
# Rough duration of a run, and standstill at both of its ends [s].
RUN_S = 10.0
STILL_S = 0.3
# Mean speed of the moves from home to a run's own pose and back, as a share of the speed limits.
TRANSFER_SHARE = 0.3
# Shortest of these moves, and of a run's own part [s].
SHORTEST_TRANSFER = 0.2
SHORTEST_PART = 4.0
# Top speed of a move of continuous acceleration, over its mean: 15/8, and a little.
FASTEST_OF_MEAN = 1.9
# Sizes that are tried until a run fits.
SIZES = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1)
# Every so many runs all joints move, if they don't in all: that keeps the inertias known, and
# rivals elsewhere at bay. The diagnosis leaves out run by run, so that no joint may move in a
# single one.
WIDE_EVERY = 2
WIDE_FAMILIES = ("wide", "vias", "random", "fourier")
WIDE_FIGURES = {"base_hz": 0.12, "swing": 0.9, SPREAD: 0.0}
# What the textbook proposes where nothing is optimised: a Fourier series of eight seconds about the
# arm's middle.
TEXTBOOK = {"period_s": 8.0, "slope": 1.0, "swing": 1.0, "draw": 0.0, SPREAD: 0.0}
# Homes, and at most the poses of runs about them, lie within this share of the usual span.
HOME_SHARE = 0.8
# For arms whose limits leave little room: half of the span at the least, two seconds from point to
# point.
CAREFUL = {"swing": 0.5, "leg_s": 2.0, "draw": 0.0, SPREAD: 0.0}


def figure_at(name: str, bounds: tuple[float, float], share: float) -> float:
    """A family's figure at a share of its range.

    Args:
        name: The figure's; one that ends as `LOGARITHMIC` lists goes by ratios, others evenly.
        bounds: Its least and its largest value.
        share: 0 to 1; clipped to that.
    """
    share = float(np.clip(share, 0.0, 1.0))
    (low, high) = bounds
    if name.endswith(LOGARITHMIC):
        return float(low * (high / low) ** share)
    return float(low + share * (high - low))


@dataclass(frozen=True, eq=False)
class RunSet:
    """Runs of one family.

    Each starts and ends at home, so that they can be run one after the other.

    The other joints stand in a pose of each run's own, which changes what the joint in question
    carries.
    """

    family: str  # name of the family
    figures: Mapping[str, float]  # its figures
    home: Float[Array, " n"]  # start and end of every run [rad]
    joint: int  # the joint that moves most
    seed: int  # of poses, phases and orders

    @classmethod
    def decode(
        cls, family: str, shares: Float[Array, " d"], joint: int, limits: MotionLimits, seed: int
    ) -> RunSet:
        """A set of runs from shares in [0, 1]; what lies outside is clipped.

        Args:
            family: A name of `FAMILIES`.
            shares: One for each joint of the home pose, then one a figure in the family's order; as
                many as `freedom` says.
            joint: Number of the joint in question.
            limits: What the arm's motion may be.
            seed: Of what the runs leave to chance.
        """
        n = limits.arm.n
        away = 2.0 * np.clip(shares[:n], 0.0, 1.0) - 1.0
        home = limits.centre + HOME_SHARE * limits.span * away
        figures = {}
        for (name, (low, high)), share in zip(FAMILIES[family].items(), shares[n:], strict=True):
            figures[name] = figure_at(name, (low, high), share)
        return cls(family, figures, home, joint, seed)

    @staticmethod
    def freedom(family: str, n: int) -> int:
        """Number of shares that make a set of a family for an arm of n joints."""
        return n + len(FAMILIES[family])

    def run(self, number: int, feasible: Feasibility) -> ReferenceMotion | None:
        """Run of a number, from 0, at the largest size that fits; None if it fits at none."""
        for size in SIZES:
            try:
                motion = self._sized(number, size, feasible.limits)
            except RobotError:  # these points can't be followed however slowly
                continue
            if feasible.allows(motion):
                return motion
        return None

    def _sized(self, number: int, size: float, limits: MotionLimits) -> ReferenceMotion:
        """From home to the run's own pose, the family's motion there, and back home.

        Args:
            number: Of the run.
            size: Share of the family's reach and spread, 1 for all of it.
            limits: Of the arm.
        """
        wide = self.family not in WIDE_FAMILIES and number % WIDE_EVERY == WIDE_EVERY - 1
        family = "wide" if wide else self.family
        figures = dict(WIDE_FIGURES if wide else self.figures)
        rng = np.random.default_rng([self.seed, number])
        home = self.home
        spread = size * figures.pop(SPREAD) * HOME_SHARE * limits.span
        away = spread * rng.uniform(-1.0, 1.0, len(home))
        pose = np.clip(home + away, limits.lower, limits.upper)
        steady = np.max(np.abs(pose - home) / (TRANSFER_SHARE * limits.speed))
        duration = max(SHORTEST_TRANSFER, FASTEST_OF_MEAN * float(steady))
        s = ticks(duration)[:, None] / duration
        # Its acceleration is continuous.
        there = home + (pose - home) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        left = max(RUN_S - 2.0 * len(there) * TICK_S - 2.0 * STILL_S, SHORTEST_PART)
        stage = Stage(limits, self.joint, pose, size, left, rng)
        path = getattr(stage, family)(**figures)
        whole = np.concatenate([there, path, there[::-1]])
        return sampled(family, whole).held(STILL_S, STILL_S)

    def runs(self, count: int, feasible: Feasibility) -> list[ReferenceMotion]:
        """The first runs; none at all if one of them can't be made to fit."""
        runs: list[ReferenceMotion] = []
        for number in range(count):
            motion = self.run(number, feasible)
            if motion is None:
                return []
            runs.append(motion)
        return runs


def duration_of(runs: Sequence[ReferenceMotion]) -> float:
    """Length of all runs together [s]."""
    return float(sum(run.duration for run in runs))


def random_runs(
    arm: ArmModel, count: int, duration: float, rng: np.random.Generator
) -> list[ReferenceMotion]:
    """Runs through random via points, there and back at several speeds.

    Careful ones where these don't fit the arm.

    Args:
        arm: The arm.
        count: Number of runs.
        duration: Rough duration of a run [s].
        rng: Source of chance.

    Raises:
        RobotError: None fit at all.
    """
    try:
        return list(plan_motions(arm, ("spline",), count, duration, rng))
    except RobotError:
        feasible = Feasibility(arm, "capsules")  # to compare with, never to be run
        centre = np.array(feasible.limits.centre)
        careful = RunSet("vias", CAREFUL, centre, 0, int(rng.integers(2**31)))
        runs = careful.runs(count, feasible)
        if not runs:
            raise
        return runs
