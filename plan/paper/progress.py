"""How far a run of the paper's experiments has come: each search's usual share of them all.

The shares are those of processor time in `usual_seconds.toml`; they decide what is told of progress
and of the time left, and nothing else.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path

from ident.progress import stage
from plan.command_options import PaperOptions
from plan.paper.brute_force import BruteForce, count_cores
from plan.paper.compression import Compression
from plan.paper.genetic import Genetic
from plan.paper.ppo import Ppo
from plan.planners.base import Planner
from plan.planners.sequential import Sequential

USUAL = tomllib.loads(Path(__file__).with_name("usual_seconds.toml").read_text(encoding="utf-8"))
# So many times as many epochs as on Table 3's task does PPO take where there is more to choose.
MORE = 4.2
# Seeds of the trials of the shortest motion in Fig. 11.
FASTEST = (0, 1, 2)


def learner(effort: PaperOptions, times: float = 1.0) -> Ppo:
    """PPO with a multiple of the epochs that it takes on Table 3's task."""
    return Ppo(epochs=max(1, round(effort.epochs * times)))


def all_searches(effort: PaperOptions) -> tuple[Planner, ...]:
    """Every search of all tables and figures, in the order in which they are run."""
    short = learner(effort)
    long = learner(effort, MORE)
    default = Sequential()
    small_task = [BruteForce(levels=effort.levels), Genetic(), short, default]
    obstacle = [long, Genetic(generations=effort.generations), default]
    fastest = [*[long] * len(FASTEST), default]
    taught = [*[long] * effort.trials, *[short] * effort.trials]
    methods = (Compression("pass"), short, long)
    shortened: list[Planner] = []
    for method in methods:
        shortened += [method] * effort.trials
    shortened.append(default)
    return (*small_task, *obstacle, *fastest, *taught, *shortened, *shortened)


def usual_seconds(planner: Planner) -> float:
    """What a search usually takes [s]."""
    if isinstance(planner, BruteForce):
        return float(USUAL["motion_of_a_grid"]) * planner.levels**6 / count_cores()
    if isinstance(planner, Genetic):
        return float(USUAL["child"]) * planner.population * planner.generations
    if isinstance(planner, Ppo):
        return float(USUAL["epoch"]) * planner.epochs
    kind = "search" if isinstance(planner, Sequential) else "compression"
    return float(USUAL[kind])


class SearchProgress:
    """Tells what is run, and what share of all is done before and after it."""

    def __init__(self, searches: Sequence[Planner]) -> None:
        self.done = 0.0
        self.whole = sum(map(usual_seconds, searches))

    def begin(self, table: str, planner: Planner) -> None:
        """A search for a table or figure begins; what was begun before is done."""
        low = self.done
        self.done += usual_seconds(planner)
        words = f"{table}: {planner.name}"
        stage(words, min(low / self.whole, 1.0), min(self.done / self.whole, 1.0))
