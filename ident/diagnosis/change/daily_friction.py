"""Friction of another day: a variance component of every model of two sets.

Friction differs between two sessions though nothing was done to the arm: joints are some kelvin
warmer, grease has settled. From run to run it follows a random walk, and the mean of R runs that
start from a common level is off by R / 3 of a step's variance. So beside every set of changes each
joint's dry and viscous friction differ between the sets by N(0, v f²) of their level f,

    v = d² (1 / S₁ + 1 / S₂) + w² (R₁ / S₁² + R₂ / S₂²) / 3,

with S sessions and R runs of each set, d the deviation from day to day, and w that from run to run.

Source: Bittencourt and Gunnarsson 2010 (static friction falls by about one per cent a kelvin); runs
of different days of a UR10e differ by 2 to 5 % of their friction.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.change.laws import FrictionChange
from ident.diagnosis.change.paired_design import PairedDesign
from ident.diagnosis.change.settings import CHANGE
from ident.effects.session_context import friction_level
from ident.regression.design import Group

Counts = tuple[int, int]


def daily_variance(run_deviation: float, runs: Counts, sessions: Counts) -> float:
    """Variance of the difference of both sets' friction without a change of the arm, as a share of
    its square.

    Args:
        run_deviation: Standard deviation of friction from run to run, as a share.
        runs, sessions: Number of runs and of sessions of each set.
    """
    between_days = sum(1.0 / count for count in sessions)
    pairs = zip(runs, sessions, strict=True)
    walked = sum(run_count / session_count**2 for run_count, session_count in pairs)
    return CHANGE.day_to_day**2 * between_days + run_deviation**2 * walked / 3.0


def daily_friction(design: PairedDesign) -> dict[Group, Float[Array, " 2"]]:
    """For each joint the columns of its friction, and how far they differ between days.

    Returns:
        By a group of these columns the standard deviations of their scaled coefficients.
    """
    evidence = design.sums.evidence
    # Few runs determine one joint's step badly: the median over the arm's joints is used.
    run_deviation = float(np.median(evidence.spread[design.joints_with_rows]))
    share = np.sqrt(daily_variance(run_deviation, design.sides.counts, design.sessions))
    components: dict[Group, Float[Array, " 2"]] = {}
    for group in evidence.layout.groups:
        if group.effect.id == FrictionChange.id:
            level = np.array(friction_level(design.session, group.joint))
            columns = Group(group.effect, group.joint, group.variant, group.columns)
            components[columns] = share * level * evidence.scale[group.columns]
    return components
