"""Plans motions: what `plan solve` and `plan compare` do."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from ident.model.hybrid import HybridModel
from ident.provenance import Provenance
from plan.api.tasks import OpenedTask, compare_task, open_task, solve_task
from plan.planners.base import Planner, Progress
from plan.problem.options import CompareOptions, SolveOptions
from plan.problem.result import PlanResult
from plan.problem.task_file import Task
from plan.solving.compare import Comparison

Scene = Task | str | Path
Model = HybridModel | str | Path


def solve(
    scene: Scene,
    model: Model | None = None,
    *,
    planner: Planner | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> PlanResult:
    """Finds one trajectory and certifies it; an expected failure is a status with a reason.

    Args:
        scene: Scene file, or the task that `load_task` read from it.
        model: Fitted model or its folder; the rigid arm without losses if None.
        planner: A planner of one's own in place of a method.
        progress: Called while searching.
        options: Any field of `SolveOptions`, as the options of `plan solve`: `method`, `objective`, `seconds` …

    Raises:
        InputError: Scene, model, method or via points can't be used.
        TypeError: No such option.
    """
    chosen = SolveOptions(**options)
    opened = open_task(scene, model, chosen)
    result = solve_task(opened, chosen, planner, progress)
    asked = {"method": result.method, "seed": chosen.seed}
    spent = {"evaluations": chosen.evaluations, "seconds": chosen.seconds}
    return result.with_provenance(origin("plan solve", opened, model, {**asked, **spent}))


def compare(
    scene: Scene, model: Model | None = None, *, progress: Progress | None = None, **options: Any
) -> Comparison:
    """Runs all methods on one task.

    Args:
        scene, model: As for `solve`.
        progress: Called while searching.
        options: Any field of `CompareOptions`, as the options of `plan compare`.

    Raises:
        InputError: Scene, model, methods or via points can't be used.
        TypeError: No such option.
    """
    chosen = CompareOptions(**options)
    opened = open_task(scene, model, chosen)
    table = compare_task(opened, chosen, progress)
    names = ("methods", "seeds", "evaluations", "seconds")
    asked = {name: value for name, value in asdict(chosen).items() if name in names}
    return table.with_provenance(origin("plan compare", opened, model, asked))


def origin(command: str, opened: OpenedTask, model: Model | None, asked: dict[str, Any]) -> Provenance:
    """Where a plan comes from."""
    problem = opened.problem
    named = model.robot.name if isinstance(model, HybridModel) else None if model is None else str(model)
    fixed = {"scene": str(opened.task.source), "model": named, "objective": problem.objective}
    return Provenance(command, settings={**fixed, "metric": problem.metric, "variables": problem.free, **asked})
