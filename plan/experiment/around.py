"""What stands round an arm that is to be excited: a scene file, the floor, a top speed."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from ident.robot.arm import ArmModel
from ident.robot.names import find_urdf
from plan.errors import MethodError, SceneError
from plan.geometry.scene import FLOOR
from plan.options import ExciteOptions
from plan.problem.obstacle_tables import floor_box
from plan.problem.task_file import Surroundings, load_surroundings

HIGHEST_FLOOR = 10.0
USUAL = ExciteOptions()


def surroundings_of(arm: ArmModel, options: ExciteOptions = USUAL) -> Surroundings:
    """The surroundings that options name; without a word of a floor, nothing goes below the base plane.

    Raises:
        MethodError: The floor's height is no number.
        SceneError: The scene file is at fault, or another robot's.
    """
    scene, floor, top_speed = options.scene, options.floor, options.top_speed
    around = Surroundings(Path("--scene")) if scene is None else load_surroundings(Path(scene), arm.n)
    if (
        around.robot is not None
        and arm.source is not None
        and find_urdf(around.robot).resolve() != arm.source.resolve()
    ):
        raise SceneError(around.source, f"it is for {around.robot!r}, the robot is {arm.name!r}", "give its --robot")
    if floor != "none" and all(box.name != FLOOR for box in around.obstacles):
        try:
            height = float(floor)
        except ValueError:
            height = math.nan
        if not abs(height) <= HIGHEST_FLOOR:
            raise MethodError("--floor", f"{floor!r} is no height", f"give metres within {HIGHEST_FLOOR:g}, or none")
        around = replace(around, obstacles=(*around.obstacles, floor_box(height)))
    if top_speed is not None:
        given = np.full(arm.n, math.radians(top_speed))
        around = replace(around, speed=given if around.speed is None else np.minimum(given, around.speed))
    return around
