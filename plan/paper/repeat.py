"""The paper's planning experiments run again: Tables 3 to 7 and what Figs. 10, 11 and 13 show.

Source: paper (Machines 2023, 11, 350), sections 4.2 to 4.4; its figures stand in `PAPER`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.arrays import Array
from ident.model.hybrid import HybridModel
from plan.dynamics.power import Metric
from plan.geometry.boxes import Box
from plan.initial.rrt_starts import find_seeds
from plan.initial.starts import from_vias
from plan.options import PaperOptions, SolveOptions, TaskOptions
from plan.paper.brute_force import BruteForce
from plan.paper.compression import Compression
from plan.paper.genetic import Genetic
from plan.paper.ppo import Ppo
from plan.planners.base import Planner, Progress
from plan.planners.compressed import start_compressed
from plan.planners.sequential import Sequential
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult, certify
from plan.problem.task_file import Task
from plan.solving.compare import Comparison
from plan.solving.set_up import set_up
from plan.solving.solve import Starts, find_starts, solve

START, GOAL = np.radians([50.0, 0.0, -120.0]), np.radians([80.0, 30.0, -90.0])
# The paper does not print where its obstacle stands; this one blocks the straight line as the paper says of its own.
OBSTACLE = Box("monitor", 0, np.eye(3), np.array([0.04, -0.47, 0.56]), np.array([0.06, 0.06, 0.06]))
# How far a drawn tester's via points lie from a tree's [rad], and the longest search of any method [s].
SPREAD, LONGEST = np.radians(12.0), 3600.0
PAPER: dict[str, tuple[float, ...]] = {
    "initial": (51.11,),
    "brute": (45.46,),
    "ga": (45.73,),
    "ppo": (46.68,),
    "tester 1": (36.0, 61.7, 36.5, 52.0, 33.1),
    "tester 2": (84.9, 38.8, 47.1, 37.3, 84.7),
    "tester 3": (37.2, 51.8, 34.0, 90.9, 40.8),
    "learned": (31.8, 31.9, 33.2, 31.7, 32.9),
    "taught": (36.5, 62.9, 37.2, 52.9, 33.9),
    "improved": (32.4, 35.6, 32.5, 46.3, 32.2),
    "Table 6 compressed": (1.64, 1.61, 1.64, 1.31, 1.64),
    "Table 6 learned": (1.25, 1.10, 0.98, 1.13, 1.26),
    "Table 7 compressed": (1.31, 2.05, 1.44, 2.25, 1.31),
    "Table 7 learned": (1.00, 1.62, 1.08, 1.70, 1.04),
    "Fig. 10 ppo": (58.08,),
    "Fig. 10 ga": (54.08,),
    "Fig. 11": (0.62, 0.64, 0.63),
    "tester 1, Act.": (36.5, 62.9, 37.2, 52.9, 33.9),
    "tester 2, Act.": (84.4, 39.7, 47.6, 37.9, 84.6),
    "tester 3, Act.": (37.9, 52.9, 34.8, 90.9, 41.8),
    "learned, Act.": (34.0, 32.1, 33.6, 32.8, 33.1),
}
# Via points of Table 3 [deg], and its wall-clock seconds; its gains follow from its joules.
TABLE3: dict[str, tuple[tuple[tuple[float, ...], ...], float | None]] = {
    "initial": (((60.0, 10.0, -110.0), (70.0, 20.0, -100.0)), None),
    "brute": (((59.0, 10.5, -112.5), (72.5, 22.5, -99.0)), 40656.0),
    "ga": (((59.7, 10.7, -112.4), (72.4, 22.9, -98.6)), 417.0),
    "ppo": (((59.2, 12.4, -115.2), (72.6, 24.1, -99.9)), 33.0),
}


@dataclass(frozen=True)
class Line:
    """One row of a table: what the paper prints, and what came out here.

    Attributes:
        table: Which table or figure.
        name: What was run.
        unit: J or s.
        paper: The paper's figures, trial by trial; empty where it has none.
        ours: Ours; infinite where there was no plan.
        cpu_seconds: Processor time of all trials [s].
        details: Via points, seconds and gain in words, the paper's and ours; empty where the paper prints none.
    """

    table: str
    name: str
    unit: str
    paper: tuple[float, ...]
    ours: tuple[float, ...]
    cpu_seconds: float
    details: tuple[str, str] = ("", "")


@dataclass(frozen=True, eq=False)
class Repeat:
    """Everything that was run again.

    Attributes:
        lines: Rows of the tables.
        search: Costs of PPO and the genetic algorithm on the obstacle task, for Fig. 10.
        motions: Problem and plan of what Figs. 11 and 13 show, by the name of the picture.
        effort: How much was run.
    """

    lines: tuple[Line, ...]
    search: Comparison
    motions: dict[str, tuple[PlanningProblem, PlanResult]]
    effort: PaperOptions


def repeat_paper(model: HybridModel | None, effort: PaperOptions, progress: Progress | None = None) -> Repeat:
    """Runs the paper's experiments on a fitted model of the TM5-900.

    Raises:
        TaskError: The model is another robot's.
    """
    lines = _table3(_problem(model, 0.65, ()), effort, progress)
    blocked = _problem(model, 1.0, (OBSTACLE,))
    search = _figure10(blocked, effort, progress)
    for method, name in (("ppo", "RL (PPO)"), ("ga", "GA"), ("sqp", "default (sqp)")):
        lines += [_line("Fig. 10", name, "J", PAPER.get(f"Fig. 10 {method}", ()), search.of(method))]
    motions = {}
    fast = [_run(replace(blocked, objective="time", free="both"), _ppo(effort, 4.2), t, progress) for t in range(3)]
    lines.append(_line("Fig. 11", "RL (PPO), stamps and via points", "s", PAPER["Fig. 11"], fast))
    lines.append(_line("Fig. 11", "default (sqp)", "s", (), [_run(_timed(blocked), Sequential(), 0, progress)]))
    motions["figure_11"] = (blocked, fast[0])
    slow = _problem(model, 4.0, (OBSTACLE,))
    taught = [_taught(slow, 1, t) for t in range(effort.trials)]
    learned = [_run(slow, _ppo(effort, 4.2), t, progress) for t in range(effort.trials)]
    improved = [_run(s, _ppo(effort, 1.0), t, progress, Starts((s,))) for t, s in enumerate(taught)]
    lines += _tables45(slow, taught, learned, improved, effort)
    for table, plans in (("Table 6", learned), ("Table 7", improved)):
        more, motion = _speed(table, slow, plans, effort, progress)
        lines += more
        if motion is not None:
            motions[f"figure_13_{table[-1]}"] = motion
    return Repeat(tuple(lines), search, motions, effort)


def _problem(model: HybridModel | None, duration: float, obstacles: tuple[Box, ...]) -> PlanningProblem:
    task = Task(Path("the paper's task"), "tm5-900", START, GOAL, duration, obstacles=obstacles)
    metric: Metric = "absolute" if obstacles else "signed"
    return set_up(task, model, TaskOptions(metric=metric))


def _timed(problem: PlanningProblem) -> PlanningProblem:
    return replace(problem, objective="time", free="both")


def _ppo(effort: PaperOptions, times: float) -> Ppo:
    return Ppo(epochs=max(1, round(effort.epochs * times)))


def _run(
    problem: PlanningProblem, planner: Planner, seed: int, progress: Progress | None, starts: Starts | None = None
) -> PlanResult:
    options = SolveOptions(seed=seed, evaluations=10**8, seconds=LONGEST, gap=False)
    return solve(problem, options, planner, None, starts, progress)


def _line(table: str, name: str, unit: str, paper: Sequence[float], runs: Sequence[PlanResult]) -> Line:
    return Line(table, name, unit, tuple(paper), tuple(run.cost for run in runs), sum(run.cpu_seconds for run in runs))


def _table3(problem: PlanningProblem, effort: PaperOptions, progress: Progress | None) -> list[Line]:
    start = float(problem.initial_evaluation.cost[0])
    first = _details("initial", problem.vias, None, 0.0)
    lines = [Line("Table 3", "initial", "J", PAPER["initial"], (start,), 0.0, first)]
    kept = replace(problem, grows=False)
    planners: dict[str, tuple[Planner, str]] = {
        "brute force": (BruteForce(levels=effort.levels), "brute"),
        "GA": (Genetic(), "ga"),
        "RL (PPO)": (_ppo(effort, 1.0), "ppo"),
    }
    for name, (planner, key) in planners.items():
        run = _run(kept, planner, 0, progress)
        vias = problem.vias if run.splines is None else run.splines.points[0, 1:-1]
        details = _details(key, vias, run.cpu_seconds, 1.0 - run.cost / start)
        lines.append(replace(_line("Table 3", name, "J", PAPER[key], [run]), details=details))
    free = _run(problem, Sequential(), 0, progress)
    return [*lines, _line("Table 3", "default (sqp), via points free", "J", (), [free])]


def _details(key: str, vias: Array, seconds: float | None, gain: float) -> tuple[str, str]:
    """Via points, seconds and gain over the initial motion in words: the paper's, and ours."""
    printed, took = TABLE3[key]
    theirs = 1.0 - PAPER[key][0] / PAPER["initial"][0]
    return _in_words(np.array(printed), took, theirs), _in_words(np.degrees(vias), seconds, gain)


