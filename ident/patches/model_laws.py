"""Named friction laws of a model in the terms of a written module, whose text holds the same laws by other figures."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ident.model.named_laws import NamedLaw
from ident.patches.standalone.log import Effect


def module_effects(laws: Sequence[NamedLaw]) -> list[Effect]:
    """What a module's `extra_torque` needs to give the laws' torque."""
    return [(law.effect, law.joint, _figures(law)) for law in laws]


def _figures(law: NamedLaw) -> dict[str, float]:
    """Figures of a law under the names that `ident.patches.standalone` knows them by."""
    values, shape = [value for value, _, _ in law.figures], dict(law.shape)
    if law.effect == "stribeck_friction":
        return {"amplitude_Nm": values[0], **shape}
    if law.effect == "nonlinear_viscous_friction":
        return {"coefficient": values[0], **shape}
    if law.effect == "load_dependent_friction":
        one, other, square, speed = (*values, 0.0, 0.0)[:4]
        excess = {"level": 0.75 * (one + other), "driving": 0.25 * (one - other)}
        return {**excess, "curvature_1_Nm": square / shape["load_Nm"], "viscous_s_rad": speed}
    if law.effect == "position_dependent_friction":
        return {"amplitude_Nm": math.hypot(*values), "phase_rad": math.atan2(values[1], values[0]), **shape}
    return {"coulomb_difference_Nm": values[0], "viscous_difference_Nms_rad": values[1]}
