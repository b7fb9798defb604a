"""Plans motions: what `plan solve` and `plan compare` do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.compiled import compile_seconds
from ident.errors import InputError
from ident.model.hybrid import HybridModel
from ident.progress import stage
from ident.results import Provenance
from ident.robot.arm import ArmModel
from plan.command_options import USUAL_BUDGET, CompareOptions, SolveOptions, TaskOptions
from plan.planners.base import Planner, budget_seconds
from plan.problem.controllers import Controller, choose_controller, require_joints
from plan.problem.driveless import hold_driveless
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.problem.task_file import Task, load_task
from plan.solving.obstruction import require_valid_ends
from plan.solving.set_up import DEFAULTS, from_taught, reach_goals, set_up
from plan.solving.solve import cheapest_goal
from plan.solving.solve import solve as solve_problem

if TYPE_CHECKING:
    from plan.solving.compare import Comparison

Scene = Task | str | Path
Model = HybridModel | str | Path
# Compiling that takes less is not told [s].
WORTH_TELLING = 0.5


def solve(
    scene: Scene, model: Model | None = None, *, planner: Planner | None = None, **options: Any
) -> PlanResult:
    """Finds one trajectory and certifies it; an expected failure is a status with a reason.

    Args:
        scene: Scene file, or the task that `load_task` read from it.
        model: Fitted model or its folder; the rigid arm without losses if None.
        planner: A planner of one's own in place of a method.
        options: Any field of `SolveOptions`, as the options of `plan solve`: `method`, `objective`,
            `seconds` …

    Raises:
        InputError: Scene, model, method or via points can't be used.
        TypeError: No such option.
    """
    chosen = SolveOptions(**options)
    compiled = compile_seconds()
    began = budget_seconds()
    result = open_task(scene, model, chosen).solve(chosen, planner, began=began)
    spent = budget_seconds() - began
    return tell_compiling(replace(result, cpu_seconds=spent), compile_seconds() - compiled)


def tell_compiling(result: PlanResult, seconds: float) -> PlanResult:
    """A result that counts the compiling of loops, too, and says so where it is to be felt.

    Args:
        result: With the processor time of everything else.
        seconds: Processor time of compiling [s].
    """
    notes = result.notes
    if seconds > WORTH_TELLING:
        said = (
            f"{seconds:.0f} s more were spent on compiling loops, once on this computer: "
            "--seconds do not hold them"
        )
        notes = (*notes, said)
    return replace(result, cpu_seconds=result.cpu_seconds + seconds, notes=notes)


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
    return open_task(scene, model, chosen).compare(chosen)


@dataclass(frozen=True, eq=False)
class OpenedTask:
    """A task that was read and checked.

    The first of its problems is started from the straight line, or from the way that the user
    taught; the others are the same with other goals, or ways to stand, that bring a frame to the
    task's pose.
    """

    task: Task  # the scene file's contents
    problems: tuple[PlanningProblem, ...]
    model: str | None = None  # what the model is called in results

    @property
    def problem(self) -> PlanningProblem:
        """The first of its problems."""
        return self.problems[0]

    def controller(self, options: SolveOptions, out: Path | None = None) -> Controller | None:
        """Who executes the plan: named by the options, or by the file that is to be written.

        Raises:
            InputError: No such controller, or not for this arm.

        Returns:
            The controller, or None where neither the options nor the file's suffix name one.
        """
        problem = self.problem
        chosen = choose_controller(options.controller, out, problem.scene.arm)
        if chosen is not None:
            require_joints(chosen, problem.n + len(problem.held))
        return chosen

    def solve(
        self,
        options: SolveOptions,
        planner: Planner | None = None,
        controller: Controller | None = None,
        began: float | None = None,
    ) -> PlanResult:
        """Solves it, with a planner of one's own if one is given, for the options' controller or a
        given one.

        Args:
            options: How.
            planner: A planner in place of a method.
            controller: Who executes the plan.
            began: Processor time of the process, without that of compiling loops, at which the
                seconds that may be spent began to count [s]; now if None.

        Raises:
            InputError: No such method, or not for this task; no such controller.
        """
        began = budget_seconds() if began is None else began
        controller = controller or self.controller(options)
        evaluations, seconds = options.budget
        left = max(seconds - (budget_seconds() - began), 0.0)
        posed = self.task.pose is not None
        problem, notes = cheapest_goal(self.problems, posed, (evaluations, left), options.seed)
        stage("searching for a motion")
        spent = budget_seconds() - began
        if problem.longest is None:
            result = solve_problem(problem, options, planner, controller=controller, spent=spent)
        else:
            from plan.solving.free_duration import solve_free_duration

            result = solve_free_duration(problem, options, planner, controller, spent)
        origin = self._origin(
            "plan solve",
            method=result.method,
            controller=None if controller is None else controller.name,
            seed=options.seed,
            evaluations=options.evaluations,
            seconds=options.seconds,
            workers=options.workers,
        )
        spent = budget_seconds() - began
        result = replace(result, notes=(*notes, *result.notes), cpu_seconds=spent)
        return result.with_provenance(origin)

    def compare(self, options: CompareOptions) -> Comparison:
        """Compares methods on it.

        Raises:
            InputError: No such method.
        """
        from plan.solving.compare import compare as compare_methods

        if self.problem.longest is not None:
            what = "methods are compared at one duration"
            raise InputError(self.task.source, what, "give task.duration_s")
        posed = self.task.pose is not None
        problem, _ = cheapest_goal(self.problems, posed, USUAL_BUDGET, 0)
        table = compare_methods(problem, self.task.source.stem, options)
        origin = self._origin(
            "plan compare",
            methods=options.methods,
            seeds=options.seeds,
            evaluations=options.evaluations,
            seconds=options.seconds,
        )
        return table.with_provenance(origin)

    def _origin(self, command: str, **asked: object) -> Provenance:
        """Where a result comes from: a command, what was asked for, and how the task is taken."""
        settings = {
            "scene": str(self.task.source),
            "model": self.model,
            "objective": self.problem.objective,
            "metric": self.problem.metric,
            "variables": self.problem.free,
            **asked,
        }
        return Provenance(command, settings=settings)


def open_task(
    scene: Scene, model: Model | None = None, options: TaskOptions = DEFAULTS
) -> OpenedTask:
    """Reads scene and model, and checks start and goal.

    Raises:
        InputError: Any of them is at fault.

    Args:
        scene: A scene file, or what `load_task` read of one; a cycle's is refused.
        model: A fitted model or its folder; None plans with the URDF's numbers.
        options: What to plan for.
    """
    if not isinstance(scene, Task | str | Path):
        what = f"a {type(scene).__name__} is no task"
        raise InputError("scene", what, "give a scene file, or what load_task read")
    task = scene if isinstance(scene, Task) else load_task(scene)
    if task.stops:
        what = "its [[leg]] tables make it a cycle"
        raise InputError(task.source, what, "use `plan cycle`, or take them out")
    task = hold_driveless(task, ArmModel.load(task.robot))
    fitted = None if model is None else HybridModel.given(model)
    problems = reach_goals(set_up(task, fitted, options), task)
    require_valid_ends(problems[0], task, options.inside)
    if task.taught is not None:
        taught = task.taught
        times = task.taught_times
        problems = tuple(from_taught(problem, taught, times) for problem in problems)
    return OpenedTask(task, problems, _name_of(model))


def _name_of(model: Model | None) -> str | None:
    """What a model is called in results: its robot's name, or its folder."""
    if model is None:
        return None
    return model.robot.name if isinstance(model, HybridModel) else str(model)
