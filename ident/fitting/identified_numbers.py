"""What the URDF says of each joint beside what was fitted: `identified` of a fit's record.

A fit allows for the URDF's tolerance wherever it takes the URDF's inertias: it has one interval,
which stands in both places.
"""

from __future__ import annotations

from ident.model.hybrid import HybridModel
from ident.robot.urdf_elements import COULOMB, VISCOUS, stated_friction

# Keys of the fitted losses, as in a diagnosis.
KEYS = {
    "viscous": VISCOUS,
    "coulomb": COULOMB,
    "motor_inertia": "armature_kgm2",
    "offset": "offset_Nm",
}
# A joint's numbers by key: nominal, value and 95 % intervals, see `FigureRecord`.
JointNumbers = dict[str, dict[str, float | None]]


def identified_numbers(model: HybridModel) -> dict[str, JointNumbers]:
    """Of each joint what the URDF says (None where it says nothing) and what was fitted.

    Args:
        model: A fitted model.
    """
    stated = stated_friction(model.nominal)
    numbers: dict[str, JointNumbers] = {joint: {} for joint in model.joint_names}
    for figure in model.figures:
        key = KEYS[figure.name]
        numbers[figure.joint][key] = {
            "nominal": stated[figure.joint].get(key),
            "value": figure.value,
            "low": figure.low,
            "high": figure.high,
            "low_with_urdf": figure.low,
            "high_with_urdf": figure.high,
        }
    return numbers
