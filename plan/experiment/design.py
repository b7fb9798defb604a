"""From hypotheses to the motion that parts them.

Search, length, proof, and random motion to compare with.

The families are searched for the set of runs with the best score: random starts, then local steps.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RobotError
from ident.progress import step
from ident.robot.arm import ArmModel
from ident.trajectories.reference import ReferenceMotion
from plan.command_options import ExciteOptions
from plan.experiment.distance import PredictedDesign, Predictor
from plan.experiment.feasible import OPEN, Feasibility
from plan.experiment.hypotheses import LONGEST_MINUTES, Hypotheses
from plan.experiment.result import Excitation, minutes_to_odds
from plan.experiment.run_set import (
    FAMILIES,
    TEXTBOOK,
    WIDE_FIGURES,
    RunSet,
    duration_of,
    random_runs,
)
from plan.problem.task_file import Surroundings

# Share of the budget for random starts, and that of these for the family that is known to suit the
# question.
STARTS_SHARE = 0.5
HINTED_SHARE = 0.35
# What every proposal must beat.
BASELINE = "random"
# Starts that are improved, of different families, and the steps' size at first, as a share of each
# range.
FINALISTS = 3
STEP = 0.15
# A step that worked makes the next ones larger, others make them smaller: one in five may work.
GROW = 1.5
SHRINK = 0.9
# Runs by which a set is rated while searching: two of its family and two wide ones.
TRIAL_RUNS = 4
# The diagnosis leaves out one run after the other: fewer than these say too little, more try the
# user's patience.
FEWEST_RUNS = 6
MOST_RUNS = 60
# With the length given: two runs of the family, and two in which all joints move.
LEAST_RUNS = 4
# Where the question has no odds [min].
USUAL_MINUTES = 3.0
# What is expected is only expected: so much more is recorded than it needs.
RESERVE = 1.5
RANDOM_TRIES = 3
# Draws of random motion that the search's best must beat at full length, else the best of them is
# proposed.
BASELINE_DRAWS = 4
PROOF_TRIES = 5
# Phases of the textbook's Fourier series that are drawn; the one in the middle is told.
TEXTBOOK_DRAWS = 3
USUAL = ExciteOptions()


class RatedRuns(NamedTuple):
    """A set of runs with its score."""

    rate: float  # its score; minus infinity if it does not fit
    family: str  # name of its family
    shares: Float[Array, " d"]  # what it was made of, see `RunSet.decode`


def search(
    rate: Callable[[str, Array], float], joints: int, hinted: str, evaluations: int, seed: int
) -> list[RatedRuns]:
    """The best set of each of the best families, by score; random motion is among them.

    Args:
        rate: Score of a family and its shares.
        joints: Number of the arm's joints.
        hinted: The family that is known to suit: it is tried most often, every other in turn.
        evaluations: Most sets that are rated.
        seed: Of all chance.
    """
    rng = np.random.default_rng(seed)
    done = list[RatedRuns]()

    def attempt(family: str, shares: Array) -> RatedRuns:
        done.append(RatedRuns(rate(family, shares), family, shares))
        step(len(done), evaluations)
        return done[-1]

    count = max(len(FAMILIES), int(STARTS_SHARE * evaluations))
    names = list(FAMILIES)
    suited = [hinted if hinted in FAMILIES else "wide"] * int(HINTED_SHARE * count)
    others = [names[k % len(names)] for k in range(count - len(suited))]
    for family in suited + others:
        attempt(family, rng.uniform(0.0, 1.0, RunSet.freedom(family, joints)))
    # None where no start fits: no step from one will.
    fitting = [trial for trial in _best_of_families(done) if np.isfinite(trial.rate)]
    finalists = fitting[:FINALISTS]
    for number, best in enumerate(finalists):  # a (1 + 1) evolution strategy in the unit cube
        reach = STEP
        for _ in range((evaluations - len(done)) // (len(finalists) - number)):
            move = reach * rng.standard_normal(len(best.shares))
            trial = attempt(best.family, np.clip(best.shares + move, 0.0, 1.0))
            if trial.rate > best.rate:
                best = trial
                reach *= GROW
            else:
                reach *= SHRINK
    ranked = _best_of_families(done)
    baselines = [trial for trial in ranked[FINALISTS:] if trial.family == BASELINE]
    return ranked[:FINALISTS] + baselines


def _best_of_families(done: Sequence[RatedRuns]) -> list[RatedRuns]:
    """The best trial of each family, the best first."""
    best: dict[str, RatedRuns] = {}
    for trial in sorted(done, key=lambda trial: -trial.rate):
        best.setdefault(trial.family, trial)
    return list(best.values())


class Designer:
    """Looks for the motion of one arm that parts some hypotheses.

    Args:
        arm: The arm.
        hypotheses: What is to be parted.
        options: Length, evaluations, seed, and what stands in for links without collision geometry.
        around: What stands around the arm, and limits inside the robot's.

    Raises:
        RobotError: A link has no shape, or two are too near one another wherever the arm is.
    """

    def __init__(
        self,
        arm: ArmModel,
        hypotheses: Hypotheses,
        options: ExciteOptions = USUAL,
        around: Surroundings = OPEN,
    ) -> None:
        self.arm = arm
        self.options = options
        self.hypotheses = hypotheses
        self.predictor = Predictor.of(arm, hypotheses.noise)
        self.feasible = Feasibility(arm, options.shapes, around)
        self.feasible.require_room()
        home = np.array(self.feasible.limits.centre)
        self.general = RunSet("wide", WIDE_FIGURES, home, hypotheses.joint, options.seed)
        self.hypotheses = replace(hypotheses, testable=self._testable())

    def see(self, runs: list[ReferenceMotion]) -> PredictedDesign:
        """What the diagnosis will see in some runs."""
        return self.predictor.look(runs, self.hypotheses.effects, self.hypotheses.reported)

    def decode(self, family: str, shares: Float[Array, " d"], draw: int = 0) -> RunSet:
        """A set of runs for the joint in question.

        Args:
            family: A name of `FAMILIES`.
            shares: The set's figures as shares of their ranges, 0 to 1; see `RunSet.decode`.
            draw: Added to the options' seed: another draw of what is left to chance.
        """
        limits = self.feasible.limits
        seed = self.options.seed + draw
        return RunSet.decode(family, shares, self.hypotheses.joint, limits, seed)

    def rate(self, family: str, shares: Float[Array, " d"]) -> float:
        """Score of a few runs a minute [nats/min]; minus infinity if they don't fit."""
        runs = self.decode(family, shares).runs(TRIAL_RUNS, self.feasible)
        if not runs:
            return -np.inf
        return 60.0 * self.hypotheses.score(self.see(runs)) / duration_of(runs)

    def best(self) -> Excitation:
        """The motion that a search finds, with random motion of its length beside it.

        Raises:
            RobotError: No motion of this arm keeps its limits and its distance from itself.
        """
        began = time.perf_counter()
        asked = self.hypotheses
        scene = self.feasible.scene
        searches = asked.testable != ()
        evaluations = self.options.evaluations if searches else 0
        run_sets = self._searched() if searches else [self.general]
        run_set, runs, view = self._best_at_length(run_sets)
        by_chance = self._by_chance(runs)
        noise = map(float, self.predictor.noise)
        sources = {"noise": "a share of the rated torque" if asked.noise is None else "diagnosis"}
        for candidate in view.candidates:
            sources[candidate.effect.id] = candidate.source
        return Excitation(
            robot=self.arm.name,
            status=asked.status,
            aim=asked.aim,
            effects=asked.ids,
            joint=self.arm.joint_names[asked.joint],
            run_set=run_set,
            runs=tuple(runs),
            distances=asked.distances(view),
            random=asked.distances(by_chance),
            testable=asked.testable,
            information=(view.information(), by_chance.information()),
            against_textbook=self._against_textbook(view, len(runs)),
            noise=dict(zip(self.arm.joint_names, noise, strict=True)),
            sources=sources,
            clearance=min(map(self.feasible.clearance, runs)) if len(scene.pairs) else None,
            scene=scene,
            carried=self.feasible.carried,
            set_up=asked.set_up,
            evaluations=evaluations,
            seconds=time.perf_counter() - began,
            seed=self.options.seed,
        )

    def _searched(self) -> list[RunSet]:
        """What a search finds, beside random motion and the textbook's."""
        seed = self.options.seed
        evaluations = self.options.evaluations
        rated = search(self.rate, self.arm.n, self.hypotheses.family, evaluations, seed)
        rng = np.random.default_rng([seed, 2])
        freedom = RunSet.freedom(BASELINE, self.arm.n)
        draws = rng.uniform(0.0, 1.0, (BASELINE_DRAWS, freedom))
        run_sets = [self.decode(trial.family, trial.shares) for trial in rated]
        run_sets += [self.decode(BASELINE, shares, number) for number, shares in enumerate(draws)]
        return run_sets + self._textbook()

    def _by_chance(self, runs: Sequence[ReferenceMotion]) -> PredictedDesign:
        """What random motion of the same length usually tells: the middle of several draws."""
        each = max(duration_of(runs) / len(runs), 1.0)
        designs = []
        for draw in range(RANDOM_TRIES):
            rng = np.random.default_rng([self.options.seed, draw, 1])
            designs.append(self.see(random_runs(self.arm, len(runs), each, rng)))
        return sorted(designs, key=self.hypotheses.score)[RANDOM_TRIES // 2]

    def _textbook(self) -> list[RunSet]:
        """The textbook's Fourier series about the arm's middle, with other phases each."""
        home = np.array(self.feasible.limits.centre)
        run_sets = []
        for draw in range(TEXTBOOK_DRAWS):
            figures = {**TEXTBOOK, "draw": draw}
            run_sets.append(RunSet("fourier", figures, home, self.hypotheses.joint, 0))
        return run_sets

    def _against_textbook(self, view: PredictedDesign, count: int) -> tuple[float, float] | None:
        """What the textbook's series of so many runs tells [nats], and how wide the proposal's
        intervals are beside it.

        The width is the median, over the base parameters, of the ratio of standard deviations. None
        where no series fits this arm.
        """
        designs: list[PredictedDesign] = []
        for run_set in self._textbook():
            runs = run_set.runs(count, self.feasible)
            if runs:
                designs.append(self.see(runs))
        if not designs:
            return None
        ranked = sorted(designs, key=lambda design: design.information())
        middle = ranked[len(designs) // 2]
        ratios = view.base_deviations() / middle.base_deviations()
        return middle.information(), float(np.median(ratios))

    def _testable(self) -> tuple[tuple[str, str], ...] | None:
        """Of effects that another set-up would part, the pairs (true, rival) that wide motion of
        all joints parts too.

        An effect that is a special case of its rival is fitted by it whatever the arm does; the
        rival may still show. None where all can be parted.
        """
        if self.hypotheses.aim != "separate" or self.hypotheses.set_up is None:
            return None
        runs = self.general.runs(TRIAL_RUNS, self.feasible)
        if not runs:
            return ()
        distances = self.hypotheses.distances(self.see(runs))
        parted = []
        for pair, distance in distances.items():
            minutes = minutes_to_odds(distance, duration_of(runs))
            if minutes is not None and minutes <= LONGEST_MINUTES:
                parted.append(pair)
        return None if len(parted) == len(distances) else tuple(parted)

    def _best_at_length(
        self, run_sets: list[RunSet]
    ) -> tuple[RunSet, list[ReferenceMotion], PredictedDesign]:
        """The set that tells most a minute at its full length.

        A few trial runs flatter some families.
        """
        best = None
        most = -np.inf
        for run_set in run_sets:
            try:
                runs = self._of_length(run_set)
            except RobotError:  # a draw that doesn't fit is none to beat
                if run_set is run_sets[0]:
                    raise
                continue
            view = self.see(runs)
            score = self.hypotheses.score(view) / duration_of(runs)
            if best is None or score > most:
                most = score
                best = (run_set, runs, view)
        assert best is not None
        return best

    def _of_length(self, run_set: RunSet) -> list[ReferenceMotion]:
        """As many runs as the question takes, each proven to keep its distance."""
        trial = self._proven(run_set, FEWEST_RUNS)
        minutes = self.options.minutes
        wanted = minutes
        if wanted is None:
            distances = self.hypotheses.counted(self.hypotheses.distances(self.see(trial)))
            needed = None
            if distances:
                needed = minutes_to_odds(min(distances), duration_of(trial))
            wanted = RESERVE * (needed or USUAL_MINUTES)
        each = duration_of(trial) / len(trial)
        count = int(np.ceil(60.0 * wanted / each))
        if minutes is not None:  # a length that was asked for is kept
            return self._proven(run_set, max(count, LEAST_RUNS))
        return self._proven(run_set, int(np.clip(count, FEWEST_RUNS, MOST_RUNS)))

    def _proven(self, run_set: RunSet, count: int) -> list[ReferenceMotion]:
        """Runs of a set, those left out that don't fit or can't be proven."""
        proven: list[ReferenceMotion] = []
        for number in range(PROOF_TRIES * count):
            run = run_set.run(number, self.feasible)
            if run is not None and self.feasible.clearance(run) > 0.0:
                proven.append(run)
            if len(proven) == count:
                return proven
        what = "no motion found that fits"
        raise RobotError(self.arm.name, what, "check its limits and collision geometry")
