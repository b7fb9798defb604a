"""What the causes do that are not one column of a law: each function has the name of its cause.

Friction, teeth and springs of one joint; bodies, gravity and pushes; sensors; and what no catalogue
lists, of which a diagnosis must say *none of these*, not name the nearest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from ident.simulation.causes.settings import GEAR, LUBRICANT
from ident.simulation.hardware import AddedBody, Hardware, Slosh
from ident.simulation.laws import Column, Contact, heat_law
from ident.trajectories.reference import ReferenceMotion


def _sprung(
    scene: Circumstances, stiffness: float, ratio: float, **more: float
) -> tuple[Hardware, float]:
    """The hardware with motor and link as two bodies, and the spring's damping [N m s/rad]."""
    inertia = scene.hardware.drive.rotor_inertia[scene.joint]
    damping = float(2.0 * ratio * np.sqrt(stiffness * inertia))
    spring: dict[str, float] = {"stiffness": stiffness, "damping": damping, **more}
    return scene.with_laws("drive", elastic=True, **spring), damping


def joint_elasticity(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """A gear that twists, with a stiffness [N m/rad], little damped."""
    hardware, damping = _sprung(scene, size, GEAR.damping_ratio)
    return hardware, {"stiffness_Nm_rad": size, "damping_Nms_rad": damping}


def backlash(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Play of a gear [rad], between teeth that are stiff."""
    stiffness = GEAR.play_stiffness * scene.rated
    hardware, _ = _sprung(scene, stiffness, 2.0 * GEAR.damping_ratio, gap=size)
    return hardware, {"gap_rad": size, "mesh_stiffness_Nm_rad": stiffness}


def torque_ripple(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Torque of an amplitude [N m] that waves with the joint's angle, part of it with the load."""
    phase = float(scene.rng.uniform(-np.pi, np.pi))
    order = float(scene.hardware.drive.ripple_order[scene.joint])
    hardware = scene.with_laws("drive", ripple=size, ripple_phase=phase, ripple_load=0.5)
    return hardware, {"amplitude_Nm": size, "order": order, "phase_rad": phase}


def nonlinear_viscous_friction(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Eyring's law of a lubricant, of a size [N m], at a speed drawn by chance.

    Its parameters hold the nearest power law, too, the form in which it is reported.
    """
    velocity = float(scene.rng.uniform(0.05, 0.3))
    # Nearest power law over 0.1 to 2 rad/s, the form in which it is reported.
    v = np.geomspace(0.1, 2.0, 60)
    bent = np.log(np.arcsinh(v / velocity))
    exponent, log_coefficient = np.polyfit(np.log(v), bent, 1)
    nearest = {"coefficient": float(size * np.exp(log_coefficient)), "exponent": float(exponent)}
    hardware = scene.with_laws("friction", eyring=size, eyring_velocity=velocity)
    return hardware, {"eyring_Nm": size, "eyring_velocity_rad_s": velocity, **nearest}


def thermal_friction(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """The joint's own heat network; its lubricant loses a share of its viscosity at the
    rated rise.
    """
    friction = scene.hardware.friction
    j = scene.joint
    time_constant = float(np.exp(scene.rng.uniform(np.log(40.0), np.log(240.0))))
    loss = friction.coulomb * 0.6 + friction.viscous * 0.36
    network = heat_law(loss, LUBRICANT.rated_rise, time_constant)
    heat = {name: network[name][j] for name in ("lubricant", "housing", "inner", "outer")}
    decay = -np.log1p(-size) / LUBRICANT.rated_rise
    dry = 0.25 * decay  # dry friction depends far less on temperature
    warming = scene.hardware.with_laws("heat", j, **heat)
    hardware = warming.with_laws("friction", j, thermal_viscous=decay, thermal_coulomb=dry)
    return hardware, {
        "viscous_change": -size,
        "coulomb_change": float(np.expm1(-dry * LUBRICANT.rated_rise)),
        "time_constant_s": time_constant,
    }


def presliding_hysteresis(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Dry friction of a size [N m] that builds up over a travel drawn by chance."""
    displacement = float(np.exp(scene.rng.uniform(np.log(2e-3), np.log(3e-2))))
    hardware = scene.with_laws("friction", soft=size, soft_stiffness=size / displacement)
    return hardware, {"amplitude_Nm": size, "displacement_rad": displacement}


def position_dependent_friction(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Dry friction that waves by a size [N m] once or twice a turn."""
    order = int(scene.rng.integers(1, 3))
    phase = float(scene.rng.uniform(-np.pi, np.pi))
    share = size / scene.coulomb
    hardware = scene.with_laws("friction", seat=share, seat_order=order, seat_phase=phase)
    return hardware, {"amplitude_Nm": size, "order": order, "phase_rad": phase}


def asymmetric_friction(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """More friction in one direction: so much dry friction [N m], and some viscous."""
    share = scene.rng.uniform(0.3, 0.8) * size / scene.coulomb
    viscous = float(share * scene.hardware.friction.viscous[scene.joint])
    hardware = scene.with_laws("friction", coulomb_skew=size, viscous_skew=viscous)
    return hardware, {"coulomb_difference_Nm": size, "viscous_difference_Nms_rad": viscous}


def joint_coupling(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """The joint's motor is also turned by its neighbour: friction and rotor of the combined
    motion.
    """
    h = scene.hardware
    j = scene.joint
    other = scene.neighbour
    ratio = float(scene.rng.choice([-1.0, 1.0]))
    viscous = float(0.4 * size * h.friction.viscous[j] / h.friction.coulomb[j])
    inertia = float(0.1 * size * h.drive.rotor_inertia[j] / h.friction.coulomb[j])
    rubbing = {"couple_ratio": ratio, "couple_coulomb": size, "couple_viscous": viscous}
    names = h.arm.joint_names
    tie = (names[j], names[other], ratio, inertia)
    bodies = h.bodies.replace(tied=(*h.bodies.tied, tie))
    rubbed = scene.with_laws("friction", couple_to=other, **rubbing)
    return rubbed.replace(bodies=bodies), {
        "coulomb_Nm": size,
        "viscous_Nms_rad": viscous,
        "inertia_kgm2": inertia,
        "ratio": ratio,
        "other_joint": names[other],
    }


def vector(name: str, values: Float[Array, " 3"], unit: str) -> Parameters:
    """A parameter for each axis, by "NAME_x_UNIT", "NAME_y_UNIT" and "NAME_z_UNIT"."""
    axes = zip("xyz", values, strict=True)
    return {f"{name}_{axis}_{unit}": float(value) for axis, value in axes}


def tilted(
    gravity: Float[Array, " 3"], axis: Float[Array, " 3"], angle: float
) -> Float[Array, " 3"]:
    """Gravity, turned about an axis of the base (Rodrigues).

    Args:
        gravity: In the base [m/s²].
        axis: Of unit length.
        angle: By which it is turned [rad].
    """
    across = np.cross(axis, gravity)
    turned = gravity * np.cos(angle) + across * np.sin(angle)
    return turned + axis * (axis @ gravity) * (1.0 - np.cos(angle))


def _carrying(hardware: Hardware, joint: int, mass: float, place: Array, radius: float) -> Hardware:
    """The hardware with a body at the link that a joint moves."""
    body = AddedBody(hardware.arm.links[joint], mass, place, radius)
    added = (*hardware.bodies.added, body)
    return hardware.replace(bodies=hardware.bodies.replace(added=added))


def payload(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """A box at the flange that nobody mentioned."""
    place = scene.rng.uniform([-0.6, -0.6, 0.3], [0.6, 0.6, 1.2])
    com = 0.06 * scene.reach * place
    hardware = _carrying(scene.hardware, -1, size, com, 0.03 * scene.reach)
    return hardware, {"mass_kg": size, **vector("com", com, "m")}


def link_inertial_error(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Something is mounted on the link, or missing from it: mass, first and second moments change
    together.
    """
    nominal = scene.hardware.arm.model.inertias[scene.joint + 1]
    mass = float(size * nominal.mass)
    centre = np.array(nominal.lever)
    place = centre + 0.08 * scene.reach * scene.rng.uniform(-1.0, 1.0, 3)
    radius = 0.02 * scene.reach
    if not size > 0.0:
        # Taken away where it is: off-centre gaps could leave a link that no body can have.
        place = centre * scene.rng.uniform(0.9, 1.1)
        radius = 0.0
    hardware = _carrying(scene.hardware, scene.joint, mass, place, radius)
    return hardware, {"mass_change_kg": mass, **vector("moment_change", mass * place, "kgm")}


def gravity_misalignment(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """The base stands askew: gravity turns about a horizontal axis of the base."""
    bodies = scene.hardware.bodies
    heading = float(scene.rng.uniform(-np.pi, np.pi))
    tilt = size * np.array([np.cos(heading), np.sin(heading)])
    axis = np.array([1.0, 0.0, 0.0])
    if size > 0.0:
        axis = np.array([tilt[0], tilt[1], 0.0]) / size
    bodies = bodies.replace(gravity=tilted(np.array(bodies.gravity), axis, size))
    return scene.hardware.replace(bodies=bodies), {
        "tilt_x_rad": float(tilt[0]),
        "tilt_y_rad": float(tilt[1]),
        "tilt_rad": size,
    }


def external_contact(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Somebody pushes against a link for a while, in one run."""
    h = scene.hardware
    rng = scene.rng
    run = int(rng.integers(len(scene.motions)))
    duration = scene.motions[run].duration
    length = min(float(rng.uniform(0.5, 1.5)), 0.4 * duration)
    start = float(rng.uniform(0.2 * duration, 0.75 * duration - length))
    direction = rng.standard_normal(3)
    force = size * direction / np.linalg.norm(direction)
    point = 1.5 * np.array(h.arm.model.inertias[scene.joint + 1].lever)
    push = Contact(scene.joint + 1, start, start + length, force, point)
    return h.replace(contact=push, contact_run=run), {
        "run": run + 1,
        "start_s": start,
        "end_s": start + length,
        "force_N": size,
        "link": h.arm.links[scene.joint],
    }


def torque_offset(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """An offset that drifts by about a tenth of itself in a minute, and wanders a little."""
    drift = float(size * scene.rng.uniform(-0.1, 0.1) / 60.0)
    wander = 0.03 * abs(size)
    sensing = scene.hardware.sensing.set(scene.joint, offset=size, drift=drift, wander=wander)
    return scene.hardware.replace(sensing=sensing), {"offset_Nm": size, "drift_Nm_s": drift}


def torque_delay(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """All torques are late by a time [s]."""
    sensing = scene.hardware.sensing.replace(delay=size)
    return scene.hardware.replace(sensing=sensing), {"delay_s": size}


def cable_drag(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Dry friction of a size [N m] within a band of the joint's angle, felt by a neighbour, too."""
    centre = float(scene.rng.uniform(-0.5, 0.5))
    width = float(scene.rng.uniform(0.3, 0.7))
    share = float(scene.rng.choice([-1.0, 1.0]) * scene.rng.uniform(0.5, 1.0))
    band = {"cable_share": share, "cable_centre": centre, "cable_width": width}
    other = scene.neighbour
    hardware = scene.with_laws("outside", cable=size, cable_other=other, **band)
    return hardware, {
        "drag_Nm": size,
        "centre_rad": centre,
        "half_width_rad": width,
        "share": share,
        "other_joint": scene.hardware.arm.joint_names[other],
    }


def velocity_product_drag(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Torque by the product of two joints' speeds, of a size [N m s²/rad²]."""
    other = scene.neighbour
    hardware = scene.with_laws("outside", product=size, product_other=other)
    return hardware, {"drag_Nms2_rad2": size, "other_joint": scene.hardware.arm.joint_names[other]}


def sloshing_load(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """A mass [kg] that swings in the load at the arm's end."""
    frequency = float(scene.rng.uniform(1.2, 3.0))
    slosh = Slosh(size, (0.0, 0.0, 0.06 * scene.reach), frequency)
    hardware = scene.hardware.replace(bodies=scene.hardware.bodies.replace(slosh=slosh))
    return hardware, {"moving_mass_kg": size, "frequency_Hz": frequency}


def supply_sag(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """A torque sensor that reads more by a share [1] as the arm draws power."""
    h = scene.hardware
    speed = np.minimum(0.3 * np.array(h.arm.velocity_limit), 1.0)
    rubbed = (h.friction.coulomb * speed).sum()
    lifted = 0.2 * (h.drive.effort_limit * speed).sum()
    power = float(rubbed + lifted)
    sensing = h.sensing.set(scene.joint, sag=size).replace(sag_power=power)
    return h.replace(sensing=sensing), {"relative_rise": size, "at_power_W": power}


def friction_step(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Friction that is larger by a share [1] from a run on, dry and viscous alike.

    Nothing of a session of one run, which has it from its beginning.
    """
    hardware = scene.hardware
    runs = len(scene.motions)
    first = int(scene.rng.integers(1, runs)) if runs > 1 else 1
    path = hardware.friction_path
    changed = np.ones((runs, 2, hardware.n)) if path is None else path.copy()
    changed[first:, :, scene.joint] *= 1.0 + size
    true: Parameters = {"relative_rise": size, "from_run": first}
    return hardware.replace(friction_path=changed), true


def kinematic_error(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """A strain-wave gear's kinematic error shakes the link, hardest where it meets the drive's
    resonance.
    """
    drive = scene.hardware.drive
    j = scene.joint
    order = float(drive.ripple_order[j])
    resonance = float(2.0 * np.pi * scene.rng.uniform(6.0, 14.0))
    shaken = {
        "wobble_order": order,
        "wobble_inertia": drive.rotor_inertia[j],
        "wobble_resonance": resonance,
    }
    hardware = scene.with_laws("outside", wobble=size, **shaken)
    return hardware, {"error_rad": size, "order": order, "resonance_Hz": resonance / (2.0 * np.pi)}


View = Literal["refit", "loss", "raw"]
Parameters = dict[str, float | str]
# A number, or a share of what the joint has, as of `Circumstances.size_of`.
Size = float | str


@dataclass(frozen=True, eq=False)
class Circumstances:
    """Where a cause acts."""

    hardware: Hardware  # the arm before it
    joint: int  # index of the joint; of an effect of the whole arm, the last
    motions: Sequence[ReferenceMotion]  # what the arm is going to do
    # source of the cause's other parameters; the same for every size that is tried
    rng: np.random.Generator

    @property
    def coulomb(self) -> float:
        """Dry friction of the joint [N m]."""
        return float(self.hardware.friction.coulomb[self.joint])

    @property
    def rated(self) -> float:
        """Rated torque of the joint [N m]."""
        return float(self.hardware.drive.effort_limit[self.joint])

    @property
    def peak(self) -> float:
        """Largest torque that the motions ask of the joint's drive, as far as is known beforehand
        [N m].
        """
        h = self.hardware
        j = self.joint
        peak = 0.0
        for motion in self.motions:
            q = motion.q[::5]
            dq = motion.dq[::5]
            ddq = motion.ddq[::5]
            torque = h.arm.inverse_dynamics(q, dq, ddq)[:, j]
            torque = torque + h.drive.rotor_inertia[j] * ddq[:, j]
            dry = h.friction.coulomb[j] * np.sign(dq[:, j])
            torque += h.friction.viscous[j] * dq[:, j] + dry
            peak = max(peak, float(np.abs(torque).max()))
        return peak

    @property
    def reach(self) -> float:
        """Rough length of the arm [m]."""
        return length_of(self.hardware.arm.model)

    @property
    def lift(self) -> float:
        """Mass that the strongest joint can hold at the stretched arm's end [kg]."""
        return float(self.hardware.drive.effort_limit.max()) / (9.81 * self.reach)

    @property
    def run(self) -> float:
        """Duration of the shortest run [s]."""
        return min(motion.duration for motion in self.motions)

    @property
    def neighbour(self) -> int:
        """The joint before, or after the first."""
        return self.joint - 1 if self.joint > 0 else min(1, self.hardware.n - 1)

    def with_laws(self, group: str, **values: Column) -> Hardware:
        """The hardware with some columns of a law changed at the joint."""
        return self.hardware.with_laws(group, self.joint, **values)

    def size_of(self, size: Size) -> float:
        """A number, or a share of a property here: "0.3 coulomb", "2 rated"."""
        if not isinstance(size, str):
            return size
        share, of = size.split()
        return float(float(share) * getattr(self, of))


def length_of(model: pin.Model) -> float:
    """Rough length of an arm [m]."""
    placements = list(model.jointPlacements)[1:]
    lengths = [np.linalg.norm(placement.translation) for placement in placements]
    return float(sum(lengths)) + 1e-3
