"""Inertial numbers of an arm's links as MuJoCo moves them, to hold intervals against."""

from typing import Any

import mujoco
import numpy as np


def link_numbers(model: Any) -> list[list[float]]:
    """Ten numbers of each joint's link, with all that is fixed to it.

    Mass, first moments and inertia about the joint's origin, in the order m, mx, my, mz, Ixx, Ixy,
    Iyy, Ixz, Iyz, Izz [kg, kg m, kg m²].

    Args:
        model: An mjModel whose joints are single hinges or slides, base to tip.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    numbers = np.zeros((model.nv, 10))
    for body in range(1, model.nbody):
        joint = moving_joint(model, body)
        if joint < 0:
            continue
        link = int(model.jnt_bodyid[joint])
        turn = data.xmat[link].reshape(3, 3)
        centre = turn.T @ (data.xipos[body] - data.xpos[link])
        axes = turn.T @ data.ximat[body].reshape(3, 3)
        mass = float(model.body_mass[body])
        inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
        inertia += mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        places = ([0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2])
        numbers[joint] += np.concatenate([[mass], mass * centre, inertia[places]])
    return numbers.tolist()


def moving_joint(model: Any, body: int) -> int:
    """The joint that moves a body, or what it is fixed to; -1 of the base."""
    while body > 0:
        if model.body_jntnum[body] > 0:
            return int(model.body_jntadr[body])
        body = int(model.body_parentid[body])
    return -1
