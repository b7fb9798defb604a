"""Plans motions: what `plan solve` and `plan compare` do."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import ModelError
from ident.files import write_record
from ident.model.hybrid import HybridModel
from ident.outputs import remove_own_file
from ident.progress import stage
from ident.results import Provenance
from plan.errors import SceneError
from plan.options import CompareOptions, SolveOptions, TaskOptions
from plan.planners import Budget, budget_of
from plan.planners.base import Planner, processor_seconds
from plan.problem.extrapolation import require_inside
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.problem.task_file import Task, load_task, load_trials
from plan.solving.compare import Comparison
from plan.solving.compare import compare as compare_methods
from plan.solving.goals import rank_goals, reach_goals
from plan.solving.set_up import from_trial, require_valid_ends, set_up
from plan.solving.solve import solve as solve_problem

Scene = Task | str | Path
Model = HybridModel | str | Path
DEFAULTS = TaskOptions()
# What a comparison's folder holds: all methods, and the best plan.
COMPARISON_FILES = ("comparison.png", "best.png", "best.rrd", "best.json")


@dataclass(frozen=True, eq=False)
class OpenedTask:
    """A task that was read and checked."""

    task: Task  # the scene file's contents
    problem: PlanningProblem  # the problem, started from the straight line, or from the way that the user taught
    # The same problem with the other goals, or those that bring a frame to the task's pose.
    others: tuple[PlanningProblem, ...] = ()
    model: str | None = None  # what the model is called in results

    def origin(self, command: str, **asked: Any) -> Provenance:
        """Where a plan of it comes from."""
        problem = self.problem
        fixed = {"scene": str(self.task.source), "model": self.model, "objective": problem.objective}
        return Provenance(command, settings={**fixed, "metric": problem.metric, "variables": problem.free, **asked})


def solve(
    scene: Scene,
    model: Model | None = None,
    *,
    planner: Planner | None = None,
    **options: Any,
) -> PlanResult:
    """Finds one trajectory and certifies it; an expected failure is a status with a reason.

    Args:
        scene: Scene file, or the task that `load_task` read from it.
        model: Fitted model or its folder; the rigid arm without losses if None.
        planner: A planner of one's own in place of a method.
        options: Any field of `SolveOptions`, as the options of `plan solve`: `method`, `objective`, `seconds` …

    Raises:
        InputError: Scene, model, method or via points can't be used.
        TypeError: No such option.
    """
    chosen, began = SolveOptions(**options), processor_seconds()
    result = solve_task(open_task(scene, model, chosen), chosen, planner)
    return replace(result, cpu_seconds=max(result.cpu_seconds, processor_seconds() - began))  # all since the call


def compare(scene: Scene, model: Model | None = None, **options: Any) -> Comparison:
    """Runs all methods on one task.

    Args:
        scene, model: As for `solve`.
        options: Any field of `CompareOptions`, as the options of `plan compare`.

    Raises:
        InputError: Scene, model, methods or via points can't be used.
        TypeError: No such option.
    """
    chosen = CompareOptions(**options)
    return compare_task(open_task(scene, model, chosen), chosen)


def open_task(scene: Scene, model: Model | None = None, options: TaskOptions = DEFAULTS) -> OpenedTask:
    """Reads scene, model and taught via points, and checks start and goal.

    Raises:
        InputError: Any of them is at fault.
    """
    if not isinstance(scene, Task | str | Path):
        raise SceneError("scene", f"a {type(scene).__name__} is no task", "give a scene file, or what load_task read")
    task = scene if isinstance(scene, Task) else load_task(scene)
    if not isinstance(model, Model | None):
        raise ModelError("model", f"a {type(model).__name__} is no model", "give a HybridModel or its folder")
    fitted = HybridModel.load(Path(model)) if isinstance(model, str | Path) else model
    problem, *others = reach_goals(set_up(task, fitted, options), task)
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
    named = model.robot.name if isinstance(model, HybridModel) else None if model is None else str(model)
    if taught is not None:
        problem, *others = (from_trial(one, taught) for one in (problem, *others))
    return OpenedTask(task, problem, tuple(others), named)


def solve_task(opened: OpenedTask, options: SolveOptions, planner: Planner | None = None) -> PlanResult:
    """Solves an opened task, with a planner of one's own if one is given.

    Raises:
        MethodError: No such method, or not for this task.
    """
    problem, note = _with_goal(opened, budget_of(options), options.seed)
    stage("searching a motion")
    result = solve_problem(problem, options, planner)
    spent = {"evaluations": options.evaluations, "seconds": options.seconds}
    origin = opened.origin("plan solve", method=result.method, seed=options.seed, **spent)
    return replace(result, notes=(*note, *result.notes)).with_provenance(origin)


def compare_task(opened: OpenedTask, options: CompareOptions) -> Comparison:
    """Compares methods on an opened task.

    Raises:
        MethodError: No such method.
    """
    problem, _ = _with_goal(opened, Budget(), 0)
    table = compare_methods(problem, opened.task.source.stem, options)
    asked = {name: asdict(options)[name] for name in ("methods", "seeds", "evaluations", "seconds")}
    return table.with_provenance(opened.origin("plan compare", **asked))


def _with_goal(opened: OpenedTask, budget: Budget, seed: int) -> tuple[PlanningProblem, tuple[str, ...]]:
    """The problem with the goal that is cheapest to go to, and what was chosen from, in words."""
    posed = opened.task.pose is not None
    if not opened.others:
        return opened.problem, ("one joint position brings the frame to the goal's pose",) if posed else ()
    ranked = rank_goals([opened.problem, *opened.others], budget, np.random.default_rng(seed))
    reached = sum(np.isfinite(cost) for cost, _ in ranked)
    which = f"{len(ranked)} joint positions bring the frame to the goal's pose" if posed else f"{len(ranked)} goals"
    return ranked[0][1], (f"{which}; short searches reached {reached} of them, and the cheapest was taken",)


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
    from plan.problem.execution import execute  # brings the table formats along

    execution = execute(result, rate)
    execution.save(out)
    longer = f", {execution.longer:.3f} s longer than planned to start and end at rest" if execution.longer else ""
    return f"motion written to {out}: {len(execution.times)} points, {execution.duration:.4f} s{longer}"


def save_comparison(opened: OpenedTask, comparison: Comparison, json_file: Path | None, out: Path | None) -> None:
    """Writes the record, and a folder with pictures and the best plan."""
    write_record(json_file, comparison.to_dict())
    if out is None:
        return
    picture, motion, timeline, record = (out / name for name in COMPARISON_FILES)
    from plan.show.pictures import draw_comparison, draw_motion, save_figure
    from plan.show.timeline import save_timeline

    save_figure(draw_comparison(comparison), picture)
    best = comparison.best()
    if best is not None:
        save_figure(draw_motion(opened.problem, best), motion)
        save_timeline(opened.problem, best, timeline)
        best.save(record)
