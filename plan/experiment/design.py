"""From a question to the motion that answers it: search, length, proof, and random motion to compare with."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ident.effects.effect_info import setup_for
from ident.errors import RobotError
from ident.robot.arm import ArmModel
from ident.trajectories.reference import ReferenceMotion
from plan.experiment.distance import PredictedDesign, look
from plan.experiment.feasible import Feasibility
from plan.experiment.foresight import Eye
from plan.experiment.hypotheses import Question
from plan.experiment.indistinguishable import LONGEST_MINUTES
from plan.experiment.result import Excitation, Status, minutes_to_odds
from plan.experiment.run_set import WIDE_FIGURES, Programme, duration_of, random_runs
from plan.experiment.search import BASELINE, ProgrammeSearch, Tell
from plan.options import ExciteOptions
from plan.problem.task_file import Surroundings

# The diagnosis leaves out one run after the other: fewer than these say too little, more try the user's patience.
FEWEST_RUNS, MOST_RUNS = 6, 60
# With the length given: two runs of the family, and two in which all joints move.
LEAST_RUNS = 4
# Where the question has no odds [min].
USUAL_MINUTES = 3.0
# What is expected is only expected: so much more is recorded than it needs.
RESERVE = 1.5
RANDOM_TRIES = 3
# Draws of random motion that the search's best must beat at full length, else the best of them is proposed.
BASELINE_DRAWS = 4
PROOF_TRIES = 5
USUAL = ExciteOptions()


def excite(
    arm: ArmModel,
    question: Question,
    options: ExciteOptions = USUAL,
    around: Surroundings | None = None,
    tell: Tell | None = None,
) -> Excitation:
    """The motion that answers a question best.

    Args:
        arm: The arm.
        question: What is to be told.
        options: Length, evaluations, seed, and what stands in for links without collision geometry.
        around: What stands around the arm, and limits inside the robot's.
        tell: Called after each evaluation with evaluations, allowed, best score.

    Raises:
        RobotError: No motion of this arm keeps its limits and its distance from itself, or a link has no shape.
    """
    began, seed, evaluations = time.perf_counter(), options.seed, options.evaluations
    stand_in: Any = options.shapes
    eye, feasible = Eye.of(arm, question.noise), Feasibility(arm, stand_in, around)
    question = replace(question, tellable=_tellable(eye, feasible, question, seed))
    if question.tellable == ():
        programmes = [_general(feasible, question, seed)]
    else:
        search = ProgrammeSearch(eye, feasible, question, evaluations, seed)
        programmes = [trial.programme for trial in search.best(tell)] + _draws(feasible, question, seed)
    programme, runs, view = _best_at_length(programmes, eye, feasible, question, options.minutes)
    chance = [_random_view(eye, question, runs, np.random.default_rng([seed, k, 1])) for k in range(RANDOM_TRIES)]
    by_chance = sorted(chance, key=question.score)[RANDOM_TRIES // 2]
    return Excitation(
        robot=arm.name,
        status=_status(question),
        aim=question.aim,
        effects=question.ids,
        joint=arm.joint_names[question.joint],
        programme=programme,
        runs=tuple(runs),
        distances=question.distances(view),
        random=question.distances(by_chance),
        tellable=question.tellable,
        information=(view.information(), by_chance.information()),
        noise=dict(zip(arm.joint_names, map(float, eye.noise), strict=True)),
        sources={"noise": "a share of the rated torque" if question.noise is None else "diagnosis", **_sizes(view)},
        clearance=min(map(feasible.clearance, runs)) if len(feasible.scene.pairs) else None,
        unchecked=feasible.scene.unchecked,
        shapes=feasible.scene.shapes,
        obstacles=tuple(box.name for box in feasible.scene.obstacles),
        carried=feasible.carried,
        set_up=setup_for(question.ids, question.asked),
        evaluations=0 if question.tellable == () else evaluations,
        seconds=time.perf_counter() - began,
        seed=seed,
    )


def _tellable(eye: Eye, feasible: Feasibility, question: Question, seed: int) -> tuple[tuple[str, str], ...] | None:
    """Of effects that another set-up would part, the pairs (true, rival) that wide motion of all joints tells too.

    An effect that is a special case of its rival is fitted by it whatever the arm does; the rival may still show. None
    where all can be told.
    """
    if question.aim != "separate" or setup_for(question.ids, question.asked) is None:
        return None
    runs = _general(feasible, question, seed).runs(4, feasible)
    if not runs:
        return ()
    found = question.distances(look(eye, runs, question.effects, question.told))
    needed = {pair: minutes_to_odds(value, duration_of(runs)) for pair, value in found.items()}
    told = tuple(pair for pair, minutes in needed.items() if minutes is not None and minutes <= LONGEST_MINUTES)
    return None if len(told) == len(found) else told


def _status(question: Question) -> Status:
    if question.tellable is None:
        return "ready"
    return "one_sided" if question.tellable else "needs_set_up"


def _general(feasible: Feasibility, question: Question, seed: int) -> Programme:
    """Wide motion of all joints about the middle pose."""
    return Programme("wide", WIDE_FIGURES, np.array(feasible.limits.centre), question.joint, seed)


def _draws(feasible: Feasibility, question: Question, seed: int) -> list[Programme]:
    """Random motion as it comes."""
    rng = np.random.default_rng([seed, 2])
    shares = rng.uniform(0.0, 1.0, (BASELINE_DRAWS, Programme.freedom(BASELINE, feasible.limits.arm.n)))
    return [Programme.decode(BASELINE, one, question.joint, feasible, seed + k) for k, one in enumerate(shares)]


def _best_at_length(
    programmes: Sequence[Programme], eye: Eye, feasible: Feasibility, question: Question, minutes: float | None
) -> tuple[Programme, list[ReferenceMotion], PredictedDesign]:
    """The programme that tells most a minute at its full length: a few trial runs flatter some families."""
    found = []
    for programme in programmes:
        try:
            runs = _of_length(programme, eye, feasible, question, minutes)
        except RobotError:  # a draw that doesn't fit is none to beat
            if programme is programmes[0]:
                raise
            continue
        view = look(eye, runs, question.effects, question.told)
        found.append((question.score(view) / duration_of(runs), programme, runs, view))
    return max(found, key=lambda one: one[0])[1:]


def _of_length(
    programme: Programme, eye: Eye, feasible: Feasibility, question: Question, minutes: float | None
) -> list[ReferenceMotion]:
    """As many runs as the question takes, each proven to keep its distance."""
    trial = _proven(programme, FEWEST_RUNS, feasible)
    wanted = minutes
    if wanted is None:
        found = question.counted(question.distances(look(eye, trial, question.effects, question.told)))
        needed = minutes_to_odds(min(found), duration_of(trial)) if found else USUAL_MINUTES
        wanted = RESERVE * (needed or USUAL_MINUTES)
    count = int(np.ceil(60.0 * wanted / (duration_of(trial) / len(trial))))
    low = LEAST_RUNS if minutes is not None else FEWEST_RUNS
    most = MOST_RUNS if minutes is None else max(count, low)  # a length that was asked for is kept
    return _proven(programme, int(np.clip(count, low, most)), feasible)


def _proven(programme: Programme, count: int, feasible: Feasibility) -> list[ReferenceMotion]:
    """Runs of a programme, those left out that don't fit or can't be proven."""
    found: list[ReferenceMotion] = []
    for number in range(PROOF_TRIES * count):
        run = programme.run(number, feasible)
        if run is not None and feasible.clearance(run) > 0.0:
            found.append(run)
        if len(found) == count:
            return found
    raise RobotError(feasible.limits.arm.name, "no motion found that fits", "check its limits and collision geometry")


def _random_view(
    eye: Eye, question: Question, runs: Sequence[ReferenceMotion], rng: np.random.Generator
) -> PredictedDesign:
    """What random motion through via points of the same length would tell."""
    count = len(runs)
    duration = max(duration_of(list(runs)) / count, 1.0)
    return look(eye, random_runs(eye.arm, count, duration, rng), question.effects, question.told)


def _sizes(view: PredictedDesign) -> dict[str, str]:
    return {one.effect.id: one.sized.source if one.sized else f"not seen: {one.silent}" for one in view.candidates}
