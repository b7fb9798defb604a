"""Units as they are written, each once: of a joint's numbers, and of keys that end in their unit.

A joint that slides has metres where one that turns has radians, and forces where that has torques;
numbers of both stand under one name, so the unit is asked for by what it is where a joint turns.
"""

from __future__ import annotations

import re

ANGLE = "rad"
SPEED = "rad/s"
TORQUE = "N m"
FORCE = "N"
DAMPING = "N m s/rad"
STIFFNESS = "N m/rad"
INERTIA = "kg m²"
MASS = "kg"
MOMENT = "kg m"
LENGTH = "m"
TIME = "s"
# Of a joint that turns, and the same of one that slides; the longer before those that they begin
# with.
SLIDING = {
    DAMPING: "N s/m",
    STIFFNESS: "N/m",
    TORQUE: FORCE,
    INERTIA: MASS,
    "mrad": "mm",
    SPEED: "m/s",
    ANGLE: LENGTH,
}
# What keys of records end in; the longest first: `rad_s` must not be read as `s`.
OF_KEYS = {
    "_Nms_rad": DAMPING,
    "_Nm_rad": STIFFNESS,
    "_rad_s": SPEED,
    "_Nm_s": "N m/s",
    "_kgm2": INERTIA,
    "_kgm": MOMENT,
    "_Nm": TORQUE,
    "_kg": MASS,
    "_rad": ANGLE,
    "_degC": "°C",
    "_N": FORCE,
    "_m": LENGTH,
    "_s": TIME,
}


def split_key(key: str) -> tuple[str, str]:
    """A key without its unit, and the unit; "" for a key that ends in none.

    Args:
        key: As records have it: `amplitude_Nm`.
    """
    for ending, unit in OF_KEYS.items():
        if key.endswith(ending):
            return key.removesuffix(ending), unit
    return key, ""


def unit_for(unit: str, slides: bool) -> str:
    """The unit of a joint's number.

    Args:
        unit: What it is where the joint turns, one of `SLIDING`; any other stays as it is.
        slides: Whether the joint slides.
    """
    return SLIDING.get(unit, unit) if slides else unit


def in_linear_units(sentence: str) -> str:
    """A sentence about a joint that turns with its units replaced by those of one that slides.

    Degrees that stand in brackets beside an angle have nothing beside a length.
    """
    sentence = re.sub(r" \([^()°]*°\)", "", sentence)
    units = "|".join(re.escape(unit) for unit in SLIDING)
    return re.sub(rf"(?<!\w)({units})(?!\w)", lambda match: SLIDING[match[0]], sentence)
