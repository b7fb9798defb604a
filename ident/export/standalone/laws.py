"""All laws by the ids of their effects.

Those of a joint's friction that a model carries, too, are `ident.model.friction_laws`' own functions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ident.export.standalone.bodies import MASSES, changed_arm
from ident.export.standalone.chain import Array
from ident.export.standalone.elastic import backlash, elasticity
from ident.export.standalone.friction import coupling, hysteresis, ripple, spring, thermal
from ident.export.standalone.log import SENSING, Effect
from ident.export.standalone.motion import MovingArm
from ident.model.friction_laws import JointStates, asymmetric, by_load, by_position, curved_viscous, stribeck

Law = Callable[[MovingArm, int, dict[str, float]], Array]


def of_columns(columns: Callable[[JointStates, dict[str, float]], Array]) -> Law:
    """A law that is linear in its coefficients, from its columns: their sum, weighted by `coefficient_0` and so on."""

    def law(m: MovingArm, j: int, p: dict[str, float]) -> Array:
        found = columns(JointStates(m.q[:, j], m.dq[:, j], m.rigid[:, j], m.direction[:, j]), p)
        return m.at(j, found @ np.array([p[f"coefficient_{k}"] for k in range(found.shape[1])]))

    return law


LAWS: dict[str, Law] = {
    "stribeck_friction": of_columns(stribeck),
    "nonlinear_viscous_friction": of_columns(curved_viscous),
    "load_dependent_friction": of_columns(by_load),
    "position_dependent_friction": of_columns(by_position),
    "asymmetric_friction": of_columns(asymmetric),
    "thermal_friction": thermal,
    "presliding_hysteresis": hysteresis,
    "joint_coupling": coupling,
    "joint_elasticity": elasticity,
    "backlash": backlash,
    "torque_ripple": ripple,
    "spring_torque": spring,
}


KNOWN = frozenset({*LAWS, *MASSES, *SENSING})


def acting_torque(effects: Sequence[Effect], motion: MovingArm) -> Array:
    """Torque of the effects that act on the joints; those of the log alone add nothing [N m]."""
    total = np.zeros_like(motion.q)
    for name, joint, figures in effects:
        if name in LAWS:
            total += LAWS[name](motion, joint, figures)
    masses = [effect for effect in effects if effect[0] in MASSES]
    return total + changed_arm(masses, motion) if masses else total
