"""What a URDF's `<dynamics>` say of each joint's friction."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from ident.robot.arm import ArmModel

VISCOUS = "viscous_Nms_rad"
COULOMB = "coulomb_Nm"
# Attributes of <dynamics>, by what they are called in results.
STATED = {VISCOUS: "damping", COULOMB: "friction"}


def stated_friction(arm: ArmModel) -> dict[str, dict[str, float]]:
    """What the URDF's `<dynamics>` say of each joint, empty where they say nothing.

    Returns:
        By joint: `viscous_Nms_rad` and `coulomb_Nm`, each where it is stated.
    """
    found: dict[str, dict[str, float]] = {joint: {} for joint in arm.joint_names}
    for element in ET.fromstring(arm.urdf).iter("joint"):
        dynamics = element.find("dynamics")
        name = element.get("name", "")
        if dynamics is None or name not in found:
            continue
        for key, attribute in STATED.items():
            if dynamics.get(attribute) is not None:
                found[name][key] = float(dynamics.get(attribute, "nan"))
    return found
