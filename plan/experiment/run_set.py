"""Sets of runs made to fit an arm: of one family with its figures about a home pose, and random ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RobotError
from ident.robot.arm import ArmModel
from ident.trajectories.kinds import plan_motions
from ident.trajectories.limits import MotionLimits
from ident.trajectories.reference import TICK_S, ReferenceMotion, sampled, ticks
from plan.experiment.families import FAMILIES, SPREAD, Stage, figure_at
from plan.experiment.feasible import Feasibility

# Rough duration of a run, and standstill at both of its ends [s].
RUN_S, STILL_S = 10.0, 0.3
# Mean speed of the moves from home to a run's own pose and back, as a share of the speed limits.
TRANSFER_SHARE = 0.3
# Sizes that are tried until a run fits.
SIZES = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1)
# Every so many runs all joints move, if they don't in all: that keeps the inertias known, and rivals elsewhere at bay.
# The diagnosis leaves out run by run, so that no joint may move in a single one.
WIDE_EVERY = 2
WIDE_FAMILIES = ("wide", "vias", "random")
WIDE_FIGURES = {"base_hz": 0.12, "swing": 0.9, SPREAD: 0.0}
# Homes, and at most the poses of runs about them, lie within this share of the usual span.
HOME_SHARE = 0.8
# For arms whose limits leave little room: half of the span at the least, two seconds from point to point.
CAREFUL = {"swing": 0.5, "leg_s": 2.0, "draw": 0.0, SPREAD: 0.0}


@dataclass(frozen=True, eq=False)
class RunSet:
    """Runs of one family; each starts and ends at home, so that they can be run one after the other.

    The other joints stand in a pose of each run's own, which changes what the joint in question carries.

    Attributes:
        family: Name of the family.
        figures: Its figures.
        home: Start and end of every run [rad].
        joint: The joint that moves most.
        seed: Of poses, phases and orders.
    """

    family: str
    figures: Mapping[str, float]
    home: Float[Array, " n"]
    joint: int
    seed: int

    @classmethod
    def decode(cls, family: str, shares: Float[Array, " d"], joint: int, limits: MotionLimits, seed: int) -> RunSet:
        """A set from shares in [0, 1]: first of the home pose, then of the figures."""
        n = limits.arm.n
        home = limits.centre + HOME_SHARE * limits.span * (2.0 * np.clip(shares[:n], 0.0, 1.0) - 1.0)
        ranges = zip(FAMILIES[family].items(), shares[n:], strict=True)
        return cls(family, {name: figure_at(name, ends, share) for (name, ends), share in ranges}, home, joint, seed)

    @staticmethod
    def freedom(family: str, n: int) -> int:
        """Number of shares that make a set."""
        return n + len(FAMILIES[family])

    def run(self, number: int, feasible: Feasibility) -> ReferenceMotion | None:
        """One run, the largest that fits; None if none does."""
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
        family, figures = ("wide", dict(WIDE_FIGURES)) if wide else (self.family, dict(self.figures))
        rng, home = np.random.default_rng([self.seed, number]), self.home
        spread = size * figures.pop(SPREAD) * HOME_SHARE * limits.span
        own = np.clip(home + spread * rng.uniform(-1.0, 1.0, len(home)), limits.lower, limits.upper)
        duration = max(0.2, 1.9 * float(np.max(np.abs(own - home) / (TRANSFER_SHARE * limits.speed))))
        s = ticks(duration)[:, None] / duration
        there = home + (own - home) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)  # its acceleration is continuous
        left = max(RUN_S - 2.0 * len(there) * TICK_S - 2.0 * STILL_S, 4.0)
        path = getattr(Stage(limits, self.joint, own, size, left, rng), family)(**figures)
        return sampled(family, np.concatenate([there, path, there[::-1]])).held(STILL_S, STILL_S)

    def runs(self, count: int, feasible: Feasibility) -> list[ReferenceMotion]:
        """The first runs; none at all if one of them can't be made to fit."""
        found: list[ReferenceMotion] = []
        for number in range(count):
            motion = self.run(number, feasible)
            if motion is None:
                return []
            found.append(motion)
        return found


def duration_of(runs: Sequence[ReferenceMotion]) -> float:
    """Length of all runs together [s]."""
    return float(sum(run.duration for run in runs))


def random_runs(arm: ArmModel, count: int, duration: float, rng: np.random.Generator) -> list[ReferenceMotion]:
    """Runs through random via points, there and back at several speeds; careful ones where these don't fit the arm.

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
        careful = RunSet("vias", CAREFUL, np.array(feasible.limits.centre), 0, int(rng.integers(2**31)))
        runs = careful.runs(count, feasible)
        if not runs:
            raise
        return runs
