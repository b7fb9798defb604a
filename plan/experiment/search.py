"""Searches the families for the motion that answers a question in the least time: random starts, then local steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from plan.experiment.distance import look
from plan.experiment.families import FAMILIES
from plan.experiment.feasible import Feasibility
from plan.experiment.foresight import Eye
from plan.experiment.hypotheses import Question
from plan.experiment.run_set import Programme, duration_of

# Runs by which a programme is judged while searching: two of its family and two wide ones.
TRIAL_RUNS = 4
# Share of the budget for random starts, and that of these for the family that is known to suit the question.
STARTS_SHARE, HINTED_SHARE = 0.5, 0.35
# What every proposal must beat.
BASELINE = "random"
# Starts that are improved, of different families, and the steps' size at first, as a share of each range.
FINALISTS, STEP = 3, 0.15
# A step that worked makes the next ones larger, others make them smaller: one in five may work.
GROW, SHRINK = 1.5, 0.9

Tell = Callable[[int, int, float], None]


@dataclass(frozen=True, eq=False)
class ProgrammeTrial:
    """A programme that was judged.

    Attributes:
        family: Name of its family.
        shares: What it was made of.
        programme: The programme.
        rate: Score a minute [nats/min]; minus infinity if it does not fit.
    """

    family: str
    shares: Float[Array, " d"]
    programme: Programme
    rate: float


@dataclass(frozen=True, eq=False)
class ProgrammeSearch:
    """Searches for one question.

    Attributes:
        eye: What the diagnosis will see.
        feasible: What the arm may do.
        question: What is asked.
        evaluations: Most programmes that are judged.
        seed: Of everything.
    """

    eye: Eye
    feasible: Feasibility
    question: Question
    evaluations: int = 120
    seed: int = 0

    def best(self, tell: Tell | None = None) -> list[ProgrammeTrial]:
        """The best programme of each of the best families, by score a minute; random motion is among them."""
        rng = np.random.default_rng(self.seed)
        done: list[ProgrammeTrial] = []

        def judge(family: str, shares: Array) -> ProgrammeTrial:
            trial = self.judge(family, shares)
            done.append(trial)
            if tell is not None:
                tell(len(done), self.evaluations, max(one.rate for one in done))
            return trial

        for family in self._starts(rng):
            judge(family, rng.uniform(0.0, 1.0, Programme.freedom(family, self.eye.arm.n)))
        finalists = _best_of_families(done)[:FINALISTS]
        for i, start in enumerate(finalists):
            left = (self.evaluations - len(done)) // (len(finalists) - i)
            self._improve(start, left, rng, judge)
        ranked = _best_of_families(done)
        return ranked[:FINALISTS] + [one for one in ranked[FINALISTS:] if one.family == BASELINE]

    def judge(self, family: str, shares: Float[Array, " d"]) -> ProgrammeTrial:
        """Score of a programme."""
        programme = Programme.decode(family, shares, self.question.joint, self.feasible, self.seed)
        runs = programme.runs(TRIAL_RUNS, self.feasible)
        if not runs:
            return ProgrammeTrial(family, shares, programme, -np.inf)
        view = look(self.eye, runs, self.question.effects, self.question.told)
        return ProgrammeTrial(family, shares, programme, 60.0 * self.question.score(view) / duration_of(runs))

    def _starts(self, rng: np.random.Generator) -> list[str]:
        """Families of the random starts: the one that is known to suit most often, every other in turn."""
        count = max(len(FAMILIES), int(STARTS_SHARE * self.evaluations))
        hinted = self.question.family if self.question.family in FAMILIES else "wide"
        first = [hinted] * int(HINTED_SHARE * count)
        names = list(FAMILIES)
        return first + [names[k % len(names)] for k in range(count - len(first))]

    def _improve(
        self, start: ProgrammeTrial, budget: int, rng: np.random.Generator, judge: Callable[..., ProgrammeTrial]
    ) -> None:
        """(1 + 1) evolution strategy in the unit cube."""
        best, step = start, STEP
        for _ in range(budget):
            move = step * rng.standard_normal(len(best.shares))
            trial = judge(best.family, np.clip(best.shares + move, 0.0, 1.0))
            step *= GROW if trial.rate > best.rate else SHRINK
            best = trial if trial.rate > best.rate else best


def _best_of_families(done: Sequence[ProgrammeTrial]) -> list[ProgrammeTrial]:
    """The best trial of each family, the best first."""
    best: dict[str, ProgrammeTrial] = {}
    for trial in sorted(done, key=lambda one: -one.rate):
        best.setdefault(trial.family, trial)
    return list(best.values())
