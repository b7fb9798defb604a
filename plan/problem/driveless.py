"""Joints without a drive, as a mobile base's in an arm's URDF.

They are held, and the task is the other joints'.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import Array, Bool

if TYPE_CHECKING:
    from ident.robot.arm import ArmModel
    from plan.problem.task_file import Task

# Fields of a task that hold one number a moving joint; of `taught` and `others` each row does.
OF_JOINTS = ("lower", "upper", "speed", "torque", "acceleration", "jerk")


def lacks_drive(arm: ArmModel) -> Bool[Array, " n"]:
    """Joints of which the URDF gives neither torque nor speed."""
    return np.asarray((arm.effort_limit <= 0.0) & (arm.velocity_limit <= 0.0))


def is_the_driven(count: int, arm: ArmModel) -> bool:
    """Whether so many angles are those of the driven joints, the others being the arm's base."""
    without = lacks_drive(arm)
    base = int(without.sum())
    return base > 0 and count == arm.n - base and bool(without[:base].all())


def hold_driveless(task: Task, arm: ArmModel) -> Task:
    """The task of the joints that have a drive, the others held where they stand.

    Joints without a drive are held where the task does not move them, nor says what they may do; or
    at their neutral position, where it gives as many angles as there are joints with a drive.
    """
    without = lacks_drive(arm)
    if not without.any() or without.all():
        return task
    names = [name for name, lacks in zip(arm.joint_names, without, strict=True) if lacks]
    if is_the_driven(task.n, arm):
        return replace(task, held=dict(zip(names, arm.neutral[without].tolist(), strict=True)))
    if task.n != arm.n or task.speed is not None or task.pose is not None:
        return task
    if any(stop.poses for stop in task.stops):
        return task
    places = [place for stop in task.stops for place in (stop.q, *stop.choices)]
    ends = np.stack([task.goal, *task.others, *places])
    if not np.all(ends[:, without] == task.start[without]) or task.taught is not None:
        return task
    driven = ~without
    changes = {
        name: values[driven] for name in OF_JOINTS if (values := getattr(task, name)) is not None
    }
    held = dict(zip(names, task.start[without].tolist(), strict=True))
    others = tuple(goal[driven] for goal in task.others)
    stops = []
    for stop in task.stops:
        choices = tuple(q[driven] for q in stop.choices)
        stops.append(replace(stop, q=stop.q[driven], choices=choices))
    changes |= {
        "start": task.start[driven],
        "goal": task.goal[driven],
        "others": others,
        "stops": tuple(stops),
    }
    return replace(task, held=held, **changes)
