"""Searches the families for the set of runs with the best score: random starts, then local steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Float
from plan.experiment.families import FAMILIES
from plan.experiment.run_set import RunSet

# Share of the budget for random starts, and that of these for the family that is known to suit the question.
STARTS_SHARE, HINTED_SHARE = 0.5, 0.35
# What every proposal must beat.
BASELINE = "random"
# Starts that are improved, of different families, and the steps' size at first, as a share of each range.
FINALISTS, STEP = 3, 0.15
# A step that worked makes the next ones larger, others make them smaller: one in five may work.
GROW, SHRINK = 1.5, 0.9

Progress = Callable[[int, int, float], None]


class RatedRuns(NamedTuple):
    """A set of runs with its score.

    Attributes:
        rate: Its score; minus infinity if it does not fit.
        family: Name of its family.
        shares: What it was made of, see `RunSet.decode`.
    """

    rate: float
    family: str
    shares: Float[Array, " d"]


def search(
    rate: Callable[[str, Array], float],
    joints: int,
    hinted: str,
    evaluations: int,
    seed: int,
    progress: Progress | None = None,
) -> list[RatedRuns]:
    """The best set of each of the best families, by score; random motion is among them.

    Args:
        rate: Score of a family and its shares.
        joints: Number of the arm's joints.
        hinted: The family that is known to suit: it is tried most often, every other in turn.
        evaluations: Most sets that are rated.
        seed: Of all chance.
        progress: Called after each with evaluations, allowed, best score.
    """
    rng, done = np.random.default_rng(seed), list[RatedRuns]()

    def attempt(family: str, shares: Array) -> RatedRuns:
        done.append(RatedRuns(rate(family, shares), family, shares))
        if progress is not None:
            progress(len(done), evaluations, max(one.rate for one in done))
        return done[-1]

    count, names = max(len(FAMILIES), int(STARTS_SHARE * evaluations)), list(FAMILIES)
    first = [hinted if hinted in FAMILIES else "wide"] * int(HINTED_SHARE * count)
    for family in first + [names[k % len(names)] for k in range(count - len(first))]:
        attempt(family, rng.uniform(0.0, 1.0, RunSet.freedom(family, joints)))
    finalists = _best_of_families(done)[:FINALISTS]
    for i, best in enumerate(finalists):  # a (1 + 1) evolution strategy in the unit cube
        step = STEP
        for _ in range((evaluations - len(done)) // (len(finalists) - i)):
            move = step * rng.standard_normal(len(best.shares))
            trial = attempt(best.family, np.clip(best.shares + move, 0.0, 1.0))
            step *= GROW if trial.rate > best.rate else SHRINK
            best = trial if trial.rate > best.rate else best
    ranked = _best_of_families(done)
    return ranked[:FINALISTS] + [one for one in ranked[FINALISTS:] if one.family == BASELINE]


def _best_of_families(done: Sequence[RatedRuns]) -> list[RatedRuns]:
    """The best trial of each family, the best first."""
    best: dict[str, RatedRuns] = {}
    for trial in sorted(done, key=lambda one: -one.rate):
        best.setdefault(trial.family, trial)
    return list(best.values())
