"""What is planted: each effect by its own physics on a recorded motion, none by the catalogue's
columns.

An effect is a function of the arm, the joint, a size that grows with what it does, and a source of
its other numbers; `EFFECTS` says how large it may be.
"""

from __future__ import annotations

from ident.simulation.real.largest_sizes import (
    fixed,
    lifted_mass,
    of_friction,
    of_viscous,
    over_range,
    push_at_length,
    twist_at_peak,
    up_to,
)
from ident.simulation.real.planted_bodies import (
    plant_contact,
    plant_link,
    plant_payload,
    plant_tilt,
)
from ident.simulation.real.planted_friction import (
    plant_asymmetric,
    plant_coupling,
    plant_curved,
    plant_hysteresis,
    plant_load,
    plant_seat,
    plant_stribeck,
    plant_thermal,
)
from ident.simulation.real.planted_gears import (
    plant_backlash,
    plant_elasticity,
    plant_ripple,
    plant_spring,
)
from ident.simulation.real.planted_sensors import (
    plant_delay,
    plant_encoder,
    plant_gain,
    plant_offset,
    plant_saturation,
)
from ident.simulation.real.planting import Planted

EFFECTS: dict[str, Planted] = {
    "stribeck_friction": Planted(plant_stribeck, of_friction(2.0)),
    "nonlinear_viscous_friction": Planted(plant_curved, up_to(1.5)),
    "load_dependent_friction": Planted(plant_load, fixed(0.5)),
    "thermal_friction": Planted(plant_thermal, fixed(0.95)),
    "presliding_hysteresis": Planted(plant_hysteresis, of_friction(1.5)),
    "position_dependent_friction": Planted(plant_seat, of_friction(1.0)),
    "asymmetric_friction": Planted(plant_asymmetric, of_viscous(1.5)),
    "joint_coupling": Planted(plant_coupling, up_to(0.8), neighbours=True),
    "joint_elasticity": Planted(plant_elasticity, twist_at_peak(0.1)),
    "backlash": Planted(plant_backlash, fixed(0.015)),
    "torque_ripple": Planted(plant_ripple, up_to(0.15)),
    "spring_torque": Planted(plant_spring, over_range(1.5)),
    "payload": Planted(plant_payload, lifted_mass, view="loss", whole_arm=True),
    "link_inertial_error": Planted(plant_link, fixed(0.8), view="loss"),
    "gravity_misalignment": Planted(plant_tilt, fixed(0.35), whole_arm=True),
    "torque_gain_error": Planted(plant_gain, fixed(0.6), view="loss"),
    "torque_offset": Planted(plant_offset, up_to(1.0), view="no_offset"),
    "torque_delay": Planted(plant_delay, fixed(0.06), whole_arm=True),
    "torque_saturation": Planted(plant_saturation, fixed(0.4)),
    "encoder_offset": Planted(plant_encoder, fixed(0.2), view="loss"),
    "external_contact": Planted(plant_contact, push_at_length(4.0), local=True),
}
"""The catalogue's effects."""