def _in_words(vias: Array, seconds: float | None, gain: float) -> str:
    points = " ".join(f"({', '.join(f'{angle:.1f}' for angle in via)})" for via in vias)
    return f"{points} deg" + ("" if seconds is None else f"; {seconds:.3g} s; gain {100 * gain:.1f} %")


def _figure10(problem: PlanningProblem, effort: PaperOptions, progress: Progress | None) -> Comparison:
    starts = find_starts(problem, np.random.default_rng(0))
    planners: list[Planner] = [_ppo(effort, 4.2), Genetic(generations=effort.generations)]
    runs = [_run(problem, planner, 0, progress, starts) for planner in planners]
    return Comparison("fig. 10", "energy", 2100, 1.0, (*runs, _run(problem, Sequential(), 0, progress)))


def _taught(problem: PlanningProblem, tester: int, trial: int) -> PlanningProblem:
    """Via points as a person might teach them: clear of the box, not the shortest way. The paper's are not printed."""
    rng = np.random.default_rng([tester, trial])
    ways = [seed.vias for seed in find_seeds(problem, rng) if not seed.reason and 1 <= len(seed.vias) <= 2]
    while True:
        vias = ways[rng.integers(len(ways))]
        start = from_vias(problem, vias + rng.uniform(-SPREAD, SPREAD, vias.shape), f"tester {tester}", 2)
        if start.initial_evaluation.feasible[0] and not certify(start, start.decode(start.initial)).broken:
            return start


