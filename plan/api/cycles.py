"""Plans cycles: what `plan cycle` does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ident.errors import InputError
from ident.files import atomic_folder
from ident.model.hybrid import HybridModel
from ident.results import Provenance
from ident.robot.arm import ArmModel
from plan.command_options import DEFAULT_METHOD, SolveOptions
from plan.planners.base import budget_seconds
from plan.problem.cycle_result import CycleResult
from plan.problem.driveless import hold_driveless
from plan.problem.execution import DEFAULT_RATE, write_motion_file
from plan.problem.task_file import Task, load_task
from plan.solving.cycle import solve_cycle, split_cycle
from plan.solving.stop_choice import choose_stops

MOTIONS_KIND = "motions"


def cycle(
    scene: Task | str | Path,
    model: HybridModel | str | Path | None = None,
    *,
    began: float | None = None,
    **options: Any,
) -> CycleResult:
    """Plans a cycle of several motions as one task; an expected failure is a status with a reason.

    Args:
        scene: Scene file with `[[leg]]` tables, or the task that `load_task` read from it.
        model: Fitted model or its folder; the rigid arm without losses if None.
        began: Processor time of the process, without that of compiling loops, at which the seconds
            that may be spent began to count [s]; now if None.
        options: Any field of `SolveOptions`, as the options of `plan cycle`.

    Raises:
        InputError: Scene or model can't be used, or a method other than the default is asked for.
        TypeError: No such option.
    """
    began = budget_seconds() if began is None else began
    chosen = SolveOptions(**options)
    if chosen.method != DEFAULT_METHOD:
        raise InputError(
            "--method",
            f"a cycle is planned by {DEFAULT_METHOD}, not {chosen.method}",
            "leave it out",
        )
    if chosen.controller is not None:
        remedy = "leave it out, and plan its motions by `plan solve` for a controller's points"
        raise InputError(
            "--controller",
            "a cycle is certified as planned, for no controller",
            remedy,
        )
    task = scene if isinstance(scene, Task) else load_task(scene)
    task = hold_driveless(task, ArmModel.load(task.robot))
    fitted = None if model is None else HybridModel.given(model)
    task = choose_stops(task, fitted, chosen)
    problems = split_cycle(task, fitted, chosen)
    result = solve_cycle(task, problems, chosen, spent=budget_seconds() - began)
    named = None if model is None or isinstance(model, HybridModel) else str(model)
    names = ("objective", "metric", "seed", "evaluations", "seconds")
    asked = {name: getattr(chosen, name) for name in names}
    settings = {"scene": str(task.source), "model": named, **asked}
    return result.with_provenance(Provenance("plan cycle", settings=settings))


def write_motions(result: CycleResult, folder: Path, rate: float = DEFAULT_RATE) -> None:
    """Samples of a solved cycle's motions, one CSV file a leg; whole or not at all.

    Args:
        result: A cycle that was solved; each of its legs has a plan.
        folder: Written anew; one file a leg: `leg_01.csv`, `leg_02.csv`, ….
        rate: Samples a second [Hz].
    """
    with atomic_folder(folder, MOTIONS_KIND) as partial:
        for number, leg in enumerate(result.legs, start=1):
            write_motion_file(leg.plan, partial / f"leg_{number:02d}.csv", rate)
