"""Tasks from files to results to files: what Python's functions and the commands share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.files import write_record
from ident.model.hybrid import HybridModel
from ident.outputs import remove_own_file
from plan.errors import MethodError, SceneError
from plan.planners import METHODS, Budget, default_budget, make_planner
from plan.planners.base import Planner, Progress
from plan.problem.execution import execute
from plan.problem.extrapolation import require_inside
from plan.problem.options import CompareOptions, SolveOptions, TaskOptions
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.problem.task_file import Task, Trial, load_task, load_trials
from plan.solving.compare import Comparison, compare
from plan.solving.goals import rank_goals, reach_goals
from plan.solving.parallel import require_workers
from plan.solving.set_up import require_valid_ends, set_up
from plan.solving.solve import solve

DEFAULTS = TaskOptions()
# What a comparison's folder holds: all methods, and the best plan.
COMPARISON_FILES = ("comparison.png", "best.png", "best.rrd", "best.json")


@dataclass(frozen=True, eq=False)
class OpenedTask:
    """A task that was read and checked.

    Attributes:
        task: The scene file's contents.
        problem: The problem, started from the straight line.
        trial: Taught via points, if the user gave some.
        others: The same problem with the other goals, or those that bring a frame to the task's pose.
    """

    task: Task
    problem: PlanningProblem
    trial: Trial | None
    others: tuple[PlanningProblem, ...] = ()


def open_task(
    scene: Task | str | Path, model: HybridModel | str | Path | None = None, options: TaskOptions = DEFAULTS
) -> OpenedTask:
    """Reads scene, model and taught via points, and checks start and goal.

    Raises:
        InputError: Any of them is at fault.
    """
    task, fitted = _task(scene), None
    if model is not None:
        from ident.api.fitting import load_model  # all that fits a model comes with it

        fitted = load_model(model)
    problem = set_up(task, fitted, options)
    problem, *others = reach_goals(problem, task)
    if options.inside:
        require_inside(problem, task.source)
    require_valid_ends(problem, task)
    taught = task.taught[0] if task.taught else None
    if options.vias is not None:
        trials = load_trials(options.vias, task.n)
        if options.trial > len(trials):
            what = f"it has {len(trials)} trials, not {options.trial}"
            raise SceneError(options.vias, what, f"use --trial 1 to {len(trials)}")
        taught = trials[options.trial - 1]
    return OpenedTask(task, problem, taught, tuple(others))


def _task(scene: Task | str | Path) -> Task:
    if isinstance(scene, Task):
        return scene
    if not isinstance(scene, str | Path):
        raise SceneError("scene", f"a {type(scene).__name__} is no task", "give a scene file, or what load_task read")
    return load_task(scene)


def solve_task(
    opened: OpenedTask, options: SolveOptions, planner: Planner | None = None, progress: Progress | None = None
) -> PlanResult:
    """Solves an opened task, with a planner of one's own if one is given.

    Raises:
        MethodError: No such method, or not for this task.
    """
    name = options.method if planner is None else planner.name
    require_workers(name, options.workers, options.resume is not None)
    planner = planner or make_planner(name, opened.problem.objective)
    usual = default_budget(name)
    budget = Budget(
        usual.evaluations if options.evaluations is None else options.evaluations,
        usual.seconds if options.seconds is None else options.seconds,
    )
    problem, note = _with_goal(opened, budget, options.seed)
    result = solve(
        problem,
        name,
        options.seed,
        budget,
        opened.trial,
        progress,
        options.resume,
        options.gap,
        planner,
        workers=options.workers,
    )
    return result if note is None else replace(result, notes=(note, *result.notes))


def _with_goal(opened: OpenedTask, budget: Budget, seed: int) -> tuple[PlanningProblem, str | None]:
    """The problem with the goal that is cheapest to go to, and what was chosen from, in words."""
    posed = opened.task.pose is not None
    if not opened.others:
        return opened.problem, "one joint position brings the frame to the goal's pose" if posed else None
    ranked = rank_goals([opened.problem, *opened.others], budget, np.random.default_rng(seed))
    reached = sum(np.isfinite(cost) for cost, _ in ranked)
    which = f"{len(ranked)} joint positions bring the frame to the goal's pose" if posed else f"{len(ranked)} goals"
    what = f"{which}; short searches reached {reached} of them"
    return ranked[0][1], f"{what}, and the cheapest was taken"


def save_outputs(
    opened: OpenedTask, result: PlanResult, json_file: Path | None, picture: Path | None, rrd: Path | None
) -> None:
    """Writes what was asked for; pictures only of a motion, and none of an earlier one is left in their place."""
    write_record(json_file, result.to_dict())
    if result.splines is None or result.stands:
        for path in (picture, rrd):
            if path is not None:
                remove_own_file(path)
        return
    if picture is not None:
        from plan.show.pictures import draw_motion, save_figure

        save_figure(draw_motion(opened.problem, result), picture)
    if rrd is not None:
        from plan.show.timeline import save_timeline

        save_timeline(opened.problem, result, rrd)


def save_motion(result: PlanResult, out: Path | None, rate: float) -> str | None:
    """Writes the motion for a controller; what was written, in words, or nothing.

    Where there is no motion, one of an earlier run is removed: a controller would take it for this task's.
    """
    if out is None:
        return None
    if result.splines is None or not result.solved:
        return f"no motion: that of an earlier run is removed from {out}" if remove_own_file(out) else None
    execution = execute(result, rate)
    execution.save(out)
    longer = f", {execution.longer:.3f} s longer than planned to start and end at rest" if execution.longer else ""
    return f"motion written to {out}: {len(execution.times)} points, {execution.duration:.4f} s{longer}"


def compare_task(opened: OpenedTask, options: CompareOptions, progress: Progress | None = None) -> Comparison:
    """Compares methods on an opened task.

    Raises:
        MethodError: No such method.
    """
    methods = options.methods
    chosen = None if methods is None else [name.strip() for name in methods.split(",") if name.strip()]
    if chosen is not None and not chosen:
        raise MethodError("--methods", "names no method", f"use some of: {', '.join(METHODS)}")
    problem = _with_goal(opened, Budget(), 0)[0]
    where = options.seeds, options.evaluations, options.seconds
    return compare(problem, opened.task.source.stem, chosen, *where, opened.trial, progress)


def save_comparison(opened: OpenedTask, comparison: Comparison, json_file: Path | None, out: Path | None) -> None:
    """Writes the record, and a folder with pictures and the best plan."""
    write_record(json_file, comparison.to_dict())
    best = comparison.best()
    if out is None:
        return
    picture, motion, timeline, record = (out / name for name in COMPARISON_FILES)
    from plan.show.pictures import draw_comparison, draw_motion, save_figure
    from plan.show.timeline import save_timeline

    save_figure(draw_comparison(comparison), picture)
    if best is not None:
        save_figure(draw_motion(opened.problem, best), motion)
        save_timeline(opened.problem, best, timeline)
        best.save(record)
