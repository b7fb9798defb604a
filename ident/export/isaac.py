"""Figures for Isaac Lab: keyword arguments of its actuator configurations; Isaac Lab is not needed to read them.

Source: Isaac Lab, isaaclab.actuators, ActuatorBaseCfg, ImplicitActuatorCfg and DelayedPDActuatorCfg.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ident.arrays import Array, Float
from ident.export.identified import IdentifiedArm
from ident.export.templates import fill


def write_isaac(identified: IdentifiedArm) -> str:
    """The module's text; its delay is none, as no recording tells of a command's."""
    arm, losses = identified.whole, identified.losses
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
    marks = {
        "ROBOT": ascii(arm.name),
        "JOINTS": ascii(list(names)),
        "ACTUATOR": _tables(names, actuator),
        "LIMITS": _tables(names, limits),
        "LIMITS_3": _tables(names, renamed),
    }
    return fill("isaaclab.py.txt", marks)


def _tables(names: tuple[str, ...], figures: Mapping[str, Float[Array, " n"]]) -> str:
    lines = []
    for key, values in figures.items():
        table = ", ".join(f"{name!a}: {float(value)!r}" for name, value in zip(names, values, strict=True))
        lines.append(f'    "{key}": {{{table}}},\n')
    return "".join(lines)
