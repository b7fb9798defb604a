"""Random motion through via points: what a proposed motion is compared with."""

from __future__ import annotations

import numpy as np

from ident.errors import RobotError
from ident.robot.arm import ArmModel
from ident.trajectories.kinds import plan_motions
from ident.trajectories.reference import ReferenceMotion
from plan.experiment.feasible import Feasibility
from plan.experiment.run_set import Programme

# For arms whose limits leave little room: half of the span at the least, two seconds from point to point.
CAREFUL = {"swing": 0.5, "leg_s": 2.0, "draw": 0.0, "pose_spread": 0.0}


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
