"""The paper's planning experiments run again, Tables 3 to 7 and Figs.

10, 11 and 13, and one page of both side by side.

Source: paper (Machines 2023, 11, 350), sections 4.2 to 4.4; its figures stand in `printed.toml`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jinja2 import Environment, StrictUndefined

from ident.arrays import Array
from ident.files import atomic_write
from ident.model.hybrid import HybridModel
from ident.results import made_by
from plan.command_options import PaperOptions, SolveOptions, TaskOptions
from plan.geometry.solids import Box, Solid
from plan.initial.trees import find_seeds
from plan.initial.vias import from_vias
from plan.paper.brute_force import BruteForce
from plan.paper.compression import Compression
from plan.paper.genetic import Genetic
from plan.paper.ppo import Ppo
from plan.paper.progress import FASTEST, MORE, SearchProgress, all_searches, learner
from plan.planners.base import Planner
from plan.planners.evolution import start_compressed
from plan.planners.sequential import Sequential
from plan.problem.certificate import certify
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.problem.task_file import Task
from plan.show.pictures import draw_comparison, draw_motion, save_figure
from plan.solving.compare import Comparison
from plan.solving.set_up import set_up
from plan.solving.solve import Starts, find_starts, solve

START = np.radians([50.0, 0.0, -120.0])
GOAL = np.radians([80.0, 30.0, -90.0])
# The paper does not print where its obstacle stands; this one blocks the straight line as the paper
# says of its own.
OBSTACLE = Box(
    "monitor", 0, np.eye(3), np.array([0.04, -0.47, 0.56]), Solid.simple("box", 0.06, 0.06, 0.06)
)
# How far a drawn tester's via points lie from a tree's [rad], and the longest search of any method
# [s].
SPREAD = np.radians(12.0)
LONGEST = 3600.0
_PRINTED = tomllib.loads(Path(__file__).with_name("printed.toml").read_text(encoding="utf-8"))
# Via points [deg], seconds, and gain over the initial motion as a share.
Details = tuple[list[list[float]], float | None, float]
PAPER: dict[str, tuple[float, ...]] = {
    name: tuple(values) for name, values in _PRINTED["values"].items()
}
PICTURES = {
    "figure_10.png": "Fig. 10: cost against evaluations and processor time",
    "figure_11.png": "Fig. 11: torques before and after speed optimisation",
    "figure_13_6.png": "Fig. 13a: before and after, from the learned energy optimum",
    "figure_13_7.png": "Fig. 13b: before and after, from a drawn tester's via points",
}
PAGE = "paper.md"
# All that a page's folder may hold.
FILES = (PAGE, *PICTURES)
TEMPLATE = Path(__file__).with_name("page.md.jinja")


@dataclass(frozen=True)
class Line:
    """One row of a table: what the paper prints, and what came out here."""

    name: str  # what was run
    unit: str  # J or s
    paper: tuple[float, ...]  # the paper's figures, trial by trial; empty where it has none
    ours: tuple[float, ...] = ()  # ours; infinite where there was no plan
    cpu_seconds: float = 0.0  # processor time of all trials [s]
    # Of Table 3 the paper's and ours; None where the paper prints none.
    details: tuple[Details, Details] | None = None


def repeat_paper(model: HybridModel | None, effort: PaperOptions) -> Repeat:
    """Runs the paper's experiments on a fitted model of the TM5-900.

    Raises:
        InputError: The model is another robot's.
    """
    runs = Repeat(model, effort)
    runs.optimise_small_task()
    blocked = runs.problem(1.0, (OBSTACLE,))
    runs.compare_searches(blocked)
    runs.shorten_from_the_task(blocked)
    slow = runs.problem(4.0, (OBSTACLE,))
    learned, improved = runs.improve_the_taught(slow)
    runs.shorten_from_energy_optima("Table 6", slow, learned)
    runs.shorten_from_energy_optima("Table 7", slow, improved)
    return runs


@dataclass(eq=False)
class Repeat:
    """The experiments in turn, and everything that was run again so far."""

    model: HybridModel | None
    effort: PaperOptions  # how much is run
    tables: dict[str, list[Line]] = field(default_factory=dict)  # rows of each table or figure
    # Problem and plan of what Figs. 11 and 13 show, by the name of the picture.
    motions: dict[str, tuple[PlanningProblem, PlanResult]] = field(default_factory=dict)
    search: Comparison | None = (
        None  # costs of PPO and the genetic algorithm on the obstacle task, for Fig. 10
    )

    def __post_init__(self) -> None:
        self.progress = SearchProgress(all_searches(self.effort))

    def problem(self, duration: float, obstacles: tuple[Box, ...] = ()) -> PlanningProblem:
        """The paper's task in a duration [s], among obstacles or without."""
        place = Path("the paper's task")
        task = Task(
            source=place,
            robot="tm5-900",
            start=START,
            goal=GOAL,
            duration=duration,
            obstacles=obstacles,
        )
        return set_up(
            task, self.model, TaskOptions(metric="absolute" if obstacles else "signed", beyond=True)
        )

    def ppo(self, times: float = 1.0) -> Ppo:
        """The paper's learner, with so many times the usual effort."""
        return learner(self.effort, times)

    def run(
        self,
        table: str,
        problem: PlanningProblem,
        planner: Planner,
        seed: int = 0,
        starts: Starts | None = None,
    ) -> PlanResult:
        """One search for a table or figure, from given initial trajectories if that is wanted."""
        self.progress.begin(table, planner)
        options = SolveOptions(seed=seed, evaluations=10**8, seconds=LONGEST, gap=False)
        return solve(problem, options, planner, starts)

    def enter(self, table: str, *lines: Line) -> None:
        """Adds lines to a table of the page."""
        self.tables.setdefault(table, []).extend(lines)

    def optimise_small_task(self) -> None:
        """Table 3: three methods on the grid's range, and ours beyond it."""
        problem = self.problem(0.65)
        start = float(problem.initial_evaluation.cost[0])
        first = Line(
            "initial",
            "J",
            PAPER["initial"],
            (start,),
            0.0,
            _details("initial", problem.vias, None, 0.0),
        )
        self.enter("Table 3", first)
        planners: dict[str, tuple[str, Planner]] = {
            "brute": ("brute force", BruteForce(levels=self.effort.levels)),
            "ga": ("GA", Genetic()),
            "ppo": ("RL (PPO)", self.ppo()),
        }
        for key, (name, planner) in planners.items():
            run = self.run("Table 3", replace(problem, grows=False), planner)
            vias = problem.vias if run.splines is None else run.splines.points[0, 1:-1]
            details = _details(key, vias, run.cpu_seconds, 1.0 - run.cost / start)
            self.enter("Table 3", replace(_line(name, "J", PAPER[key], run), details=details))
        free = self.run("Table 3", problem, Sequential())
        self.enter("Table 3", _line("default (sqp), via points free", "J", (), free))

    def compare_searches(self, problem: PlanningProblem) -> None:
        """Fig. 10: PPO against the genetic algorithm from the same starts, and ours."""
        starts = find_starts(problem, np.random.default_rng(0))
        runs = []
        planners: dict[str, tuple[Planner, Starts | None]] = {
            "RL (PPO)": (self.ppo(MORE), starts),
            "GA": (Genetic(generations=self.effort.generations), starts),
            "default (sqp)": (Sequential(), None),
        }
        for name, (planner, begin) in planners.items():
            runs.append(self.run("Fig. 10", problem, planner, starts=begin))
            self.enter(
                "Fig. 10", _line(name, "J", PAPER.get(f"Fig. 10 {planner.name}", ()), runs[-1])
            )
        self.search = Comparison("fig. 10", "energy", 2100, 1.0, tuple(runs))

    def shorten_from_the_task(self, problem: PlanningProblem) -> None:
        """Fig. 11: the shortest motion, via points and stamps free."""
        timed = replace(problem, objective="time", free="both")
        fast = [self.run("Fig. 11", timed, self.ppo(MORE), t) for t in FASTEST]
        self.enter(
            "Fig. 11", _line("RL (PPO), stamps and via points", "s", PAPER["Fig. 11"], *fast)
        )
        ours = self.run("Fig. 11", timed, Sequential())
        self.enter("Fig. 11", _line("default (sqp)", "s", (), ours))
        self.motions["figure_11"] = (problem, fast[0])

    def improve_the_taught(
        self, problem: PlanningProblem
    ) -> tuple[list[PlanResult], list[PlanResult]]:
        """Tables 4 and 5: what testers teach, what is learned from the task, and what from the
        first tester's.
        """
        trials = range(self.effort.trials)
        taught = {}
        for tester in (1, 2, 3):
            taught[tester] = [_teach(problem, tester, t) for t in trials]
        learned = [self.run("Table 4", problem, self.ppo(MORE), t) for t in trials]
        improved = [
            self.run("Table 5", start, self.ppo(), t, ([start], []))
            for t, start in enumerate(taught[1])
        ]
        for tester, starts in taught.items():
            ours = tuple(float(start.initial_evaluation.cost[0]) for start in starts)
            name = f"tester {tester}"
            self.enter(
                "Table 4", Line(f"{name}, Mo. (by the model; drawn here)", "J", PAPER[name], ours)
            )
            self.enter("Table 4", Line(f"{name}, Act. (on the arm)", "J", PAPER[f"{name}, Act."]))
            if tester == 1:
                name = "tester 1, Act. (ours drawn here, by the model)"
                self.enter("Table 5", Line(name, "J", PAPER["taught"], ours))
        self.enter(
            "Table 4", _line("RL (PPO), Mo. (by the model)", "J", PAPER["learned"], *learned)
        )
        self.enter("Table 4", Line("RL (PPO), Act. (on the arm)", "J", PAPER["learned, Act."]))
        self.enter("Table 5", _line("RL (PPO) from tester 1's", "J", PAPER["improved"], *improved))
        return learned, improved

    def shorten_from_energy_optima(
        self, table: str, problem: PlanningProblem, plans: Sequence[PlanResult]
    ) -> None:
        """Tables 6 and 7, and Fig.

        13: time compression against learning, each from an energy optimum.
        """
        start = {
            "objective": "time",
            "free": "times",
            "label": "the energy optimum that was learned",
        }
        splines = [plan.splines for plan in plans if plan.splines is not None and plan.solved]
        slow = [problem.with_initial(motion, **start) for motion in splines]
        timed = map(start_compressed, slow)
        both = [start_compressed(replace(task, free="both")) for task in slow]
        planners: dict[str, tuple[list[PlanningProblem], Planner]] = {
            "time compression, each section once": (slow, Compression("pass")),
            "RL (PPO), time stamps": (list(timed), self.ppo()),
            "RL (PPO), stamps and via points": (both, self.ppo(MORE)),
        }
        for number, (name, (starts, planner)) in enumerate(planners.items()):
            last = [
                self.run(table, task, planner, seed, ([task], []))
                for seed, task in enumerate(starts)
            ]
            printed = PAPER[f"{table} {'learned' if number else 'compressed'}"]
            self.enter(table, _line(name, "s", printed, *last))
        free = self.run(table, replace(problem, objective="time", free="both"), Sequential())
        self.enter(table, _line("default (sqp), from the task", "s", (), free))
        if last:
            self.motions[f"figure_13_{table[-1]}"] = (slow[0], last[0])


