"""A cycle's motions, each as a task of its own: from stop to stop, with what the arm carries."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

from ident.errors import InputError
from plan.problem.stops import GRIP, holds_at_first
from plan.problem.task_file import Task


def leg_tasks(task: Task, objective: str) -> list[Task]:
    """The cycle's motions in turn, those between two stops at one place among them.

    Raises:
        InputError: The file has no stops, ends in no angles, or does not say how long it may take.
    """
    if not task.stops:
        raise InputError(task.source, "it has no [[leg]]", "add some, or use `plan solve`")
    if task.pose is not None or task.others:
        what = f"a cycle ends at task.goal_deg, not at {task.keys[1]}"
        raise InputError(task.source, what, "give goal_deg")
    free = moving_time(task, objective)
    holding = holds_at_first(task.stops)
    places = [task.start, *(stop.q for stop in task.stops), task.goal]
    deeds = ["", *(stop.does for stop in task.stops)]
    legs = []
    for number, (start, goal) in enumerate(pairwise(places)):
        if deeds[number]:
            holding = deeds[number] == GRIP
        leg = replace(task, stops=(), start=start, goal=goal)
        standby = task.standby if task.duration is None else 0.0
        leg = replace(leg, duration=None, longest=free, standby=standby)
        if not holding:
            leg = replace(leg, attached=(), payload=None)
        legs.append(leg)
    return legs


def moving_time(task: Task, objective: str) -> float | None:
    """How long the arm may move in all [s]; None where time is the objective.

    Raises:
        InputError: Nothing says so, or nothing is left of it.
    """
    if objective == "time":
        return None
    whole = task.duration if task.duration is not None else task.longest
    if whole is None:
        what = "a cycle of least energy needs task.duration_s or at_most_s"
        raise InputError(task.source, what, "add one of them")
    left = whole - sum(stop.dwell for stop in task.stops)
    if left <= 0.0:
        what = f"the stops' dwell_s take all of the cycle's {whole:g} s"
        raise InputError(task.source, what, "make them shorter")
    return left
