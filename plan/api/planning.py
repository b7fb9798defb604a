"""Plans motions: what `plan solve` and `plan compare` do."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ident.model.hybrid import HybridModel
from ident.provenance import Provenance
from plan.api.tasks import OpenedTask, compare_task, open_task, solve_task
from plan.planners.base import Planner, Progress
from plan.problem.result import PlanResult
from plan.problem.task_file import Task
from plan.solving.compare import Comparison
from plan.solving.solve import DEFAULT_METHOD

Scene = Task | str | Path
Model = HybridModel | str | Path


def solve(
    scene: Scene,
    model: Model | None = None,
    *,
    method: str | Planner = DEFAULT_METHOD,
    objective: str = "energy",
    metric: str = "absolute",
    variables: str | None = None,
    vias: str | Path | None = None,
    trial: int = 1,
    shapes: str | None = None,
    inside: bool = False,
    reserve: bool = True,
    seed: int = 0,
    evaluations: int | None = None,
    seconds: float | None = None,
    gap: bool = True,
    resume: Path | None = None,
    progress: Progress | None = None,
) -> PlanResult:
    """Finds one trajectory and certifies it; an expected failure is a status with a reason.

    Args:
        scene: Scene file, or the task that `load_task` read from it.
        model: Fitted model or its folder; the rigid arm without losses if None.
        method: `sqp`, `reference`, `cma`, `ppo`, `ppo-paper`, `ga`, `ga-pymoo`, `brute`, `compress`, `toppra`, `ompl`
            (where OMPL is installed), or a planner of one's own.
        objective: `energy` or `time`.
        metric: How energy is counted: `signed`, `positive`, `absolute` or `copper`.
        variables: What is searched: `vias`, `times` or `both`.
        vias: File of taught via points to start from.
        trial: Which of them, from 1.
        shapes: What stands in for links without a collision shape: `visual`, `capsules` or `boxes`.
        inside: Whether the motion must stay where the model was fitted.
        reserve: Whether torque is set aside for what the model's intervals leave open.
        seed: Of all randomness.
        evaluations, seconds: What may be spent; the method's default if None.
        gap: Whether the reference is run too, for `reference_gap`.
        resume: Checkpoint file.
        progress: Called while searching.

    Raises:
        InputError: Scene, model, method or via points can't be used.
    """
    opened = open_task(scene, model, objective, metric, variables, vias, trial, shapes, inside, reserve)
    result = solve_task(opened, method, seed, evaluations, seconds, gap, resume, progress)
    asked = {"method": result.method, "seed": seed, "evaluations": evaluations, "seconds": seconds}
    return result.with_provenance(origin("plan solve", opened, model, asked))


def compare(
    scene: Scene,
    model: Model | None = None,
    *,
    methods: str | Sequence[str] | None = None,
    objective: str = "energy",
    metric: str = "absolute",
    variables: str | None = None,
    vias: str | Path | None = None,
    trial: int = 1,
    shapes: str | None = None,
    inside: bool = False,
    reserve: bool = True,
    seeds: int = 5,
    evaluations: int = 2100,
    seconds: float = 1.0,
    progress: Progress | None = None,
) -> Comparison:
    """Runs all methods on one task.

    Args:
        scene, model, objective, metric, variables, vias, trial, shapes, inside, reserve: As for `solve`.
        methods: Names; all that can do the task if None.
        seeds: Number of seeds.
        evaluations, seconds: Where costs are compared.
        progress: Called while searching.

    Raises:
        InputError: Scene, model, methods or via points can't be used.
    """
    opened = open_task(scene, model, objective, metric, variables, vias, trial, shapes, inside, reserve)
    named = methods if methods is None or isinstance(methods, str) else ",".join(methods)
    table = compare_task(opened, named, seeds, evaluations, seconds, progress)
    asked = {"methods": named, "seeds": seeds, "evaluations": evaluations, "seconds": seconds}
    return table.with_provenance(origin("plan compare", opened, model, asked))


def origin(command: str, opened: OpenedTask, model: Model | None, asked: dict[str, Any]) -> Provenance:
    """Where a plan comes from."""
    problem = opened.problem
    named = model.robot.name if isinstance(model, HybridModel) else None if model is None else str(model)
    fixed = {"scene": str(opened.task.source), "model": named, "objective": problem.objective}
    return Provenance(command, settings={**fixed, "metric": problem.metric, "variables": problem.free, **asked})