def _line(name: str, unit: str, paper: Sequence[float], *runs: PlanResult) -> Line:
    return Line(
        name,
        unit,
        tuple(paper),
        tuple(run.cost for run in runs),
        sum(run.cpu_seconds for run in runs),
    )


def _details(key: str, vias: Array, seconds: float | None, gain: float) -> tuple[Details, Details]:
    printed = _PRINTED["table3"][key]
    theirs = 1.0 - PAPER[key][0] / PAPER["initial"][0]
    return (printed["vias_deg"], printed.get("seconds"), theirs), (
        np.degrees(vias).tolist(),
        seconds,
        gain,
    )


def _teach(problem: PlanningProblem, tester: int, trial: int) -> PlanningProblem:
    """Via points as a person might teach them: clear of the box, not the shortest way.

    The paper's are not printed.
    """
    rng = np.random.default_rng([tester, trial])
    ways = [
        seed.vias
        for seed in find_seeds(problem, rng)
        if not seed.reason and 1 <= len(seed.vias) <= 2
    ]
    while True:
        vias = ways[rng.integers(len(ways))]
        start = from_vias(
            problem, vias + rng.uniform(-SPREAD, SPREAD, vias.shape), f"tester {tester}", 2
        )
        if (
            start.initial_evaluation.feasible[0]
            and not certify(start, start.decode(start.initial)).broken
        ):
            return start


def write_page(repeat: Repeat, out: Path) -> Path:
    """Writes `paper.md` and its pictures into a folder; returns the page."""
    assert repeat.search is not None
    save_figure(draw_comparison(repeat.search), out / "figure_10.png")
    drawn = {"figure_10.png"}
    for name, (problem, result) in repeat.motions.items():
        if result.splines is not None:
            save_figure(draw_motion(problem, result), out / f"{name}.png")
            drawn.add(f"{name}.png")
    settings = Environment(undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True)
    text = settings.from_string(TEMPLATE.read_text(encoding="utf-8")).render(
        effort=repeat.effort,
        full=PaperOptions(),
        tables=repeat.tables,
        inf=np.inf,
        made_by=made_by(),
        pictures={name: words for name, words in PICTURES.items() if name in drawn},
    )
    with atomic_write(out / PAGE) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return out / PAGE
