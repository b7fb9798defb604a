"""Figures for Isaac Lab: keyword arguments of its actuator configurations; Isaac Lab is not needed to read them.

Source: Isaac Lab, isaaclab.actuators, ActuatorBaseCfg, ImplicitActuatorCfg and DelayedPDActuatorCfg.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ident.arrays import Array, Float
from ident.laws.motion import Losses
from ident.robot.arm import ArmModel

HEADER = '''"""Figures for Isaac Lab, beside robot.urdf, whose link inertias are the identified ones.

ImplicitActuatorCfg(**ACTUATOR, stiffness=…, damping=…), or
DelayedPDActuatorCfg(**ACTUATOR, **LIMITS, stiffness=…, damping=…, min_delay=…, max_delay=…)
Isaac Lab 3 has other names for an actuator's limits: LIMITS_3 in place of LIMITS.

Frictions are efforts [N m], as Isaac Sim 5 and later take them (before, a share of the load); armature is rotor
inertia at the joint [kg m²]. The controller's gains are the user's. `delay_steps(dt)` gives the bounds of the
command's delay in physics steps; it is (0, 0) where no recording told of one.
"""

from math import ceil, floor
'''
CALL = '''

def delay_steps(dt):
    """Least and most physics steps of dt seconds by which a command is late."""
    return floor(DELAY_S[0] / dt), ceil(DELAY_S[1] / dt)
'''


def write_isaac(arm: ArmModel, losses: Losses, delay: tuple[float, float] = (0.0, 0.0)) -> str:
    """The module's text.

    Args:
        arm: The arm.
        losses: Its losses.
        delay: Interval of the command's delay [s].
    """
    names = arm.joint_names
    actuator = {
        "armature": losses.motor_inertia,
        "friction": losses.coulomb,
        "dynamic_friction": losses.coulomb,
        "viscous_friction": losses.viscous,
    }
    known = {
        "effort_limit": np.array(arm.effort_limit),
        "velocity_limit": np.array(arm.velocity_limit),
    }
    # A limit that a URDF does not state is zero or beyond all measure there.
    limits = {key: values for key, values in known.items() if ((values > 0.0) & (values < 1e6)).all()}
    renamed = {f"actuator_{key}": values for key, values in limits.items()}
    return (
        f"{HEADER}\nROBOT = {arm.name!a}\n"
        f"DELAY_S = ({float(delay[0])!r}, {float(delay[1])!r})\n"
        f'ACTUATOR = {{\n    "joint_names_expr": {list(names)!a},\n{_tables(names, actuator)}}}\n'
        f"LIMITS = {{\n{_tables(names, limits)}}}\nLIMITS_3 = {{\n{_tables(names, renamed)}}}\n{CALL}"
    )


def _tables(names: tuple[str, ...], figures: Mapping[str, Float[Array, " n"]]) -> str:
    lines = []
    for key, values in figures.items():
        table = ", ".join(f"{name!a}: {float(value)!r}" for name, value in zip(names, values, strict=True))
        lines.append(f'    "{key}": {{{table}}},\n')
    return "".join(lines)
