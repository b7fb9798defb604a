"""Parameters of an arm that are followed from day to day: their names, units and words."""

from __future__ import annotations

from ident.units import DAMPING, INERTIA, LENGTH, MASS, MOMENT, TIME, TORQUE

# Parameter -> unit.
UNITS = {
    "gain": "1",
    "rotor": INERTIA,
    "viscous": DAMPING,
    "coulomb": TORQUE,
    "offset": TORQUE,
    "gap": TORQUE,
}
# Further ones, of links and of the whole arm, of which there are ranges alone.
BODY_UNITS = {
    "mass_kg": MASS,
    "centre_x_m": LENGTH,
    "centre_y_m": LENGTH,
    "centre_z_m": LENGTH,
    "payload_kg": MASS,
    "payload_moment_x_kgm": MOMENT,
    "payload_moment_y_kgm": MOMENT,
    "payload_moment_z_kgm": MOMENT,
    "delay_s": TIME,
}
RANGED_UNITS = {**UNITS, **BODY_UNITS}
# What each is called.
WORDS = {
    "gain": "torque gain",
    "rotor": "rotor inertia",
    "viscous": "damping",
    "coulomb": "dry friction",
    "offset": "torque offset",
    "mass_kg": "mass",
    "centre_x_m": "centre x",
    "centre_y_m": "centre y",
    "centre_z_m": "centre z",
    "payload_kg": "payload",
    "payload_moment_x_kgm": "payload moment x",
    "payload_moment_y_kgm": "payload moment y",
    "payload_moment_z_kgm": "payload moment z",
    "delay_s": "delay of the torque",
}
# Terms of a joint's torque, in the order of their columns.
TERMS = ("gain", "rotor", "viscous", "coulomb", "offset")
# Parameters that follow the torque's scale and of which a share makes sense; a torque offset has
# none of its own.
SCALED = ("gain", "rotor", "viscous", "coulomb", "mass_kg")


def unit_of(name: str) -> str:
    """What stands behind a parameter's number: a blank and its unit, if it has one."""
    unit = RANGED_UNITS[name]
    return "" if unit == "1" else f" {unit}"
