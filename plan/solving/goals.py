"""Goals of which any will do, and poses with every way to stand there: which of them is the cheapest to go to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import Array
from ident.errors import InputError
from plan.geometry.pairs import why_refused
from plan.initial.inverse_kinematics import reach_pose
from plan.initial.starts import straight
from plan.planners import Budget, Ledger
from plan.planners.sequential import Sequential
from plan.problem.problem import PlanningProblem
from plan.problem.rules import Pose
from plan.problem.task_file import Task

# What is tried for each way before one is chosen, and how long in processor time [s].
QUICK = Sequential(starts=2, first=18, kept=(1,), levels=0)
QUICK_SECONDS = 3.0


def reach_goals(problem: PlanningProblem, task: Task) -> tuple[PlanningProblem, ...]:
    """The task once for every goal: joint positions that are given, or that bring its frame to a pose, nearest first.

    Raises:
        InputError: No such frame, or the arm can't bring it to any of the poses.
    """
    if task.pose is None:
        low, high, clear = problem.limits.lower, problem.limits.upper, problem.limits.clearance
        inside = [q for q in (task.goal, *task.others) if np.all(q >= low) and np.all(q <= high)]
        goals = [q for q in inside if why_refused(problem.scene, q, clear) is None] or [task.goal]
    else:
        found = [_reach(problem, task, pose) for pose in (task.pose, *task.other_poses)]
        goals = [q for one in found if not isinstance(one, InputError) for q in one]
        if not goals:
            raise next(one for one in found if isinstance(one, InputError))
    return tuple(replace(problem, goal=q, vias=straight(problem.start, q, problem.via_count)) for q in goals)


def _reach(problem: PlanningProblem, task: Task, pose: Pose) -> list[Array] | InputError:
    """Joint positions that bring a frame to its pose, or why there are none."""
    arm, limits = problem.scene.arm, problem.limits
    named, frames = pose.frame or arm.links[-1], dict.fromkeys(str(one.name) for one in arm.model.frames)
    if named not in frames:
        names = ", ".join(one for one in frames if one != "universe")
        return InputError(task.source, f"task.goal_pose: the robot has no frame {named!r}", f"use one of: {names}")
    ways, outside, (place, turn) = reach_pose(arm, pose, named, problem.start, limits.lower, limits.upper)
    refused = [why_refused(problem.scene, q, limits.clearance) for q in ways]
    goals = [q for q, why in zip(ways, refused, strict=True) if why is None]
    if goals:
        return goals
    comes = f"task.goal_pose: {named} comes there in"
    if refused and refused[0] is not None:
        what = f"{comes} {len(refused)} ways, in all of them something is in the way (in the nearest {refused[0][0]})"
        return InputError(task.source, what, "move the pose or the obstacle")
    if outside:
        what = f"{comes} {outside} ways, all of them out of the position limits"
        return InputError(task.source, what, "move the pose, or widen [limits]")
    short = f"{1000 * place:.0f} mm" + ("" if pose.rotation is None else f" and {np.degrees(turn):.0f} deg")
    what = f"task.goal_pose: the {arm.n} joints that move can't bring {named} there; they come within {short}"
    remedies = ["move the pose", *["leave its rotation out"] * (pose.rotation is not None)]
    return InputError(task.source, what, ", or ".join([*remedies, *["let more joints move"] * bool(arm.locked_joints)]))


def cheapest_goal(
    problems: Sequence[PlanningProblem], posed: bool, budget: Budget, seed: int
) -> tuple[PlanningProblem, tuple[str, ...]]:
    """The problem with the goal that is the cheapest to go to by a short search each; what was chosen from, in words.

    Args:
        problems: One for each goal, the nearest first.
        posed: Whether the goal is a pose.
        budget: Of the whole planning task; a third of it at most is spent here.
        seed: Of all chance.
    """
    if len(problems) == 1:
        return problems[0], ("one joint position brings the frame to the goal's pose",) if posed else ()
    seconds, rng = min(QUICK_SECONDS, budget.seconds / (3.0 * len(problems))), np.random.default_rng(seed)
    costs = []
    for problem in problems:
        ledger = Ledger(Budget(max(1, budget.evaluations // (3 * len(problems))), seconds))
        best = QUICK.run([problem], ledger, rng).best
        costs.append(best.cost if best is not None and best.feasible else np.inf)
    which = f"{len(problems)} joint positions bring the frame to the goal's pose" if posed else f"{len(problems)} goals"
    note = f"{which}; short searches reached {np.isfinite(costs).sum()} of them, and the cheapest was taken"
    return problems[int(np.argmin(costs))], (note,)  # the nearest where none was reached
