"""Runs made to fit an arm: a programme of one family with its figures about a home pose, and random ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RobotError
from ident.robot.arm import ArmModel
from ident.trajectories.kinds import plan_motions
from ident.trajectories.reference import ReferenceMotion
from plan.experiment.families import FAMILIES, make_run
from plan.experiment.feasible import Feasibility

# Sizes that are tried until a run fits.
SIZES = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1)
# Every so many runs all joints move, if they don't in all: that keeps the inertias known, and rivals elsewhere at bay.
# The diagnosis leaves out run by run, so that no joint may move in a single one.
WIDE_EVERY = 2
WIDE_FAMILIES = ("wide", "vias", "random")
WIDE_FIGURES = {"base_hz": 0.12, "swing": 0.9, "pose_spread": 0.0}
# Homes lie within this share of the usual span about the middle.
HOME_SHARE = 0.8
# For arms whose limits leave little room: half of the span at the least, two seconds from point to point.
CAREFUL = {"swing": 0.5, "leg_s": 2.0, "draw": 0.0, "pose_spread": 0.0}


@dataclass(frozen=True, eq=False)
class Programme:
    """What the arm is asked to do.

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
    def decode(cls, family: str, shares: Float[Array, " d"], joint: int, feasible: Feasibility, seed: int) -> Programme:
        """A programme from shares in [0, 1]: first of the home pose, then of the figures."""
        limits, n = feasible.limits, feasible.limits.arm.n
        home = limits.centre + HOME_SHARE * limits.span * (2.0 * np.clip(shares[:n], 0.0, 1.0) - 1.0)
        figures = zip(FAMILIES[family].figures, shares[n:], strict=True)
        return cls(family, {figure.name: figure.at(float(share)) for figure, share in figures}, home, joint, seed)

    @staticmethod
    def freedom(family: str, n: int) -> int:
        """Number of shares that make a programme."""
        return n + len(FAMILIES[family].figures)

    def run(self, number: int, feasible: Feasibility) -> ReferenceMotion | None:
        """One run, the largest that fits; None if none does."""
        wide = self.family not in WIDE_FAMILIES and number % WIDE_EVERY == WIDE_EVERY - 1
        family = FAMILIES["wide" if wide else self.family]
        figures = WIDE_FIGURES if wide else self.figures
        for size in SIZES:
            rng = np.random.default_rng([self.seed, number])
            try:
                motion = make_run(family, figures, feasible.limits, self.joint, self.home, size, rng)
            except RobotError:  # these points can't be followed however slowly
                continue
            if feasible.allows(motion):
                return motion
        return None

    def runs(self, count: int, feasible: Feasibility) -> list[ReferenceMotion]:
        """The first runs; none at all if one of them can't be made to fit."""
        found: list[ReferenceMotion] = []
        for number in range(count):
            motion = self.run(number, feasible)
            if motion is None:
                return []
            found.append(motion)
        return found


def duration_of(runs: list[ReferenceMotion]) -> float:
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
        runs = Programme("vias", CAREFUL, np.array(feasible.limits.centre), 0, int(rng.integers(2**31))).runs(
            count, feasible
        )
        if not runs:
            raise
        return runs
