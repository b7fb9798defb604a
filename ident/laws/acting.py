"""All laws by the ids of their effects, and the torque of some of them together."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ident.laws.bodies import BODIES, changed_arm
from ident.laws.chain import Array
from ident.laws.elastic import backlash, elasticity
from ident.laws.friction import JointStates, coupling, hysteresis, ripple, spring, thermal
from ident.laws.motion import MovingArm
from ident.laws.sensing import SENSING, Effect
from ident.laws.table import COLUMNS, Columns

Law = Callable[[MovingArm, int, dict[str, float]], Array]


def of_columns(columns: Columns) -> Law:
    """A law that is linear in its coefficients, from its columns: their sum, weighted by `coefficient_0` and so on."""

    def law(m: MovingArm, j: int, p: dict[str, float]) -> Array:
        found = columns(JointStates(m.q[:, j], m.dq[:, j], m.rigid[:, j], m.direction[:, j]), p)
        return m.at(j, sum(p[f"coefficient_{k}"] * column for k, column in enumerate(found)))

    return law


LAWS: dict[str, Law] = {
    **{name: of_columns(columns) for name, columns in COLUMNS.items()},
    "thermal_friction": thermal,
    "presliding_hysteresis": hysteresis,
    "joint_coupling": coupling,
    "joint_elasticity": elasticity,
    "backlash": backlash,
    "torque_ripple": ripple,
    "spring_torque": spring,
}


KNOWN = frozenset({*LAWS, *BODIES, *SENSING})


def acting_torque(effects: Sequence[Effect], motion: MovingArm) -> Array:
    """Torque of the effects that act on the joints; those of the log alone add nothing [N m]."""
    total = np.zeros_like(motion.q)
    for name, joint, p in effects:
        if name in LAWS:
            total += LAWS[name](motion, joint, p)
    bodies = [effect for effect in effects if effect[0] in BODIES]
    return total + changed_arm(bodies, motion) if bodies else total
