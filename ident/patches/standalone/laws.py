"""All laws by the ids of their effects."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ident.patches.standalone.chain import Array
from ident.patches.standalone.elastic import backlash, elasticity
from ident.patches.standalone.log import SENSING, Effect
from ident.patches.standalone.masses import MASSES, changed_arm
from ident.patches.standalone.motion import MovingArm
from ident.patches.standalone.rubbing import (
    asymmetric,
    coupling,
    hysteresis,
    load_dependent,
    nonlinear_viscous,
    position_dependent,
    ripple,
    spring,
    stribeck,
    thermal,
)

LAWS: dict[str, Callable[[MovingArm, int, dict[str, float]], Array]] = {
    "stribeck_friction": stribeck,
    "nonlinear_viscous_friction": nonlinear_viscous,
    "load_dependent_friction": load_dependent,
    "thermal_friction": thermal,
    "presliding_hysteresis": hysteresis,
    "position_dependent_friction": position_dependent,
    "asymmetric_friction": asymmetric,
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