def _tables45(
    problem: PlanningProblem,
    taught: list[PlanningProblem],
    learned: list[PlanResult],
    improved: list[PlanResult],
    effort: PaperOptions,
) -> list[Line]:
    lines = []
    first: tuple[float, ...] = ()
    for tester in (1, 2, 3):
        starts = taught if tester == 1 else [_taught(problem, tester, t) for t in range(effort.trials)]
        ours = tuple(float(start.initial_evaluation.cost[0]) for start in starts)
        name = f"tester {tester}"
        lines.append(Line("Table 4", f"{name}, Mo. (by the model; drawn here)", "J", PAPER[name], ours, 0.0))
        lines.append(Line("Table 4", f"{name}, Act. (on the arm)", "J", PAPER[f"{name}, Act."], (), 0.0))
        first = first or ours
    return [
        *lines,
        _line("Table 4", "RL (PPO), Mo. (by the model)", "J", PAPER["learned"], learned),
        Line("Table 4", "RL (PPO), Act. (on the arm)", "J", PAPER["learned, Act."], (), 0.0),
        Line("Table 5", "tester 1, Act. (ours drawn here, by the model)", "J", PAPER["taught"], first, 0.0),
        _line("Table 5", "RL (PPO) from tester 1's", "J", PAPER["improved"], improved),
    ]


def _speed(
    table: str,
    problem: PlanningProblem,
    plans: list[PlanResult],
    effort: PaperOptions,
    progress: Progress | None,
) -> tuple[list[Line], tuple[PlanningProblem, PlanResult] | None]:
    """Time compression against learning, each from an energy optimum; and the first motion before and after."""
    solved = [plan for plan in plans if plan.splines is not None and plan.solved]
    start = {"objective": "time", "free": "times", "label": "the energy optimum that was learned"}
    slow = [problem.with_initial(p.splines, **start) for p in solved if p.splines]
    both = [start_compressed(replace(start, free="both")) for start in slow]
    planners: dict[str, tuple[list[PlanningProblem], Planner]] = {
        "time compression, each section once": (slow, Compression("pass")),
        "RL (PPO), time stamps": ([start_compressed(start) for start in slow], _ppo(effort, 1.0)),
        "RL (PPO), stamps and via points": (both, _ppo(effort, 4.2)),
    }
    lines, last = [], []
    for number, (name, (starts, planner)) in enumerate(planners.items()):
        last = [_run(start, planner, t, progress, Starts((start,))) for t, start in enumerate(starts)]
        printed = PAPER[f"{table} {'learned' if number else 'compressed'}"]
        lines.append(_line(table, name, "s", printed, last))
    free = _run(_timed(problem), Sequential(), 0, progress)
    lines.append(_line(table, "default (sqp), from the task", "s", (), [free]))
    return lines, (slow[0], last[0]) if last else None
